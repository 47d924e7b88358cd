"""The digital twin: the instrument on its bench in time, with friction, drives, sensors, and loads.

Angles in rad, forces in N, time in s. Commands are the values at the end of each step.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple, Unpack

import numpy as np
from numpy.typing import ArrayLike

from tenodesis import _core, plant
from tenodesis._core import Status
from tenodesis.control.joints import JointController
from tenodesis.control.pairs import compensated
from tenodesis.errors import ArgumentError
from tenodesis.instrument import Instrument, InstrumentLike, ShortForm, as_instrument, expanded
from tenodesis.run import Array, Names, Run, concatenate
from tenodesis.twin.axes_core import AxesCore
from tenodesis.twin.chain_core import ChainCore
from tenodesis.twin.closed_loop import (
    LoopController,
    SignalFault,
    controlled_signals,
    run_closed_loop,
    run_joint_loop,
    warn_of_faults,
)
from tenodesis.twin.commands import Frame, Held, Loads, as_columns, check_held, check_spool_tension, grip_error
from tenodesis.twin.contact import Contact, Contacts, by_axis
from tenodesis.twin.core import Stepped, Surroundings, TwinCore
from tenodesis.twin.rows import check_seed, lost, with_currents

_LOOSENING_BLOCK = 0.05  # s


class State(NamedTuple):
    """The complete state of a twin, to store and set again; its bytes are valid for this version of the core only."""

    kind: str
    """The kind of twin to which it can be set."""
    time: float
    axes: tuple[bytes, ...]
    held: Held | None = None


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
    """Dissipated by damping, and taken from swings that time steps do not follow."""
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
    """The digital twin of an instrument, at rest with straight joints and pretensioned tendons at first.

    The instrument's tables friction, dynamics, drives, sensors and mismatch are those of the twin. The time step is in
    s; the sensors' noise has a seed from 0 to 2**64 - 1. A quasi-static twin leaves inertia and damping out: every step
    ends at rest.

    Raises ValueError if the time step is too long for the fastest oscillation or does not divide the sampling period,
    or the seed is invalid.
    """

    def __init__(
        self, inst: InstrumentLike, *, time_step: float = plant.TIME_STEP, seed: int = 0, quasi_static: bool = False
    ) -> None:
        inst = as_instrument(inst)
        check_seed(seed)
        self.inst = inst
        self.time_step = time_step
        self.seed = int(seed)
        self.quasi_static = quasi_static
        self._core = _core_of(inst, time_step, self.seed, quasi_static)
        self.names = self._core.names
        self._steps = 0
        self._held: Held | None = None
        friction = inst.friction
        self._kind = (
            f"{self._core.kind}, {friction.law} friction, {friction.sheath_contacts} sheath contacts, "
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
    def core(self) -> _core.Twin:
        """The core's twin; :attr:`time` is not updated if it is stepped directly."""
        return self._core.core

    @cached_property
    def live_device(self) -> _core.LiveDevice:
        """It as a device of the live loop; :attr:`time` is not updated by that."""
        return self._core.device(self.time_step)

    @property
    def steps_per_tick(self) -> int:
        """Time steps between two samples of the sensors."""
        return self._core.steps_per_tick

    @property
    def spool_radius(self) -> float:
        """Radius of the spools, m."""
        return self._core.spool_radius

    @property
    def stretch(self) -> float:
        """Largest stretch of a tendon at rest, m."""
        return self._core.stretch

    @cached_property
    def _assumed(self) -> ShortForm:
        """What a controller of the instrument is made for."""
        return compensated(self.inst)

    @property
    def state(self) -> State:
        """The complete state; setting it restores the twin to it."""
        return State(self._kind, self.time, (self._core.state,), self._held)

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
        (self._core.state,) = state.axes
        self._held = state.held
        self._steps = round(state.time / self.time_step)

    def run(
        self,
        handle_angle: ArrayLike,
        force: ArrayLike = 0.0,
        *,
        radial_force: ArrayLike = 0.0,
        weight: ArrayLike = 0.0,
        wrench: ArrayLike = 0.0,
        grip_force: ArrayLike = 0.0,
        spool_velocity: ArrayLike = 0.0,
        sheath_bend: ArrayLike = 0.0,
        let_out: ArrayLike = 0.0,
        spool_tension: ArrayLike = 0.0,
        contact: Contacts | None = None,
        held: Held | None = None,
        axes: Frame = "tip",
        controller: LoopController | JointController | None = None,
        target: ArrayLike | None = None,
        request: ArrayLike = 0,
        fault_injection: Sequence[SignalFault] = (),
        relay: float = np.inf,
    ) -> Run:
        """Step over arrays of commands, from the present state, and return the signals, one row per step.

        Forces on axes are for planar instruments, a wrench for those that list joints and tendons.

        Parameters
        ----------
        handle_angle
            Angles of the handle's joints, or the hand's aim if the hand has a stiffness, rad, shape (n, joints of the
            handle); (n,) for one, or for all alike.
        force
            Tangential force at the tip, N, turning with it; positive opposes positive flexion. As handle_angle, or a
            number.
        radial_force
            Force along the end-effector, N; positive outward.
        weight
            Weight on one cable of the load rig more than on the other, N, which makes a tangential force (Fig. 13).
        wrench
            Force (N) and moment (N m) on the tip, (n, 6) or (6,): x, y, z of either.
        grip_force
            Force that presses the jaws apart, N, (n,) or a number.
        spool_velocity
            Spool velocities commanded, rad/s, agonist and antagonist of each axis: shape (n, tendons), or (tendons,).
        sheath_bend
            Bend of the sheath in addition to the instrument's, rad; as handle_angle, or a number.
        let_out
            Length of tendon that has slipped off its spool, m, as spool_velocity; half a metre for a torn one.
        spool_tension
            Tensions that the drives hold instead of velocities, N, as spool_velocity; 0 for a drive that follows its
            velocity. The tension follows with the drive's lag, quasi-static at once; the spool goes where it must.
        contact
            Tissue at the tip, for the whole call; with several joints one per joint, None where there is none. It stays
            in place if the next call has the same.
        held
            What the jaws hold, for the whole call; it stays in place if the next call has the same.
        axes
            "tip": the wrench turns with the end-effector, z along it; "stem": it keeps its direction.
        controller
            Closes the loop: over the joints with a pair of tendons of their own, or a
            :class:`tenodesis.control.JointController` over all joints, whose estimates it keeps. It is given the
            sensors' readings, and the drives its spool velocities. It goes on from the call before on this twin; one
            that has run elsewhere must be reset first.
        target
            Of a tool without a handle under a controller of all joints: angles commanded to the joints, rad, (n,
            joints) or (joints,). What spool_velocity winds beside it turns them as a rigid coupling would.
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
            A command is not finite, beyond the handle's range, or not one of the instrument's, the relay's time is
            negative, the tip is inside tissue that is placed, the jaws are too narrow for what is put between, two
            faults are at one signal at the same time, or the controller is for another instrument, or has run on
            another twin and was not reset; nothing has been done then.
        NoSolutionError
            The load on the tip is more than it can hold; the twin is then in its state before the call.

        Warns
        -----
        FaultWarning
            The controller faulted.
        """
        before = self.state
        rows, count = self._rows(
            handle_angle,
            force,
            radial_force=radial_force,
            weight=weight,
            wrench=wrench,
            grip_force=grip_force,
            spool_velocity=spool_velocity,
            sheath_bend=sheath_bend,
            let_out=let_out,
            spool_tension=spool_tension,
            contact=contact,
            held=held,
            axes=axes,
        )
        core, first = self._core, self._steps
        signals = core.commanded(rows, tissue=contact is not None, tension=np.ndim(spool_tension) > 0)
        names = self.names
        if target is not None and not isinstance(controller, JointController):
            raise ArgumentError("target is given without a controller of all joints; leave it out.", key="target")
        if controller is None:
            done = core.run(rows)
        elif isinstance(controller, JointController):
            names = controller.names_of(self.inst)
            controller.begin(self, self.time)
            done, control = run_joint_loop(
                core,
                rows,
                controller,
                target=target,
                request=request,
                faults=fault_injection,
                first_step=first,
                time_step=self.time_step,
            )
            signals |= control
        else:
            controller.check_instrument(self._assumed)
            controller.begin(self, self.time)
            done = run_closed_loop(
                core,
                rows,
                controller,
                request,
                fault_injection,
                first_step=first,
                time_step=self.time_step,
                relay=relay,
            )
        self._advance(done, count, before)
        if controller is not None:
            controller.begin(self, self.time)
            if not isinstance(controller, JointController):
                velocity = signals["commanded_spool_velocity"]
                signals |= controlled_signals(done.control, velocity, core.own_tendons)
        run = self._run(first, count, signals | done.signals, names)
        if controller is not None:
            warn_of_faults(run, self.inst)
        return run

    def _advance(self, done: Stepped, count: int, before: State) -> None:
        """Count steps that were taken; of those that were not, return to the state before and raise the reason."""
        if done.status != Status.OK:
            self.state = before
            raise lost(done.status, done.steps, self.time + done.steps * self.time_step)
        self._steps += count

    def _run(self, first: int, count: int, signals: Mapping[str, Array], names: Names) -> Run:
        """Return the run of so many steps after the first ones, from signals by row."""
        time = np.arange(first + 1, first + 1 + count, dtype=np.float64) * self.time_step
        shaped: dict[str, Any] = {name: values.reshape(names.shape(name, count)) for name, values in signals.items()}
        return with_currents(Run(time, *names, **shaped), self.inst)

    def step(self, handle_angle: ArrayLike, force: ArrayLike = 0.0, **loads: Unpack[Loads]) -> Run:
        """Advance by one step and return its signals, without their first dimension; otherwise as :meth:`run`."""
        rows: dict[str, Any] = {
            name: value if name in ("contact", "held", "axes") else np.asarray(value, float)[np.newaxis]
            for name, value in loads.items()
        }
        run = self.run(np.asarray(handle_angle, float)[np.newaxis], np.asarray(force, float)[np.newaxis], **rows)
        signals: dict[str, Any] = {name: values[0] for name, values in run.signals().items()}
        return Run(run.time[0], *run.names, **signals)

    def energy(self, handle_angle: ArrayLike, force: ArrayLike = 0.0, **loads: Unpack[Loads]) -> Energy:
        """Step over arrays of commands and return the energy balance; otherwise as :meth:`run`."""
        before = self.state
        rows, count = self._rows(handle_angle, force, **loads)
        steps, status, values = self._core.audit(rows)
        if status != Status.OK:
            self.state = before
            raise lost(status, steps, self.time + steps * self.time_step)
        self._steps += count
        *energies, sweeps = values
        return Energy._make([*energies, int(sweeps)])

    def loosen(self, length: float = 2e-3) -> Run:
        """Unwind all spools by a length (m) at a third of their speed, without load, and return that run.

        The handle stays at its last commanded angle; tendons that have no pretension are slack as they are, and stay.
        Raises ValueError if the length is not positive.
        """
        if not 0 < length < 1:
            raise ArgumentError(key="length", value=length, allowed="a length above 0 and below 1 m")
        drives = self.inst.drives
        speed = drives.motor_speed / drives.gear_ratio / 3
        start, pretensions = self._core.now()["spool_angle"], self.inst.pretensions
        tight = (pretensions > 0) | ~np.any(pretensions)
        runs = []
        # The drives need time to accelerate and to stop.
        expected = length / self.spool_radius / speed + 2 * speed * drives.gear_ratio / drives.motor_acceleration
        for _ in range(2 * round(expected / _LOOSENING_BLOCK) + 20):
            unwound = (start - self._core.now()["spool_angle"])[..., tight].min() * self.spool_radius
            runs.append(self._hold(np.where(tight, -speed if unwound < length else 0.0, 0.0)))
            if unwound >= length and np.abs(runs[-1]["spool_velocity"][-1]).max() < 1e-6 * speed:
                break
        return concatenate(runs)

    def _hold(self, velocity: Array) -> Run:
        """Run for a block, unloaded, the handle at its last commanded angle, spools at velocities (rad/s)."""
        count = max(1, round(_LOOSENING_BLOCK / self.time_step))
        handle = np.tile(self._core.handle_wanted(), (count, 1))
        return self.run(handle, spool_velocity=np.tile(velocity, (count, 1)))

    def _rows(self, handle_angle: ArrayLike, force: ArrayLike, **loads: Unpack[Loads]) -> tuple[Array, int]:
        """Return the commands as the core takes them, checked, and their number; what is held is between the jaws."""
        core, given = self._core, dict(loads)
        contact: Any = given.pop("contact", None)
        held: Any = given.pop("held", None)
        axes: Any = given.pop("axes", "tip")
        arguments: dict[str, Any] = {"handle_angle": handle_angle, "force": force, **given}
        commands = as_columns(dict.fromkeys(core.widths, 0.0) | arguments, core.widths, self.inst)
        core.check(commands)
        check_spool_tension(commands["spool_tension"], self.inst)
        tissue = by_axis(contact, self.names.joints)
        if contact is not None or held is not None:
            self._check_outside(tissue, held)
        rows = core.rows(commands, Surroundings(tissue, held, axes))
        self._held = held
        return rows, len(commands["handle_angle"])

    def _check_outside(self, tissue: Sequence[Contact | None], held: Held | None) -> None:
        """Raise ArgumentError if the tip is within tissue, or the jaws within what they hold, that was not there."""
        now = self._core.now()["output_angle"].ravel()
        for one, there, angle in zip(tissue, self._core.tissue(), now, strict=True):
            if one is not None and there != one.row:
                one.check_outside(float(angle))
        if held is not None and self.inst.grip is None:
            raise grip_error("held", self.inst)
        check_held(held, self._held, float(self.inst.grip_arms @ now))


def _core_of(inst: Instrument, time_step: float, seed: int, quasi_static: bool) -> TwinCore:
    """Return the core's twin of an instrument: side by side for axes that do not act on each other, else of a chain."""
    if (axes := inst.short_form) is not None:
        return AxesCore(axes, time_step, seed, quasi_static)
    return ChainCore(expanded(inst), time_step, seed, quasi_static)
