"""Running a protocol on a plant, with or without a controller in the loop."""

import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np

from tenodesis.control import Controller, JointController, OperatingState, Request
from tenodesis.control.pairs import served_motors
from tenodesis.errors import ArgumentError, FaultWarning, ProtocolError
from tenodesis.instrument import Instrument, ShortForm
from tenodesis.run import CONTROL, Array, Run, concatenate
from tenodesis.simulate.command import Between, Command, Plant, Segment, sampled
from tenodesis.simulate.pretension import Pretension
from tenodesis.simulate.protocol import Planned, Protocol, block_size, errors_of
from tenodesis.twin import Held
from tenodesis.twin.closed_loop import warn_of_faults

_BLOCK = 1.0
"""Longest block, s."""

_HOMING_BLOCK = 0.01
"""Time between two checks of whether homing is done, s."""
_HOMING_TIMEOUT = 60.0
"""Time after which homing before a protocol is given up, s."""


class _Bench:
    """A plant, what its jaws hold, and its controller if there is one, the requests to which are in the runs."""

    def __init__(self, plant: Plant, controller: Controller | JointController | None) -> None:
        self.plant, self.controller = plant, controller
        self.inst, self.time_step, self.spool_radius = plant.inst, plant.time_step, plant.spool_radius
        self._last: Run | None = None
        self._between: Between | None = None
        self._held: Held | None = None

    def run(self, **commands: Any) -> Run:
        """Continue by as many time steps as there are commands; the controller's pending request comes with the first.

        Raises ProtocolError if the tip is inside tissue that is placed, or the jaws are too narrow for an object.
        """
        self._put_between(commands.pop("between", None))
        if self._held is not None:
            commands["held"] = self._held
        request = np.zeros(len(commands["handle_angle"]), np.uint8)
        if self.controller is not None:
            request[0] = self.controller.take_request()
            commands |= {"controller": self.controller, "request": request}
        with warnings.catch_warnings():
            # Once for the entire run, not for each of its blocks.
            warnings.simplefilter("ignore", FaultWarning)
            try:
                run = self.plant.run(**commands)
            except ArgumentError as problem:
                what, _, key = problem.key.partition(".")
                if what not in ("contact", "held"):
                    raise
                sentence = str(problem).removeprefix(f"{what}.").rstrip(".")
                raise ProtocolError(sentence, key=key, value=problem.value, allowed=problem.allowed) from None
        self._last = run
        return run if self.controller is None else with_request(run, request.astype(np.float64))

    def _put_between(self, between: Between | None) -> None:
        """Put something between the jaws, or take it away; what was there stays as it is."""
        if between == self._between:
            return
        self._between, self._held = between, None
        if between is not None:
            arms = self.inst.grip_arms
            angles = np.zeros(len(arms)) if self._last is None else self._last.by_column("output_angle")[-1]
            self._held = between.held(float(arms @ angles))

    def home(self, command: Command, timeout: float) -> Iterator[Run]:
        """Home, resume if the controller starts enabled, and yield the plant's response in short runs.

        A fault on the way ends homing, not the run. Raises ProtocolError if homing takes longer than the timeout (s).
        """
        steps = max(1, round(_HOMING_BLOCK / self.time_step))
        (commands,) = sampled([Segment(command, command, steps)], steps)
        controller = cast("Controller", self.controller)
        controller.ask(Request.HOME)
        run = self.run(**commands)
        yield run
        elapsed = steps * self.time_step
        while run["operating_state"][-1].max() == OperatingState.ENABLED:
            if elapsed >= timeout:
                raise ProtocolError(
                    f"the controller has not homed within the timeout of {timeout:g} s; give a larger timeout, or a "
                    "larger control.homing_speed of the controller's instrument",
                    key="timeout",
                    value=timeout,
                )
            run = self.run(**commands)
            yield run
            elapsed += steps * self.time_step
        if controller.enabled_at_start and run["operating_state"][-1].max() == OperatingState.PAUSED:
            controller.ask(Request.RESUME)
            yield self.run(**commands)


