"""Catalogues, merged from files: the parts at hand and the constraints of a design."""

from collections.abc import Mapping, Sequence
from functools import reduce
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

from pydantic import AfterValidator, Field, TypeAdapter, ValidationError, model_validator

from tenodesis.errors import DesignError
from tenodesis.instrument import Name
from tenodesis.scaling.parts import (
    KINDS,
    BoughtPart,
    Encoder,
    Gears,
    LoadCell,
    Motor,
    Pulley,
    PulleyTable,
    Rod,
    RodTable,
    Rope,
    RopeTable,
    Spool,
    SpoolTable,
    Weight,
    WeightTable,
    expanded,
    ordered,
    twice,
)
from tenodesis.similarity.parameters import RADII
from tenodesis.toml import FileTable, did_you_mean, parse_toml, read_text, validated
from tenodesis.units import Force, Length, Mass, Moment, PositiveForce, SimilarityError

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
    hardware: tuple[BoughtPart, ...] = Field(default=(), description="Bearings, shafts, screws, ferrules and drives")
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


STANDARD = "standard"
"""The shipped catalogue that is used by default."""

_ALWAYS = ("ropes", "load_cells", "spools", "weights")
NEEDED: Mapping[str, tuple[str, ...]] = {
    "tendon-gear": ("gears", *_ALWAYS),
    "tendon-pulley": ("pulleys", *_ALWAYS),
    "continuum": ("pulleys", "rods", *_ALWAYS),
}
"""Parts that a design requires, by joint type."""

_SHIPPED = Path(__file__).parents[1] / "catalogue"


class Catalogue(FileTable):
    """Parts at hand and constraints, in SI units; use :func:`load`."""

    name: str
    description: str = ""
    gears: Gears | None = None
    pulleys: tuple[Pulley, ...] = ()
    ropes: tuple[Rope, ...] = ()
    rods: tuple[Rod, ...] = ()
    load_cells: tuple[LoadCell, ...] = ()
    encoders: tuple[Encoder, ...] = ()
    spools: tuple[Spool, ...] = ()
    weights: tuple[Weight, ...] = ()
    motors: tuple[Motor, ...] = ()
    hardware: tuple[BoughtPart, ...] = ()
    constraints: Constraints = Constraints()
    sources: Mapping[str, str] = Field(default={})

    def refuse_incomplete(self, joint_type: str) -> None:
        """Refuse a catalogue that lacks what a scale model of a joint type needs.

        Raises DesignError if a list is empty, or there is no such joint type.
        """
        if joint_type not in NEEDED:
            raise DesignError(key="joint_type", value=joint_type, allowed=f"one of {', '.join(NEEDED)}")
        for kind in NEEDED[joint_type]:
            held = self.gears.modules if kind == "gears" and self.gears else getattr(self, kind)
            if not held:
                raise DesignError(
                    f"catalogue {self.name} has no {kind.replace('_', ' ')}, which a {joint_type} scale model needs; "
                    f"add {'[gears]' if kind == 'gears' else f'[[{kind}]]'} or a shipped catalogue.",
                    key=kind,
                    allowed="in the catalogue",
                )


def shipped() -> tuple[str, ...]:
    """Return the names of the shipped catalogues."""
    return tuple(sorted(file.stem for file in _SHIPPED.glob("*.toml")))


def load(*names_or_paths: str | Path) -> Catalogue:
    """Read and merge shipped catalogues, by name, and catalogue files, by path; by default the standard one.

    Parts of all files are joined; a part that several have is the last one's. Of gears and constraints, a later file's
    values replace an earlier one's key by key. What a file includes comes before it.

    Raises DesignError if there is no such catalogue or file, it cannot be read, or it is not valid.
    """
    catalogues = [_read(wanted, Path(), ()) for wanted in names_or_paths or (STANDARD,)]
    name = " + ".join(catalogue.name for catalogue in catalogues)
    return reduce(_merged, catalogues).model_copy(update={"name": name})


def json_schema() -> dict[str, Any]:
    """Return the JSON schema of catalogue files, for editors that complete and check TOML."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **CatalogueFile.model_json_schema(),
        "title": "Tenodesis catalogue",
    }


def _read(name_or_path: str | Path, folder: Path, chain: tuple[Path, ...]) -> Catalogue:
    """Read a catalogue and those that it includes; `chain` are the files that include it."""
    wanted = str(name_or_path)
    path = _SHIPPED / f"{wanted}.toml" if wanted in shipped() else folder / wanted
    source = f"{wanted} (included by {chain[-1].name})" if chain else wanted
    text = read_text(path, DesignError, source=source, kind="catalogue", names=shipped())
    if path.resolve() in chain:
        raise DesignError(
            f"{source}: it includes itself; catalogues must not include one another.",
            key="include",
            value=source,
            allowed="another catalogue",
        )
    file = parse(text, source)
    own = Catalogue(
        name=file.name or path.stem,
        gears=file.gears,
        constraints=file.constraints,
        description=file.description,
        sources=file.sources,
        **{kind: tuple(expanded(getattr(file, kind))) for kind in KINDS},
    )
    included = [_read(other, path.parent, (*chain, path.resolve())) for other in file.include]
    return reduce(_merged, [*included, own])


def _merged(earlier: Catalogue, later: Catalogue) -> Catalogue:
    parts = {kind: {part.key: part for one in (earlier, later) for part in getattr(one, kind)} for kind in KINDS}
    return Catalogue(
        name=later.name,
        description=later.description or earlier.description,
        gears=_over(earlier.gears, later.gears) if earlier.gears and later.gears else later.gears or earlier.gears,
        constraints=_over(earlier.constraints, later.constraints),
        sources={**earlier.sources, **later.sources},
        **{kind: tuple(by_key.values()) for kind, by_key in parts.items()},
    )


_T = TypeVar("_T", bound=FileTable)


def _over(earlier: _T, later: _T) -> _T:
    return earlier.model_copy(update={key: getattr(later, key) for key in later.model_fields_set})


SAME_LENGTH = 1e-6
"""Relative difference up to which a length equals the pinned length."""

_RANGES = ("overall_length", "end_effector_length", "handle_length")
_PARTS = {"rope": "ropes", "rod": "rods", "load_cell": "load_cells", "encoder": "encoders"}
PINS = ("factor", *_RANGES, *RADII, "tendon_diameter", *_PARTS, "spool_radius", "pretension")
"""Keys that may be pinned."""


def parse_pins(pins: Mapping[str, Any], *, file: bool = False) -> dict[str, Any]:
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
        raise DesignError(
            f"{key} = {wanted!r} is pinned, but catalogue {catalogue.name} has {names}.",
            key=key,
            value=wanted,
            allowed=names,
        )
    return found


def missing(key: str, wanted: float, sizes: Sequence[float], catalogue: Catalogue) -> DesignError:
    """Return the error that no part has the pinned size (m), with the nearest sizes."""
    near = sorted(set(sizes), key=lambda one: abs(one - wanted))[:2]
    sizes_mm = " and ".join(f"{1e3 * one:.6g} mm" for one in sorted(near)) or "none"
    return DesignError(
        f"{key} = {1e3 * wanted:.6g} mm is pinned, but no part of catalogue {catalogue.name} has it; "
        f"nearest: {sizes_mm}.",
        key=key,
        value=wanted,
        allowed=sizes_mm,
    )
