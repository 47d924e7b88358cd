"""Unknowns of any routing from recordings of all its tendons, with the instrument's own twin as their model.

What is given to the twin is the handle's angles, what the spools have wound, and the load on the tip. Compared are the
tensions at the spools and whichever of the joints' angles were measured. Joints are straight and tendons have their
pretension where spools and handle are at zero; from there the twin approaches where a recording begins.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import degrees, pi, sqrt
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from tenodesis.errors import ArgumentError, IdentificationError, NoSolutionError
from tenodesis.identification.any_instrument import value_of, with_values
from tenodesis.identification.formats.csv import as_identification
from tenodesis.identification.formats.mcap import first_rows
from tenodesis.identification.formats.measured import MeasuredRun, Raw
from tenodesis.identification.problem import Parameter, SensorError, differenced, scales
from tenodesis.identification.registry import Format
from tenodesis.identification.twin_model.marginalise import Marginalisation, marginalise
from tenodesis.identification.twin_model.stepped import ChannelLabel, SteppedProblem
from tenodesis.identification.twin_model.steps import InputError, QuantisedSensor, SteppedRun, encoder, unrounded
from tenodesis.instrument import FullForm, InstrumentLike, expanded
from tenodesis.kinematics import Port, tip_pose
from tenodesis.kinematics.chain import rotated
from tenodesis.magnitude import rms
from tenodesis.plant import handle_share
from tenodesis.recording import lab_map, lab_tables, signal_tables
from tenodesis.recording.blocks import Progress
from tenodesis.recording.signal_tables import POSE
from tenodesis.run import ACROSS, COMPONENTS, Array, Run
from tenodesis.threads import thread_pool
from tenodesis.twin import Twin

MOST_COMPARED = 3000
"""Rows of a recording that are compared, evenly: more would say hardly more, for what friction leaves is not white."""
_APPROACH = 0.5
"""Time in which the twin comes to where a recording begins, if that is not at home, s."""
_MOST_SUBSTEPS, _DIGITS = 64, 12
_STEP, _LEAST_STEP = 4e-2, 1e-2
"""Differences by which slopes are taken, over a parameter's scale: smaller ones see when stick and slip turn."""
_KEPT = 2
"""Slopes whose simulated readings are kept: those at an optimum are asked for again."""
_AT_HOME = 0.01
"""Angle of a spool below which it is at zero, and only its counts say otherwise, rad."""
_LEAST_COEFFICIENT = 0.05
"""At which the search for a friction coefficient begins where the file states none."""
_LEAST_MOTION = (0.02, 1e-4, 1e-2, 1e-2, 1e-3)
"""Below which nothing moves the instrument: of handle, rad, spools, m, wrench and grip, N or N m, spools, rad/s."""
_USED = (
    *("commanded_handle_angle", "measured_handle_angle", "commanded_spool_velocity", "measured_spool_angle"),
    *("measured_tension", "measured_output_angle", "wrench", "applied_grip_force", "held_stiffness", "force"),
    "commanded_spool_tension",
    "radial_force",
)
"""Signals that are read of a recording."""
_ABOUT = {"held_stiffness", "force", "radial_force"}
"""Of these, what says whether it can be."""
_MEASURED = {"measured_tension", "measured_output_angle", *POSE}
"""What is compared."""
_POSE = {f"{kind}.{axis}": least for kind, least in (("position", 1e-6), ("direction", 1e-5)) for axis in "xyz"}
"""Components of the tip's pose as a camera sees it, and their least noise, m and 1: the model is no better."""
LAWS = ("none", "capstan")


class _Unknown(NamedTuple):
    """What a key of the instrument's file is; its bounds are factors of the file's value, or values."""

    unit: str
    lower: float
    upper: float
    meaning: str
    group: str


