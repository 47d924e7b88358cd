"""The digital twin: the instrument on its bench in time, with friction, drives, sensors and load rig.

Angles in rad, forces in N, time in s. Commands are what holds at the end of each step.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import degrees, pi, sqrt
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tenodesis import _core, statics
from tenodesis._core import Status
from tenodesis.errors import NoSolutionError
from tenodesis.instrument import PARAMETERS, Instrument
from tenodesis.signals import Array, Run, concatenate
from tenodesis.tampering import Tampering, tampered
from tenodesis.threads import threads

if TYPE_CHECKING:
    from tenodesis.control import Controller

TIME_STEP = 5e-4
"""Default time step, s."""

_COMMANDS = _core.twin_commands()
_SIGNALS = _core.twin_signals()
_ARGUMENTS: dict[str, int | slice] = {
    **{name: _COMMANDS.index(name) for name in ("handle_angle", "force", "radial_force", "weight")},
    "spool_velocity": slice(4, 6),
    "sheath_bend": _COMMANDS.index("sheath_bend"),
    "let_out": slice(7, 9),
}
"""Columns of a command, by the argument that fills them."""
_PER_TENDON = ("spool_velocity", "let_out")
_ROW = _core.twin_parameters()
_CONTROL = _core.control_signals()
_CONTROLLED = tuple(dict.fromkeys(name.partition(".")[0] for name in _CONTROL))
_MEASURED_AND_TRUE = tuple(dict.fromkeys(name.partition(".")[0] for name in _SIGNALS if name != "sweeps"))

# More would leave fewer than a dozen steps to a swing of the tip, and the rule's error no longer small.
_MOST_PHASE = 0.5
_DEFAULT_SWING = 2 * pi * 20.0  # rad/s
_DEFAULT_DAMPING_RATIO = 0.2
_STOP_STIFFENING = 20.0  # stop over tip
_LOOSENING_BLOCK = 0.05  # s
_TENDONS = ("agonist", "antagonist")


class State(NamedTuple):
    """The whole state of a twin, to be kept and set again; its bytes suit this version of the core only."""

    kind: str
    """What twin it is of; only another of that kind can be set to it."""
    time: float
    axes: tuple[bytes, ...]


class Energy(NamedTuple):
    """Where the energy of a stretch of time went, J, with what the steps' friction law left over."""

    stored_before: float
    stored_after: float
    handle: float
    """Work of the handle on the tendons."""
    spools: float
    """Work of the spools on the tendons."""
    load: float
    """Work of the load on the tip."""
    friction: float
    """Lost to friction."""
    damping: float
    """Lost to damping."""
    least_friction: float
    """Smallest loss to friction in any step, by the tensions at its end, where the law holds."""
    residual: float
    """Largest residual of the friction law in any step, as a share of the tension scale."""
    sweeps: int
    """Most passes that a step took."""

    @property
    def work(self) -> float:
        """All work done on and by the instrument, as a positive sum."""
        return abs(self.handle) + abs(self.spools) + abs(self.load)

    @property
    def unaccounted(self) -> float:
        """Energy that the balance leaves over."""
        put_in = self.handle + self.spools + self.load - self.friction - self.damping
        return self.stored_after - self.stored_before - put_in


