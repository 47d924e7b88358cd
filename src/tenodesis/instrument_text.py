"""Instruments, and other models of quantities, as the text of a file that gives them again to the last bit."""

from collections.abc import Mapping, Sequence
from typing import Any, get_args

import tomli_w
from pydantic import BaseModel

from tenodesis.instrument import Instrument
from tenodesis.quantity import Quantity


def to_toml(inst: Instrument) -> str:
    """Return the text of an instrument file, defaults included, from which :func:`tenodesis.parse` gives `inst` again.

    Numbers among the overrides come back as text with their unit.
    """
    units = {key: quantity.unit for key, _, quantity in inst.quantities()}
    units["tendon_length"] = "m"
    own = {
        axis: {key: _with_unit(value, units[key]) for key, value in values.items() if value is not None}
        for axis, values in inst.overrides.items()
    }
    return tomli_w.dumps(with_units(inst) | {"overrides": own})


def with_units(model: BaseModel, *, unset: bool = True) -> dict[str, Any]:
    """Return the values of a model by key, as its file has them; those of quantities are text with their SI unit.

    Parameters
    ----------
    model
        The model.
    unset
        Whether to return defaults as well.
    """
    values: dict[str, Any] = {}
    for name, field in type(model).model_fields.items():
        value = getattr(model, name)
        if value is None or not (unset or name in model.model_fields_set):
            continue
        quantity = _quantity(field.annotation, field.metadata)
        values[field.alias or name] = _plain(value, unset) if quantity is None else _with_unit(value, quantity.unit)
    return values


def _quantity(annotation: Any, metadata: Sequence[Any] = ()) -> Quantity | None:
    """Return the kind of quantity that is annotated, or of which there are several."""
    found = next((item for item in metadata if isinstance(item, Quantity)), None)
    inner = (_quantity(option, getattr(option, "__metadata__", ())) for option in get_args(annotation))
    return found or next((quantity for quantity in inner if quantity is not None), None)


def _with_unit(value: Any, unit: str) -> Any:
    if isinstance(value, tuple | list):
        return [_with_unit(item, unit) for item in value]
    return value if isinstance(value, str) else f"{float(value)!r} {unit}"


def _plain(value: Any, unset: bool) -> Any:
    if isinstance(value, BaseModel):
        return with_units(value, unset=unset)
    if isinstance(value, Mapping):
        return dict(value)
    return [_plain(item, unset) for item in value] if isinstance(value, tuple) else value
