"""Choices fixed beforehand, and a catalogue narrowed to them."""

from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import TypeAdapter, ValidationError

from tenodesis.errors import DesignError
from tenodesis.scaling.catalogue import Catalogue
from tenodesis.similarity.parameters import RADII
from tenodesis.units import Force, Length

SAME_LENGTH = 1e-6
"""Relative difference up to which a length equals the pinned length."""

_RANGES = ("overall_length", "end_effector_length", "handle_length")
_PARTS = {"rope": "ropes", "rod": "rods", "load_cell": "load_cells", "encoder": "encoders"}
PINS = ("factor", *_RANGES, *RADII, "tendon_diameter", *_PARTS, "spool_radius", "pretension")
"""Keys that may be pinned."""


def parse(pins: Mapping[str, Any], *, file: bool = False) -> dict[str, Any]:
    """Return pins in SI units.

    Lengths (m) and pretension (N) are given as numbers or text with a unit, parts by name, factor as a number; in a
    `file` numbers must have their units. Raises DesignError if a key is unknown or a value is not understood.
    """
    return {key: _value(key, value, file) for key, value in pins.items()}


def _value(key: str, value: Any, file: bool) -> Any:
    if key not in PINS:
        raise DesignError(
            f"{key} cannot be pinned; keys that can are {', '.join(PINS)}.", key=key, allowed=", ".join(PINS)
        )
    if key in _PARTS:
        return str(value)
    kind: Any = Force if key == "pretension" else float if key == "factor" else Length
    try:
        found = TypeAdapter(kind).validate_python(value, context={"file": file})
    except ValidationError as invalid:
        problem = invalid.errors(include_url=False)[0]["msg"].removeprefix("Value error, ")
        raise DesignError(f"{key} = {value!r} is pinned: {problem}.", key=key, value=value) from None
    if key == "factor" and not 0.1 <= found <= 1000:
        raise DesignError(key="factor", value=found, allowed="a number from 0.1 to 1000")
    return found


def same(one: float, other: float) -> bool:
    """Return whether two lengths, m, are those of the same part."""
    return abs(one - other) <= SAME_LENGTH * abs(other)


def narrowed(catalogue: Catalogue, pins: Mapping[str, Any]) -> Catalogue:
    """Return a catalogue with only the pinned parts and ranges; radii stay, as modules and teeth give them.

    Raises DesignError, which names the nearest part, if the catalogue has no such part.
    """
    changes: dict[str, Any] = {}
    for key, field in _PARTS.items():
        if key in pins:
            changes[field] = _named(getattr(catalogue, field), key, pins[key], catalogue)
    for key, field, size in (("tendon_diameter", "ropes", "diameter"), ("spool_radius", "spools", "radius")):
        if key in pins:
            parts = changes.get(field, getattr(catalogue, field))
            changes[field] = tuple(part for part in parts if same(getattr(part, size), pins[key]))
            if not changes[field]:
                raise missing(key, pins[key], [getattr(part, size) for part in parts], catalogue)
    ranges: dict[str, Any] = {key: (pins[key], pins[key]) for key in (*_RANGES, "factor") if key in pins}
    constraints = catalogue.constraints.model_copy(update=ranges)
    return catalogue.model_copy(update=changes | {"constraints": constraints})


def _named(parts: Sequence[Any], key: str, wanted: str, catalogue: Catalogue) -> tuple[Any, ...]:
    found = tuple(part for part in parts if part.name == wanted)
    if not found:
        names = ", ".join(part.name for part in parts) or "none"
        raise DesignError(f"{key} = {wanted!r} is pinned, but catalogue {catalogue.name} has {names}.")
    return found


def missing(key: str, wanted: float, sizes: Sequence[float], catalogue: Catalogue) -> DesignError:
    """Return the error that no part has the pinned size (m), with the nearest sizes."""
    near = sorted(set(sizes), key=lambda one: abs(one - wanted))[:2]
    sizes_mm = " and ".join(f"{1e3 * one:.6g} mm" for one in sorted(near)) or "none"
    return DesignError(
        f"{key} = {1e3 * wanted:.6g} mm is pinned, but no part of catalogue {catalogue.name} has it; "
        f"nearest: {sizes_mm}."
    )
