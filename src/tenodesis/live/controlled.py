"""What a live instrument's controller serves, if it has one."""

from functools import lru_cache

from tenodesis.control.pairs import Pair, compensated, names_of, pairs, served_motors
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


def serves_all(inst: Instrument) -> bool:
    """Whether a live instrument's controller is that of all joints: where no joint has a pair of its own."""
    return controlled(inst)[0] is None


def served_pairs(inst: Instrument) -> dict[str, Pair]:
    """Return the pairs of tendons that a live instrument's controller commands, by axis; none without a controller."""
    return pairs(inst) if controlled(inst)[0] is not None else {}


def free_motors(inst: Instrument) -> list[int]:
    """Return the tendons whose motors no controller commands, by number."""
    taken = [] if serves_all(inst) else served_motors(inst, all_joints=False)
    return [n for n, one in enumerate(inst.tendons) if one.start == "spool" and n not in taken]


@lru_cache(maxsize=16)
def live_names(inst: Instrument) -> Names:
    """Return what the columns of a live instrument are named after."""
    names = names_of(inst)
    return names._replace(compensated=names.joints) if serves_all(inst) else names
