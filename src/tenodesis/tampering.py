"""Faults between an instrument and its controller: what a signal shows instead, and when."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tenodesis import _core

PLACES = tuple(_core.fault_injection_places())
"""Signals that can be tampered with: sensors, spool velocities on their way to the drives, and the tick itself."""

Place: TypeAlias = Literal[
    "handle_angle",
    "tension.agonist",
    "tension.antagonist",
    "spool_angle.agonist",
    "spool_angle.antagonist",
    "spool_velocity.agonist",
    "spool_velocity.antagonist",
    "tick",
]
_MODES = ("none", "add", "set", "hold")


@dataclass(frozen=True)
class Tampering:
    """One signal tampered with for a time: a value added, set instead, or the last one held.

    Of ``tick``, ``hold`` leaves ticks out and ``add`` moves their time, s.

    Raises
    ------
    ValueError
        There is no such place or mode.
    """

    place: Place
    mode: Literal["add", "set", "hold"]
    value: float = 0.0
    rate: float = 0.0
    """Growth of the value per second."""
    start: float = 0.0
    stop: float = inf
    axis: str | None = None
    """All axes if not given."""

    def __post_init__(self) -> None:
        if self.place not in PLACES:
            raise ValueError(f"place is {self.place!r}; allowed are {', '.join(PLACES)}.")
        if self.mode not in _MODES[1:]:
            raise ValueError(f"mode is {self.mode!r}; allowed are {', '.join(_MODES[1:])}.")


def tampered(
    tampering: Sequence[Tampering], axes: tuple[str, ...], start: float, time: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """Return values and modes by axis, step and place, as the core takes them; start: of the first step, s.

    Raises
    ------
    ValueError
        An instrument has no such axis.
    """
    values = np.zeros((len(axes), time.size, len(PLACES)))
    modes = np.zeros(values.shape, np.uint8)
    for one in tampering:
        if one.axis is not None and one.axis not in axes:
            raise ValueError(f"axis is {one.axis!r}; allowed are {', '.join(axes)}.")
        if one.stop <= start:
            continue
        during = (time > one.start) & (time <= one.stop)
        place = PLACES.index(one.place)
        for n, axis in enumerate(axes):
            if one.axis in (None, axis):
                values[n, during, place] = one.value + one.rate * (time[during] - one.start)
                modes[n, during, place] = _MODES.index(one.mode)
    return values, modes
