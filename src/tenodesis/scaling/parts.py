"""Parts to build and test a scale model, as single parts or as series that differ in size only."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, Literal, Self, TypeAlias, TypeVar

from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from tenodesis.instrument import Name
from tenodesis.toml import FileTable
from tenodesis.units import (
    AngleError,
    Bits,
    EncoderRange,
    Inertia,
    Length,
    Mass,
    Modulus,
    Moment,
    MotorSpeed,
    PositiveForce,
    PositiveMass,
    Strength,
)

Source = Annotated[str, Field(max_length=400)]
Known: TypeAlias = Literal["sure", "second hand", "to be checked"]
"""How far values can be relied on: looked up at their source, quoted by others, or assumed."""

_Count = Annotated[int, Field(ge=1, le=1000, strict=True)]
_Teeth = Annotated[int, Field(ge=6, le=1000, strict=True)]
_Factor = Annotated[float, Field(gt=0, lt=1, strict=True)]
_SAME = 9
"""Significant digits to which two sizes are compared, whatever their units in the file."""


def ordered(pair: tuple[float, float]) -> tuple[float, float]:
    """Return a pair of minimum and maximum, or raise ValueError if it is not in order."""
    if pair[0] > pair[1]:
        raise ValueError(f"its least, {pair[0]:g}, is more than its most, {pair[1]:g}; the least must come first")
    return pair


def twice(keys: Sequence[str]) -> str | None:
    """Return the first key that occurs twice."""
    return next((key for place, key in enumerate(keys) if key in keys[:place]), None)


class Gears(FileTable):
    """Available spur gears: every module with every number of teeth."""

    modules: tuple[Length, ...] = Field(default=(), description="Modules")
    teeth: Annotated[tuple[_Teeth, _Teeth], AfterValidator(ordered)] = Field(
        default=(12, 60), description="Least and most number of teeth"
    )
    stock_modules: tuple[Length, ...] = Field(default=(), description="Modules that dealers keep")
    stock_teeth: tuple[_Teeth, ...] = Field(default=(), description="Numbers of teeth that dealers keep")

    @model_validator(mode="after")
    def _distinct(self) -> Self:
        again = twice([_size(module) for module in self.modules])
        if again:
            raise ValueError(f"modules has {again} twice; it must have every module once")
        return self


class CataloguePart(FileTable):
    """A part of a catalogue, identified among its kind by its key."""

    source: Source = Field(default="", description="Source of the values")
    known: Known = Field(default="to be checked", description="Whether values are looked up, quoted, or assumed")

    @property
    def key(self) -> str:
        """Name or size, unique among the parts of a kind."""
        return str(getattr(self, "name", ""))

    def expand(self) -> tuple[Self, ...]:
        """Return the parts that this table of a file describes."""
        return (self,)


class _Round(CataloguePart):
    """A part that guides the tendon at a radius."""

    radius: Length = Field(description="Radius of the tendon")

    @property
    def key(self) -> str:
        """Radius in mm."""
        return _size(self.radius)


class Pulley(_Round):
    """A round pulley; of a continuum, also the distance of its tendons from the backbone."""

    to_size: bool = Field(default=False, strict=True, description="Whether radii between such pulleys can be made")


class Spool(_Round):
    """The spool of a drive."""


class Rope(CataloguePart):
    """A wire rope for tendons."""

    name: Name = Field(description="Name in the parts list")
    diameter: Length = Field(description="Nominal diameter")
    modulus: Modulus = Field(description="Young's modulus over the full circle of the diameter: stiffness is E A / L")
    breaking_load: PositiveForce = Field(description="Minimum breaking force")

    @property
    def rigidity(self) -> float:
        """Stiffness times length, E A, N."""
        return math.pi / 4 * self.diameter**2 * self.modulus


class Rod(CataloguePart):
    """A round rod or wire for the backbone of a continuum."""

    name: Name = Field(description="Name in the parts list")
    diameter: Length = Field(description="Diameter")
    modulus: Modulus = Field(description="Young's modulus")

    @property
    def rigidity(self) -> float:
        """Flexural rigidity E I, N·m²."""
        return self.modulus * math.pi * self.diameter**4 / 64


class LoadCell(CataloguePart):
    """A load cell for the tension of a tendon."""

    name: Name = Field(description="Name in the parts list")
    range: PositiveForce = Field(description="Largest force that it can measure")
    resolution: PositiveForce = Field(description="Smallest difference of force that it resolves")

    @model_validator(mode="after")
    def _finer_than_its_range(self) -> Self:
        if self.resolution >= self.range:
            raise ValueError(
                f"resolution is {self.resolution:g} N, which is not below the range of {self.range:g} N; "
                "it must be finer"
            )
        return self


class Encoder(CataloguePart):
    """A joint encoder, and the smallest distal joint that can carry it."""

    name: Name = Field(description="Name in the parts list")
    least_distal_radius: Length = Field(description="Smallest distal radius that it fits")
    bits: Bits = Field(description="Bits of its converter")
    range: EncoderRange = Field(description="Angle of the converter's full range")
    noise: AngleError = Field(description="Standard deviation of a reading")

    @property
    def resolution(self) -> float:
        """Angle of the converter's last bit, rad."""
        angle: float = self.range / 2**self.bits
        return angle


class Motor(CataloguePart):
    """A motor with its gearing, by what it does at the spool's shaft."""

    name: Name = Field(description="Name in the order list")
    drive: Name = Field(description="What drives it: motors of the same are alternatives by size only")
    torque: Moment = Field(description="Torque that it holds for long, at its output")
    speed: MotorSpeed = Field(description="Largest speed at that torque, at its output")
    inertia: Inertia = Field(description="Inertia of rotor and gearing, at its output")


