"""Catalogues, merged from files: the parts at hand and the constraints of a design."""

from collections.abc import Mapping
from functools import reduce
from pathlib import Path
from typing import Any, TypeVar

from pydantic import Field

from tenodesis.errors import DesignError
from tenodesis.scaling.catalogue_file import CatalogueFile, Constraints, parse
from tenodesis.scaling.parts import (
    KINDS,
    Encoder,
    Gears,
    Hardware,
    LoadCell,
    Motor,
    Pulley,
    Rod,
    Rope,
    Spool,
    Weight,
    expanded,
)
from tenodesis.toml import FileTable, read_text

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
    hardware: tuple[Hardware, ...] = ()
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
                    f"add {'[gears]' if kind == 'gears' else f'[[{kind}]]'} or a shipped catalogue."
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
        raise DesignError(f"{source}: it includes itself; catalogues must not include one another.")
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
