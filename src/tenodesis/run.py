"""The signals of a run, simulated or recorded: their definitions, and the run that contains them."""

# ruff: noqa: RUF009 - a field's default carries the signal's definition

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Self, TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tenodesis import _core, notebook
from tenodesis.errors import ArgumentError

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

Array: TypeAlias = NDArray[np.float64]

TENDONS = ("agonist", "antagonist")
"""The tendons of a joint that has a pair of its own, in the order of arrays."""

COMPONENTS = ("fx", "fy", "fz", "mx", "my", "mz")
"""Components of a wrench, in the order of arrays."""

ACROSS = {"yaw": "fx", "pitch": "fy"}
"""The component of a wrench at the tip that bends a joint, by the joint's axis."""

Owner: TypeAlias = Literal["joints", "handle_joints", "tendons", "compensated", "components", "run"]
"""What a signal has a column for each of; "run": it has one alone."""


class Signal(NamedTuple):
    """A signal: its SI unit, what it has columns of, and its description."""

    unit: str
    of: Owner
    description: str

    @property
    def per_tendon(self) -> bool:
        """Whether it has a column per tendon."""
        return self.of == "tendons"


class Names(NamedTuple):
    """What the columns of a run are named after."""

    joints: tuple[str, ...]
    """Of the tip."""
    handle_joints: tuple[str, ...]
    tendons: tuple[str, ...]
    compensated: tuple[str, ...] = ()
    """Joints of the tip that a controller serves, in its order."""

    @classmethod
    def paired(cls, joints: Sequence[str]) -> Self:
        """Return the names where every joint has a joint at the handle and two tendons of its own."""
        tendons = tuple(f"{joint}_{side}" for joint in joints for side in TENDONS)
        return cls(tuple(joints), tuple(f"handle_{joint}" for joint in joints), tendons, tuple(joints))

    def columns(self, signal: str) -> tuple[str, ...]:
        """Return the names of a signal's columns; empty if it has one alone."""
        of = SIGNALS[signal].of
        if of == "run":
            return ()
        return COMPONENTS if of == "components" else getattr(self, of)

    def headings(self, signal: str) -> tuple[str, ...]:
        """Return the names of a signal's columns in tables: ``tension.pitch_wound``, ``wrench.fx``, ``grip_force``.

        Where every joint has a joint of the handle and a pair of tendons of its own, ``handle_angle.yaw`` and
        ``tension.yaw.agonist``.
        """
        columns = self.columns(signal)
        if self[:3] == Names.paired(self.joints)[:3]:
            if SIGNALS[signal].of == "handle_joints":
                columns = self.joints
            elif SIGNALS[signal].per_tendon:
                columns = tuple(f"{joint}.{side}" for joint in self.joints for side in TENDONS)
        return tuple(f"{signal}.{column}" for column in columns) or (signal,) * (SIGNALS[signal].of == "run")

    def shape(self, signal: str, rows: int) -> tuple[int, ...]:
        """Return the shape of a signal of so many rows."""
        columns = len(self.columns(signal))
        single = SIGNALS[signal].of == "run" or (columns == 1 and not SIGNALS[signal].per_tendon)
        return (rows,) if single else (rows, columns)

    def arcs(self, signal: str, name: str) -> list[int]:
        """Return the numbers of a signal's columns of a backbone's arcs, NAME_arc1 and on; of another column, its own.

        Raises KeyError as :meth:`column`.
        """
        columns = self.columns(signal)
        arcs = [n for n, one in enumerate(columns) if re.fullmatch(rf"{re.escape(name)}_arc\d+", one)]
        is_backbone = name not in columns and len(arcs) > 1 and SIGNALS[signal].of == "joints"
        return arcs if is_backbone else [self.column(signal, name)]

    def column(self, signal: str, name: str) -> int:
        """Return the number of a signal's column by its name, or by an end of it that no other has: ``agonist``.

        Raises KeyError if there is no such column.
        """
        columns, wanted = self.columns(signal), name.replace(".", "_")
        found = [wanted] if wanted in columns else [one for one in columns if one.endswith(f"_{wanted}")]
        if len(found) != 1:
            raise KeyError(f"{name} is not among the columns of {signal}; they are {', '.join(columns) or 'none'}")
        return columns.index(found[0])


