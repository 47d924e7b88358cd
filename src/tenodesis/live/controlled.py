"""What a live instrument's controller serves, if it has one."""

from functools import lru_cache

from tenodesis.control.pairs import compensated, names_of
from tenodesis.errors import ArgumentError
from tenodesis.instrument import Instrument, ShortForm
from tenodesis.run import Names


@lru_cache(maxsize=16)
def controlled(inst: Instrument) -> tuple[ShortForm | None, str | None]:
    """Return what an instrument's controller is made for, or None and in a sentence why it has none."""
    try:
        return compensated(inst), None
    except ArgumentError as problem:
        return None, str(problem)


@lru_cache(maxsize=16)
def live_names(inst: Instrument) -> Names:
    """Return what the columns of a live instrument are named after; without a controller none is compensated."""
    names = names_of(inst)
    return names if controlled(inst)[0] is not None else names._replace(compensated=())
