"""Parts a scale model is built from and tested with, one by one or as a series that differs in size alone."""

import math
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Self

from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from tenodesis.files import FileTable
from tenodesis.instrument import Name
from tenodesis.units import AngleError, Bits, EncoderRange, Length, Mass, Modulus, PositiveForce, PositiveMass, Strength

Source = Annotated[str, Field(max_length=400)]

_Count = Annotated[int, Field(ge=1, le=1000, strict=True)]
_Teeth = Annotated[int, Field(ge=6, le=1000, strict=True)]
_Factor = Annotated[float, Field(gt=0, lt=1, strict=True)]
_SAME = 9
"""Digits by which two sizes are the same one, however their units were written."""


def ordered(pair: tuple[float, float]) -> tuple[float, float]:
    """Return a least and a most value that are in order.

    Raises
    ------
    ValueError
        The least is more than the most.
    """
    if pair[0] > pair[1]:
        raise ValueError(f"its least, {pair[0]:g}, is more than its most, {pair[1]:g}; allowed is the least first")
    return pair


def twice(keys: Sequence[str]) -> str | None:
    """Return the first key that is there twice."""
    return next((key for place, key in enumerate(keys) if key in keys[:place]), None)


class Gears(FileTable):
    """Spur gears one can buy or cut: every module with every number of teeth."""

    modules: tuple[Length, ...] = Field(default=(), description="Modules")
    teeth: Annotated[tuple[_Teeth, _Teeth], AfterValidator(ordered)] = Field(
        default=(12, 60), description="Least and most number of teeth"
    )

    @model_validator(mode="after")
    def _distinct(self) -> Self:
        again = twice([_size(module) for module in self.modules])
        if again:
            raise ValueError(f"modules has {again} twice; allowed is every module once")
        return self


class Part(FileTable):
    """One part of a catalogue, told from others of its kind by its key."""

    source: Source = Field(default="", description="Where the values are from")

    @property
    def key(self) -> str:
        """What no other part of the kind has: its name or its size."""
        return str(getattr(self, "name", ""))

    def expand(self) -> tuple[Self, ...]:
        """Return the parts that this table of a file stands for."""
        return (self,)


class Pulley(Part):
    """A round pulley; of a continuum, also the distance of its tendons from the backbone."""

    radius: Length = Field(description="Radius at which the tendon runs")

    @property
    def key(self) -> str:
        """Radius in mm."""
        return _size(self.radius)


class Spool(Part):
    """The spool of a drive."""

    radius: Length = Field(description="Radius at which the tendon is wound")

    @property
    def key(self) -> str:
        """Radius in mm."""
        return _size(self.radius)


class Rope(Part):
    """A wire rope that serves as a tendon."""

    name: Name = Field(description="What the parts list calls it")
    diameter: Length = Field(description="Nominal diameter")
    modulus: Modulus = Field(description="Young's modulus over the full circle of the diameter: stiffness is E A / L")
    breaking_load: PositiveForce = Field(description="Minimum breaking force")


class Rod(Part):
    """A round rod or wire that serves as the backbone of a continuum."""

    name: Name = Field(description="What the parts list calls it")
    diameter: Length = Field(description="Diameter")
    modulus: Modulus = Field(description="Young's modulus")

    @property
    def rigidity(self) -> float:
        """Flexural rigidity E I, N·m²."""
        return self.modulus * math.pi * self.diameter**4 / 64


class LoadCell(Part):
    """A load cell for the tension of a tendon."""

    name: Name = Field(description="What the parts list calls it")
    range: PositiveForce = Field(description="Largest force it can tell")
    resolution: PositiveForce = Field(description="Smallest difference of force it can tell")

    @model_validator(mode="after")
    def _finer_than_its_range(self) -> Self:
        if self.resolution >= self.range:
            raise ValueError(
                f"resolution is {self.resolution:g} N, which is not below the range of {self.range:g} N; "
                "allowed is a finer resolution"
            )
        return self


class Encoder(Part):
    """A joint encoder, and how large a distal joint must be to carry it."""

    name: Name = Field(description="What the parts list calls it")
    least_distal_radius: Length = Field(description="Smallest distal radius that it fits")
    bits: Bits = Field(description="Bits of its converter")
    range: EncoderRange = Field(description="Angle that the converter's range stands for")
    noise: AngleError = Field(description="Standard deviation of a reading")


class Weight(Part):
    """Weights of one mass."""

    mass: PositiveMass = Field(description="Nominal mass")
    count: _Count = Field(default=1, description="How many there are")
    tolerance: Mass = Field(default=0.0, description="Largest error of one")

    @property
    def key(self) -> str:
        """Mass in g."""
        return f"{self.mass * 1e3:.{_SAME}g} g"


class _Series(FileTable):
    """Parts that differ in size alone, written as one table."""

    source: Source = Field(default="", description="Where the values are from")