def _signal(group: str, unit: str, of: Owner, description: str) -> Any:
    """Return the default of a signal's field: None, with the signal's definition as metadata."""
    return field(default=None, metadata={"group": group, "signal": Signal(unit, of, description)})


@dataclass(frozen=True)
class Run:
    """The signals of a run, one row per time step; :data:`SIGNALS` describes each.

    A signal has a column per joint, joint of the handle, tendon or component, named as :meth:`columns` gives them:
    ``run["tension.pitch_wound"]`` is one of ``run["tension"]``. Shapes, for n steps: (n, columns), agonist before
    antagonist; (n,) with one joint. Tendons and components always have an axis of their own. A signal that was not
    recorded is None.

    Without tendons named, every joint has a joint at the handle and two tendons of its own, as in a planar instrument.
    """

    time: Array
    joints: tuple[str, ...]
    handle_joints: tuple[str, ...] = ()
    tendons: tuple[str, ...] = ()
    compensated: tuple[str, ...] = ()
    """Joints of the tip that a controller serves, in its order."""
    commanded_handle_angle: Array | None = _signal(
        "command", "rad", "handle_joints", "Handle angle that the hand aims at"
    )
    commanded_output_angle: Array | None = _signal(
        "command", "rad", "joints", "Output angle commanded to a tool without a handle, as its law aims at it"
    )
    force: Array | None = _signal(
        "command", "N", "joints", "Tangential force at the tip; positive opposes positive flexion"
    )
    radial_force: Array | None = _signal("command", "N", "joints", "Force along the end-effector; positive outward")
    contact_angle: Array | None = _signal("command", "rad", "joints", "Output angle at which the tip touches tissue")
    contact_stiffness: Array | None = _signal(
        "command",
        "N/m",
        "joints",
        "Tissue's stiffness at the tip: positive in flexion, negative in extension; 0: there is none",
    )
    contact_damping: Array | None = _signal("command", "N*s/m", "joints", "Tissue's damping at the tip")
    wrench: Array | None = _signal("command", "N, N*m", "components", "Force and moment on the tip: x, y, z of either")
    applied_grip_force: Array | None = _signal(
        "command", "N", "run", "Force that presses the jaws apart, besides that of what they hold"
    )
    held_opening: Array | None = _signal(
        "command", "m", "run", "Opening of the jaws below which they press what they hold, by the arms of the grip"
    )
    held_stiffness: Array | None = _signal("command", "N/m", "run", "Stiffness of what they hold; 0: it is nothing")
    held_damping: Array | None = _signal("command", "N*s/m", "run", "Its damping")
    commanded_spool_velocity: Array | None = _signal(
        "command", "rad/s", "tendons", "Spool velocity commanded to the drives; positive winds"
    )
    commanded_spool_tension: Array | None = _signal(
        "command", "N", "tendons", "Tension that the drives hold whatever their spools do; 0: they follow the velocity"
    )
    measured_handle_angle: Array | None = _signal("measured", "rad", "handle_joints", "Handle angle by its encoder")
    measured_output_angle: Array | None = _signal(
        "measured", "rad", "joints", "Output angle by the distal encoder, which only a bench has"
    )
    measured_tension: Array | None = _signal(
        "measured", "N", "tendons", "Tendon tension by the load cells beside the spools, or by currents"
    )
    measured_current: Array | None = _signal(
        "measured", "A", "tendons", "Motor current, where it gives the measured tension"
    )
    measured_spool_angle: Array | None = _signal("measured", "rad", "tendons", "Spool angle by the motors' encoders")
    handle_angle: Array | None = _signal("truth", "rad", "handle_joints", "Handle angle")
    handle_torque: Array | None = _signal("truth", "N*m", "handle_joints", "Torque of the hand on the handle")
    output_angle: Array | None = _signal("truth", "rad", "joints", "Output angle of the end-effector")
    output_velocity: Array | None = _signal("truth", "rad/s", "joints", "Its rate")
    contact_force: Array | None = _signal(
        "truth",
        "N",
        "joints",
        "Tangential force of tissue on the tip, mean of the step; positive opposes positive flexion",
    )
    grip_force: Array | None = _signal("truth", "N", "run", "Force of the jaws on what they hold, mean of the step")
    tension: Array | None = _signal("truth", "N", "tendons", "Tendon tension beside the spool")
    distal_tension: Array | None = _signal("truth", "N", "tendons", "Tendon tension at the tip")
    spool_angle: Array | None = _signal("truth", "rad", "tendons", "Spool angle")
    spool_velocity: Array | None = _signal("truth", "rad/s", "tendons", "Its rate")
    estimated_output_angle: Array | None = _signal(
        "control", "rad", "compensated", "Output angle by the controller's observer"
    )
    estimated_output_angle_std: Array | None = _signal("control", "rad", "compensated", "Its standard deviation")
    estimated_force: Array | None = _signal(
        "control", "N", "compensated", "Tangential force at the tip by the observer"
    )
    estimated_force_std: Array | None = _signal("control", "N", "compensated", "Its standard deviation")
    friction_scale: Array | None = _signal(
        "control", "1", "compensated", "Estimated friction over that of the controller's instrument file"
    )
    friction_scale_std: Array | None = _signal("control", "1", "compensated", "Its standard deviation")
    operating_state: Array | None = _signal("control", "1", "compensated", "0 disabled, 1 enabled, 2 paused, 3 fault")
    faults: Array | None = _signal(
        "control", "1", "compensated", "Faults as a mask of bits, tenodesis.control.FAULTS in order"
    )
    phase: Array | None = _signal(
        "control",
        "1",
        "compensated",
        "Of the robust law: 0 rest, 1 track, 2 pull, 3 release, 4 restrained, 5 yielding, 6 dither",
    )
    homing_failure: Array | None = _signal(
        "control",
        "1",
        "compensated",
        "Why homing failed: number in tenodesis.control.HOMING_REASONS, and 256 per tendon",
    )
    request: Array | None = _signal(
        "control", "1", "compensated", "Request to the controller, tenodesis.control.Request; 0 none"
    )

    def __post_init__(self) -> None:
        if not self.tendons:
            for group, names in Names.paired(self.joints)._asdict().items():
                object.__setattr__(self, group, names)

    @property
    def names(self) -> Names:
        """What the columns are named after."""
        return Names(self.joints, self.handle_joints, self.tendons, self.compensated)

    @property
    def axes(self) -> tuple[str, ...]:
        """The joints of the tip, by the name that they have in a planar instrument."""
        return self.joints

    def signals(self) -> dict[str, Array]:
        """Return the signals that were recorded, by name, without the time."""
        named = {name: getattr(self, name) for name in SIGNALS}
        return {name: values for name, values in named.items() if values is not None}

    @overload
    def __getitem__(self, key: str) -> Array: ...
    @overload
    def __getitem__(self, key: slice) -> "Run": ...
    def __getitem__(self, key: str | slice) -> "Array | Run":
        """Return a signal or one of its columns by name, or what lies between two times, s, both included.

        ``run["tension"]``, ``run["tension.agonist"]``, ``run[1.0:2.5]``, ``run[2.0:]``. A step is a number of rows:
        ``run[::20]``. For rows by number see :meth:`rows`. A backbone's name gives the sum of its arcs' columns.

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
        name, _, column = key.partition(".")
        values = getattr(self, name) if name in SIGNALS else None
        if values is None:
            raise KeyError(f"{name} is not among the signals; they are {', '.join(self.signals())}")
        if not column:
            return np.asarray(values)
        of = self.names.arcs(name, column)
        return np.asarray(
            self.by_column(name)[..., of].sum(axis=-1) if len(of) > 1 else self.by_column(name)[..., of[0]]
        )

    def columns(self, signal: str) -> tuple[str, ...]:
        """Return the names of a signal's columns; empty if it has one alone. Raises KeyError if it is unknown."""
        return self.names.columns(signal)

    def by_column(self, signal: str) -> Array:
        """Return a recorded signal with an axis for its columns even if it has one: (n, columns)."""
        values = np.asarray(getattr(self, signal))
        count = 1 if SIGNALS[signal].of == "run" else len(self.columns(signal))
        return values.reshape(*np.shape(self.time), count)

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
        masks = fault_bits(self.faults)
        rows = {name: np.flatnonzero(masks >> bit & 1) for bit, (name, _, _) in enumerate(_core.faults())}
        first = sorted((int(found[0]), name) for name, found in rows.items() if found.size)
        times = np.atleast_1d(self.time)
        return {name: float(times[row]) for row, name in first}

    def to_pandas(self) -> "pd.DataFrame":
        """Return a DataFrame with a column per signal and joint, tendon or component, over the time in s.

        Raises
        ------
        MissingExtraError
            pandas is not installed.
        """
        import tenodesis as tn  # noqa: PLC0415 - by the public name, since tables stand above runs

        return tn.recording.to_pandas(self)

    def axis(self, name: str) -> "Run":
        """Return the run of a single joint with its own joint of the handle and its own pair of tendons.

        Its signals have shape (n,), per tendon (n, 2). Those of the entire tip remain.

        Raises
        ------
        KeyError
            There is no such joint, or its tendons are not its own.
        """
        own = Names.paired([name])
        if name not in self.joints or not set(own.tendons) <= set(self.tendons):
            alone = [joint for joint in self.joints if set(Names.paired([joint]).tendons) <= set(self.tendons)]
            raise KeyError(f"{name} is not among the axes; they are {', '.join(alone)}")
        if self.names == own:
            return self
        kept = Names(*(tuple(one for one in mine if one in own) for mine, own in zip(self.names, own, strict=True)))
        signals: dict[str, Any] = {}
        for key, values in self.signals().items():
            numbers = [self.names.column(key, column) for column in kept.columns(key)]
            shape = np.shape(self.time) + kept.shape(key, 1)[1:]
            signals[key] = self.by_column(key)[..., numbers].reshape(shape) if numbers else values
        of_others = {key for key in signals if SIGNALS[key].of != "run" and not kept.columns(key)}
        return replace(self, **kept._asdict(), **(signals | dict.fromkeys(of_others)))

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
        """Rows, times and joints in words."""
        times = np.atleast_1d(self.time)
        span = f", {times[0]:.6g} to {times[-1]:.6g} s" if times.size else ""
        return f"{times.size} rows{span}, {' and '.join(self.joints)}"


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

