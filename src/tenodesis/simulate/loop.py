"""A twin with a controller in the loop, as a protocol is run on it."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from tenodesis.control import Controller, OperatingState, Request
from tenodesis.errors import ProtocolError
from tenodesis.instrument import Instrument
from tenodesis.run import Array, Run
from tenodesis.simulate.command import Command, Segment, sampled
from tenodesis.simulate.pretension import Pretension
from tenodesis.simulate.protocol import Planned
from tenodesis.simulate.twin import Controllable

_BLOCK = 0.01
"""Time after which it is looked whether homing is done, s."""


class Loop:
    """A twin whose motors a controller moves; what was asked of the controller is in the runs.

    Parameters
    ----------
    twin
        The twin.
    controller
        The controller.

    Raises
    ------
    ValueError
        The controller is for other axes or joints.
    """

    def __init__(self, twin: Controllable, controller: Controller) -> None:
        controller.check_instrument(twin.inst)
        self.twin, self.controller = twin, controller

    @property
    def time_step(self) -> float:
        """Time step, s."""
        return self.twin.time_step

    def refuse(self, plan: Sequence[Planned]) -> None:
        """Refuse phases that move the spools themselves, or ask homing for what it does not do.

        Raises
        ------
        ProtocolError
            There is one.
        """
        refuse(plan, self.twin.inst.axes, self.controller.inst)

    def run(self, *, handle_angle: Array, force: Array, radial_force: Array, spool_velocity: Array) -> Run:
        """Go on by as many time steps as there are commands; what the controller was told to ask comes with the first.

        The spool velocities are nought.
        """
        asked = np.zeros(len(handle_angle), np.uint8)
        asked[0] = self.controller.take_request()
        run = self.twin.run(
            handle_angle=handle_angle,
            force=force,
            radial_force=radial_force,
            spool_velocity=spool_velocity,
            controller=self.controller,
            request=asked,
        )
        return with_request(run, asked.astype(np.float64))

    def home(self, held: Command, timeout: float) -> Iterator[Run]:
        """Home, resume if the controller starts enabled, and yield what the twin says to that in short runs.

        A fault on the way ends homing, not the run.

        Raises
        ------
        ProtocolError
            Homing takes longer than the timeout (s).
        """
        steps = max(1, round(_BLOCK / self.time_step))
        (commands,) = sampled([Segment(held, held, steps)], steps)
        self.controller.ask(Request.HOME)
        run = self.run(**commands)
        yield run
        elapsed = steps * self.time_step
        while run["operating_state"][-1].max() == OperatingState.ENABLED:
            if elapsed >= timeout:
                raise ProtocolError(
                    f"the controller has not homed within the timeout of {timeout:g} s; allowed is a larger timeout, "
                    "or a larger control.homing_speed of the controller's instrument"
                )
            run = self.run(**commands)
            yield run
            elapsed += steps * self.time_step
        if self.controller.enabled_at_start and run["operating_state"][-1].max() == OperatingState.PAUSED:
            self.controller.ask(Request.RESUME)
            yield self.run(**commands)


def refuse(plan: Sequence[Planned], axes: tuple[str, ...], told: Instrument) -> None:
    """Refuse phases that a controller cannot run: that move the spools, or ask homing for what it does not do.

    Parameters
    ----------
    plan
        The phases.
    axes
        Of the instrument that runs them.
    told
        The instrument as the controller has it.

    Raises
    ------
    ProtocolError
        There is one.
    """
    for planned in plan:
        try:
            if isinstance(planned.phase, Pretension):
                _refuse_pretension(planned.phase, planned.held, axes, told)
            else:
                _refuse_driven(planned)
        except ProtocolError as problem:
            raise ProtocolError(f"{planned.called}: {problem}.") from None


def _refuse_pretension(phase: Pretension, held: Command, axes: tuple[str, ...], told: Instrument) -> None:
    if phase.axis is not None and len(axes) > 1:
        raise ProtocolError(f"axis is {phase.axis}; allowed with a controller is none, since it homes all axes")
    if held.force.any() or held.radial_force.any():
        raise ProtocolError("the tip is loaded; allowed with a controller is homing without load")
    for axis in axes:
        given = _pretension(told, axis)
        if phase.tension is not None and abs(phase.tension - given) > phase.tolerance:
            raise ProtocolError(
                f"tension is {phase.tension:g} N; allowed with a controller is the pretension of {given:g} N that "
                f"{told.name} has, to which it homes"
            )


def _refuse_driven(planned: Planned) -> None:
    if any(command.spool_velocity.any() for part in planned.segments for command in (part.start, part.end)):
        raise ProtocolError(
            "spool_velocity is given; allowed with a controller is a phase that leaves the motors to it"
        )


def with_request(run: Run, request: Array) -> Run:
    """Return a run with what its controller was asked at each step, shape (n,)."""
    return replace(run, request=request if len(run.axes) == 1 else np.stack([request] * len(run.axes), -1))


def _pretension(inst: Instrument, axis: str) -> float:
    return (inst.axis(axis) if len(inst.axes) > 1 else inst).pretension
