"""Instruments and other tables of quantities written as files that are read back to the last bit."""

from collections.abc import Mapping
from typing import Any

import tomli_w
from pydantic import BaseModel

from tenodesis.instrument import Instrument
from tenodesis.units import READABLE, in_unit, quantity_of

_LONG = 10.0
"""Time from which it is written in seconds, s."""


def to_toml(given: Instrument) -> str:
    """Return the text of an instrument file, which :func:`tenodesis.parse` reads back as the instrument.

    The short form has its defaults, and numbers among the overrides come back as text with their unit; a list of
    joints and tendons has what was given.
    """
    if (inst := given.short_form) is None:
        return tomli_w.dumps(with_units(given, unset=False))
    units = {key: quantity.unit for key, _, quantity in inst.quantities()}
    units["tendon_length"] = "m"
    own = {
        axis: {key: _with_unit(value, units[key]) for key, value in values.items() if value is not None}
        for axis, values in inst.overrides.items()
    }
    return tomli_w.dumps(with_units(inst) | {"overrides": own})


def to_file(inst: Instrument, *, comment: str = "") -> str:
    """Return the text of an instrument's file for people to read and edit, with a comment at its beginning.

    It has the values that were given, no defaults, in the units of drawings, to nine digits.
    """
    values = {key: value for key, value in readable(with_units(inst, unset=False)).items() if value not in ({}, [])}
    lines = "".join(f"# {line}\n" for line in comment.splitlines())
    return f"{lines}\n{tomli_w.dumps(values)}" if lines else tomli_w.dumps(values)


def readable(value: Any, units: Mapping[str, str] = READABLE) -> Any:
    """Return the values of a file with their quantities in units for people, to nine digits."""
    if isinstance(value, dict):
        return {key: item if key == "sources" else readable(item, units) for key, item in value.items()}
    if isinstance(value, list):
        return [readable(item, units) for item in value]
    number, _, unit = value.partition(" ") if isinstance(value, str) else ("", "", "")
    try:
        written = unit if unit == "s" and float(number) >= _LONG else units.get(unit, unit)
        shown = float(number) * in_unit(written, unit)
    except ValueError:
        return value
    return f"{shown + 0.0:.9g} {written}"


def with_units(model: BaseModel, *, unset: bool = True) -> dict[str, Any]:
    """Return the values of a table by key, as in a file; quantities are text with their SI unit.

    Defaults are included unless only what was set is wanted.
    """
    values: dict[str, Any] = {}
    for name, field in type(model).model_fields.items():
        value = model.as_given(name) if isinstance(model, Instrument) else getattr(model, name)
        if value is None or not (unset or name in model.model_fields_set):
            continue
        quantity = quantity_of(field)
        values[field.alias or name] = _plain(value, unset) if quantity is None else _with_unit(value, quantity.unit)
    return values


def _with_unit(value: Any, unit: str) -> Any:
    if isinstance(value, Mapping):
        return {key: _with_unit(item, unit) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [_with_unit(item, unit) for item in value]
    return value if isinstance(value, str) else f"{float(value)!r} {unit}"


def _plain(value: Any, unset: bool) -> Any:
    if isinstance(value, BaseModel):
        return with_units(value, unset=unset)
    if isinstance(value, Mapping):
        return {key: _plain(item, unset) for key, item in value.items()}
    return [_plain(item, unset) for item in value] if isinstance(value, tuple) else value
