"""Physical quantities of an instrument file: written with their unit, kept in SI."""

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import pint
from pydantic import BeforeValidator, ValidationInfo, WithJsonSchema

_UNITS: pint.UnitRegistry[float] = pint.UnitRegistry()


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
        return " ".join(
            [
                f"{article} {self.name}",
                *(["and ".join(f"{bound} " for bound in bounds).strip()] if bounds else []),
            ]
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
        elif isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(f'it must be {self.allowed}, written like "{self.example}"')
        elif info.context and info.context.get("file"):
            raise ValueError(f'it has no unit; write {self.allowed} like "{self.example}"')
        else:
            number = float(value)
        inside = (
            math.isfinite(number)
            and (self.above is None or number > self.above)
            and (self.at_least is None or number >= self.at_least)
            and (self.below is None or number < self.below)
        )
        if not inside:
            raise ValueError(f"it must be {self.allowed}")
        return number

    def _read(self, text: str) -> float:
        try:
            quantity: Any = _UNITS.Quantity(text)
        except Exception as problem:  # pint raises whatever its tokenizer does
            raise ValueError(f'it is not understood; write {self.allowed} like "{self.example}"') from problem
        if quantity.unitless and not _UNITS.Unit(self.unit).dimensionless:
            raise ValueError(f'it has no unit; write {self.allowed} like "{self.example}"')
        if quantity.dimensionless != _UNITS.Unit(self.unit).dimensionless or not quantity.check(
            _UNITS.Unit(self.unit).dimensionality
        ):
            raise ValueError(
                f'it is measured in {quantity.units:~P}; it must be {self.allowed}, written like "{self.example}"'
            )
        return float(quantity.to(self.unit).magnitude)


def annotation(quantity: Quantity) -> tuple[BeforeValidator, WithJsonSchema, Quantity]:
    """Return what a pydantic field of this quantity is annotated with: reading, editor schema, and itself."""
    schema = {
        "type": "string",
        "description": f"{quantity.allowed}, with its unit".capitalize(),
        "examples": [quantity.example],
        "pattern": r"^\s*[-+]?[0-9.]+([eE][-+]?[0-9]+)?\s*[^0-9\s].*$",
    }
    return BeforeValidator(quantity.parse), WithJsonSchema(schema), quantity


@cache
def in_unit(unit: str, si_unit: str) -> float:
    """Return how many of `unit` one `si_unit` is, for showing SI values on screen and in reports."""
    return float(_UNITS.Quantity(1.0, si_unit).to(unit).magnitude)