_OF_TENDON = {
    "stiffness": _Unknown("N/m", 0.2, 5.0, "stiffness of the whole tendon", "stiffness"),
    "pretension": _Unknown("N", 0.2, 5.0, "tension with all spools at zero", "pretension"),
}
_OF_JOINT = {
    "backbone_rigidity": _Unknown("N*m^2", 0.2, 5.0, "rigidity of the backbone", "stiffness"),
    "radius": _Unknown("m", 0.5, 2.0, "arm of the joint's tendons", "radius"),
}
_OF_CROSSING = _Unknown("m", 0.5, 2.0, "arm of the tendon at the joint", "radius")
_HANDLE_SHARE = "friction.handle_compliance_share"
_SHARES = {
    _HANDLE_SHARE: "share of a tendon's compliance in the handle",
    "friction.handle_joint_compliance_share": "share of it in the span of a joint of the handle",
    "friction.tip_joint_compliance_share": "share of it in the span of a joint at the tip",
}
"""Where friction divides tendons; shares that the file leaves to lengths are not unknown, but for the handle's."""
_LEAST_SHARE, _MOST_SHARE = 0.001, 0.9
_COEFFICIENTS = ("friction.vertex_coefficient", "friction.sheath_coefficient")
_COEFFICIENT = _Unknown("1", 0.0, 1.0, "friction coefficient", "friction")
_DAMPING = _Unknown("1", 0.0, 2.0, "damping of the tip over critical", "viscous")
_OFFSETS = ".encoder_offset"
_TABLES = ("friction.", "dynamics.")
_OFFSET = _Unknown("rad", -0.3, 0.3, "offset of the joint's encoder", "offset")


@dataclass(frozen=True)
class RoutingRun(MeasuredRun):
    """A recording of all tendons, with its instrument if the recording contains it.

    Columns are named ``signal.NAME``: handle_angle, output_angle and spool_angle in rad, tension in N, wrench in N and
    N m; grip_force, which presses the jaws apart, in N.
    """

    instrument: FullForm | None = None
    settled: float = 0.0
    """Time from the first row until tendons have slipped whichever way they lay, s: readings before are not compared"""


class _Inputs(NamedTuple):
    """What is given to the twin, a row each step, besides what the spools have wound, the commands of its run."""

    handle: Array
    """(n, joints of the handle), rad"""
    velocity: Array
    """Commanded to the spools, (n, tendons), rad/s"""
    wrench: Array
    """(n, 6), N and N m"""
    grip: Array
    """(n, 1), N"""
    from_home: bool
    """Whether handle and spools are at zero, and the tip free, at first."""
    settles: bool
    """Whether what is compared begins later than that."""


def of_run(
    run: Run,
    inst: InstrumentLike | None = None,
    *,
    name: str = "run",
    notes: Sequence[str] = (),
    settled: float = 0.0,
) -> RoutingRun:
    """Return a run's inputs and readings as a recording to identify from; the search starts from the instrument.

    settled: time before which readings are not compared, s, for tendons that did not begin as the twin's do.

    Raises
    ------
    IdentificationError
        The run lacks tensions, is too short, or too much of it is corrupt.
    """
    notes, held = [*notes], np.flatnonzero(run["held_stiffness"] if "held_stiffness" in run.signals() else 0.0)
    if held.size:
        notes.append(f"from {run.time[held[0]]:.4g} s on the jaws hold something, which is not in the model: left out")
        run = run.rows(0, int(held[0]))
    columns = by_name(run, [signal for signal in _USED if signal not in _ABOUT])
    found = _of_columns(name, run.time, columns, notes, None if inst is None else expanded(inst))
    return replace(found, settled=settled)


def by_name(run: Run, signals: Iterable[str]) -> dict[str, Array]:
    """Return those signals that a run has, ``measured_tension.NAME``, and forces by axis as those on the tip."""
    found = run.signals()
    return {
        f"{signal}.{column}" if column else signal: rows[:, n]
        for signal in signals
        if signal in found
        for rows in [run.by_column(signal)]
        for n, column in enumerate(run.columns(signal) or [""] * rows.shape[1])
    } | _on_one_tip(run)


def _on_one_tip(run: Run) -> dict[str, Array]:
    """Return forces by axis, which oppose flexion, as components of the force on the tip that all axes have."""
    if "force" not in run.signals():
        return {}
    across = zip(run.axes, run.by_column("force").T, strict=True)
    return {f"wrench.{ACROSS[axis]}": -row for axis, row in across} | {"wrench.fz": run.by_column("radial_force")[:, 0]}