HELD = tuple(name for name in COMMANDS if name.startswith("held_"))
"""The commands that describe what jaws hold."""

CONTROL = _group("control")
"""Estimates, outputs and requests of a controller; NaN while it does not run."""


def fault_bits(faults: ArrayLike) -> NDArray[np.int64]:
    """Return the faults of all axes in each row as bits, (n,), of a signal (n,) or (n, axes), NaN: none."""
    bits: NDArray[np.int64] = np.bitwise_or.reduce(np.atleast_2d(np.nan_to_num(faults).astype(np.int64).T), axis=0)
    return bits


def concatenate(runs: Sequence[Run]) -> Run:
    """Return consecutive runs joined into one, whose arrays are copies: it keeps none of theirs in memory.

    Raises
    ------
    ValueError
        There is none, or they have different joints, tendons or signals.
    """
    if not runs:
        raise ArgumentError(key="runs", value=runs, allowed="one run or more")
    first = runs[0]
    names = tuple(first.signals())
    if any(run.names != first.names or tuple(run.signals()) != names for run in runs):
        raise ArgumentError("the runs differ in axes or signals; they must have the same.", key="runs")
    joined: dict[str, Any] = {name: np.concatenate([getattr(run, name) for run in runs]) for name in ("time", *names)}
    return replace(first, **joined)
