"""The signals of a run, simulated or recorded: their definitions, and the run that contains them."""

# ruff: noqa: RUF009 - a field's default carries the signal's definition

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, overload

import numpy as np
from numpy.typing import NDArray

from tenodesis import _core, notebook
from tenodesis.errors import ArgumentError

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

Array: TypeAlias = NDArray[np.float64]

TENDONS = ("agonist", "antagonist")
"""The tendons of an axis, in the order of arrays."""


class Signal(NamedTuple):
    """A signal: its SI unit, whether it exists per tendon, and its description."""

    unit: str
    per_tendon: bool
    description: str


def _signal(group: str, unit: str, description: str, *, per_tendon: bool = False) -> Any:
    """Return the default of a signal's field: None, with the signal's definition as metadata."""
    return field(default=None, metadata={"group": group, "signal": Signal(unit, per_tendon, description)})


@dataclass(frozen=True)
class Run:
    """The signals of a run, one row per time step; :data:`SIGNALS` describes each.

    Shapes, for n steps: (n,) and per tendon (n, 2), agonist first; with two axes (n, 2) and (n, 2, 2), axis before
    tendon. A signal that was not recorded is None.
    """

    time: Array
    axes: tuple[str, ...]
    commanded_handle_angle: Array | None = _signal("command", "rad", "Handle angle that the hand aims at")
    force: Array | None = _signal("command", "N", "Tangential force at the tip; positive opposes positive flexion")
    radial_force: Array | None = _signal("command", "N", "Force along the end-effector; positive outward")
    contact_angle: Array | None = _signal("command", "rad", "Output angle at which the tip touches tissue")
    contact_stiffness: Array | None = _signal(
        "command", "N/m", "Tissue's stiffness at the tip: positive in flexion, negative in extension; 0: there is none"
    )
    contact_damping: Array | None = _signal("command", "N*s/m", "Tissue's damping at the tip")
    commanded_spool_velocity: Array | None = _signal(
        "command", "rad/s", "Spool velocity commanded to the drives; positive winds", per_tendon=True
    )
    measured_handle_angle: Array | None = _signal("measured", "rad", "Handle angle by its encoder")
    measured_output_angle: Array | None = _signal(
        "measured", "rad", "Output angle by the distal encoder, which only a bench has"
    )
    measured_tension: Array | None = _signal(
        "measured", "N", "Tendon tension by the load cells beside the spools, or by currents", per_tendon=True
    )
    measured_current: Array | None = _signal(
        "measured", "A", "Motor current, where it gives the measured tension", per_tendon=True
    )
    measured_spool_angle: Array | None = _signal(
        "measured", "rad", "Spool angle by the motors' encoders", per_tendon=True
    )
    handle_angle: Array | None = _signal("truth", "rad", "Handle angle")
    handle_torque: Array | None = _signal("truth", "N*m", "Torque of the hand on the handle")
    output_angle: Array | None = _signal("truth", "rad", "Output angle of the end-effector")
    output_velocity: Array | None = _signal("truth", "rad/s", "Its rate")
    contact_force: Array | None = _signal(
        "truth", "N", "Tangential force of tissue on the tip, mean of the step; positive opposes positive flexion"
    )
    tension: Array | None = _signal("truth", "N", "Tendon tension beside the spool", per_tendon=True)
    distal_tension: Array | None = _signal("truth", "N", "Tendon tension at the tip", per_tendon=True)
    spool_angle: Array | None = _signal("truth", "rad", "Spool angle", per_tendon=True)
    spool_velocity: Array | None = _signal("truth", "rad/s", "Its rate", per_tendon=True)
    estimated_output_angle: Array | None = _signal("control", "rad", "Output angle by the controller's observer")
    estimated_output_angle_std: Array | None = _signal("control", "rad", "Its standard deviation")
    estimated_force: Array | None = _signal("control", "N", "Tangential force at the tip by the observer")
    estimated_force_std: Array | None = _signal("control", "N", "Its standard deviation")
    friction_scale: Array | None = _signal(
        "control", "1", "Estimated friction over that of the controller's instrument file"
    )
    friction_scale_std: Array | None = _signal("control", "1", "Its standard deviation")
    operating_state: Array | None = _signal("control", "1", "0 disabled, 1 enabled, 2 paused, 3 fault")
    faults: Array | None = _signal("control", "1", "Faults as a mask of bits, tenodesis.control.FAULTS in order")
    phase: Array | None = _signal(
        "control", "1", "Of the robust law: 0 rest, 1 track, 2 pull, 3 release, 4 restrained, 5 yielding"
    )
    homing_failure: Array | None = _signal(
        "control", "1", "Why homing failed: number in tenodesis.control.HOMING_REASONS, and 256 per tendon"
    )
    request: Array | None = _signal("control", "1", "Request to the controller, tenodesis.control.Request; 0 none")

    def signals(self) -> dict[str, Array]:
        """Return the signals that were recorded, by name, without the time."""
        named = {name: getattr(self, name) for name in SIGNALS}
        return {name: values for name, values in named.items() if values is not None}

    @overload
    def __getitem__(self, key: str) -> Array: ...
    @overload
    def __getitem__(self, key: slice) -> "Run": ...
    def __getitem__(self, key: str | slice) -> "Array | Run":
        """Return a signal by name, or what lies between two times, s, both included: ``run[1.0:2.5]``, ``run[2.0:]``.

        A step is a number of rows: ``run[::20]``. For rows by number see :meth:`rows`.

        Raises
        ------
        KeyError
            The signal is unknown or was not recorded.
        ArgumentError
            The bounds are whole numbers, which could be seconds or rows.
        """
        if isinstance(key, slice):
            bounds = [bound for bound in (key.start, key.stop) if bound is not None]
            if bounds and not any(isinstance(bound, float) for bound in bounds):
                first, last = ("" if bound is None else bound for bound in (key.start, key.stop))
                raise ArgumentError(
                    f"run[{first}:{last}] could be rows or seconds; it must be run.rows({key.start}, {key.stop}) for "
                    "rows, or have a decimal point for seconds.",
                    key="run",
                    value=key,
                )
            start, stop = -np.inf if key.start is None else key.start, np.inf if key.stop is None else key.stop
            return (self.between(start, stop) if bounds else self).rows(step=key.step)
        values = getattr(self, key) if key in SIGNALS else None
        if values is None:
            raise KeyError(f"{key} is not among the signals; they are {', '.join(self.signals())}")
        return np.asarray(values)

    def between(self, start: float = -np.inf, stop: float = np.inf) -> "Run":
        """Return the rows between two times, s, both included."""
        first, last = np.searchsorted(self.time, start, "left"), np.searchsorted(self.time, stop, "right")
        return self.rows(int(first), int(last))

    def rows(self, first: int | None = None, last: int | None = None, step: int | None = None) -> "Run":
        """Return every step-th row from the first on, before the last, as slices count: ``run.rows(-100)``."""
        return self._map(lambda values: values[first:last:step])

    @property
    def fault_times(self) -> dict[str, float]:
        """When each fault of the controller came first, s, by name, in the order of time; empty without any."""
        if self.faults is None or not len(self):
            return {}
        masks = np.bitwise_or.reduce(np.nan_to_num(self.faults).astype(np.int64).reshape(len(self), -1), axis=1)
        rows = {name: np.flatnonzero(masks >> bit & 1) for bit, (name, _, _) in enumerate(_core.faults())}
        first = sorted((int(found[0]), name) for name, found in rows.items() if found.size)
        times = np.atleast_1d(self.time)
        return {name: float(times[row]) for row, name in first}

    def to_pandas(self) -> "pd.DataFrame":
        """Return a DataFrame with a column per signal and axis or tendon, over the time in s.

        Raises
        ------
        MissingExtraError
            pandas is not installed.
        """
        import tenodesis as tn  # noqa: PLC0415 - by the public name, since tables stand above runs

        return tn.recording.to_pandas(self)

    def axis(self, name: str) -> "Run":
        """Return the run of a single axis, with signals of shape (n,), per tendon (n, 2).

        Raises
        ------
        KeyError
            There is no such axis.
        """
        if name not in self.axes:
            raise KeyError(f"{name} is not among the axes; they are {', '.join(self.axes)}")
        if len(self.axes) == 1:
            return self
        index = self.axes.index(name)
        own: dict[str, Any] = {key: values[:, index] for key, values in self.signals().items()}
        return replace(self, axes=(name,), **own)

    def plot(self, *signals: str) -> "Figure":
        """Return a figure of signals over time: those named, or angles, tensions and forces; see :mod:`tenodesis.plot`.

        Raises
        ------
        KeyError
            A signal is unknown or was not recorded.
        """
        import tenodesis as tn  # noqa: PLC0415 - by the public name, since figures stand above runs

        return tn.plot.run(self, signals)

    def _map(self, change: Callable[[Array], Array]) -> "Run":
        """Return this run with its time and all signals changed alike."""
        changed: dict[str, Any] = {key: change(values) for key, values in self.signals().items()}
        return replace(self, time=change(self.time), **changed)

    def __len__(self) -> int:
        return int(self.time.size)

    def __repr__(self) -> str:
        faults = ", ".join(self.fault_times)
        return f"<Run of {self._extent}, {len(self.signals())} signals{', faults: ' * bool(faults)}{faults}>"

    def _repr_html_(self) -> str:
        """Return a table for notebooks: of every signal its unit, its range, and its value at the end."""
        rows = [
            _row(SIGNALS[name], name, values if np.ndim(self.time) else values[np.newaxis])
            for name, values in self.signals().items()
        ]
        faults = ", ".join(f"{name} from {time:.6g} s" for name, time in self.fault_times.items())
        title = f"Run of {self._extent}" + (f", faults: {faults}" if faults else "")
        return notebook.table(title, ("signal", "unit", "least", "largest", "at the end", "meaning"), rows)

    @property
    def _extent(self) -> str:
        """Rows, times and axes in words."""
        times = np.atleast_1d(self.time)
        span = f", {times[0]:.6g} to {times[-1]:.6g} s" if times.size else ""
        return f"{times.size} rows{span}, {' and '.join(self.axes)}"