def _of_columns(
    name: str, time: Array, given: Mapping[str, Array], notes: Sequence[str], inst: FullForm | None
) -> RoutingRun:
    """Return a recording of signals by name, ``measured_tension.NAME``; raises as :func:`of_run`."""
    of: dict[str, dict[str, Array]] = {}
    for heading, row in given.items():
        signal, _, one = heading.partition(".")
        if np.isfinite(row).any():
            of.setdefault(signal, {})[one] = row
    if not _MEASURED & of.keys():
        raise IdentificationError(
            f"{name} has neither tensions, angles of joints, nor the tip's pose; it must have one of them.",
            key="signals",
            value=sorted(_MEASURED),
        )
    handle = next((one for one in ("commanded_handle_angle", "measured_handle_angle") if one in of), None)
    # as with the handle, what was commanded is known without noise, unless drives held tensions instead
    follows = "commanded_spool_velocity" in of and not any(
        np.any(row) for row in of.get("commanded_spool_tension", {}).values()
    )
    spool = "commanded_spool_velocity" if follows else "measured_spool_angle"
    columns: dict[str, Array] = {}
    for signal in (*sorted(_MEASURED), spool, *((handle,) if handle else ()), "wrench"):
        short = "handle_angle" if signal == handle else signal.removeprefix("measured_").removeprefix("commanded_")
        columns |= {f"{short}.{one}": row for one, row in of.get(signal, {}).items()}
    for row in of.get("applied_grip_force", {}).values():
        if np.any(row):
            columns["grip_force"] = row
    if follows:
        for one, row in of.get("measured_spool_angle", {}).items():
            columns[f"spool_angle.{one}"] = np.full(row.size, 0.0 if abs(row[0]) < _AT_HOME else row[0])
    raw = Raw(name, time, columns)
    for note in notes:
        raw.note(note)
    if "wrench" not in of:
        raw.note("no load was recorded: the tip is taken to be free")
    raw.finite()
    raw.clock((("s", 1.0),))
    raw.enough()
    raw.gaps()
    done = raw.done()
    return RoutingRun(done.name, done.time, done.columns, done.notes, instrument=inst)


def load(path: Path, progress: Progress | None = None) -> RoutingRun:
    """Return a recording, with its instrument where it is no table; raises IdentificationError as :func:`of_run`."""
    with as_identification():
        if lab_tables.is_table(path):
            columns, notes = signal_tables.read(path)
            if lab_map.TIME not in columns:
                raise IdentificationError(f"{path} has no column of the time.", key="time", value=path)
            return _of_columns(path.name, columns.pop(lab_map.TIME), columns, notes, None)
        recording, left_out = first_rows(path, _USED, progress)
        inst = recording.instrument() if "instrument" in recording.metadata else None
    return of_run(recording.run, inst, name=path.name, notes=left_out)


