"""Fault injection between an instrument and its controller: the false value of a signal, and when it applies."""

from dataclasses import dataclass
from math import inf
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tenodesis import _core
from tenodesis.errors import ArgumentError

INJECTION_POINTS = tuple(_core.fault_injection_points())
"""Signals that a fault can be injected into: sensors, spool velocities on their way to the drives, and the tick."""

InjectionPoint: TypeAlias = Literal[
    "handle_angle",
    "tension.agonist",
    "tension.antagonist",
    "spool_angle.agonist",
    "spool_angle.antagonist",
    "spool_velocity.agonist",
    "spool_velocity.antagonist",
    "tick",
]
INJECTION_MODES = ("none", "add", "set", "hold", "scale", "swap")
"""What a fault does to a signal, in the order of the core."""


def check_mode(point: str, mode: str) -> None:
    """Check that a fault of this mode can be injected at this point.

    Raises
    ------
    ArgumentError
        It cannot.
    """
    if (mode == "swap" and "." not in point) or (mode == "scale" and point == "tick"):
        where = ", ".join(one for one in INJECTION_POINTS if ("." in one if mode == "swap" else one != "tick"))
        raise ArgumentError(f"mode is {mode} at {point}; it may be at {where}.", key="mode", value=mode, allowed=where)


@dataclass(frozen=True)
class FaultInjection:
    """A fault of a signal for a time.

    A value is added (``add``), set instead (``set``) or a gain (``scale``); the last value is held (``hold``); or the
    two tendons' signals are exchanged (``swap``, at either of the two). On ``tick``, ``hold`` leaves ticks out,
    ``add`` shifts their time, s, and ``set`` sets it.

    Raises
    ------
    ArgumentError
        There is no such point or mode, or not this mode at this point.
    """

    point: InjectionPoint
    mode: Literal["add", "set", "hold", "scale", "swap"]
    value: float = 0.0
    rate: float = 0.0
    """Growth of the value per second."""
    start: float = 0.0
    stop: float = inf
    axis: str | None = None
    """All axes if not given."""

    def __post_init__(self) -> None:
        if self.point not in INJECTION_POINTS:
            raise ArgumentError(key="point", value=self.point, allowed=f"one of {', '.join(INJECTION_POINTS)}")
        if self.mode not in INJECTION_MODES[1:]:
            raise ArgumentError(key="mode", value=self.mode, allowed=f"one of {', '.join(INJECTION_MODES[1:])}")
        check_mode(self.point, self.mode)

    def schedule(
        self,
        axes: tuple[str, ...],
        start: float,
        time: NDArray[np.float64],
        values: NDArray[np.float64],
        modes: NDArray[np.uint8],
    ) -> None:
        """Write this fault into the values and modes for the core.

        Parameters
        ----------
        axes
            Names of the instrument's axes.
        start
            Time of the first step, s.
        time
            Time of each step, s, shape (n,).
        values, modes
            What to write to: the value and the number of the mode, shape (axes, n, points).

        Raises
        ------
        ArgumentError
            The instrument has no such axis, or another fault is at this point at the same time.
        """
        if self.axis is not None and self.axis not in axes:
            raise ArgumentError(key="axis", value=self.axis, allowed=f"one of {', '.join(axes)}")
        if self.stop <= start:
            return
        during = (time > self.start) & (time <= self.stop)
        point = INJECTION_POINTS.index(self.point)
        for n, axis in enumerate(axes):
            if self.axis in (None, axis):
                if modes[n, during, point].any():
                    raise ArgumentError(
                        f"two faults are at {self.point} at the same time; give one after the other.", key="point"
                    )
                values[n, during, point] = self.value + self.rate * (time[during] - self.start)
                modes[n, during, point] = INJECTION_MODES.index(self.mode)
