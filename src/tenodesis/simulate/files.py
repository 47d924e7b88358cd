"""Protocol files."""

import tomllib
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from tenodesis.errors import ProtocolError
from tenodesis.simulate.protocol import AnyPhase, Protocol

KINDS: dict[str, type[BaseModel]] = {kind.model_fields["kind"].default: kind for kind in get_args(AnyPhase)}
"""Phases by their kind."""

_SHIPPED = Path(__file__).parent / "shipped"


def shipped() -> tuple[str, ...]:
    """Return the names of the protocols that come with the package."""
    return tuple(sorted(file.stem for file in _SHIPPED.glob("*.toml")))


def load(name_or_path: str | Path) -> Protocol:
    """Read a protocol that comes with the package, by name, or a protocol file, by path.

    Raises
    ------
    ProtocolError
        There is no such protocol or file, it cannot be read, or it is not valid.
    """
    source = str(name_or_path)
    path = _SHIPPED / f"{source}.toml" if source in shipped() else Path(name_or_path)
    try:
        text = path.read_text("utf-8-sig")
    except (FileNotFoundError, IsADirectoryError, NotADirectoryError):
        raise ProtocolError(
            f"{source}: there is no such file and no protocol of that name; "
            f"allowed is the path of a TOML file or one of {', '.join(shipped())}."
        ) from None
    except UnicodeDecodeError:
        raise ProtocolError(f"{source} is not UTF-8 text; allowed is a TOML file.") from None
    except OSError as problem:
        raise ProtocolError(f"{source} cannot be read: {problem.strerror}.") from None
    except ValueError:
        raise ProtocolError(f"{source!r} is no path; allowed is the path of a TOML file.") from None
    return parse(text, source, folder=path.parent)


def parse(text: str, source: str = "protocol", *, folder: Path | None = None) -> Protocol:
    """Read a protocol from the text of a protocol file.

    Parameters
    ----------
    text
        The text.
    source
        What messages start with.
    folder
        Where recorded motions are; the working directory if not given.

    Raises
    ------
    ProtocolError
        The text is not TOML or not a valid protocol.
    """
    try:
        values = tomllib.loads(text)
    except tomllib.TOMLDecodeError as problem:
        raise ProtocolError(f"{source} is not valid TOML: {problem}.") from None
    except RecursionError:
        raise ProtocolError(f"{source} is not valid TOML: it is nested too deeply.") from None
    try:
        return Protocol.model_validate(values, context={"file": True, "folder": folder or Path()})
    except ValidationError as invalid:
        sentences = [_sentence(error) for error in invalid.errors(include_url=False)]
        raise ProtocolError("\n".join(f"{source}: {sentence}" for sentence in sentences)) from None


def _sentence(error: Any) -> str:
    """Say what is wrong with one value: its phase and key, what it is, and what is allowed."""
    location = error["loc"]
    if location[:1] != ("phases",) or len(location) == 1:
        return _of_key(error, location, Protocol)
    phase = f"phase {location[1] + 1}"
    if len(location) == 2:
        return f"{phase}{_of_kind(error)}"
    kind = location[2]
    return f"{phase} ({kind}): {_of_key(error, location[3:], KINDS[kind])}"


def _of_kind(error: Any) -> str:
    """Say what is wrong with a phase that is of no kind."""
    kinds = ", ".join(KINDS)
    if error["type"] == "union_tag_not_found":
        return f": kind is missing; allowed are {kinds}."
    if error["type"] == "union_tag_invalid":
        return f": kind is {error['input']['kind']!r}; allowed are {kinds}."
    return f" is {error['input']!r}; allowed is a table, [[phases]]."


def _of_key(error: Any, location: tuple[Any, ...], model: type[BaseModel]) -> str:
    key = ".".join(str(part) for part in location)
    told = str(error["msg"]).removeprefix("Value error, ").removeprefix("Input should be ").rstrip(".")
    if error["type"] == "missing":
        return f"{key} is missing; it is required."
    if error["type"] == "extra_forbidden":
        known = [field.alias or name for name, field in model.model_fields.items()]
        return f"{key} is not a known key; allowed are {', '.join(known)}."
    if not key:
        return f"{told}."
    if error["type"] == "path_type":
        told = "the path of a CSV file"
    if error["type"] == "tuple_type":
        told = "a list; phases are one, of tables [[phases]]" if key == "phases" else "a list"
    if error["type"] != "value_error":
        told = f"it must be {told}"
    return f"{key} = {error['input']!r}: {told}."
