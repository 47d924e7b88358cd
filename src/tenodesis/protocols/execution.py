"""Running a protocol on a twin."""

from collections.abc import Callable, Iterator

from tenodesis.errors import ProtocolError
from tenodesis.protocols.command import sampled
from tenodesis.protocols.pretension import Pretension
from tenodesis.protocols.protocol import Planned, Protocol, block_size
from tenodesis.protocols.twin import Twin
from tenodesis.signals import Run, concatenate

_BLOCK = 1.0
"""Longest block, s."""


def execute(
    twin: Twin,
    protocol: Protocol,
    *,
    on_block: Callable[[Run], object] | None = None,
    progress: Callable[[float, float], object] | None = None,
) -> Run:
    """Run a protocol on a twin whose handle is straight, without load, the drives at rest.

    Parameters
    ----------
    twin
        The twin, or whatever takes commands as it does.
    protocol
        The protocol; all of it is checked before the first command.
    on_block
        Called with every block, 1 s of a run at most.
    progress
        Called after every block with the seconds done and those of the whole run, as :meth:`Protocol.duration` has it.

    Raises
    ------
    ProtocolError
        The instrument cannot run the protocol, or a tendon does not get tight.
    """
    plan = protocol.plan(twin.inst, twin.time_step)
    total = sum(planned.seconds for planned in plan)
    runs: list[Run] = []
    begun = 0.0
    for planned in plan:
        done = begun
        begun += planned.seconds
        for run in _runs(twin, planned):
            runs.append(run)
            done += len(run) * twin.time_step
            if on_block is not None:
                on_block(run)
            if progress is not None:
                progress(min(done, begun), total)
    if progress is not None:
        progress(total, total)
    return concatenate(runs)


def _runs(twin: Twin, planned: Planned) -> Iterator[Run]:
    """Yield the runs of a phase."""
    if not isinstance(planned.phase, Pretension):
        for commands in sampled(planned.segments, block_size(twin.time_step, _BLOCK)):
            yield twin.run(**commands)
        return
    try:
        yield from planned.phase.run(twin, planned.held)
    except ProtocolError as problem:
        raise ProtocolError(f"{planned.called}: {problem}.") from None
