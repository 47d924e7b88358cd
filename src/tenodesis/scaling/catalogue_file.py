"""Catalogue files: their tables, and a sentence for each error in a file."""

from collections.abc import Mapping
from typing import Annotated, Self

from pydantic import AfterValidator, Field, model_validator

from tenodesis.errors import DesignError
from tenodesis.instrument import Name
from tenodesis.scaling.parts import (
    KINDS,
    Encoder,
    Gears,
    Hardware,
    LoadCell,
    Motor,
    PulleyTable,
    RodTable,
    RopeTable,
    SpoolTable,
    WeightTable,
    expanded,
    ordered,
    twice,
)
from tenodesis.toml import FileTable, did_you_mean, parse_toml, validated
from tenodesis.units import Length, Mass, Moment, PositiveForce, SimilarityError

_Scale = Annotated[float, Field(gt=0, le=1000, strict=True)]
_Margin = Annotated[float, Field(ge=1, le=1000, strict=True)]
_Tolerance = Annotated[float, Field(ge=0, lt=1, strict=True)]
_Lengths = Annotated[tuple[Length, Length], AfterValidator(ordered)]


class Constraints(FileTable):
    """Constraints of a design; None leaves a value free; pairs are minimum and maximum."""

    factor: Annotated[tuple[_Scale, _Scale], AfterValidator(ordered)] | None = Field(
        default=None, description="Scaled-up over real-size distal radius, least and most"
    )
    ratio_tolerance: _Tolerance = Field(
        default=0.01, description="Share by which the ratio of proximal to distal radius may differ from the real one"
    )
    overall_length: _Lengths | None = Field(default=None, description="Overall length, least and most")
    end_effector_length: _Lengths | None = Field(default=None, description="End-effector length, least and most")
    handle_length: _Lengths | None = Field(default=None, description="Handle length, least and most")
    print_bed: tuple[Length, Length] | None = Field(
        default=None, description="Print bed that the largest wheel must fit on: width and depth"
    )
    spool_torque: Moment | None = Field(
        default=None, description="Largest torque of a spool's drive while it holds a tendon"
    )
    similarity_error: SimilarityError | None = Field(
        default=None, description="Largest difference in output angle of a scale model"
    )
    tension_margin: _Margin = Field(default=1.5, description="Least breaking load over the largest tension")
    load_cell_margin: _Margin = Field(default=1.2, description="Least range of a load cell over the largest tension")
    largest_force: PositiveForce | None = Field(
        default=None, description="Largest force on the real-size tip; without it the largest of its conditions"
    )
    test_forces: tuple[PositiveForce, ...] = Field(
        default=(), max_length=12, description="Test forces on the real-size tip; without them those of its conditions"
    )
    cable_pulley_radius: Length = Field(default=15e-3, description="Radius the weight cables act at")
    cable_mass: Mass = Field(default=0.05, description="Least mass on each weight cable, which keeps it taut")
    force_tolerance: _Tolerance = Field(default=0.02, description="Largest relative error of a force set by weights")


class CatalogueFile(FileTable):
    """A catalogue file; every key is optional, so that a file can add to others."""

    name: Name | None = Field(default=None, description="Name of the catalogue; without it the file's name")
    description: str = Field(default="", max_length=200, description="One line about the catalogue")
    include: tuple[str, ...] = Field(
        default=(), description="Catalogues to include: names of shipped catalogues, or paths relative to this file"
    )
    gears: Gears | None = Field(default=None, description="Gears at hand")
    pulleys: tuple[PulleyTable, ...] = Field(default=(), description="Pulleys at hand")
    ropes: tuple[RopeTable, ...] = Field(default=(), description="Wire ropes at hand")
    rods: tuple[RodTable, ...] = Field(default=(), description="Rods for backbones at hand")
    load_cells: tuple[LoadCell, ...] = Field(default=(), description="Load cells at hand")
    encoders: tuple[Encoder, ...] = Field(default=(), description="Joint encoders at hand")
    spools: tuple[SpoolTable, ...] = Field(default=(), description="Spools at hand")
    weights: tuple[WeightTable, ...] = Field(default=(), description="Weights at hand")
    motors: tuple[Motor, ...] = Field(default=(), description="Motors with their gearing at hand")
    hardware: tuple[Hardware, ...] = Field(default=(), description="Bearings, shafts, screws, ferrules and drives")
    constraints: Constraints = Field(default=Constraints(), description="Constraints of the design")
    sources: Mapping[str, str] = Field(
        default={}, description='Where values other than parts\' are from, by key such as "constraints.factor"'
    )

    @model_validator(mode="after")
    def _coherent(self) -> Self:
        for kind in KINDS:
            again = twice([part.key for part in expanded(getattr(self, kind))])
            if again:
                raise ValueError(f"{kind} has {again!r} twice; it must have every part once")
        for key in self.sources:
            if key not in _SOURCE_KEYS:
                hint = did_you_mean(key, _SOURCE_KEYS)
                raise ValueError(f"sources.{key} names no key{hint}; keys are {', '.join(_SOURCE_KEYS)}")
        return self


_SOURCE_KEYS = (
    *("gears", "constraints", *KINDS),
    *(f"gears.{key}" for key in Gears.model_fields),
    *(f"constraints.{key}" for key in Constraints.model_fields),
)


def parse(text: str, source: str) -> CatalogueFile:
    """Read a catalogue file from its text.

    Raises DesignError, whose message starts with `source`, if the text is not TOML or not a valid catalogue.
    """
    values = parse_toml(text, DesignError, source, "a catalogue")
    return validated(CatalogueFile, values, DesignError, source, context={"file": True})
