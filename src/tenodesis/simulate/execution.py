"""Running a protocol on a twin, with or without a controller in the loop."""

from collections.abc import Callable, Iterator
from typing import cast, overload

from tenodesis.control import Controller
from tenodesis.errors import ProtocolError
from tenodesis.run import Run, concatenate
from tenodesis.simulate.command import sampled
from tenodesis.simulate.loop import Loop
from tenodesis.simulate.pretension import Pretension
from tenodesis.simulate.protocol import Planned, Protocol, block_size
from tenodesis.simulate.twin import Controllable, Twin

_BLOCK = 1.0
"""Longest block, s."""

_OnBlock = Callable[[Run], object] | None
_OnProgress = Callable[[float, float], object] | None


@overload
def execute(
    twin: Twin,
    protocol: Protocol,
    controller: None = None,
    *,
    on_block: _OnBlock = None,
    progress: _OnProgress = None,
) -> Run: ...
@overload
def execute(
    twin: Controllable,
    protocol: Protocol,
    controller: Controller | None,
    *,
    on_block: _OnBlock = None,
    progress: _OnProgress = None,
) -> Run: ...
def execute(
    twin: Twin,
    protocol: Protocol,
    controller: Controller | None = None,
    *,
    on_block: _OnBlock = None,
    progress: _OnProgress = None,
) -> Run:
    """Run a protocol on a twin whose handle is straight, without load, the drives at rest.

    With a controller the motors are its own. A pretension phase is then its homing, whether or not it was homed before:
    all axes at once, to the pretension, at the speed and within the stroke that its instrument's table control has;
    after that it resumes if it is one that starts enabled. A fault ends nothing: the motors hold, the protocol goes on,
    and the run says so.

    Parameters
    ----------
    twin
        The twin, or whatever takes commands as it does.
    protocol
        The protocol; all of it is checked before the first command.
    controller
        Closes the loop, on from the state it is in.
    on_block
        Called with every block, 1 s of a run at most.
    progress
        Called after every block with the seconds done and those of the whole run, as :meth:`Protocol.duration` has it.

    Raises
    ------
    ProtocolError
        The instrument cannot run the protocol, or a tendon does not get tight; with a controller, the protocol moves
        the spools or asks for a pretension that homing does not give, or homing outlasts its phase.
    ValueError
        The controller is for other axes or joints.
    """
    plan = protocol.plan(twin.inst, twin.time_step)
    loop = None if controller is None else Loop(cast(Controllable, twin), controller)
    if loop is not None:
        loop.refuse(plan)
    total = sum(planned.seconds for planned in plan)
    runs: list[Run] = []
    begun = 0.0
    for planned in plan:
        done = begun
        begun += planned.seconds
        for run in _runs(twin if loop is None else loop, planned):
            runs.append(run)
            done += len(run) * twin.time_step
            if on_block is not None:
                on_block(run)
            if progress is not None:
                progress(min(done, begun), total)
    if progress is not None:
        progress(total, total)
    return concatenate(runs)


def _runs(twin: Twin | Loop, planned: Planned) -> Iterator[Run]:
    """Yield the runs of a phase."""
    if not isinstance(planned.phase, Pretension):
        for commands in sampled(planned.segments, block_size(twin.time_step, _BLOCK)):
            yield twin.run(**commands)
        return
    try:
        if isinstance(twin, Loop):
            yield from twin.home(planned.held, planned.phase.timeout)
        else:
            yield from planned.phase.run(twin, planned.held)
    except ProtocolError as problem:
        raise ProtocolError(f"{planned.called}: {problem}.") from None