class Twin:
    """The digital twin of an instrument, at rest with a straight handle and pretensioned tendons at first.

    Parameters
    ----------
    inst
        The instrument; its tables friction, dynamics, drives, sensors and mismatch say what it is made of.
    time_step
        Time step, s.
    seed
        Seed of the sensors' noise, from 0 to 2**64 - 1.
    quasi_static
        Leave inertia and damping out: every step ends at rest.

    Raises
    ------
    ValueError
        The time step is too large for the tip's swing or no whole part of the sampling period, or the seed is invalid.
    """

    def __init__(
        self, inst: Instrument, *, time_step: float = TIME_STEP, seed: int = 0, quasi_static: bool = False
    ) -> None:
        _check_seed(seed)
        self.inst = inst
        self.time_step = time_step
        self.seed = int(seed)
        self.quasi_static = quasi_static
        self._single = [inst] if len(inst.axes) == 1 else [inst.axis(name) for name in inst.axes]
        # Axes draw from far apart in the same sequence, whose steps are this odd number.
        self._axes = [
            _core.Twin(_spec(one, time_step, quasi_static), (int(seed) + (n << 40) * 0x9E3779B97F4A7C15) % 2**64)
            for n, one in enumerate(self._single)
        ]
        self._steps = 0
        self._steps_per_tick = _steps_per_sample(inst, time_step, quasi_static)
        friction = inst.friction
        self._kind = (
            f"{inst.joint_type} joints of {inst.name}, {len(inst.axes)} axes, {friction.law} friction, "
            f"{friction.sheath_contacts} sheath contacts, {'quasi-static' if quasi_static else 'dynamic'} steps of "
            f"{time_step:g} s"
        )

    @property
    def time(self) -> float:
        """Time simulated since the start, s."""
        return self._steps * self.time_step

    @property
    def cores(self) -> list[_core.Twin]:
        """The twins of the core, one per axis; whoever steps them leaves :attr:`time` behind."""
        return self._axes

    @property
    def steps_per_tick(self) -> int:
        """Time steps between two samples of the sensors."""
        return self._steps_per_tick

    @property
    def spool_radius(self) -> float:
        """Radius of the spools, m."""
        return self.inst.drives.spool_radius

    @property
    def state(self) -> State:
        """The whole state; setting it puts the twin back there."""
        return State(self._kind, self.time, tuple(axis.state for axis in self._axes))

    @state.setter
    def state(self, state: State) -> None:
        if not isinstance(state, State):
            raise TypeError(f"state is {state!r}; allowed is what a twin's state was.")
        if state.kind != self._kind:
            raise ValueError(f"state is of a twin with {state.kind}; allowed is one with {self._kind}.")
        for axis, kept in zip(self._axes, state.axes, strict=True):
            axis.state = kept
        self._steps = round(state.time / self.time_step)

    def run(
        self,
        handle_angle: ArrayLike,
        force: ArrayLike = 0.0,
        *,
        radial_force: ArrayLike = 0.0,
        weight: ArrayLike = 0.0,
        spool_velocity: ArrayLike = 0.0,
        sheath_bend: ArrayLike = 0.0,
        let_out: ArrayLike = 0.0,
        controller: "Controller | None" = None,
        request: ArrayLike = 0,
        tampering: Sequence[Tampering] = (),
    ) -> Run:
        """Step over arrays of commands, on from the present state.

        Parameters
        ----------
        handle_angle
            Handle angle, or where the hand wants it if it has a stiffness, rad, shape (n,); with two axes (n, 2).
        force
            Tangential force at the tip, N, turning with it; positive opposes positive flexion. As handle_angle, or a
            number.
        radial_force
            Force along the end-effector, N; positive outward.
        weight
            Weight on one cable of the load rig more than on the other, N, which makes a tangential force (Fig. 13).
        spool_velocity
            Spool velocities asked of the drives, rad/s, agonist and antagonist: shape (n, 2), or (2,); with two axes
            (n, 2, 2), axis before tendon.
        sheath_bend
            Bend of the sheath beside its own, rad; as handle_angle, or a number.
        let_out
            Length of tendon that has come off its spool, m, as spool_velocity; half a metre stands for a torn one.
        controller
            Closes the loop: what the sensors say goes to it, and its spool velocities to the drives.
        request
            What the controller is asked at each step, numbers of :class:`tenodesis.control.Request`; shape (n,).
        tampering
            Faults between the twin and the controller.

        Returns
        -------
        Run
            The signals, one row per step.

        Raises
        ------
        ValueError
            A command is not finite or beyond the handle's range; nothing has been done then.
        NoSolutionError
            The tip was loaded past what it can hold; the twin stands where it stood before.
        """
        rows = self._commands(handle_angle, force, radial_force, weight, spool_velocity, sheath_bend, let_out)
        count = rows[0].shape[0]
        before = self.state
        if controller is not None:
            return self._controlled(controller, rows, np.asarray(request), tampering)
        outs = []
        for name, axis, row in zip(self.inst.axes, self._axes, rows, strict=True):
            out = np.empty((count, len(_SIGNALS)))
            steps, status = axis.run(row, out)
            if status != Status.OK:
                self.state = before
                raise _lost(status, f"step {steps} ({name}, {self.time + steps * self.time_step:.6g} s)")
            outs.append(out)
        time = np.arange(self._steps + 1, self._steps + 1 + count, dtype=np.float64) * self.time_step
        self._steps += count
        return as_run(time, self.inst.axes, rows, outs)

    def _controlled(
        self, controller: "Controller", rows: list[Array], request: NDArray[Any], tampering: Sequence[Tampering]
    ) -> Run:
        """Step with the controller in the loop; if the tip is lost, twin and controller stay where it was."""
        controller.refuse_another(self.inst)
        count = rows[0].shape[0]
        start = self._steps * self.time_step
        time = np.arange(self._steps + 1, self._steps + 1 + count, dtype=np.float64) * self.time_step
        if any(np.any(row[:, _ARGUMENTS["spool_velocity"]]) for row in rows):
            raise ValueError("spool_velocity and a controller are both given; allowed is one of them.")
        values, modes = (None, None) if not tampering else tampered(tampering, self.inst.axes, start, time)
        outs = np.empty((len(rows), count, len(_SIGNALS)))
        control = np.empty((len(rows), count, len(_CONTROL)))
        steps, status = _core.run_controlled(
            self._axes,
            controller.core,
            np.stack(rows),
            self._steps_per_tick,
            self.time_step,
            self._steps,
            _requests(controller, request, count),
            values,
            modes,
            outs,
            control,
        )
        self._steps += steps
        if status != Status.OK:
            raise _lost(status, f"step {steps} ({self.time:.6g} s)")
        return as_run(time, self.inst.axes, rows, list(outs), list(control))

    def step(
        self,
        handle_angle: ArrayLike,
        force: ArrayLike = 0.0,
        *,
        radial_force: ArrayLike = 0.0,
        weight: ArrayLike = 0.0,
        spool_velocity: ArrayLike = 0.0,
    ) -> Run:
        """Advance by one step and return its signals, without the row; arguments and errors as for :meth:`run`."""
        run = self.run(
            np.asarray(handle_angle, float)[np.newaxis],
            np.asarray(force, float)[np.newaxis],
            radial_force=np.asarray(radial_force, float)[np.newaxis],
            weight=np.asarray(weight, float)[np.newaxis],
            spool_velocity=np.broadcast_to(np.asarray(spool_velocity, float), (2,) if len(self._axes) == 1 else (2, 2))[
                np.newaxis
            ],
        )
        return Run(run.time[0], run.axes, **{name: values[0] for name, values in run.signals().items()})

    def energy(
        self,
        handle_angle: ArrayLike,
        force: ArrayLike = 0.0,
        *,
        radial_force: ArrayLike = 0.0,
        weight: ArrayLike = 0.0,
        spool_velocity: ArrayLike = 0.0,
    ) -> Energy:
        """Step over arrays of commands and return where the energy went; of one axis, otherwise as :meth:`run`."""
        if len(self._axes) != 1:
            raise ValueError(f"{self.inst.name} has two axes; allowed is one: the twin of inst.axis(name).")
        (rows,) = self._commands(handle_angle, force, radial_force, weight, spool_velocity)
        before = self.state
        steps, status, energies, least, residual, sweeps = self._axes[0].audit(rows)
        if status != Status.OK:
            self.state = before
            raise _lost(status, f"step {steps} ({self.time + steps * self.time_step:.6g} s)")
        self._steps += steps
        stored_before, stored_after, handle, spools, load, friction, damping = energies
        return Energy(stored_before, stored_after, handle, spools, load, friction, damping, least, residual, sweeps)

    def loosen(self, length: float = 2e-3) -> Run:
        """Let both motors out by a length (m) at a third of their speed, without load, and return that run.

        The handle stays where it was last told to be.

        Raises
        ------
        ValueError
            The length is not positive.
        """
        if not 0 < length < 1:
            raise ValueError(f"length is {length!r}; allowed is a length above 0 and below 1 m.")
        drives = self.inst.drives
        speed = drives.motor_speed / drives.gear_ratio / 3
        started = self._spools()
        runs = []
        # The drives take their time to get up to speed, and to stop.
        expected = length / drives.spool_radius / speed + 2 * speed * drives.gear_ratio / drives.motor_acceleration
        for _ in range(2 * round(expected / _LOOSENING_BLOCK) + 20):
            unwinding = (started - self._spools()).min() * drives.spool_radius < length
            runs.append(self._hold(-speed if unwinding else 0.0))
            if not unwinding and np.abs(runs[-1]["spool_velocity"][-1]).max() < 1e-6 * speed:
                break
        return concatenate(runs)

    def _spools(self) -> Array:
        """Return where the spools are, rad, in whatever order."""
        columns = slice(_SIGNALS.index("spool_angle.agonist"), _SIGNALS.index("spool_angle.antagonist") + 1)
        return np.array([axis.signals(np.zeros((1, len(_COMMANDS))))[columns] for axis in self._axes])

    def _hold(self, velocity: float) -> Run:
        """Run for a block with the handle where it was last wanted, no load, and all spools at a velocity (rad/s)."""
        count = max(1, round(_LOOSENING_BLOCK / self.time_step))
        wanted = np.array([axis.handle_wanted for axis in self._axes])
        handle = np.tile(wanted, (count, 1)) if len(self._axes) > 1 else np.full(count, wanted[0])
        return self.run(handle, spool_velocity=np.full((*handle.shape, len(_TENDONS)), velocity))

    def _commands(self, *arguments: ArrayLike) -> list[Array]:
        """Return the commands of each axis as rows, checked."""
        axes = len(self._axes)
        arrays = [np.asarray(argument, float) for argument in arguments]
        count = arrays[0].shape[0] if arrays[0].ndim else 1
        base: tuple[int, ...] = (count,) if axes == 1 else (count, axes)
        rows = np.zeros((axes, count, len(_COMMANDS)))
        for (name, columns), array in zip(_ARGUMENTS.items(), arrays, strict=False):
            per_tendon = name in _PER_TENDON
            wanted = (*base, 2) if per_tendon else base
            # A number per step holds for both axes.
            given = array[:, np.newaxis] if axes == 2 and not per_tendon and array.shape == (count,) else array
            try:
                full = np.broadcast_to(given, wanted)
            except ValueError:
                raise ValueError(f"{name} has shape {array.shape}; allowed is {wanted}, or a number.") from None
            _refuse_not_finite(name, array)
            for n in range(axes):
                rows[n, :, columns] = full if axes == 1 else full[:, n]
        if rows[..., _COMMANDS.index("weight")].any():
            _refuse_without_rig(self.inst)
        for n, one in enumerate(self._single):
            if not one.dynamics.hand_stiffness:
                _refuse_beyond_range(one, rows[n, :, 0], self.inst.axes[n] if axes > 1 else "")
        return list(rows)


