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
_MODES = ("none", "add", "set", "hold")


@dataclass(frozen=True)
class FaultInjection:
    """A fault of a signal for a time: a value added, a value set instead, or the last value held.

    On ``tick``, ``hold`` leaves ticks out and ``add`` shifts their time, s.

    Raises
    ------
    ArgumentError
        There is no such point or mode.
    """

    point: InjectionPoint
    mode: Literal["add", "set", "hold"]
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
        if self.mode not in _MODES[1:]:
            raise ArgumentError(key="mode", value=self.mode, allowed=f"one of {', '.join(_MODES[1:])}")

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
            The instrument has no such axis.
        """
        if self.axis is not None and self.axis not in axes:
            raise ArgumentError(key="axis", value=self.axis, allowed=f"one of {', '.join(axes)}")
        if self.stop <= start:
            return
        during = (time > self.start) & (time <= self.stop)
        point = INJECTION_POINTS.index(self.point)
        for n, axis in enumerate(axes):
            if self.axis in (None, axis):
                values[n, during, point] = self.value + self.rate * (time[during] - self.start)
                modes[n, during, point] = _MODES.index(self.mode)
