"""The values of an instrument, one by one: as its file has them, and the defaults that count."""

import json
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from pydantic import BaseModel

from tenodesis.errors import InstrumentError
from tenodesis.instrument.reading import source_text
from tenodesis.instrument.short_form import ShortForm
from tenodesis.instrument.text import readable, with_units
from tenodesis.toml import parse_toml
from tenodesis.units import READABLE, quantity_of

_ALWAYS = {"drives", "sensors", "control"}
"""Tables whose defaults are listed."""
_COEFFICIENTS = ("law", "vertex_coefficient", "sheath_coefficient", "sheath_bend")
"""Keys of table friction that are listed, given or not."""
_OF_OTHER_SENSORS = {"load-cell": ("current_", "torque_constant_"), "current": ("load_cell_",)}
"""What keys of table sensors begin with that do not count, by the kind of the sensors; those given are listed."""
_UNITS = {unit: shown for unit, shown in READABLE.items() if unit != "rad/s"}
"""Units of defaults; those of motors are round in SI."""
_TITLES = {"name", "description", "joint_type", "axes", "overrides", "sources", "devices"}
"""What is no value of the mechanism."""


class Listed(NamedTuple):
    """A value of an instrument."""

    key: str
    """Key of the file, within a table with a dot; of an axis of its own "pitch: KEY"."""
    text: str
    """As the file has it, or a default in units for people"""
    value: Any
    """In SI"""
    unit: str
    """SI unit, empty if it is no quantity"""
    given: bool
    """Whether the file has it, rather than a default"""
    source: str


def listed(name_or_path: str, inst: ShortForm) -> tuple[Listed, ...]:
    """Return the values of an instrument in the order of its file: those given, and the defaults that count.

    Parameters
    ----------
    name_or_path
        Where the instrument was loaded from.
    inst
        The instrument.

    Raises
    ------
    InstrumentError
        The file cannot be read.
    """
    written = parse_toml(source_text(name_or_path), InstrumentError, name_or_path)
    return tuple(_values(inst, written))


def _values(inst: ShortForm, written: Mapping[str, Any]) -> Iterator[Listed]:
    fields = type(inst).model_fields
    dimensions = [name for name in fields if name not in _TITLES and not isinstance(getattr(inst, name), BaseModel)]
    # The file's own order, defaults behind it.
    order = list(written)
    dimensions.sort(key=lambda name: order.index(key) if (key := fields[name].alias or name) in order else len(order))
    for name in dimensions:
        yield from _value(inst, inst, name, "", written)
    for name in fields:
        table = getattr(inst, name)
        if name in _TITLES or not isinstance(table, BaseModel):
            continue
        given = written.get(name, {})
        for key in type(table).model_fields:
            other = name == "sensors" and key.startswith(_OF_OTHER_SENSORS[inst.sensors.kind])
            if key in given or (name in _ALWAYS and not other) or (name == "friction" and key in _COEFFICIENTS):
                yield from _value(inst, table, key, f"{name}.", given)
    for axis, values in inst.overrides.items():
        own = inst.axis(axis)
        for key, text in values.items():
            name = next(name for name, field in fields.items() if key in (name, field.alias))
            yield from _value(own, own, name, "", {key: text}, f"{axis}: ")


def _value(  # noqa: PLR0917
    inst: ShortForm, table: BaseModel, name: str, prefix: str, written: Mapping[str, Any], axis: str = ""
) -> Iterator[Listed]:
    field = type(table).model_fields[name]
    value, key, quantity = getattr(table, name), field.alias or name, quantity_of(field)
    if value is None or value == ():
        return
    given = key in written
    text = _text(written[key]) if given else _text(readable(with_units(table).get(key, value), _UNITS))
    source = inst.sources.get(f"{prefix}{key}", inst.sources.get(prefix.rstrip("."), "")) if given else "default"
    unit = "" if quantity is None else quantity.unit
    yield Listed(f"{axis}{prefix}{key}", text, value, unit, given, source)


def _text(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ", ".join(map(_text, value))
    return value if isinstance(value, str) else json.dumps(value)
