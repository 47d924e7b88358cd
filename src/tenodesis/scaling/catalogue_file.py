"""Catalogue files: their tables, and one sentence for each error in a file."""

import tomllib
from collections.abc import Mapping
from typing import Annotated, Any, Self

from pydantic import AfterValidator, BaseModel, Field, ValidationError, model_validator

from tenodesis.errors import DesignError
from tenodesis.instrument import Force, Moment, Name
from tenodesis.instrument.hardware import Length, Table
from tenodesis.scaling.parts import (
    KINDS,
    Encoder,
    Gears,
    LoadCell,
    Mass,
    PulleyTable,
    RodTable,
    RopeTable,
    SpoolTable,
    WeightTable,
    expanded,
    ordered,
    twice,
)
from tenodesis.units import Quantity, annotation

_Scale = Annotated[float, Field(gt=0, le=1000, strict=True)]
_Margin = Annotated[float, Field(ge=1, le=1000, strict=True)]
_Tolerance = Annotated[float, Field(ge=0, lt=1, strict=True)]
SimilarityError = Annotated[float, *annotation(Quantity("angle", "rad", "2 deg", above=0, below=4))]
_Lengths = Annotated[tuple[Length, Length], AfterValidator(ordered)]


class Constraints(Table):
    """Constraints of a design; None leaves a value free, pairs are least and most."""

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
    largest_force: Force | None = Field(
        default=None, description="Largest force on the real-size tip; without it the largest of its conditions"
    )
    test_forces: tuple[Force, ...] = Field(
        default=(), max_length=12, description="Test forces on the real-size tip; without them those of its conditions"
    )
    cable_pulley_radius: Length = Field(default=15e-3, description="Radius the weight cables act at")
    cable_mass: Mass = Field(default=0.05, description="Least mass on each weight cable, which keeps it taut")
    force_tolerance: _Tolerance = Field(default=0.02, description="Largest relative error of a force set by weights")


class CatalogueFile(Table):
    """A catalogue file; every key is optional, so that a file can add to others."""

    name: Name | None = Field(default=None, description="Name of the catalogue; without it the file's name")
    description: str = Field(default="", max_length=200, description="One line about the catalogue")
    include: tuple[str, ...] = Field(
        default=(), description="Catalogues this one builds on: names of shipped ones, or paths relative to this file"
    )
    gears: Gears | None = Field(default=None, description="Gears at hand")
    pulleys: tuple[PulleyTable, ...] = Field(default=(), description="Pulleys at hand")
    ropes: tuple[RopeTable, ...] = Field(default=(), description="Wire ropes at hand")
    rods: tuple[RodTable, ...] = Field(default=(), description="Rods for backbones at hand")
    load_cells: tuple[LoadCell, ...] = Field(default=(), description="Load cells at hand")
    encoders: tuple[Encoder, ...] = Field(default=(), description="Joint encoders at hand")
    spools: tuple[SpoolTable, ...] = Field(default=(), description="Spools at hand")
    weights: tuple[WeightTable, ...] = Field(default=(), description="Weights at hand")
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
                raise ValueError(f"sources.{key} names no key; keys are {', '.join(_SOURCE_KEYS)}")
        return self


_SOURCE_KEYS = (
    *("gears", "constraints", *KINDS),
    *(f"gears.{key}" for key in Gears.model_fields),
    *(f"constraints.{key}" for key in Constraints.model_fields),
)


_INSTEAD = {"tuple_type": "a list", "too_short": "a list that is not empty", "model_type": "a table"}
"""What is allowed, by pydantic's name of the mistake, where its own words are about Python."""


def parse(text: str, source: str) -> CatalogueFile:
    """Read a catalogue file from its text.

    Raises
    ------
    DesignError
        The text is not TOML or not a valid catalogue; the message starts with `source`.
    """
    try:
        values = tomllib.loads(text)
    except tomllib.TOMLDecodeError as problem:
        raise DesignError(f"{source} is not valid TOML: {problem}.") from None
    except RecursionError:
        raise DesignError(f"{source} is not valid TOML: it is nested too deeply.") from None
    try:
        return CatalogueFile.model_validate(values, context={"file": True})
    except ValidationError as invalid:
        sentences = [_sentence(values, error) for error in invalid.errors(include_url=False)]
        raise DesignError("\n".join(f"{source}: {sentence}" for sentence in sentences)) from None


def _sentence(values: dict[str, Any], error: Any) -> str:
    """Say what is wrong with one value: its part or table, its key, what it is, and what is allowed."""
    location = error["loc"]
    if location[:1] and location[0] in KINDS:
        return _of_part(values, error)
    tables: dict[str, type[BaseModel]] = {"gears": Gears, "constraints": Constraints}
    table = tables.get(location[0]) if len(location) > 1 else None
    return _of_key(error, _dotted(location), table or CatalogueFile)


def _of_part(values: dict[str, Any], error: Any) -> str:
    """Say what is wrong with one part, which is named by its place in the file and its name."""
    kind, *rest = error["loc"]
    if not rest:
        return f"{kind} = {error['input']!r}: it must be a list of tables, [[{kind}]]."
    place, *rest = rest
    model, *series = KINDS[kind]
    if series and rest:
        tag, *rest = rest
        model = series[0] if tag == "series" else model
    table = values[kind][place]
    if not isinstance(table, dict):
        return f"{kind} {place + 1} = {table!r}: it must be a table, [[{kind}]]."
    named = f" ({table['name']})" if isinstance(table.get("name"), str) else ""
    return f"{kind} {place + 1}{named}: {_of_key(error, _dotted(rest), model)}"


def _of_key(error: Any, key: str, model: type[BaseModel]) -> str:
    told = str(error["msg"]).removeprefix("Value error, ").removeprefix("Input should be ").rstrip(".")
    if error["type"] == "missing":
        return f"{key} is missing; it is required."
    if error["type"] == "extra_forbidden":
        return f"{key} is not a known key; allowed are {', '.join(model.model_fields)}."
    if not key or isinstance(error["input"], dict):
        return f"{key}: {told}." if key else f"{told}."
    if error["type"] != "value_error":
        told = f"it must be {_INSTEAD.get(error['type'], told)}"
    return f"{key} = {error['input']!r}: {told}."


def _dotted(location: Any) -> str:
    """Write a location as a key, counting values of a list from one."""
    return "".join(f" (value {part + 1})" if isinstance(part, int) else f".{part}" for part in location).lstrip(".")
