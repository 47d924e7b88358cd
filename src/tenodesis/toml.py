"""TOML files: read, and checked with sentences that name key, value and what the value must be."""

import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeVar, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Tag, ValidationError

from tenodesis.errors import ArgumentError, Error
from tenodesis.files import read_regular

_LARGEST = 16_000_000
"""Largest TOML file, bytes."""
_MCAP = b"\x89MCAP"
_MOST_PARTS, _MOST_BITS = 100, 64
"""Parts that a dotted key may have, whose cost grows with their square, and bits of an integer."""
_LONG_KEY = re.compile(rf"(?<![\w-])(?:[\w-]++[ \t]*+\.[ \t]*+){{{_MOST_PARTS}}}", re.ASCII)
_TEXT = re.compile(
    r'''"""(?:[^\\]|\\.)*?(?:"""|\Z)|\'{3}.*?(?:\'{3}|\Z)|"(?:[^"\\\n]|\\[^\n])*+"?|'[^'\n]*+'?|(?P<comment>\#[^\n]*+)''',
    re.DOTALL,
)
"""Strings, also without an end, and comments, in which a dotted text is no key."""
_MARKS = {
    "an instrument": {"joint_type", "joints", "tendons"},
    "a protocol": {"phases"},
    "tolerances": {"parameters"},
    "a catalogue": {"gears", "pulleys", "ropes", "rods", "load_cells", "encoders", "spools", "weights", "constraints"},
}
"""Keys that only one kind of file has."""