def execute(
    plant: Plant,
    protocol: Protocol,
    controller: Controller | JointController | None = None,
    *,
    on_block: Callable[[Run], object] | None = None,
    progress: Callable[[float, float], object] | None = None,
) -> Run:
    """Run a protocol, checked before, on a plant at rest: straight, without load, nothing between its jaws.

    A controller moves the motors of its axes itself. A pretension phase is then its homing, whether or not it was homed
    before: all axes at once, to the pretension, at the speed and within the stroke of the table control of its
    instrument; after that it resumes if it starts enabled. One of all joints begins only after it, and counts the
    spools' angles from there. After a fault the motors hold and the protocol goes on; the
    run has the fault among its signals.

    Parameters
    ----------
    controller
        Closes the loop, from its present state on; one that has run on another plant must be reset first.
    on_block
        Called with every block, 1 s of a run at most.
    progress
        Called after every block with the seconds done and those of the entire run, as in :meth:`Protocol.duration`.

    Raises
    ------
    ProtocolError
        The instrument cannot run the protocol, a tendon does not get tight, the tip is inside tissue that is placed, or
        its jaws are too narrow for an object; with a controller, the protocol moves its spools or requires a pretension
        that homing does not reach, or homing outlasts its phase.
    ValueError
        The controller is for other axes or joints, or has run on another plant and was not reset.

    Warns
    -----
    FaultWarning
        The controller faulted.
    """
    runs: list[Run] = []
    for run in blocks(plant, protocol, controller, progress=progress):
        runs.append(run)
        if on_block is not None:
            on_block(run)
    return concatenate(runs)


def blocks(
    plant: Plant,
    protocol: Protocol,
    controller: Controller | JointController | None = None,
    *,
    home: bool = False,
    progress: Callable[[float, float], object] | None = None,
) -> Iterator[Run]:
    """Yield the run of :func:`execute` in blocks of 1 s at most, none of which is kept; parameters and errors alike.

    home: whether the controller homes before the first phase, or after it where that tightens tendons.
    """
    plan = protocol.plan(plant.inst, plant.time_step)
    if controller is not None:
        controller.check_instrument(plant.inst)
        check_controllable(plan, plant.inst, controller.inst)
    # The law of all joints begins with tight tendons: until then, load cells alone say how far to wind.
    tightened = isinstance(controller, JointController) and isinstance(protocol.phases[0], Pretension)
    bench = _Bench(plant, None if tightened else controller)
    total = sum(planned.seconds for planned in plan)
    begun = 0.0
    fault: Run | None = None
    rise = controller.numbers["homing_rise"] if isinstance(controller, JointController) else 0.0
    parts = [(planned.seconds, _runs(bench, planned, rise)) for planned in plan]
    if home:
        parts.insert(int(tightened), (0.0, bench.home(plan[0].initial, _HOMING_TIMEOUT)))
    for seconds, part in parts:
        done = begun
        begun += seconds
        for moved in part:
            run = moved if bench.controller is controller else without_control(moved, controller)
            yield run
            done += len(run) * plant.time_step
            if fault is None and controller is not None:
                fault = _fault(run)
            if progress is not None:
                progress(min(done, begun), total)
        if isinstance(controller, JointController) and bench.controller is None:
            controller.count_from(run.by_column("measured_spool_angle")[-1])
            bench.controller = controller
    if progress is not None:
        progress(total, total)
    if fault is not None:
        warn_of_faults(fault, plant.inst)


def _fault(run: Run) -> Run | None:
    """Return the row in which a controller's fault comes, None without one."""
    states = run.by_column("operating_state")
    rows = np.flatnonzero((states == OperatingState.FAULT).any(axis=1))
    return run.rows(rows[0], rows[0] + 1) if rows.size else None


