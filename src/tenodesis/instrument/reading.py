"""Instrument files: shipped or by path, read into instruments."""

from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, TypeAlias

from pydantic import TypeAdapter, ValidationError

from tenodesis.errors import InstrumentError
from tenodesis.instrument.full_form import FullForm, RouteError
from tenodesis.instrument.instrument import ENTRIES, Instrument
from tenodesis.instrument.mechanisms import JOINT_TYPES, SHORT_FORM
from tenodesis.instrument.short_form import ShortForm
from tenodesis.toml import did_you_mean, parse_toml, read_text, validated

_LISTS = {"joints", "tendons"}
"""Keys that only a file has that lists joints and tendons."""

InstrumentLike: TypeAlias = Instrument | str | Path
"""An instrument, the name of one that comes with the package, or the path of an instrument file."""


def shipped() -> tuple[str, ...]:
    """Return the names of the instruments that come with the package."""
    files = (Path(entry.name) for entry in _shipped_folder().iterdir())
    return tuple(sorted(file.stem for file in files if file.suffix == ".toml"))


def load(name_or_path: InstrumentLike) -> Instrument:
    """Read an instrument that comes with the package, by name, or an instrument file, by path.

    An instrument is returned as it is. Raises InstrumentError if there is no such instrument or file, it cannot be
    read, or it is not valid.
    """
    return as_instrument(name_or_path, "name_or_path")


def as_instrument(given: InstrumentLike, argument: str = "inst") -> Instrument:
    """Return an instrument that is given as such, by name or by path.

    Raises TypeError, which names the argument, if it is none of these, and InstrumentError as :func:`load`.
    """
    if isinstance(given, Instrument):
        return given
    if not isinstance(given, str | Path):
        raise TypeError(f"{argument} is {given!r}; it must be an instrument, its name or the path of its file.")
    source = str(given)
    return _shipped_instrument(source) if source in shipped() else parse(source_text(given), source)


def as_short_form(given: InstrumentLike, argument: str = "inst") -> ShortForm:
    """Return an instrument whose file has the short form; errors as :func:`as_instrument`, and InstrumentError if not.

    Raises
    ------
    InstrumentError
        Its file lists joints and tendons.
    """
    inst = as_instrument(given, argument)
    if inst.short_form is None:
        raise inst.expanded.not_short()
    return inst.short_form


def expanded(given: InstrumentLike, argument: str = "inst") -> FullForm:
    """Return an instrument, given as such, by name or by path, as joints and tendons.

    Errors as :func:`as_instrument`, and InstrumentError where the short form leaves nothing for the stem.
    """
    return as_instrument(given, argument).expanded


def in_arcs(given: InstrumentLike, arcs: int | None = None) -> FullForm:
    """Return an instrument, given as such, by name or by path, as joints and tendons with its backbones in arcs.

    By default in as many as an error of half a percent of a deflection takes. Errors as :func:`expanded`, and
    InstrumentError for an odd number above 1.
    """
    inst = expanded(given)
    joints = [
        joint.model_copy(update={"arcs": arcs})
        if joint.mechanism == "continuum" and joint.place == "tip" and not joint.arc
        else joint
        for joint in inst.as_given("joints")
    ]
    if all(joint is other for joint, other in zip(joints, inst.as_given("joints"), strict=True)):
        return inst
    values = inst.with_values({"joints": joints})
    return validated(FullForm, values, InstrumentError, inst.name, context={"expanded": True}, entries=ENTRIES)


def source_text(name_or_path: str | Path) -> str:
    """Return the text of the file of an instrument that comes with the package, by name, or of another, by path.

    Raises InstrumentError if there is no such instrument or file, or it cannot be read.
    """
    source = str(name_or_path)
    if source in shipped():
        return str((_shipped_folder() / f"{source}.toml").read_text("utf-8"))
    return read_text(Path(name_or_path), InstrumentError, source=source, kind="instrument", names=shipped())


def parse(text: str, source: str = "instrument") -> Instrument:
    """Read an instrument from the text (str) of an instrument file.

    Raises InstrumentError, whose message starts with `source`, if the text is not TOML or not a valid instrument.
    """
    values = parse_toml(text, InstrumentError, source, "an instrument")
    joint_type = values.get("joint_type")
    if joint_type is None and _LISTS & values.keys():
        return validated(FullForm, values, InstrumentError, source, context={"file": True}, entries=ENTRIES)
    if not isinstance(joint_type, str) or joint_type not in JOINT_TYPES:
        found = "is missing" if joint_type is None else f"is {joint_type!r}{did_you_mean(str(joint_type), JOINT_TYPES)}"
        allowed = f"one of {', '.join(JOINT_TYPES)}"
        raise InstrumentError(
            f"{source}: joint_type {found}; it must be {allowed}.", key="joint_type", value=joint_type, allowed=allowed
        )
    short = validated(JOINT_TYPES[joint_type], values, InstrumentError, source, context={"file": True})
    arcs = getattr(short, "arcs", 1)
    return in_arcs(short.replace(arcs=1), arcs) if arcs > 1 else short


def misrouted(name_or_path: str | Path) -> RouteError | None:
    """Return what is wrong with the routes in a file that :func:`load` refuses, with what its tables describe.

    None if something else is wrong. Raises InstrumentError if the file cannot be read.
    """
    values = parse_toml(source_text(name_or_path), InstrumentError, str(name_or_path))
    if not _LISTS & values.keys():
        return None
    try:
        FullForm.model_validate(values, context={"file": True})
    except ValidationError as invalid:
        problem = invalid.errors(include_url=False)[0].get("ctx", {}).get("error")
        return problem if isinstance(problem, RouteError) else None
    return None


def json_schema() -> dict[str, Any]:
    """Return the JSON schema of instrument files, for editors that complete and check TOML."""
    schema = TypeAdapter(SHORT_FORM | FullForm).json_schema(by_alias=True)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "Tenodesis instrument", **schema}


@cache
def _shipped_instrument(name: str) -> Instrument:
    return parse(source_text(name), name)


def _shipped_folder() -> Any:
    return resources.files("tenodesis") / "instruments"
