"""Physical quantities of an instrument file: written with their unit, kept in SI."""

import math
import re
from dataclasses import dataclass
from functools import cache
from numbers import Real
from typing import Any

import pint
from pydantic import BeforeValidator, ValidationInfo, WithJsonSchema

_UNITS: pint.UnitRegistry[float] = pint.UnitRegistry()
_ANGLE_UNITS = {"radian", "milliradian", "degree", "arcminute", "turn"}

# Number and unit are told apart here, not by pint, which would work out arithmetic, and take a decimal comma for none.
_NUMBER = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+|nan|inf)(?:[eE][-+]?[0-9]+)?"
_UNIT = r"(?:[^\W\d_]+(?:(?:\^|\*\*)-?[0-9])?|°)"
_WRITTEN = re.compile(rf"(?P<number>{_NUMBER})(?P<unit>\s*|\s*(?:1\s*/\s*)?{_UNIT}(?:(?:\s*[*/·]\s*|\s+){_UNIT})*)")


@dataclass(frozen=True)
class Quantity:
    """One kind of quantity: its name, SI unit, an example of how to write it, and its bounds in SI."""

    name: str
    unit: str
    example: str
    above: float | None = None
    at_least: float | None = None
    below: float | None = None

    @property
    def allowed(self) -> str:
        """What a value may be, as the end of a sentence."""
        bounds = [
            f"{word} {bound:g} {self.unit}"
            for word, bound in (("above", self.above), ("of at least", self.at_least), ("below", self.below))
            if bound is not None
        ]
        article = "an" if self.name[0] in "aeiou" else "a"
        return " ".join([f"{article} {self.name}", *([" and ".join(bounds)] if bounds else [])])

    def allows(self, number: float) -> bool:
        """Return whether a number, in SI, is finite and within the bounds."""
        return (
            math.isfinite(number)
            and (self.above is None or number > self.above)
            and (self.at_least is None or number >= self.at_least)
            and (self.below is None or number < self.below)
        )

    def parse(self, value: Any, info: ValidationInfo) -> float:
        """Read a value into SI: text with a unit, or outside files a bare SI number.

        Raises
        ------
        ValueError
            The value is no number, lacks its unit, has another dimension or lies outside its bounds.
        """
        if isinstance(value, str):
            number = self._read(value)
        elif isinstance(value, bool) or not isinstance(value, Real):
            raise ValueError(f'it must be {self.allowed}, written like "{self.example}"')
        elif info.context and info.context.get("file"):
            raise ValueError(f'it has no unit; write {self.allowed} like "{self.example}"')
        else:
            number = float(value)
        if not self.allows(number):
            raise ValueError(f"it must be {self.allowed}")
        return number

    def _read(self, text: str) -> float:
        written = _WRITTEN.fullmatch(text.strip())
        if written is None:
            raise ValueError(f'it is not understood; write {self.allowed} like "{self.example}"')
        number, unit_text = float(written["number"]), written["unit"].strip()
        if not unit_text:
            raise ValueError(f'it has no unit; write {self.allowed} like "{self.example}"')
        try:
            unit: Any = _UNITS.Unit(unit_text.replace("·", "*"))
        except Exception as problem:  # pint raises whatever its tokenizer does
            raise ValueError(f'it is not understood; write {self.allowed} like "{self.example}"') from problem
        # Angles have no dimension, and neither have percents or mm/mm, which are no angles.
        angle = self.unit == "rad"
        if unit.dimensionality != _UNITS.Unit(self.unit).dimensionality or (angle and str(unit) not in _ANGLE_UNITS):
            raise ValueError(f'it is measured in {unit_text}; it must be {self.allowed}, written like "{self.example}"')
        return float(_UNITS.Quantity(number, unit).to(self.unit).magnitude)


def annotation(quantity: Quantity) -> tuple[BeforeValidator, WithJsonSchema, Quantity]:
    """Return what a pydantic field of this quantity is annotated with: reading, editor schema, and itself."""
    told = f"{quantity.allowed}, with its unit"
    schema = {
        "type": "string",
        "description": told[0].upper() + told[1:],
        "examples": [quantity.example],
        "pattern": r"^\s*[-+]?[0-9.]+([eE][-+]?[0-9]+)?(\s*[^0-9\s]|\s+1\s*/).*$",
    }
    return BeforeValidator(quantity.parse), WithJsonSchema(schema), quantity


@cache
def in_unit(unit: str, si_unit: str) -> float:
    """Return how many of `unit` one `si_unit` is, for showing SI values on screen and in reports."""
    return float(_UNITS.Quantity(1.0, si_unit).to(unit).magnitude)


STANDARD_GRAVITY = in_unit("m/s^2", "standard_gravity")
"""Weight of a mass, N/kg."""