class BoughtPart(CataloguePart):
    """A part that a drawing shows but nobody makes: bearings, shafts, screws, ferrules, drives."""

    name: Name = Field(description="Designation, by its standard where there is one")
    use: Literal["bearing", "shaft", "screw", "ferrule", "drive", "acquisition"] = Field(description="What it is")
    size: Length | None = Field(default=None, description="Bore, diameter, thread, or the rope's diameter; None: any")
    static_load: PositiveForce | None = Field(default=None, description="Static load rating of a bearing")

    @property
    def key(self) -> str:
        """Use and name."""
        return f"{self.use} {self.name}"


class Weight(CataloguePart):
    """Weights of equal mass."""

    mass: PositiveMass = Field(description="Nominal mass")
    count: _Count = Field(default=1, description="How many there are")
    tolerance: Mass = Field(default=0.0, description="Largest error of a single weight")

    @property
    def key(self) -> str:
        """Mass in g."""
        return f"{self.mass * 1e3:.{_SAME}g} g"


_Part = TypeVar("_Part", bound=CataloguePart)


class _PartSeries(FileTable):
    """Parts that differ in size only, written as a single table."""

    source: Source = Field(default="", description="Source of the values")
    known: Known = Field(default="to be checked", description="Whether values are looked up, quoted, or assumed")

    def _parts(self, kind: type[_Part], same: Mapping[str, Any] = {}, **sizes: Sequence[Any]) -> tuple[_Part, ...]:
        """Return parts of a kind that have the same values but for their sizes, by key."""
        rows = (dict(zip(sizes, row, strict=True)) for row in zip(*sizes.values(), strict=True))
        return tuple(kind(**row, **same, source=self.source, known=self.known) for row in rows)


class RopeSeries(_PartSeries):
    """Ropes of equal construction and grade in several diameters (EN 12385-4).

    Their minimum breaking force is K d² R: the construction's factor, the square of the diameter, the rope grade.
    """

    name: Name = Field(description="Construction and material; a rope's name is this and its diameter")
    diameters: tuple[Length, ...] = Field(min_length=1, description="Nominal diameters")
    breaking_load_factor: _Factor = Field(description="Factor K of the construction's minimum breaking force")
    rope_grade: Strength = Field(description="Rope grade R")
    modulus: Modulus = Field(description="Young's modulus over the full circle of the diameter")

    def expand(self) -> tuple[Rope, ...]:
        """Return the ropes."""
        names = [f"{self.name} {_size(diameter)}" for diameter in self.diameters]
        loads = [self.breaking_load_factor * diameter**2 * self.rope_grade for diameter in self.diameters]
        return self._parts(Rope, {"modulus": self.modulus}, name=names, diameter=self.diameters, breaking_load=loads)


class RodSeries(_PartSeries):
    """Rods of equal material in several diameters."""

    name: Name = Field(description="Material; a rod's name is this and its diameter")
    diameters: tuple[Length, ...] = Field(min_length=1, description="Diameters")
    modulus: Modulus = Field(description="Young's modulus")

    def expand(self) -> tuple[Rod, ...]:
        """Return the rods."""
        names = [f"{self.name} {_size(diameter)}" for diameter in self.diameters]
        return self._parts(Rod, {"modulus": self.modulus}, name=names, diameter=self.diameters)


class _RoundSeries(_PartSeries):
    """Round parts of several radii."""

    radii: tuple[Length, ...] = Field(min_length=1, description="Radii of the tendon")


class PulleySeries(_RoundSeries):
    """Pulleys of several radii."""

    to_size: bool = Field(default=False, strict=True, description="Whether radii between these can be made")

    def expand(self) -> tuple[Pulley, ...]:
        """Return the pulleys."""
        return self._parts(Pulley, {"to_size": self.to_size}, radius=self.radii)


class SpoolSeries(_RoundSeries):
    """Spools of several radii."""

    def expand(self) -> tuple[Spool, ...]:
        """Return the spools."""
        return self._parts(Spool, radius=self.radii)


class WeightSeries(_PartSeries):
    """A set of weights: its masses, with their counts and tolerances."""

    masses: tuple[PositiveMass, ...] = Field(min_length=1, description="Nominal masses")
    counts: tuple[_Count, ...] = Field(description="How many there are of each mass")
    tolerances: tuple[Mass, ...] = Field(default=(), description="Largest error of a weight of each mass")

    @model_validator(mode="after")
    def _one_of_each(self) -> Self:
        for key in ("counts", "tolerances"):
            given = len(getattr(self, key))
            if given != len(self.masses) and (given or key == "counts"):
                raise ValueError(
                    f"{key} and masses have {given} and {len(self.masses)} values; both must have the same number"
                )
        return self

    def expand(self) -> tuple[Weight, ...]:
        """Return the weights."""
        tolerances = self.tolerances or (0.0,) * len(self.masses)
        return self._parts(Weight, mass=self.masses, count=self.counts, tolerance=tolerances)


def _form(*plurals: str) -> Discriminator:
    """Return what distinguishes a series from a single part: a key that only a series has."""

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
    "motors": (Motor,),
    "hardware": (BoughtPart,),
}
"""Kinds of parts by their key in a catalogue: the table of a single part and, if any, that of a series."""


def expanded(tables: Sequence[Any]) -> Iterator[Any]:
    """Yield the parts that tables of a file describe."""
    for table in tables:
        yield from table.expand()