class FileTable(BaseModel):
    """A table of a TOML file: read-only, without unknown keys or numbers that are not finite."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    def __setattr__(self, name: str, value: object) -> None:
        """Refuse a change: what is derived from a value would not follow it."""
        if name in type(self).model_fields:
            way = (
                f"make a changed copy: inst.replace({name}={value!r})" if hasattr(self, "replace") else "make a new one"
            )
            raise ArgumentError(f"{name} cannot be set, for the table is read-only; {way}.", key=name, value=value)
        super().__setattr__(name, value)


_LIKE = 0.75
"""Least similarity of a key to a key of another table that could be meant."""

_Model = TypeVar("_Model", bound=BaseModel)


def read_text(path: Path, error: type[Error], *, source: str = "", kind: str = "", names: Sequence[str] = ()) -> str:
    """Return the text of a TOML file.

    Parameters
    ----------
    path
        The file.
    error
        The exception to raise.
    source
        What messages call it; by default its path.
    kind, names
        What comes with the package and could be meant instead, "instrument" for example, and the names there are.

    Raises
    ------
    Error
        There is no such file, or it cannot be read; of the class `error`.
    """
    source = source or str(path)
    data = b""
    needed = f"the path of a TOML file or one of {', '.join(names)}" if names else "the path of a TOML file"
    try:
        data = read_regular(path, _LARGEST)
        return data.decode("utf-8-sig")
    except (FileNotFoundError, IsADirectoryError, NotADirectoryError):
        problem = f"{source}: there is no such file{f' and no {kind} of that name' if kind else ''}"
    except UnicodeDecodeError:
        problem = f"{source} is {'a recording, MCAP' if data.startswith(_MCAP) else 'not UTF-8 text'}"
        needed = "a TOML file"
    except OSError as failure:
        problem = f"{source} cannot be read: {failure.strerror}"
    except ValueError:
        problem, needed = f"{source!r} is no path", "the path of a TOML file"
    raise error(f"{problem}; it must be {needed}.", key="file", value=source, allowed=needed)


def file_keys(kind: type[BaseModel], prefix: str = "") -> Iterator[str]:
    """Yield the keys that a file may have, those within tables with a dot."""
    for name, field in kind.model_fields.items():
        key = prefix + (field.alias or name)
        yield key
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            yield from file_keys(field.annotation, key + ".")


def did_you_mean(key: str, here: Iterable[str], elsewhere: Iterable[str] = ()) -> str:
    """Return the key that could be meant instead of an unknown one, as " (did you mean KEY?)"; empty if there is none.

    Parameters
    ----------
    key
        The unknown key, with the tables that it is in before dots.
    here
        The keys of the table that it is in.
    elsewhere
        All keys of the file, with the tables that they are in before dots.
    """
    table, dot, name = key.rpartition(".")
    # Of two tables with a key of that name the outer one is meant.
    by_name = {one.rpartition(".")[2]: one for one in sorted(elsewhere, key=lambda one: (-one.count("."), one))}
    near = [by_name[name]] if name in by_name else []
    near += [f"{table}{dot}{found}" for found in get_close_matches(name, list(here), 1)]
    near += [by_name[found] for found in get_close_matches(name, list(by_name), 1, _LIKE)]
    return f" (did you mean {near[0]}?)" if near else ""


def parse_toml(text: str, error: type[Error], source: str, kind: str = "") -> dict[str, Any]:
    """Return the values of a TOML text, or raise an exception of the class `error` that begins with `source`.

    With a kind, "an instrument" for example, a file of another kind that this package reads is such an error as well.
    """
    try:
        values = _loads(text)
    except RecursionError:
        problem = f"{source} is not valid TOML: it is nested too deeply."
    except ValueError as failure:
        problem = f"{source} is not valid TOML: {failure}."
    else:
        if not kind or _MARKS[kind] & values.keys():
            return values
        found = next((other for other, keys in _MARKS.items() if keys & values.keys()), kind)
        if found == kind:
            return values
        raise error(f"{source} describes {found}; it must describe {kind}.", key="file", value=source, allowed=kind)
    raise error(problem, key="file", value=source, allowed="a TOML file")


def _loads(text: str) -> dict[str, Any]:
    """Return the values of a TOML text; raises ValueError for one that is none, or that takes too much to read."""
    # a string may be a part of a key
    if _LONG_KEY.search(_TEXT.sub(lambda one: "" if one["comment"] else "_", text)):
        raise ValueError(f"a key has more than {_MOST_PARTS} parts")
    too_large = f"an integer has more than {_MOST_BITS} bits"
    try:
        values = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except ValueError:
        # Python converts no more than some thousand digits.
        raise ValueError(too_large) from None
    within: list[Any] = [values]
    while within:
        one = within.pop()
        if isinstance(one, dict | list):
            within += one.values() if isinstance(one, dict) else one
        elif isinstance(one, int) and one.bit_length() > _MOST_BITS:
            raise ValueError(too_large)
    return values


def validated(
    model: type[_Model],
    values: Mapping[str, Any],
    error: type[Error],
    source: str = "",
    *,
    context: Mapping[str, Any] | None = None,
    entries: Mapping[str, str] | None = None,
) -> _Model:
    """Return values as a model.

    Parameters
    ----------
    model
        The model.
    values
        Its values by key, as a file has them or as they are given in Python.
    error
        The exception to raise.
    source
        What each sentence begins with: the file.
    context
        What validators are given, `{"file": True}` for values that must have their units.
    entries
        What an entry of a list of tables is called, by the list's key, if not by that key: `{"phases": "phase"}`.

    Raises
    ------
    Error
        The values are not valid; of the class `error`, one sentence a mistake, with key, value and what the value must
        be of the first.
    """
    try:
        return model.model_validate(dict(values), context=dict(context or {}))
    except ValidationError as invalid:
        found = invalid.errors(include_url=False)
        # A list of which every entry is wrong also counts as empty.
        within = {one["loc"][:length] for one in found for length in range(len(one["loc"]))}
        own = [one for one in found if one["type"] != "too_short" or one["loc"] not in within]
        mistakes = [_mistake(model, values, one, entries or {}) for one in own]
    prefix = f"{source}: " if source else ""
    sentences = dict.fromkeys(f"{prefix}{mistake.sentence}" for mistake in mistakes)
    first = mistakes[0]
    raise error("\n".join(sentences), key=first.key, value=first.value, allowed=first.allowed)


class _Mistake(NamedTuple):
    """An error in a value."""

    sentence: str
    key: str
    value: Any
    allowed: str


class _KeyPlace(NamedTuple):
    """Position of a value in a file."""

    entry: str
    """Entry of a list of tables, "phase 2 (ramp): "."""
    key: str
    tables: dict[str, type[BaseModel]]
    """The kinds of table that the value can be, by the tag of each."""
    siblings: list[str]
    """Keys of the table that the value is in."""
    of_list: str
    """Key of the list of tables of which the value is an entry, if any."""


def _mistake(model: type[BaseModel], values: Mapping[str, Any], error: Any, entries: Mapping[str, str]) -> _Mistake:
    kind, value = error["type"], error["input"]
    place = _locate(model, values, error, entries)
    key, known = place.key, ", ".join(place.siblings)
    if kind == "missing":
        return _Mistake(f"{place.entry}{key} is missing; it is required.", key, None, "given")
    if kind == "extra_forbidden":
        hint = did_you_mean(key, place.siblings, () if place.entry else file_keys(model))
        sentence = f"{place.entry}{key} is not a known key{hint}; it must be one of {known}."
        return _Mistake(sentence, key, value, f"one of {known}")
    if kind.startswith("union_tag"):
        key = error["ctx"]["discriminator"].strip("'")
        missing = kind == "union_tag_not_found"
        found = "is missing" if missing else f"is {value[key]!r}{did_you_mean(str(value[key]), place.tables)}"
        allowed = f"one of {', '.join(place.tables)}"
        return _Mistake(f"{place.entry}{key} {found}; it must be {allowed}.", key, value.get(key), allowed)
    problem = str(error["msg"]).removeprefix("Value error, ").removeprefix("Input should be ").rstrip(".")
    if kind != "value_error":
        problem = f"it must be {_needed(error, place, problem)}"
    allowed = problem.partition("it must be ")[2]
    cause = error.get("ctx", {}).get("error")
    if isinstance(cause, Error) and cause.key:
        about = f"{key}.{cause.key}" if key else cause.key
        sentence = f"{place.entry}{key}{': ' if key else ''}{problem}."
        return _Mistake(sentence, about, cause.value, cause.allowed or allowed)
    if not key:
        return _Mistake(f"{place.entry}{problem}.", place.entry, value, allowed)
    shown = "" if isinstance(value, dict) and kind == "value_error" else f" = {value!r}"
    return _Mistake(f"{place.entry}{key}{shown}: {problem}.", key, value, allowed)


def _needed(error: Any, place: _KeyPlace, message: str) -> str:
    """Return what a value must be, where pydantic's message refers to Python types."""
    least, most = (error.get("ctx", {}).get(key, 0) for key in ("min_length", "max_length"))
    table = f"a table, [[{place.of_list}]]" if place.of_list else "a table"
    return {
        "tuple_type": f"a list of tables, [[{place.key}]]" if place.tables else "a list",
        "model_type": table,
        "model_attributes_type": table,
        "dict_type": table,
        "path_type": "the path of a file",
        "too_short": "a list that is not empty" if least == 1 else f"a list of at least {least}",
        "too_long": f"a list of at most {most}",
        "string_too_short": f"text of at least {least} characters",
        "string_too_long": f"text of at most {most} characters",
    }.get(error["type"], message)


