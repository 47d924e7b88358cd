"""Catalogue files."""

from collections.abc import Mapping
from typing import Self

from pydantic import Field, model_validator

from tenodesis.errors import DesignError
from tenodesis.files import FileTable, parse_toml, validated
from tenodesis.instrument import Name
from tenodesis.scaling.constraints_table import Constraints
from tenodesis.scaling.parts import (
    KINDS,
    Encoder,
    Gears,
    LoadCell,
    PulleyTable,
    RodTable,
    RopeTable,
    SpoolTable,
    WeightTable,
    expanded,
    twice,
)


class CatalogueFile(FileTable):
    """What a catalogue file may say; everything is optional, so that a file can add to others."""

    name: Name | None = Field(default=None, description="What the catalogue is called; without it the file's name")
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
    constraints: Constraints = Field(default=Constraints(), description="What the design must keep to")
    sources: Mapping[str, str] = Field(
        default={}, description='Where values other than parts\' are from, by key such as "constraints.factor"'
    )

    @model_validator(mode="after")
    def _coherent(self) -> Self:
        for kind in KINDS:
            again = twice([part.key for part in expanded(getattr(self, kind))])
            if again:
                raise ValueError(f"{kind} has {again!r} twice; allowed is every part once")
        for key in self.sources:
            if key not in _SOURCE_KEYS:
                raise ValueError(f"sources.{key} names no key; allowed are {', '.join(_SOURCE_KEYS)}")
        return self


_SOURCE_KEYS = (
    *("gears", "constraints", *KINDS),
    *(f"gears.{key}" for key in Gears.model_fields),
    *(f"constraints.{key}" for key in Constraints.model_fields),
)


def parse(text: str, source: str) -> CatalogueFile:
    """Read a catalogue file from its text.

    Raises
    ------
    DesignError
        The text is not TOML or not a valid catalogue; the message starts with `source`.
    """
    return validated(CatalogueFile, parse_toml(text, DesignError, source), DesignError, source, context={"file": True})
