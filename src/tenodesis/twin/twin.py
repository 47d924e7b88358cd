"""The digital twin: the instrument on its bench in time, with friction, drives, sensors and load rig.

Angles in rad, forces in N, time in s. Commands are the values at the end of each step.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tenodesis import _core, plant
from tenodesis._core import Status
from tenodesis.errors import ArgumentError
from tenodesis.instrument import InstrumentLike, as_short_form
from tenodesis.run import TENDONS, Array, Run, concatenate
from tenodesis.twin.closed_loop import LoopController, SignalFault, run_closed_loop, warn_of_faults
from tenodesis.twin.contact import Contacts, by_axis, rows_of
from tenodesis.twin.rows import (
    ARGUMENTS,
    COMMANDS,
    PER_TENDON,
    SIGNALS,
    as_run,
    check_finite,
    check_handle_range,
    check_rig,
    check_seed,
    commanded,
    lost,
    with_currents,
)

_LOOSENING_BLOCK = 0.05  # s


class State(NamedTuple):
    """The complete state of a twin, to store and set again; its bytes are valid for this version of the core only."""

    kind: str
    """The kind of twin to which it can be set."""
    time: float
    axes: tuple[bytes, ...]


class Energy(NamedTuple):
    """Energy balance over a period, J, and how well the steps satisfied the friction law."""

    stored_before: float
    stored_after: float
    handle: float
    """Work of the handle on the tendons."""
    spools: float
    """Work of the spools on the tendons."""
    load: float
    """Work of the load on the tip."""
    friction: float
    """Dissipated by friction."""
    damping: float
    """Dissipated by damping."""
    tissue: float
    """Dissipated by tissue's damping, or stored in tissue that was taken away."""
    least_friction: float
    """Smallest dissipation by friction in any step, by the tensions at its end, where the law is satisfied."""
    residual: float
    """Largest residual of the friction law in any step, as a share of the tension scale."""
    sweeps: int
    """Largest number of passes of a step."""

    @property
    def work(self) -> float:
        """All work done on and by the instrument, as a positive sum."""
        return abs(self.handle) + abs(self.spools) + abs(self.load)

    @property
    def unaccounted(self) -> float:
        """Residual of the energy balance."""
        put_in = self.handle + self.spools + self.load - self.friction - self.damping - self.tissue
        return self.stored_after - self.stored_before - put_in