def _locate(model: type[BaseModel], values: Any, error: Any, entries: Mapping[str, str]) -> _KeyPlace:
    """Return the position of an error found by pydantic, in the file's terms; values of a list count from 1."""
    tables, siblings, place = {"": model}, list[str](), _KeyPlace("", "", {}, [], "")
    for part in error["loc"]:
        if isinstance(part, int):
            values = dict(enumerate(values)).get(part) if isinstance(values, list | tuple) else None
            entry = f"{entries.get(place.key, place.key)} {part + 1}"
            if tables and isinstance(values, dict):
                name = next((values[key] for key in ("name", "kind") if isinstance(values.get(key), str)), None)
                named = f" ({name})" if name is not None and not error["type"].startswith("union_tag") else ""
                place = _KeyPlace(f"{place.entry}{entry}{named}: ", "", tables, siblings, "")
            elif tables:
                place = place._replace(key=entry, of_list=place.key)
            else:
                place = place._replace(key=f"{place.key} (value {part + 1})")
            continue
        if len(tables) > 1:  # the tag of a union, which is no key of the file
            tables = {part: tables[part]} if part in tables else tables
            continue
        fields = {field.alias or name: field for table in tables.values() for name, field in table.model_fields.items()}
        is_key = part in fields or (isinstance(values, dict) and part in values)
        values = values.get(part) if isinstance(values, dict) else None
        if is_key or error["type"] in ("missing", "extra_forbidden"):
            field = fields.get(part)
            siblings, tables = list(fields), {} if field is None else _tables(field.annotation)
            place = place._replace(key=f"{place.key}.{part}".lstrip("."))
    return place._replace(tables=tables, siblings=siblings)


def _tables(annotation: Any, tag: str = "") -> dict[str, type[BaseModel]]:
    """Return the tables among the types that an annotation is made of, by tag: that of its union, or its kind."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        kind = annotation.model_fields.get("kind")
        return {tag or (str(kind.default) if kind else ""): annotation}
    if get_origin(annotation) is Annotated:
        tag = next((str(one.tag) for one in annotation.__metadata__ if isinstance(one, Tag)), tag)
    return {name: table for option in get_args(annotation) for name, table in _tables(option, tag).items()}
