"""Any instrument as joints and tendons."""

from pathlib import Path

from tenodesis import instrument
from tenodesis.errors import InstrumentError
from tenodesis.instrument import FullForm, InstrumentLike, as_instrument, expanded

CoupledLike = InstrumentLike


def parse(text: str, source: str = "instrument") -> FullForm:
    """Return the instrument of a text as joints and tendons."""
    return expanded(instrument.parse(text, source))


load = of_planar = expanded


def is_coupled(name_or_path: str | Path) -> bool:
    """Return whether this is the name or the file of an instrument that lists joints and tendons."""
    try:
        return isinstance(as_instrument(name_or_path), FullForm)
    except InstrumentError:
        return False


def shipped() -> tuple[str, ...]:
    """Return the names of the shipped instruments that list joints and tendons."""
    return tuple(name for name in instrument.shipped() if is_coupled(name))
