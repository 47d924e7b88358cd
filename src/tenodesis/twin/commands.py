"""The commands of a twin, by argument and by column, and what is refused before a run."""

from math import degrees

import numpy as np

from tenodesis import _core
from tenodesis._core import Status
from tenodesis.errors import NoSolutionError
from tenodesis.instrument import Instrument
from tenodesis.run import Array

COMMANDS = _core.twin_commands()
ARGUMENTS: dict[str, int | slice] = {
    **{name: COMMANDS.index(name) for name in ("handle_angle", "force", "radial_force", "weight")},
    "spool_velocity": slice(4, 6),
    "sheath_bend": COMMANDS.index("sheath_bend"),
    "let_out": slice(7, 9),
}
"""Columns of a command, by the argument that fills them."""
PER_TENDON = ("spool_velocity", "let_out")
TENDONS = ("agonist", "antagonist")


def check_seed(seed: int) -> None:
    """Raise ValueError for a seed that is no whole number from 0 to 2**64 - 1."""
    if not isinstance(seed, int | np.integer) or isinstance(seed, bool) or not 0 <= seed < 2**64:
        raise ValueError(f"seed is {seed!r}; allowed is a whole number from 0 to 2**64 - 1.")


def refuse_not_finite(name: str, array: Array) -> None:
    """Raise ValueError for the first value that is not finite."""
    finite = np.isfinite(array)
    if not finite.all():
        at = tuple(int(i) for i in np.unravel_index(int(np.argmin(finite)), array.shape))
        place = f"[{', '.join(str(i) for i in at)}]" if at else ""
        raise ValueError(f"{name}{place} is {array[at]}; allowed is a finite number.")


def refuse_beyond_range(inst: Instrument, handle_angle: Array, axis: str) -> None:
    """Raise ValueError for the first handle angle, rad, shape (n,), beyond the handle's range."""
    wrong = np.flatnonzero(np.abs(handle_angle) > inst.handle_range + 1e-9)
    if wrong.size:
        at = int(wrong[0])
        raise ValueError(
            f"handle_angle[{at}]{f' of {axis}' if axis else ''} is {handle_angle[at]:.6g} rad "
            f"({degrees(handle_angle[at]):.4g} deg); allowed is the handle's range of "
            f"±{degrees(inst.handle_range):.4g} deg."
        )


def refuse_without_rig(inst: Instrument) -> None:
    """Raise ValueError for an instrument on which the load rig has no pulley to hang a weight on."""
    if inst.conditions.cable_pulley_radius is None:
        raise ValueError(
            f"weight is given, but {inst.name} has no conditions.cable_pulley_radius; allowed is a force, or that key."
        )


def lost(status: Status, place: str) -> Exception:
    """Return the exception for a run that the core ended at a place."""
    if status == Status.OUT_OF_RANGE:
        return NoSolutionError(
            f"at {place} the handle was pushed beyond its range; allowed is a smaller load or angle."
        )
    if status == Status.NOT_FINITE:
        return ValueError(f"at {place} a command is not finite; allowed is a finite number.")
    return NoSolutionError(
        f"at {place} the tip finds no equilibrium: the load is past what the tendons can hold; allowed is a smaller "
        "load or more pretension."
    )