def _row(signal: Signal, name: str, values: Array) -> tuple[str, ...]:
    finite = values[np.isfinite(values)]
    bounds = (f"{finite.min():.4g}", f"{finite.max():.4g}") if finite.size else ("–", "–")
    end = ", ".join(f"{value:.4g}" for value in np.ravel(values[-1:]))
    return name, signal.unit, *bounds, end, signal.description


SIGNALS: dict[str, Signal] = {one.name: one.metadata["signal"] for one in fields(Run) if one.metadata}
"""Definition of each signal, by its name."""


def _group(group: str) -> dict[str, Signal]:
    return {one.name: SIGNALS[one.name] for one in fields(Run) if one.metadata.get("group") == group}


COMMANDS = _group("command")
"""Inputs to the instrument."""

MEASURED = _group("measured")
"""Sensor readings, sampled and held."""

TRUTH = _group("truth")
"""Signals that only a twin has, and no bench."""

TISSUE = tuple(name for name in COMMANDS if name.startswith("contact_"))
"""The commands among them that describe tissue, which only some runs have."""

CONTROL = _group("control")
"""Estimates, outputs and requests of a controller; NaN while it does not run."""


def concatenate(runs: Sequence[Run]) -> Run:
    """Return consecutive runs joined into one.

    Raises
    ------
    ValueError
        There is none, or they have different axes or signals.
    """
    if not runs:
        raise ArgumentError(key="runs", value=runs, allowed="one run or more")
    first = runs[0]
    names = tuple(first.signals())
    if any(run.axes != first.axes or tuple(run.signals()) != names for run in runs):
        raise ArgumentError("the runs differ in axes or signals; they must have the same.", key="runs")
    joined: dict[str, Any] = {name: np.concatenate([getattr(run, name) for run in runs]) for name in ("time", *names)}
    return replace(first, **joined)