class RopeSeries(_Series):
    """Ropes of one construction and grade in several diameters (EN 12385-4).

    Their minimum breaking force is K d² R: the construction's factor, the square of the diameter, the rope grade.
    """

    name: Name = Field(description="Construction and material; a rope's name is this and its diameter")
    diameters: tuple[Length, ...] = Field(min_length=1, description="Nominal diameters")
    breaking_load_factor: _Factor = Field(description="Factor K of the construction's minimum breaking force")
    rope_grade: Strength = Field(description="Rope grade R")
    modulus: Modulus = Field(description="Young's modulus over the full circle of the diameter")

    def expand(self) -> tuple[Rope, ...]:
        """Return the ropes."""
        return tuple(
            Rope(
                name=f"{self.name} {_size(diameter)}",
                diameter=diameter,
                modulus=self.modulus,
                breaking_load=self.breaking_load_factor * diameter**2 * self.rope_grade,
                source=self.source,
            )
            for diameter in self.diameters
        )


class RodSeries(_Series):
    """Rods of one material in several diameters."""

    name: Name = Field(description="Material; a rod's name is this and its diameter")
    diameters: tuple[Length, ...] = Field(min_length=1, description="Diameters")
    modulus: Modulus = Field(description="Young's modulus")

    def expand(self) -> tuple[Rod, ...]:
        """Return the rods."""
        return tuple(
            Rod(name=f"{self.name} {_size(diameter)}", diameter=diameter, modulus=self.modulus, source=self.source)
            for diameter in self.diameters
        )


class PulleySeries(_Series):
    """Pulleys of several radii."""

    radii: tuple[Length, ...] = Field(min_length=1, description="Radii at which the tendon runs")

    def expand(self) -> tuple[Pulley, ...]:
        """Return the pulleys."""
        return tuple(Pulley(radius=radius, source=self.source) for radius in self.radii)


class SpoolSeries(_Series):
    """Spools of several radii."""

    radii: tuple[Length, ...] = Field(min_length=1, description="Radii at which the tendon is wound")

    def expand(self) -> tuple[Spool, ...]:
        """Return the spools."""
        return tuple(Spool(radius=radius, source=self.source) for radius in self.radii)


class WeightSeries(_Series):
    """A set of weights: its masses, and of each how many and how good."""

    masses: tuple[PositiveMass, ...] = Field(min_length=1, description="Nominal masses")
    counts: tuple[_Count, ...] = Field(description="How many there are of each mass")
    tolerances: tuple[Mass, ...] = Field(default=(), description="Largest error of one of each mass")

    @model_validator(mode="after")
    def _one_of_each(self) -> Self:
        for key in ("counts", "tolerances"):
            given = len(getattr(self, key))
            if given != len(self.masses) and (given or key == "counts"):
                raise ValueError(f"{key} and masses have {given} and {len(self.masses)} values; allowed are as many")
        return self

    def expand(self) -> tuple[Weight, ...]:
        """Return the weights."""
        tolerances = self.tolerances or (0.0,) * len(self.masses)
        return tuple(
            Weight(mass=mass, count=count, tolerance=tolerance, source=self.source)
            for mass, count, tolerance in zip(self.masses, self.counts, tolerances, strict=True)
        )


def _form(*plurals: str) -> Discriminator:
    """Tell a series from a single part by the key that only a series has."""

    def form(value: Any) -> str:
        keys = value if isinstance(value, dict) else dict(value) if isinstance(value, FileTable) else {}
        return "series" if any(plural in keys for plural in plurals) else "one"

    return Discriminator(form)


RopeTable = Annotated[Annotated[Rope, Tag("one")] | Annotated[RopeSeries, Tag("series")], _form("diameters")]
RodTable = Annotated[Annotated[Rod, Tag("one")] | Annotated[RodSeries, Tag("series")], _form("diameters")]
PulleyTable = Annotated[Annotated[Pulley, Tag("one")] | Annotated[PulleySeries, Tag("series")], _form("radii")]
SpoolTable = Annotated[Annotated[Spool, Tag("one")] | Annotated[SpoolSeries, Tag("series")], _form("radii")]
WeightTable = Annotated[
    Annotated[Weight, Tag("one")] | Annotated[WeightSeries, Tag("series")], _form("masses", "counts", "tolerances")
]


def _size(length: float) -> str:
    return f"{length * 1e3:.{_SAME}g} mm"


KINDS: dict[str, tuple[type[FileTable], ...]] = {
    "pulleys": (Pulley, PulleySeries),
    "ropes": (Rope, RopeSeries),
    "rods": (Rod, RodSeries),
    "load_cells": (LoadCell,),
    "encoders": (Encoder,),
    "spools": (Spool, SpoolSeries),
    "weights": (Weight, WeightSeries),
}
"""Kinds of parts by the key of a catalogue: the model of one and, where there is one, that of a series."""


def expanded(tables: Sequence[Any]) -> Iterator[Any]:
    """Yield the parts that tables of a file stand for."""
    for table in tables:
        yield from table.expand()
