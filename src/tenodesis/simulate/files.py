"""Protocol files."""

from pathlib import Path

from tenodesis.errors import ProtocolError
from tenodesis.files import parse_toml, read_text, validated
from tenodesis.simulate.protocol import Protocol

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
    text = read_text(path, ProtocolError, source=source, kind="protocol", names=shipped())
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
    context = {"file": True, "folder": folder or Path()}
    values = parse_toml(text, ProtocolError, source)
    return validated(Protocol, values, ProtocolError, source, context=context, entries={"phases": "phase"})