class Routing(SteppedProblem):
    """Recordings of all tendons of an instrument, and what of it is unknown.

    Unknown are each tendon's stiffness and pretension, rigidities of backbones, arms of tendons at joints, friction
    coefficients, shares of the tendons' compliance that friction divides, damping, and offsets of joints' encoders.

    Raises
    ------
    IdentificationError
        No instrument is known, a recording lacks one of its tendons or joints of the handle, or nothing moves in it.
    """

    searches_near = 7

    def __init__(self, runs: Sequence[MeasuredRun], law: str, inst: FullForm) -> None:
        if law not in LAWS:
            raise IdentificationError(key="law", value=law, allowed=" or ".join(LAWS))
        self.inst = _under(law, inst)
        self.runs = tuple(one.name for one in runs)
        self._bends = inst.arc_places
        self._tension_sensors = {
            f"tension.{tendon.name}": sensor for tendon, sensor in zip(inst.tendons, inst.tension_sensors, strict=True)
        }
        self._recorded, self._finer = tuple(runs), 1
        self._pose_noise = {
            channel: max(
                _of_differences(
                    [one.columns[channel][self._rows_compared(one)] for one in runs if channel in one.columns]
                ),
                least,
            )
            for channel, least in _POSE.items()
        }
        self._prepare()
        self.parameters = self._parameters()
        self._step = _STEP
        self._known: dict[tuple[bytes, int], dict[str, Array]] = {}
        self._near: dict[int, Marginalisation] = {}
        self._cells: dict[int, Array] = {}

    @cached_property
    def linear(self) -> NDArray[np.bool_]:
        """Which parameters are offsets of encoders, (parameters,)."""
        return np.array([one.name.endswith(_OFFSETS) for one in self.parameters])

    def _prepare(self) -> None:
        """Put the recordings into the steps that the twin takes."""
        both = [self._input(one) for one in self._recorded]
        self._inputs, self._runs = [inputs for inputs, _ in both], [run for _, run in both]

    def _input(self, run: MeasuredRun) -> tuple[_Inputs, SteppedRun]:
        """Return what is given to the twin, at each of its steps, and what the spools have wound with what is read."""
        name, columns, count = run.name, run.columns, len(run)
        spools = [{f"{kind}.{one.name}" for one in self.inst.tendons} for kind in ("spool_velocity", "spool_angle")]
        needed = [f"handle_angle.{one.name}" for one in self.inst.handle_joints]
        # a spool that is not recorded rests only where all do
        lacking = [*needed, *(one for names in spools if names & columns.keys() for one in sorted(names))]
        lacking = [one for one in lacking if one not in columns]
        if lacking or not self._channels(run):
            lacking = lacking or ["tensions", "angles of joints"]
            raise IdentificationError(
                f"{name} lacks {', '.join(lacking)} of {self.inst.name}.", key="columns", value=lacking
            )

        def rows(names: Sequence[str], scale: float = 1.0) -> Array:
            zero = np.zeros(count)
            return (
                np.stack([scale * columns.get(one, zero) for one in names], axis=1) if names else np.zeros((count, 0))
            )

        drives = self.inst.own_drives
        counted = rows([f"spool_angle.{one.name}" for one in self.inst.tendons], drives.spool_radius)
        resolution = drives.spool_radius * 2 * pi / drives.encoder_counts / drives.gear_ratio
        paths = [unrounded(row, run.sample_time, resolution) for row in counted.T]
        wound = np.stack([path.values for path in paths], axis=1)
        handle = rows([f"handle_angle.{one.name}" for one in self.inst.handle_joints])
        velocity = rows([f"spool_velocity.{one.name}" for one in self.inst.tendons])
        wrench = rows([f"wrench.{one}" for one in COMPONENTS])
        grip = rows(["grip_force"])
        given = (handle, wound, wrench, grip, velocity)
        if not any(np.ptp(of, axis=0).max(initial=0.0) > least for of, least in zip(given, _LEAST_MOTION, strict=True)):
            raise IdentificationError(
                f"{name}: neither handle nor spools nor the load move.", key="columns", value=list(columns)
            )
        step, substeps = steps_within(self.inst, run.sample_time, self._finer)
        # a rest before it would let tendons slip elsewhere than in a recording that begins at once
        positions = zip(given[:-1], _LEAST_MOTION, strict=False)
        from_home = all(np.abs(of[0]).max(initial=0.0) <= least for of, least in positions)
        approach = 0 if from_home else round(_APPROACH / step)
        at = np.arange((count - 1) * substeps + 1) / substeps

        def stepped(rows: Array) -> Array:
            own = [np.interp(at, np.arange(count), row) for row in rows.T]
            whole = np.stack(own, axis=1) if own else np.zeros((at.size, 0))
            return np.concatenate([np.outer(np.arange(approach) / max(approach, 1), whole[0]), whole])

        # a velocity holds for a step, and in the approach there is none
        held = np.repeat(velocity, substeps, axis=0)[: at.size]
        channels = self._channels(run)
        compared = self._rows_compared(run)
        errors = [(column, error) for column, path in enumerate(paths) for error in path.errors]
        inputs = _Inputs(
            handle=stepped(handle),
            velocity=np.concatenate([np.zeros((approach, velocity.shape[1])), held]),
            wrench=stepped(wrench),
            grip=stepped(grip),
            from_home=from_home,
            settles=isinstance(run, RoutingRun) and run.settled > 0,
        )
        return inputs, SteppedRun(
            name=name,
            time_step=step,
            stride=1,
            commands=stepped(wound),
            lead=approach,
            kept=approach + substeps * np.arange(count)[compared],
            time=run.time[compared],
            input_errors=tuple(
                InputError(
                    column,
                    approach + substeps * error.first,
                    np.interp(
                        np.arange((error.shape.size - 1) * substeps + 1) / substeps,
                        np.arange(error.shape.size),
                        error.shape,
                    ),
                )
                for column, error in errors
            ),
            mixing=block_diag(*(path.mixing for path in paths)),
            measured={channel: row[compared] for channel, row in channels.items()},
            sensors={channel: self._sensor(channel) for channel in channels},
            handle_as_read=False,
        )

    def _rows_compared(self, run: MeasuredRun) -> slice:
        """Return which rows of a recording are compared."""
        rows = _compared(self._channels(run))
        before = int(np.searchsorted(run.time, run.time[0] + (run.settled if isinstance(run, RoutingRun) else 0.0)))
        return slice(rows.start + -(-max(before - rows.start, 0) // rows.step) * rows.step, None, rows.step)

    def _channels(self, run: MeasuredRun) -> dict[str, Array]:
        """Return what is compared, by channel: tensions, and angles of joints, of a backbone its arcs' sum."""
        columns = run.columns
        found = {channel: columns[channel] for channel in self._tension_sensors if channel in columns}
        names = [joint.name for joint in self.inst.tip_joints]
        for bend, arcs in self._bends.items():
            parts = [columns.get(f"output_angle.{names[i]}") for i in arcs]
            whole = columns.get(f"output_angle.{bend}")
            if all(part is not None for part in parts):
                whole = np.sum([part for part in parts if part is not None], axis=0)
            if whole is not None:
                found[f"output_angle.{bend}"] = whole
        return found | {name: columns[name] for name in _POSE if name in columns}

    def _parameters(self) -> tuple[Parameter, ...]:
        inst = self.inst
        shown = {channel for one in self._runs for channel in one.measured}
        unknowns: dict[str, _Unknown] = {}
        for tendon in inst.as_given("tendons"):
            unknowns |= {f"{tendon.name}.{key}": of for key, of in _OF_TENDON.items()}
            # a radius of its own, of a tendon that the joint's rotation does not leave alone
            unknowns |= {f"{tendon.name}.{one.joint}.radius": _OF_CROSSING for one in tendon.route if one.radius}
        for joint in inst.as_given("joints"):
            unknowns |= {f"{joint.name}.{key}": of for key, of in _OF_JOINT.items() if getattr(joint, key, None)}
        found = []
        for name, of in unknowns.items():
            # a tendon without pretension may have some, up to 1 N
            start = self.value(inst, name)
            found.append((name, of._replace(lower=of.lower * start, upper=of.upper * start or 1.0)))
        if inst.friction.law != "none":
            found += [(key, _COEFFICIENT) for key in _coefficients(inst)]
            for key, meaning in _SHARES.items():
                if key == _HANDLE_SHARE or getattr(inst.friction, key.partition(".")[2]) is not None:
                    found.append((key, _Unknown("1", _LEAST_SHARE, _MOST_SHARE, meaning, "compliance")))
        found.append(("dynamics.damping_ratio", _DAMPING))
        found += [(f"{bend}{_OFFSETS}", _OFFSET) for bend in self._bends if f"output_angle.{bend}" in shown]
        return tuple(Parameter(name, of.unit, self.value(inst, name), *of[1:]) for name, of in found)

    def starting_values(self, runs: Sequence[int]) -> Array:
        """Return the file's values, but friction that the file lacks, and pretensions as a recording from home begins.

        A pair whose pretensions differ by more than its friction holds slips at once, and keeps just what friction
        holds. From equal ones a search finds another optimum, at which friction holds that from the beginning.
        """
        values = {one.name: one.start for one in self.parameters}
        values |= {key: values[key] or _LEAST_COEFFICIENT for key in _COEFFICIENTS if key in values}
        known = (run for run in runs if self._inputs[run].from_home and not self._inputs[run].settles)
        first = next((self._runs[run].measured for run in known), {})
        for channel in self._tension_sensors.keys() & first.keys():
            values[f"{channel.partition('.')[2]}.pretension"] = float(first[channel][0])
        return np.array([*values.values()])

    @staticmethod
    def value(inst: FullForm, name: str) -> float:
        """Return what an instrument has as one of the parameters, of an encoder's offset nothing."""
        if name.startswith(_TABLES):
            table, _, key = name.partition(".")
            value = getattr(getattr(inst, table), key)
            return handle_share(inst, inst.tendon_length) if value is None else float(value)
        return 0.0 if name.endswith(_OFFSETS) else value_of(inst, name)

    def instrument(self, values: Array) -> FullForm:
        """Return the instrument with these values in place."""
        named = dict(zip((one.name for one in self.parameters), values.tolist(), strict=True))
        tables = {key: value for key, value in named.items() if key.startswith(_TABLES)}
        own = {key: value for key, value in named.items() if key not in tables and not key.endswith(_OFFSETS)}
        return with_values(self.inst, list(own), np.array(list(own.values())), **tables)

    def _sensor(self, channel: str) -> QuantisedSensor:
        if channel in self._tension_sensors:
            sensor = self._tension_sensors[channel]
            return QuantisedSensor(sensor.noise, sensor.resolution)
        if channel in _POSE:
            return QuantisedSensor(self._pose_noise[channel], 0.0)
        # an arc has an encoder of its own
        return QuantisedSensor(*(sqrt(len(self._bends[channel.partition(".")[2]])) * one for one in encoder(self.inst)))

    def ahead(self, points: Sequence[Array], run: int) -> None:
        """Simulate the twins of several values of the parameters side by side, of which the readings are then known."""
        while True:
            keys = dict.fromkeys((np.where(self.linear, 0.0, one).tobytes(), run) for one in points)
            # the latest are last
            self._known |= {key: self._known.pop(key) for key in keys if key in self._known}
            lacking = [key for key in keys if key not in self._known]
            given = [np.frombuffer(values) for values, _ in lacking]
            try:
                with thread_pool() as pool:
                    found = [*pool.map(lambda one: self._simulated(one, run, self._runs[run].commands), given)]
            except ArgumentError:
                # stiffer tendons swing faster: from now on, steps are shorter
                self._finer += 1
                self._prepare()
                self._near.clear()
                self._known.clear()
                continue
            self._known |= zip(lacking, found, strict=True)
            for key in [*self._known][: -2 * _KEPT * len(self.parameters) * len(self.runs)]:
                del self._known[key]
            return

    def _readings(self, values: Array, run: int) -> dict[str, Array]:
        self.ahead([values], run)
        offsets = {
            f"output_angle.{one.name.removesuffix(_OFFSETS)}": value
            for one, value in zip(self.parameters, values.tolist(), strict=True)
            if one.name.endswith(_OFFSETS)
        }
        known = self._known[np.where(self.linear, 0.0, values).tobytes(), run]
        return {channel: row + offsets[channel] if channel in offsets else row for channel, row in known.items()}

    def _simulated(self, values: Array, run: int, wound: Array) -> dict[str, Array]:
        """Return them without encoders' offsets where spools have wound this, (steps, tendons), m."""
        inputs, one = self._inputs[run], self._runs[run]
        try:
            inst = self.instrument(values)
            whole = Twin(inst, time_step=one.time_step).run(
                inputs.handle,
                wrench=inputs.wrench,
                spool_velocity=inputs.velocity,
                let_out=-wound,
                grip_force=inputs.grip[:, 0],
            )
        except (NoSolutionError, ArgumentError) as problem:
            if problem.key == "time_step":
                raise
            return {channel: np.full(row.size, np.nan) for channel, row in one.measured.items()}
        tension, angle = (whole.by_column(signal)[one.kept] for signal in ("tension", "output_angle"))
        found = {f"tension.{one.name}": tension[:, i] for i, one in enumerate(inst.tendons)}
        for bend, arcs in self._bends.items():
            found[f"output_angle.{bend}"] = angle[:, arcs].sum(axis=1)
        if not found.keys() >= one.measured.keys():
            pose = tip_pose(inst, angle, port=Port(insertion=0.0))
            axis = rotated(pose.quaternion[:, 0], np.array([0.0, 0.0, 1.0]))
            found |= dict(zip(_POSE, np.concatenate([pose.position[:, 0], axis], axis=1).T, strict=True))
        return {channel: found[channel] for channel in one.measured}

    def _expected(self, values: Array, run: int, wound: Array) -> Array:
        return self._scaled(self._simulated(values, run, wound), run)

    def residuals(self, values: Array, run: int) -> Array:
        """Return measured minus model of all channels over their noise.

        Near an optimum they are without what counts hide, or without what load cells' errors may be.
        """
        return self._whitened(self.plain_residuals(values, run), run)

    def _whitened(self, rows: Array, run: int) -> Array:
        if run in self._cells:
            return rows - self._cells[run] @ (self._cells[run].T @ rows)
        return self._near[run].whitened(rows) if run in self._near else rows

    def derivatives(self, values: Array, run: int, which: Sequence[int]) -> Array:
        """Return differences of the residuals by parameters, of a step in which stick and slip hardly turn."""
        lower, upper = (np.array([getattr(one, end) for one in self.parameters]) for end in ("lower", "upper"))
        slopes = differenced(
            lambda at: -self._scaled(self._readings(at, run), run),
            values,
            lower,
            upper,
            scales(self.parameters, values),
            which=which,
            step=self._step,
            ahead=lambda points: self.ahead(points, run),
        )
        return self._whitened(np.nan_to_num(slopes), run)

    def refine(self, values: Array, runs: Sequence[int]) -> bool:
        """Halve the difference by which slopes are taken, and marginalise what spools' counts hide near some values."""
        self._step /= 2
        for run in runs if self._step >= _LEAST_STEP else ():
            if self._runs[run].input_errors:
                self._near[run] = marginalise(self._runs[run], partial(self._expected, values, run))
        return self._step >= _LEAST_STEP

    def weigh_sensors(self, values: Array, runs: Sequence[int]) -> bool:
        """Take offsets and gains of load cells of runs, near some values, into the residuals' weights, of others out.

        Not in a search that must descend: what is left of the tensions determines their level by when tendons slip,
        where it ends in any of many optima. And not beside what spools' counts hide: its effects are not linear, and
        what the level of tensions would tell beside them is less than intervals would say.
        """
        self._cells.clear()
        for run in runs if not any(self._runs[run].input_errors for run in runs) else ():
            effects = self._of_cells(values, run)
            if effects.any():
                directions, sizes, _ = np.linalg.svd(effects, full_matrices=False)
                # (1 + M M')^(-1/2) = 1 - D D'
                self._cells[run] = directions * np.sqrt(1 - 1 / np.sqrt(1 + sizes**2))
        return bool(self._cells)

    def jacobian(self, values: Array, run: int) -> Array:
        """Return them by all parameters."""
        return self.derivatives(values, run, range(len(self.parameters)))

    def _of_cells(self, values: Array, run: int) -> Array:
        """Return effects on plain residuals of one deviation of each load cell's offset and gain, (n, m).

        Gains act on the tensions of the model, for readings have the residuals' own noise.
        """
        model = self._readings(values, run)
        effects = []
        for channel, sensor in self._tension_sensors.items():
            for error in (sensor.offset, sensor.gain_error * model[channel]) if channel in model else ():
                own = {name: 0 * row + (error if name == channel else 0.0) for name, row in model.items()}
                effects.append(self._scaled(own, run))
        size = sum(row.size for row in model.values())
        return np.nan_to_num(np.stack(effects, axis=1)) if effects else np.zeros((size, 0))

    def systematic_errors(self, values: Array, run: int) -> Array | None:
        """Return effects of load cells and of counts if not linear, (n, m); None once cells are in the weights."""
        if run in self._cells:
            return None
        found, near = self._of_cells(values, run), self._near.get(run)
        return found if near is None else near.whitened(np.concatenate([found, near.nonlinear], axis=1))

    def sensor_errors(self, values: Array, run: int, slopes: Array, covariance: Array) -> dict[str, SensorError]:
        """Return what load cells read too much: ``tension.NAME.offset``, N, and ``tension.NAME.gain``, a share."""
        if run not in self._cells:
            return {}
        left, sizes, right = np.linalg.svd(self._of_cells(values, run), full_matrices=False)
        # (1 + M'M)^-1 M' before plain rows, of whitened ones
        estimator = right.T * (sizes / np.sqrt(1 + sizes**2)) @ left.T
        by_parameters = estimator @ slopes
        spread = right.T / (1 + sizes**2) @ right + by_parameters @ covariance @ by_parameters.T
        likeliest = zip(estimator @ self.residuals(values, run), np.sqrt(np.diag(spread)), strict=True)
        found = {}
        for channel in [one for one in self._tension_sensors if one in self._runs[run].measured]:
            sensor = self._tension_sensors[channel]
            for key, scale, unit in (("offset", sensor.offset, "N"), ("gain", sensor.gain_error, "1")):
                value, std = (float(scale * one) for one in next(likeliest))
                found[f"{channel}.{key}"] = SensorError(value, std, unit)
        return found

    def _shown(self, channel: str) -> ChannelLabel:
        kind, scale = ("tension_N", 1.0) if channel.startswith("tension") else ("output_angle_deg", degrees(1))
        if channel in _POSE:
            kind, scale = ("position_mm", 1e3) if channel.startswith("position") else ("direction_1", 1.0)
        return ChannelLabel(f"{channel}_{kind.rpartition('_')[2]}", kind, scale)

    def _likeliest(self, values: Array, run: int) -> dict[str, Array]:
        """Return the model's readings by channel, with the errors of load cells that are likeliest where it has them.

        They are in the model once they are in the weights, of a run held out as of one that is fitted.
        """
        model = dict(self._readings(values, run))
        if not self._cells:
            return model
        effects = self._of_cells(values, run)
        rows = self.plain_residuals(values, run)
        likeliest = np.linalg.solve(np.eye(effects.shape[1]) + effects.T @ effects, effects.T @ rows)
        cells = [channel for channel in self._tension_sensors if channel in model]
        for channel, (offset, gain) in zip(cells, likeliest.reshape(-1, 2).tolist(), strict=True):
            sensor = self._tension_sensors[channel]
            model[channel] = model[channel] * (1 + gain * sensor.gain_error) + offset * sensor.offset
        return model


def steps_within(inst: FullForm, sample_time: float, least: int = 1) -> tuple[float, int]:
    """Return the longest step of the twin that divides the time between rows, s, and how many there are in it.

    They are at least so many. Raises IdentificationError if none is short enough.
    """
    for substeps in range(least, _MOST_SUBSTEPS):
        try:
            # a clock's last digits are no time
            return Twin(inst, time_step=round(sample_time / substeps, _DIGITS)).time_step, substeps
        except ArgumentError:
            continue
    raise IdentificationError(key="sample_time", value=sample_time, allowed="shorter")


def _of_differences(rows: Sequence[Array]) -> float:
    """Return the standard deviation of white noise by second differences of signals, 0 of none."""
    differences = [np.diff(row, 2) for row in rows]
    return rms(np.concatenate(differences)) / sqrt(6) if differences else 0.0


def _compared(channels: Mapping[str, Array]) -> slice:
    """Return which rows of readings are compared: even ones of those in which sensors were read.

    Between them a recording may hold its readings, which are those of earlier instants.
    """
    rows = np.stack([*channels.values()], axis=1)
    read = 1 + np.flatnonzero((rows[1:] != rows[:-1]).any(axis=1))
    period = int(np.gcd.reduce(np.diff(read), initial=0))
    # coarse steps of a slow angle are no period: in one of that, most readings differ from those before
    if not 2 * period * read.size >= len(rows):
        period = 1
    first = int(read[0]) % period if read.size else 0
    stride = -(-(len(rows) - first) // (period * MOST_COMPARED))
    return slice(first, None, period * stride)


def _under(law: str, inst: FullForm) -> FullForm:
    """Return the instrument under a friction law."""
    if law == "none":
        return inst.replace(**{"friction.law": "none"}, **dict.fromkeys(_COEFFICIENTS, 0.0))
    return inst.replace(**{"friction.law": "capstan"}, **{key: Routing.value(inst, key) for key in _coefficients(inst)})


def _coefficients(inst: FullForm) -> tuple[str, ...]:
    """Return the friction coefficients that act on an instrument: in a straight sheath there is none."""
    return _COEFFICIENTS if inst.friction.sheath_bend > 0 else _COEFFICIENTS[:1]


def problem(train: Sequence[MeasuredRun], test: Sequence[MeasuredRun], *, law: str, instrument: Any = None) -> Routing:
    """Return the model with its recordings, those of train first; raises as :class:`Routing`."""
    runs = [*train, *test]
    own = next((one.instrument for one in runs if isinstance(one, RoutingRun) and one.instrument is not None), None)
    inst = own if instrument is None else expanded(instrument)
    if inst is None:
        raise IdentificationError(
            f"{runs[0].name} does not name its instrument; give one.", key="instrument", value=None
        )
    return Routing(runs, law, inst)


FORMAT = Format(load, problem, LAWS, "capstan", shows_progress=True)