class Twin:
    """The digital twin of an instrument, at rest with a straight handle and pretensioned tendons at first.

    The instrument's tables friction, dynamics, drives, sensors and mismatch are those of the twin. The time step is in
    s; the sensors' noise has a seed from 0 to 2**64 - 1. A quasi-static twin leaves inertia and damping out: every step
    ends at rest.

    Raises ValueError if the time step is too long for the tip's oscillation or does not divide the sampling period, or
    the seed is invalid.
    """

    def __init__(
        self, inst: InstrumentLike, *, time_step: float = plant.TIME_STEP, seed: int = 0, quasi_static: bool = False
    ) -> None:
        inst = as_short_form(inst)
        check_seed(seed)
        self.inst = inst
        self.time_step = time_step
        self.seed = int(seed)
        self.quasi_static = quasi_static
        # Axes draw from distant parts of the same random sequence, whose increment is this odd number.
        self._axes = [
            _core.Twin(
                plant.spec(planar, time_step, quasi_static), (int(seed) + (n << 40) * 0x9E3779B97F4A7C15) % 2**64
            )
            for n, planar in enumerate(inst.planar)
        ]
        self._steps = 0
        self._steps_per_tick = plant.steps_per_sample(inst, time_step, quasi_static)
        friction = inst.friction
        self._kind = (
            f"{inst.joint_type} joints of {inst.name}, {len(inst.axes)} axes, {friction.law} friction, "
            f"{friction.sheath_contacts} sheath contacts, "
            f"{'' if friction.vertices_per_joint == 1 else 'two vertices a joint, '}"
            f"{'bent tendons, ' if friction.bends else ''}{'quasi-static' if quasi_static else 'dynamic'} steps of "
            f"{time_step:g} s"
        )

    def __repr__(self) -> str:
        kind = "quasi-static" if self.quasi_static else "dynamic"
        steps = f"{kind} steps of {self.time_step:g} s"
        return f"<Twin of {self.inst.name!r} at {self.time:.6g} s, {steps}, seed {self.seed}>"

    @property
    def time(self) -> float:
        """Time simulated since the start, s."""
        return self._steps * self.time_step

    @property
    def cores(self) -> list[_core.Twin]:
        """The twins of the core, one per axis; :attr:`time` is not updated if they are stepped directly."""
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
        """The complete state; setting it restores the twin to it."""
        return State(self._kind, self.time, tuple(axis.state for axis in self._axes))

    @state.setter
    def state(self, state: State) -> None:
        if not isinstance(state, State):
            raise TypeError(f"state is {state!r}; it must be the state of a twin.")
        if state.kind != self._kind:
            raise ArgumentError(
                f"state is of a twin with {state.kind}; it must be of one with {self._kind}.",
                key="state",
                value=state.kind,
                allowed=self._kind,
            )
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
        contact: Contacts | None = None,
        controller: LoopController | None = None,
        request: ArrayLike = 0,
        fault_injection: Sequence[SignalFault] = (),
        relay: float = np.inf,
    ) -> Run:
        """Step over arrays of commands, from the present state, and return the signals, one row per step.

        Parameters
        ----------
        handle_angle
            Handle angle, or the hand's aim if the hand has a stiffness, rad, shape (n,); with two axes (n, 2).
        force
            Tangential force at the tip, N, turning with it; positive opposes positive flexion. As handle_angle, or a
            number.
        radial_force
            Force along the end-effector, N; positive outward.
        weight
            Weight on one cable of the load rig more than on the other, N, which makes a tangential force (Fig. 13).
        spool_velocity
            Spool velocities commanded, rad/s, agonist and antagonist of each axis: shape (n, tendons), or (tendons,).
        sheath_bend
            Bend of the sheath in addition to the instrument's, rad; as handle_angle, or a number.
        let_out
            Length of tendon that has slipped off its spool, m, as spool_velocity; half a metre for a torn one.
        contact
            Tissue at the tip, for the whole call; with two axes one per axis, None where there is none. It stays in
            place if the next call has the same.
        controller
            Closes the loop: it is given the sensors' readings, and the drives its spool velocities. It goes on from the
            call before on this twin; one that has run elsewhere must be reset first.
        request
            Request to the controller at each step, values of :class:`tenodesis.control.Request`; shape (n,).
        fault_injection
            Faults on the signals between the twin and the controller.
        relay
            Time in which a relay in the motors' supply opens once the controller demands it, s; infinite if there is
            none. Without supply the motors brake.

        Raises
        ------
        ValueError
            A command is not finite or beyond the handle's range, the relay's time is negative, the tip is inside tissue
            that is placed, two faults are at one signal at the same time, or the controller has run on another twin and
            was not reset; nothing has been done then.
        NoSolutionError
            The load on the tip is more than it can hold; the twin is then in its state before the call.

        Warns
        -----
        FaultWarning
            The controller faulted.
        """
        rows = self._commands(handle_angle, force, radial_force, weight, spool_velocity, sheath_bend, let_out)
        self._place(contact, rows)
        count = rows[0].shape[0]
        time = np.arange(self._steps + 1, self._steps + 1 + count, dtype=np.float64) * self.time_step
        given = commanded(rows, tissue=contact is not None)
        if controller is None:
            return with_currents(as_run(time, self.inst.axes, given, self._step_axes(rows)), self.inst)
        controller.check_instrument(self.inst)
        controller.begin(self, self.time)
        steps, status, outs, control = run_closed_loop(
            self._axes,
            rows,
            controller,
            np.asarray(request),
            fault_injection,
            axes=self.inst.axes,
            first_step=self._steps,
            steps_per_tick=self._steps_per_tick,
            time_step=self.time_step,
            relay=relay,
        )
        self._steps += steps
        controller.begin(self, self.time)
        if status != Status.OK:
            raise lost(status, f"step {steps} ({self.time:.6g} s)")
        run = with_currents(as_run(time, self.inst.axes, given, outs, control), self.inst)
        warn_of_faults(run, self.inst)
        return run

    def _step_axes(self, rows: list[Array]) -> list[Array]:
        """Step every axis over its commands and return its signals; a lost step leaves the twin unchanged."""
        before = self.state
        outs = []
        for name, axis, row in zip(self.inst.axes, self._axes, rows, strict=True):
            out = np.empty((len(row), len(SIGNALS)))
            steps, status = axis.run(row, out)
            if status != Status.OK:
                self.state = before
                raise lost(status, f"step {steps} ({name}, {self.time + steps * self.time_step:.6g} s)")
            outs.append(out)
        self._steps += len(rows[0])
        return outs

    def step(
        self,
        handle_angle: ArrayLike,
        force: ArrayLike = 0.0,
        *,
        radial_force: ArrayLike = 0.0,
        weight: ArrayLike = 0.0,
        spool_velocity: ArrayLike = 0.0,
        contact: Contacts | None = None,
    ) -> Run:
        """Advance by one step and return its signals, without their first dimension; otherwise as :meth:`run`."""
        run = self.run(
            np.asarray(handle_angle, float)[np.newaxis],
            np.asarray(force, float)[np.newaxis],
            radial_force=np.asarray(radial_force, float)[np.newaxis],
            weight=np.asarray(weight, float)[np.newaxis],
            spool_velocity=np.broadcast_to(np.asarray(spool_velocity, float), 2 * len(self._axes))[np.newaxis],
            contact=contact,
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
        contact: Contacts | None = None,
    ) -> Energy:
        """Step over arrays of commands and return the energy balance; for one axis, otherwise as :meth:`run`."""
        if len(self._axes) != 1:
            raise ArgumentError(f"{self.inst.name} has two axes; it must have one: make the twin of inst.axis(name).")
        (rows,) = self._commands(handle_angle, force, radial_force, weight, spool_velocity)
        self._place(contact, [rows])
        before = self.state
        steps, status, energies, least, residual, sweeps = self._axes[0].audit(rows)
        if status != Status.OK:
            self.state = before
            raise lost(status, f"step {steps} ({self.time + steps * self.time_step:.6g} s)")
        self._steps += steps
        stored_before, stored_after, handle, spools, load, friction, damping, tissue = energies
        return Energy(
            stored_before, stored_after, handle, spools, load, friction, damping, tissue, least, residual, sweeps
        )

    def loosen(self, length: float = 2e-3) -> Run:
        """Unwind both spools by a length (m) at a third of their speed, without load, and return that run.

        The handle stays at its last commanded angle. Raises ValueError if the length is not positive.
        """
        if not 0 < length < 1:
            raise ArgumentError(key="length", value=length, allowed="a length above 0 and below 1 m")
        drives = self.inst.drives
        speed = drives.motor_speed / drives.gear_ratio / 3
        start = self._spool_angles()
        runs = []
        # The drives need time to accelerate and to stop.
        expected = length / drives.spool_radius / speed + 2 * speed * drives.gear_ratio / drives.motor_acceleration
        for _ in range(2 * round(expected / _LOOSENING_BLOCK) + 20):
            unwinding = (start - self._spool_angles()).min() * drives.spool_radius < length
            runs.append(self._hold(-speed if unwinding else 0.0))
            if not unwinding and np.abs(runs[-1]["spool_velocity"][-1]).max() < 1e-6 * speed:
                break
        return concatenate(runs)

    def _place(self, contact: Contacts | None, rows: Sequence[Array]) -> None:
        """Write tissue into the commands of each axis; the tip must be outside of tissue that was not there before."""
        tissue = rows_of(contact, self.inst.axes)
        for axis, one, row, columns in zip(self._axes, by_axis(contact, self.inst.axes), rows, tissue, strict=True):
            if one is not None and axis.contact != one.row:
                one.check_outside(axis.signals(np.zeros((1, len(COMMANDS))))[SIGNALS.index("output_angle")])
            row[:, ARGUMENTS["contact"]] = columns

    def _spool_angles(self) -> Array:
        """Return the spools' angles, rad, shape (axes, 2)."""
        columns = slice(SIGNALS.index("spool_angle.agonist"), SIGNALS.index("spool_angle.antagonist") + 1)
        return np.array([axis.signals(np.zeros((1, len(COMMANDS))))[columns] for axis in self._axes])

    def _hold(self, velocity: float) -> Run:
        """Run for a block, unloaded, the handle at its last commanded angle, all spools at a velocity (rad/s)."""
        count = max(1, round(_LOOSENING_BLOCK / self.time_step))
        aim = np.array([axis.handle_wanted for axis in self._axes])
        handle = np.tile(aim, (count, 1)) if len(self._axes) > 1 else np.full(count, aim[0])
        return self.run(handle, spool_velocity=np.full((count, len(TENDONS) * len(self._axes)), velocity))

    def _commands(self, *arguments: ArrayLike) -> list[Array]:
        """Return the commands of each axis as rows, checked."""
        axes = len(self._axes)
        arrays = [np.asarray(argument, float) for argument in arguments]
        count = arrays[0].shape[0] if arrays[0].ndim else 1
        base: tuple[int, ...] = (count,) if axes == 1 else (count, axes)
        rows = np.zeros((axes, count, len(COMMANDS)))
        for (name, columns), array in zip(ARGUMENTS.items(), arrays, strict=False):
            per_tendon = name in PER_TENDON
            shape = (count, 2 * axes) if per_tendon else base
            # A value per step is for both axes.
            given = array[:, np.newaxis] if axes == 2 and not per_tendon and array.shape == (count,) else array
            if per_tendon and array.shape[-2:] == (axes, 2) and axes > 1:
                given = array.reshape(*array.shape[:-2], -1)
            try:
                full = np.broadcast_to(given, shape)
            except ValueError:
                problem = f"{name} has shape {array.shape}; it must be {shape}, or a number."
                raise ArgumentError(problem, key=name, value=array.shape, allowed=str(shape)) from None
            check_finite(name, array)
            for n in range(axes):
                own = full[:, 2 * n : 2 * n + 2] if per_tendon else full if axes == 1 else full[:, n]
                rows[n, :, columns] = own
        if rows[..., COMMANDS.index("weight")].any():
            check_rig(self.inst)
        for n, planar in enumerate(self.inst.planar):
            if not planar.dynamics.hand_stiffness:
                check_handle_range(planar, rows[n, :, 0], self.inst.axes[n] if axes > 1 else "")
        return list(rows)
