"""The signals of a run, of the twin's or a bench's: what each is, and the run that holds them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple, TypeAlias, overload

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]


class Signal(NamedTuple):
    """One signal: its SI unit, whether each tendon has its own, and what it is."""

    unit: str
    per_tendon: bool
    description: str


COMMANDS = {
    "commanded_handle_angle": Signal("rad", False, "Handle angle that the hand aims at"),
    "force": Signal("N", False, "Tangential force at the tip; positive opposes positive flexion"),
    "radial_force": Signal("N", False, "Force along the end-effector; positive outward"),
    "commanded_spool_velocity": Signal("rad/s", True, "Spool velocity asked of the drives; positive winds"),
}
"""What is done to the instrument."""

MEASURED = {
    "measured_handle_angle": Signal("rad", False, "Handle angle by its encoder"),
    "measured_output_angle": Signal("rad", False, "Output angle by the distal encoder, which only a bench has"),
    "measured_tension": Signal("N", True, "Tendon tension by the load cells beside the spools"),
    "measured_spool_angle": Signal("rad", True, "Spool angle by the motors' encoders"),
}
"""What sensors say; sampled and held."""

TRUTH = {
    "handle_angle": Signal("rad", False, "Handle angle"),
    "handle_torque": Signal("N*m", False, "Torque the hand holds the handle with"),
    "output_angle": Signal("rad", False, "Output angle of the end-effector"),
    "output_velocity": Signal("rad/s", False, "Its rate"),
    "tension": Signal("N", True, "Tendon tension beside the spool"),
    "distal_tension": Signal("N", True, "Tendon tension at the tip"),
    "spool_angle": Signal("rad", True, "Spool angle"),
    "spool_velocity": Signal("rad/s", True, "Its rate"),
}
"""What the twin knows and no bench does."""

CONTROL = {
    "estimated_output_angle": Signal("rad", False, "Output angle by the controller's observer"),
    "estimated_output_angle_std": Signal("rad", False, "Its standard deviation"),
    "estimated_force": Signal("N", False, "Tangential force at the tip by the observer"),
    "estimated_force_std": Signal("N", False, "Its standard deviation"),
    "friction_scale": Signal("1", False, "Friction there is over the friction the controller was told"),
    "friction_scale_std": Signal("1", False, "Its standard deviation"),
    "operating_state": Signal("1", False, "0 disabled, 1 enabled, 2 paused, 3 fault"),
    "faults": Signal("1", False, "Faults as a mask of bits, tenodesis.control.FAULTS in order"),
    "phase": Signal("1", False, "Of the robust law: 0 rest, 1 track, 2 pull, 3 release"),
    "request": Signal("1", False, "What it was asked, a number of tenodesis.control.Request; 0 nothing"),
}
"""What a controller says of itself, NaN as long as it does not run, and what it was asked."""

SIGNALS = COMMANDS | MEASURED | TRUTH | CONTROL


@dataclass(frozen=True)
class Run:
    """The signals of a run, one row per time step; :data:`SIGNALS` says what each is.

    Shapes, for n steps: (n,) and per tendon (n, 2), agonist first; with two axes (n, 2) and (n, 2, 2), axis before
    tendon. A signal that was not recorded is None.
    """

    time: Array
    axes: tuple[str, ...]
    commanded_handle_angle: Array | None = None
    force: Array | None = None
    radial_force: Array | None = None
    commanded_spool_velocity: Array | None = None
    measured_handle_angle: Array | None = None
    measured_output_angle: Array | None = None
    measured_tension: Array | None = None
    measured_spool_angle: Array | None = None
    handle_angle: Array | None = None
    handle_torque: Array | None = None
    output_angle: Array | None = None
    output_velocity: Array | None = None
    tension: Array | None = None
    distal_tension: Array | None = None
    spool_angle: Array | None = None
    spool_velocity: Array | None = None
    estimated_output_angle: Array | None = None
    estimated_output_angle_std: Array | None = None
    estimated_force: Array | None = None
    estimated_force_std: Array | None = None
    friction_scale: Array | None = None
    friction_scale_std: Array | None = None
    operating_state: Array | None = None
    faults: Array | None = None
    phase: Array | None = None
    request: Array | None = None

    def signals(self) -> dict[str, Array]:
        """Return the signals that are there, by name, without the time."""
        named = {field.name: getattr(self, field.name) for field in fields(self) if field.name in SIGNALS}
        return {name: values for name, values in named.items() if values is not None}

    @overload
    def __getitem__(self, key: str) -> Array: ...
    @overload
    def __getitem__(self, key: slice) -> "Run": ...
    def __getitem__(self, key: str | slice) -> "Array | Run":
        """Return a signal by name, or the rows of a slice as a run of their own.

        Raises
        ------
        KeyError
            The signal is unknown or was not recorded.
        """
        if isinstance(key, slice):
            return self._map(lambda values: values[key])
        values = getattr(self, key) if key in SIGNALS else None
        if values is None:
            raise KeyError(f"{key} is not among the signals; there are {', '.join(self.signals())}")
        return np.asarray(values)

    def between(self, start: float = -np.inf, stop: float = np.inf) -> "Run":
        """Return the rows from a time to another one, s, both included."""
        first, last = np.searchsorted(self.time, start, "left"), np.searchsorted(self.time, stop, "right")
        return self[int(first) : int(last)]

    def axis(self, name: str) -> "Run":
        """Return the run of one axis alone, its signals of shape (n,) and per tendon (n, 2).

        Raises
        ------
        KeyError
            There is no such axis.
        """
        if name not in self.axes:
            raise KeyError(f"{name} is not among the axes; there are {', '.join(self.axes)}")
        if len(self.axes) == 1:
            return self
        number = self.axes.index(name)
        own: dict[str, Any] = {key: values[:, number] for key, values in self.signals().items()}
        return replace(self, axes=(name,), **own)

    def _map(self, change: Callable[[Array], Array]) -> "Run":
        """Return this run with its time and all signals changed alike."""
        changed: dict[str, Any] = {key: change(values) for key, values in self.signals().items()}
        return replace(self, time=change(self.time), **changed)

    def __len__(self) -> int:
        return int(self.time.size)


def concatenate(runs: Sequence[Run]) -> Run:
    """Return runs, one after another, as one.

    Raises
    ------
    ValueError
        There is none, or they have different axes or signals.
    """
    if not runs:
        raise ValueError("there is no run; allowed are one or more.")
    first = runs[0]
    names = tuple(first.signals())
    if any(run.axes != first.axes or tuple(run.signals()) != names for run in runs):
        raise ValueError("the runs differ in axes or signals; allowed are runs that have the same.")
    whole: dict[str, Any] = {name: np.concatenate([getattr(run, name) for run in runs]) for name in ("time", *names)}
    return replace(first, **whole)