@dataclass(frozen=True)
class Batch:
    """The runs of :func:`run_many`: kept signals by name, shape (runs, samples); NaN after a run was lost."""

    time: Array
    signals: Mapping[str, Array]
    steps: NDArray[np.int64]
    """Steps that each run took."""
    status: NDArray[np.int64]
    """Why each run took no more, as numbers of :class:`tenodesis.statics.Status`."""

    def __getitem__(self, name: str) -> Array:
        return self.signals[name]


def run_many(
    inst: Instrument | Sequence[Instrument],
    handle_angle: ArrayLike,
    force: ArrayLike = 0.0,
    *,
    radial_force: ArrayLike = 0.0,
    weight: ArrayLike = 0.0,
    spool_velocity: ArrayLike = 0.0,
    vary: Mapping[str, ArrayLike] | None = None,
    seeds: ArrayLike | None = None,
    signals: Sequence[str] = ("output_angle",),
    every: int = 1,
    time_step: float = TIME_STEP,
    quasi_static: bool = False,
) -> Batch:
    """Run many twins of one axis from rest, side by side over threads; results do not depend on how many.

    Parameters
    ----------
    inst
        The instrument, or one per run; all of one joint type.
    handle_angle, force, radial_force, weight
        Commands as for :meth:`Twin.run`, shape (n,) for all runs or (runs, n).
    spool_velocity
        Spool velocities, rad/s, shape (n, 2) for all runs or (runs, n, 2).
    vary
        Values per run by key of the instrument, as :meth:`Instrument.replace` takes them: ``{"pretension": array}``,
        ``{"friction.vertex_coefficient": array}``.
    seeds
        Seed per run; by default 0, 1, 2, ...
    signals
        Signals to keep, by name; a tendon's is written ``tension.agonist``.
    every
        Keep every so-manieth step.
    time_step, quasi_static
        As for :class:`Twin`.

    Raises
    ------
    ValueError
        Shapes do not fit, a command is not finite or beyond the handle's range, or a signal is unknown.
    InstrumentError
        A varied value is not allowed.
    """
    insts = _instruments(inst, vary or {})
    commands = _shared_commands(len(insts), handle_angle, force, radial_force, weight, spool_velocity)
    runs = len(insts)
    if commands.shape[0] > 1 and runs == 1:
        insts = insts * commands.shape[0]
        runs = len(insts)
    if commands.shape[0] not in (1, runs):
        raise ValueError(f"commands are for {commands.shape[0]} runs, instruments for {runs}; allowed is the same.")
    prescribed = [one for one in insts if not one.dynamics.hand_stiffness]
    if prescribed:
        narrowest = min(prescribed, key=lambda one: one.handle_range)
        for row in commands[:, :, 0]:
            _refuse_beyond_range(narrowest, row, "")
    if commands[:, :, _COMMANDS.index("weight")].any():
        for one in insts:
            _refuse_without_rig(one)
    if not commands.shape[1]:
        raise ValueError("handle_angle is empty; allowed is at least one step.")
    if not (isinstance(every, int | np.integer) and 1 <= every <= commands.shape[1]):
        raise ValueError(f"every is {every!r}; allowed is a whole number from 1 to {commands.shape[1]}, the steps.")
    for name in signals:
        if name not in _SIGNALS:
            raise ValueError(f"signals names {name!r}; allowed are {', '.join(_SIGNALS)}.")
    chosen = [_SIGNALS.index(name) for name in signals]
    seed_row = _seeds(seeds, runs)
    spec = _spec(insts[0], time_step, quasi_static)
    parameters = _rows(insts, time_step, quasi_static)
    out = np.full((runs, len(chosen), commands.shape[1] // every), np.nan)
    told = np.zeros((runs, 2), np.int64)
    _core.run_many(spec, parameters, commands, seed_row, chosen, every, out, told, threads())
    time = (1 + np.arange(out.shape[2])) * every * time_step
    return Batch(time, {name: out[:, n] for n, name in enumerate(signals)}, told[:, 0], told[:, 1])


def swing(inst: Instrument) -> float:
    """Return the angular frequency of the straight, unloaded, frictionless tip, rad/s."""
    return sqrt(float(statics.flexural_stiffness(inst, 0.0)) / _inertia(inst))


def longest_step(inst: Instrument) -> float:
    """Return the longest time step that a swing of the tip allows, s."""
    return _MOST_PHASE / swing(inst)


def _instruments(inst: Instrument | Sequence[Instrument], vary: Mapping[str, ArrayLike]) -> list[Instrument]:
    insts = [inst] if isinstance(inst, Instrument) else list(inst)
    if not insts:
        raise ValueError("inst is empty; allowed is at least one instrument.")
    columns = {key: np.atleast_1d(np.asarray(values)) for key, values in vary.items()}
    for key, column in columns.items():
        if column.ndim != 1 or not column.size or column.dtype == object:
            raise ValueError(f"vary[{key!r}] has shape {column.shape}; allowed is one value per run.")
    lengths = {column.size for column in columns.values()} | ({len(insts)} if len(insts) > 1 else set())
    if len(lengths) > 1:
        raise ValueError(f"vary has columns of {sorted(lengths)} runs; allowed is the same number for all.")
    if columns:
        runs = lengths.pop()
        insts = insts * runs if len(insts) == 1 else insts
        insts = [
            one.replace(**{key: column[n].item() for key, column in columns.items()}) for n, one in enumerate(insts)
        ]
    first = insts[0]
    fixed = ("law", "sheath_contacts")
    for one in insts:
        if len(one.axes) != 1:
            raise ValueError(f"{one.name} has two axes; allowed is one: inst.axis(name).")
        same = all(getattr(one.friction, key) == getattr(first.friction, key) for key in fixed)
        if one.joint_type != first.joint_type or not same or one.sensors.sampling_rate != first.sensors.sampling_rate:
            raise ValueError(
                "the runs differ in joint type, friction law, sheath contacts or sampling rate; allowed is one of each."
            )
    return insts


def _shared_commands(runs: int, *arguments: ArrayLike) -> Array:
    """Return commands by run, step and column; one run's if all share them."""
    arrays = [np.asarray(argument, float) for argument in arguments]
    flat = [array if name != "spool_velocity" else array[..., 0] if array.ndim > 1 else np.zeros(())
            for name, array in zip(_ARGUMENTS, arrays, strict=False)]  # fmt: skip
    try:
        shape = np.broadcast_shapes(*(array.shape for array in flat))
    except ValueError:
        told = ", ".join(f"{name} {array.shape}" for name, array in zip(_ARGUMENTS, arrays, strict=False))
        raise ValueError(f"the shapes do not broadcast: {told}.") from None
    shape = (1,) * (2 - len(shape)) + shape
    if len(shape) != 2 or (shape[0] not in (1, runs) and runs != 1):
        raise ValueError(f"commands have shape {shape}; allowed is (n,) or ({runs}, n).")
    rows = np.zeros((*shape, len(_COMMANDS)))
    for (name, columns), array in zip(_ARGUMENTS.items(), arrays, strict=False):
        _refuse_not_finite(name, array)
        rows[..., columns] = array
    return rows


def _seeds(seeds: ArrayLike | None, runs: int) -> NDArray[np.uint64]:
    given = list(range(runs)) if seeds is None else np.asarray(seeds).tolist()
    if not isinstance(given, list) or len(given) != runs:
        raise ValueError(f"seeds has shape {np.shape(given)}; allowed is ({runs},).")
    for seed in given:
        _check_seed(seed)
    return np.array(given, np.uint64)


def _rows(insts: Sequence[Instrument], time_step: float, quasi_static: bool) -> Array:
    """Return the parameters of every run, each instrument checked and worked out once."""
    rows: dict[int, list[float]] = {}
    for one in insts:
        if id(one) not in rows:
            _steps_per_sample(one, time_step, quasi_static)
            rows[id(one)] = _parameters(one, time_step)
    return np.array([rows[id(one)] for one in insts])


def _inertia(inst: Instrument) -> float:
    given = inst.dynamics.tip_inertia
    return float(statics.flexural_stiffness(inst, 0.0)) / _DEFAULT_SWING**2 if given is None else given


def _handle_share(inst: Instrument) -> float:
    """Return the share of a tendon's compliance between spool and handle joint, by length unless it is given."""
    given = inst.friction.handle_compliance_share
    return inst.handle_length / (inst.tendon_length or inst.overall_length) if given is None else given


def _parameters(inst: Instrument, time_step: float) -> list[float]:
    """Return the numbers of a twin, then those of its axis, in the core's order."""
    friction, dynamics, drives = inst.friction, inst.dynamics, inst.drives
    sensors, mismatch = inst.sensors, inst.mismatch
    stiffness = float(statics.flexural_stiffness(inst, 0.0))
    inertia = _inertia(inst)
    damping = dynamics.tip_damping
    values = {
        "vertex_coefficient": friction.vertex_coefficient,
        "sheath_coefficient": friction.sheath_coefficient,
        "sheath_bend": friction.sheath_bend,
        "sheath_bend_rate": friction.sheath_bend_per_handle_angle,
        "viscous": friction.viscous,
        "constant": friction.constant,
        "static_ratio": friction.static_ratio,
        "stribeck_speed": friction.stribeck_speed,
        "memory": friction.memory,
        "handle_length_share": _handle_share(inst),
        "stiffness_ratio": mismatch.stiffness_ratio,
        "pretension_ratio": mismatch.pretension_ratio,
        "tip_inertia": inertia,
        "tip_damping": 2 * _DEFAULT_DAMPING_RATIO * sqrt(stiffness * inertia) if damping is None else damping,
        "output_stop": inst.output_stop,
        "stop_stiffness": _STOP_STIFFENING * stiffness,
        "hand_stiffness": dynamics.hand_stiffness,
        "hand_damping": dynamics.hand_damping,
        "hand_inertia": dynamics.hand_inertia,
        "spool_radius": drives.spool_radius,
        "spool_speed_limit": drives.motor_speed / drives.gear_ratio,
        "spool_acceleration_limit": drives.motor_acceleration / drives.gear_ratio,
        "drive_time_constant": drives.time_constant,
        "backlash": drives.backlash,
        "rig_pulley_radius": inst.conditions.cable_pulley_radius or 0.0,
        "encoder_noise": sensors.encoder_noise,
        "encoder_range": sensors.encoder_range,
        "encoder_resolution": sensors.encoder_range / 2**sensors.encoder_bits,
        "handle_encoder_offset": mismatch.handle_encoder_offset,
        "output_encoder_offset": mismatch.output_encoder_offset,
        "motor_encoder_resolution": 2 * pi / drives.encoder_counts / drives.gear_ratio,
        "load_cell_noise": sensors.load_cell_noise,
        "load_cell_range": sensors.load_cell_range,
        # The converter's range reaches to either side.
        "load_cell_resolution": 2 * sensors.load_cell_range / 2**sensors.load_cell_bits,
        "time_step": time_step,
    }
    for n, tendon in enumerate(_TENDONS):
        values[f"{tendon}_load_cell_gain"] = mismatch.load_cell_gain[n]
        values[f"{tendon}_load_cell_bias"] = mismatch.load_cell_bias[n]
    return [values[name] for name in _ROW] + inst.spec.__getstate__()[1]


def _requests(controller: "Controller", request: NDArray[Any], count: int) -> NDArray[np.uint8] | None:
    """Return the requests of each step; what was asked of the controller before comes with the first."""
    asked = controller.take_request()
    if not asked and not request.any():
        return None
    requests = np.array(np.broadcast_to(request, (count,)), np.uint8)
    if count and not requests[0]:
        requests[0] = asked
    return requests


def numbers(inst: Instrument, time_step: float = TIME_STEP) -> dict[str, float]:
    """Return what an instrument's twin and axis are made of, in SI units, by the core's names; NaN where not given."""
    return dict(zip((*_ROW, *PARAMETERS), _parameters(inst, time_step), strict=True))


def _spec(inst: Instrument, time_step: float, quasi_static: bool) -> _core.TwinSpec:
    per_sample = _steps_per_sample(inst, time_step, quasi_static)
    numbers = _parameters(inst, time_step)[: len(_ROW)]
    friction = inst.friction
    return _core.TwinSpec(
        inst.spec, numbers, friction.law == "stribeck", friction.sheath_contacts, per_sample, quasi_static
    )


def _steps_per_sample(inst: Instrument, time_step: float, quasi_static: bool) -> int:
    """Return how many steps a sample takes, unless the time step or the tendons' lengths do not suit the instrument."""
    if not (np.isfinite(time_step) and time_step > 0):
        raise ValueError(f"time_step is {time_step!r}; allowed is a time above 0 s.")
    longest = longest_step(inst)
    if not quasi_static and time_step > longest:
        raise ValueError(
            f"time_step is {time_step:g} s; allowed is at most {longest:.3g} s, a twelfth of a swing of the tip of "
            f"{inst.name} ({swing(inst) / (2 * pi):.3g} Hz)."
        )
    per_sample = max(1, round(1 / (inst.sensors.sampling_rate * time_step)))
    if (
        1 / inst.sensors.sampling_rate > time_step
        and abs(per_sample * time_step * inst.sensors.sampling_rate - 1) > 1e-6
    ):
        raise ValueError(
            f"time_step is {time_step:g} s; allowed is a whole part of the sampling period of "
            f"{1 / inst.sensors.sampling_rate:g} s, or more."
        )
    joints = sum(_core.joint_shares(inst.spec))
    if not _handle_share(inst) + joints < 1:
        given = inst.friction.handle_compliance_share
        what, instead = (
            ("handle_length and joints take", "of the length of a tendon")
            if given is None
            else (f"friction.handle_compliance_share is {given:g}, which with the joints makes", "of the compliance")
        )
        allowed = (
            "all of it: a shorter handle_length or a longer tendon_length."
            if given is None
            else f"all of it: a share below {1 - joints:.3g}."
        )
        raise ValueError(
            f"{what} {_handle_share(inst) + joints:.3g} {instead} of {inst.name}; allowed is less than {allowed}"
        )
    return per_sample


def _check_seed(seed: int) -> None:
    if not isinstance(seed, int | np.integer) or isinstance(seed, bool) or not 0 <= seed < 2**64:
        raise ValueError(f"seed is {seed!r}; allowed is a whole number from 0 to 2**64 - 1.")


def _refuse_not_finite(name: str, array: Array) -> None:
    finite = np.isfinite(array)
    if not finite.all():
        at = tuple(int(i) for i in np.unravel_index(int(np.argmin(finite)), array.shape))
        place = f"[{', '.join(str(i) for i in at)}]" if at else ""
        raise ValueError(f"{name}{place} is {array[at]}; allowed is a finite number.")


def _refuse_beyond_range(inst: Instrument, handle_angle: Array, axis: str) -> None:
    wrong = np.flatnonzero(np.abs(handle_angle) > inst.handle_range + 1e-9)
    if wrong.size:
        at = int(wrong[0])
        raise ValueError(
            f"handle_angle[{at}]{f' of {axis}' if axis else ''} is {handle_angle[at]:.6g} rad "
            f"({degrees(handle_angle[at]):.4g} deg); allowed is the handle's range of "
            f"±{degrees(inst.handle_range):.4g} deg."
        )


def _refuse_without_rig(inst: Instrument) -> None:
    if inst.conditions.cable_pulley_radius is None:
        raise ValueError(
            f"weight is given, but {inst.name} has no conditions.cable_pulley_radius; allowed is a force, or that key."
        )


def _lost(status: Status, place: str) -> Exception:
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


def as_run(
    time: Array, axes: tuple[str, ...], rows: Sequence[Array], outs: Sequence[Array], controls: Sequence[Array] = ()
) -> Run:
    """Return rows of the core as signals: by step, by axis if there are two, by tendon.

    Parameters
    ----------
    time
        Of each row, s, shape (n,).
    axes
        Names of the axes.
    rows, outs, controls
        Per axis, commands, the twin's signals and the controller's, a row each per step.
    """

    def signal(names: Sequence[str], stack: Sequence[Array], name: str) -> Array:
        if name in names:
            columns: int | slice = names.index(name)
        else:
            first = names.index(f"{name}.{_TENDONS[0]}")
            columns = slice(first, first + len(_TENDONS))
        per_axis = [one[:, columns] for one in stack]
        return per_axis[0] if len(stack) == 1 else np.stack(per_axis, 1)

    def command(columns: int | slice) -> Array:
        per_axis = [row[:, columns] for row in rows]
        return per_axis[0] if len(rows) == 1 else np.stack(per_axis, 1)

    sent = {name: signal(_CONTROL, controls, name) for name in _CONTROLLED} if controls else {}
    return Run(
        time,
        axes,
        commanded_handle_angle=command(0),
        radial_force=command(2),
        **{"commanded_spool_velocity": command(slice(4, 6)), **sent},
        **{name: signal(_SIGNALS, outs, name) for name in _MEASURED_AND_TRUE},
    )
