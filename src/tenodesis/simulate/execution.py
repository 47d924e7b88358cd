"""Running a protocol on a plant, with or without a controller in the loop."""

import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from tenodesis.control import Controller, OperatingState, Request
from tenodesis.errors import ArgumentError, FaultWarning, ProtocolError
from tenodesis.instrument import ShortForm
from tenodesis.run import Array, Run, concatenate
from tenodesis.simulate.command import Command, ControllablePlant, Plant, Segment, sampled
from tenodesis.simulate.pretension import Pretension
from tenodesis.simulate.protocol import Planned, Protocol, block_size, errors_of
from tenodesis.twin import Contact
from tenodesis.twin.closed_loop import warn_of_faults

_BLOCK = 1.0
"""Longest block, s."""

_HOMING_BLOCK = 0.01
"""Time between two checks of whether homing is done, s."""


class _Loop:
    """A plant with a controller that moves its motors; the requests to the controller are in the runs."""

    def __init__(self, plant: ControllablePlant, controller: Controller) -> None:
        self.plant, self.controller = plant, controller

    def run(
        self,
        *,
        handle_angle: Array,
        force: Array,
        radial_force: Array,
        spool_velocity: Array,
        contact: Sequence[Contact | None] | None = None,
    ) -> Run:
        """Continue by as many time steps as there are commands; the controller's pending request comes with the first.

        The spool velocities are 0.
        """
        request = np.zeros(len(handle_angle), np.uint8)
        request[0] = self.controller.take_request()
        tissue: dict[str, Any] = {} if contact is None else {"contact": contact}
        with warnings.catch_warnings():
            # Once for the entire run, not for each of its blocks.
            warnings.simplefilter("ignore", FaultWarning)
            run = self.plant.run(
                handle_angle=handle_angle,
                force=force,
                radial_force=radial_force,
                spool_velocity=spool_velocity,
                **tissue,
                controller=self.controller,
                request=request,
            )
        return with_request(run, request.astype(np.float64))

    def home(self, command: Command, timeout: float) -> Iterator[Run]:
        """Home, resume if the controller starts enabled, and yield the plant's response in short runs.

        A fault on the way ends homing, not the run. Raises ProtocolError if homing takes longer than the timeout (s).
        """
        time_step = self.plant.time_step
        steps = max(1, round(_HOMING_BLOCK / time_step))
        (commands,) = sampled([Segment(command, command, steps)], steps)
        self.controller.ask(Request.HOME)
        run = self.run(**commands)
        yield run
        elapsed = steps * time_step
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
            elapsed += steps * time_step
        if self.controller.enabled_at_start and run["operating_state"][-1].max() == OperatingState.PAUSED:
            self.controller.ask(Request.RESUME)
            yield self.run(**commands)


def execute(
    plant: ControllablePlant,
    protocol: Protocol,
    controller: Controller | None = None,
    *,
    on_block: Callable[[Run], object] | None = None,
    progress: Callable[[float, float], object] | None = None,
) -> Run:
    """Run a protocol, checked before, on a plant whose handle is straight, without load, the drives at rest.

    A controller moves the motors itself. A pretension phase is then its homing, whether or not it was homed before: all
    axes at once, to the pretension, at the speed and within the stroke of the table control of its instrument; after
    that it resumes if it starts enabled. After a fault the motors hold and the protocol goes on; the run has the fault
    among its signals.

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
        The instrument cannot run the protocol, a tendon does not get tight, or the tip is inside tissue that is placed;
        with a controller, the protocol moves the spools or requires a pretension that homing does not reach, or homing
        outlasts its phase.
    ValueError
        The controller is for other axes or joints, or has run on another plant and was not reset.

    Warns
    -----
    FaultWarning
        The controller faulted.
    """
    plan = protocol.plan(plant.inst, plant.time_step)
    loop = None
    if controller is not None:
        controller.check_instrument(plant.inst)
        check_controllable(plan, controller.inst)
        loop = _Loop(plant, controller)
    total = sum(planned.seconds for planned in plan)
    runs: list[Run] = []
    begun = 0.0
    for planned in plan:
        done = begun
        begun += planned.seconds
        for run in _runs(plant, loop, planned):
            runs.append(run)
            done += len(run) * plant.time_step
            if on_block is not None:
                on_block(run)
            if progress is not None:
                progress(min(done, begun), total)
    if progress is not None:
        progress(total, total)
    run = concatenate(runs)
    warn_of_faults(run, plant.inst)
    return run


def check_controllable(plan: Sequence[Planned], inst: ShortForm) -> None:
    """Check that a controller can run phases: they must leave the spools to it and match the homing of its instrument.

    Raises ProtocolError if it cannot run a phase.
    """
    for planned in plan:
        with errors_of(planned.label):
            if isinstance(planned.phase, Pretension):
                _check_homing(planned.phase, planned.initial, inst)
            elif any(command.spool_velocity.any() for part in planned.segments for command in (part.start, part.end)):
                raise ProtocolError(
                    "spool_velocity is given; with a controller a phase must leave the motors to it",
                    key="spool_velocity",
                )


def with_request(run: Run, request: Array) -> Run:
    """Return a run with the requests to its controller at each step, shape (n,)."""
    return replace(run, request=request if len(run.axes) == 1 else np.stack([request] * len(run.axes), -1))


def _continued(plant: Plant | _Loop, commands: dict[str, Any]) -> Run:
    try:
        return plant.run(**commands)
    except ArgumentError as problem:
        if problem.key != "contact.angle":
            raise
        raise ProtocolError(
            str(problem).removeprefix("contact.").rstrip("."), key="angle", value=problem.value, allowed=problem.allowed
        ) from None


def _check_homing(phase: Pretension, initial: Command, inst: ShortForm) -> None:
    if phase.axis is not None and len(inst.axes) > 1:
        raise ProtocolError(
            f"axis is {phase.axis}; with a controller give none, since it homes all axes", key="axis", value=phase.axis
        )
    if initial.force.any() or initial.radial_force.any():
        raise ProtocolError("the tip is loaded; with a controller homing must be without load")
    for planar in inst.planar:
        if phase.tension is not None and abs(phase.tension - planar.pretension) > phase.tolerance:
            raise ProtocolError(
                f"tension is {phase.tension:g} N; with a controller it must be the pretension of "
                f"{planar.pretension:g} N that {inst.name} has, to which it homes",
                key="tension",
                value=phase.tension,
                allowed=f"{planar.pretension:g} N",
            )


def _runs(plant: Plant, loop: _Loop | None, planned: Planned) -> Iterator[Run]:
    """Yield the runs of a phase."""
    if not isinstance(planned.phase, Pretension):
        with errors_of(planned.label):
            for commands in sampled(planned.segments, block_size(plant.time_step, _BLOCK)):
                yield _continued(loop or plant, commands)
        return
    with errors_of(planned.label):
        if loop is None:
            yield from planned.phase.run(plant, planned.initial)
        else:
            yield from loop.home(planned.initial, planned.phase.timeout)