def check_controllable(plan: Sequence[Planned], inst: Instrument, assumed: Instrument) -> None:
    """Check that a controller can run phases on an instrument: they leave its spools to it, and match its homing.

    The controller is made for the instrument `assumed`; one in the full form has a controller of all joints, which
    begins after a first pretension phase, and to which velocities of the spools of a tool without a handle are
    commands. Raises ProtocolError if it cannot run a phase.
    """
    all_joints = not isinstance(assumed, ShortForm)
    own = served_motors(inst, all_joints=all_joints)
    for planned in plan:
        with errors_of(planned.label):
            if isinstance(planned.phase, Pretension):
                if all_joints and planned is not plan[0]:
                    raise ProtocolError(
                        "a controller of all joints homes tendons that are tight, and tightens none; put the phase "
                        "first, or leave it out",
                        key="phase",
                        value="pretension",
                        allowed="first",
                    )
                _check_homing(planned.phase, planned.initial, assumed)
                continue
            commands = [command for part in planned.segments for command in (part.start, part.end)]
            velocities = [] if all_joints and not inst.handle_joints else [one.spool_velocity for one in commands]
            tensions = [command.spool_tension for command in commands if command.spool_tension is not None]
            driven = np.any([np.zeros(len(inst.expanded.tendons)), *velocities, *tensions], axis=0)
            moved = next((m for m in own if driven[m]), None)
            if moved is not None:
                name = inst.tendons[moved].name
                of_tendons = ("spool_velocities", "spool_tensions")
                key = next((key for key in of_tendons if name in getattr(planned.phase, key, ())), "spool_velocity")
                raise ProtocolError(
                    f"{key} is given for {name}; with a controller a phase must leave its motors to it",
                    key=key,
                    value=name,
                )


def with_request(run: Run, request: Array) -> Run:
    """Return a run with the requests to its controller at each step, shape (n,)."""
    shape = run.names.shape("request", len(run))
    return replace(run, request=np.broadcast_to(request.reshape(-1, *(1,) * (len(shape) - 1)), shape).copy())


def without_control(run: Run, controller: Controller | JointController | None) -> Run:
    """Return a run with the signals of a controller that did not run yet, all NaN."""
    names, given = run.names, set(CONTROL)
    if isinstance(controller, JointController):
        names = names._replace(compensated=names.joints)
        given = {*controller.signals_of(np.empty((0, controller.core.stored))), "request"}
    absent: dict[str, Any] = {
        name: np.full(names.shape(name, len(run)), np.nan) for name in given - {"commanded_spool_velocity"}
    }
    return replace(run, compensated=names.compensated, **absent)


def _check_homing(phase: Pretension, initial: Command, inst: Instrument) -> None:
    if phase.axis is not None and len(inst.axes) > 1:
        raise ProtocolError(
            f"axis is {phase.axis}; with a controller give none, since it homes all axes", key="axis", value=phase.axis
        )
    if initial.is_loaded:
        raise ProtocolError(
            "the tip is loaded; with a controller homing must be without load", key="force", allowed="0 N"
        )
    for pretension in inst.pretensions:
        if phase.tension is not None and abs(phase.tension - pretension) > phase.tolerance:
            raise ProtocolError(
                f"tension is {phase.tension:g} N; with a controller it must be the pretension of "
                f"{pretension:g} N that {inst.name} has, to which it homes",
                key="tension",
                value=phase.tension,
                allowed=f"{pretension:g} N",
            )


def _runs(bench: _Bench, planned: Planned, rise: float) -> Iterator[Run]:
    """Yield the runs of a phase; tendons that are to be tight for a law of all joints are wound by a rise beyond."""
    with errors_of(planned.label):
        if not isinstance(planned.phase, Pretension):
            for commands in sampled(planned.segments, block_size(bench.time_step, _BLOCK)):
                yield bench.run(**commands)
        elif bench.controller is None:
            way = planned.phase.run_both_ways(bench, planned.initial, rise) if rise else None
            yield from way or planned.phase.run(bench, planned.initial)
        else:
            yield from bench.home(planned.initial, planned.phase.timeout)
