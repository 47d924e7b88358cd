"""What is asked of an instrument: at one instant, and along a stretch of time."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tenodesis.run import Array

Path: TypeAlias = Callable[[NDArray[np.int64]], Array]
"""Handle angles (rad) after numbers of steps, from 1."""


class Command(NamedTuple):
    """What is asked at one instant, by axis: handle angle (rad), forces (N) and spool velocities (rad/s)."""

    handle_angle: Array
    force: Array
    radial_force: Array
    spool_velocity: Array

    @classmethod
    def rest(cls, axes: int) -> Self:
        """Return the command of an instrument that is straight, unloaded and not driven."""
        return cls(np.zeros(axes), np.zeros(axes), np.zeros(axes), np.zeros((axes, 2)))

    def on(self, axis: int, **changes: float | Sequence[float] | Array | None) -> Self:
        """Return this command with some values changed on one axis; None leaves a value as it is."""
        changed = {}
        for name, value in changes.items():
            if value is not None:
                changed[name] = getattr(self, name).copy()
                changed[name][axis] = value
        return self._replace(**changed)


@dataclass(frozen=True)
class Segment:
    """A stretch of a phase: every command goes linearly from start to end, the last step being at the end.

    With a path, the handle angle (rad) of one axis is what that gives for the steps done, 1 to `steps`.
    """

    start: Command
    end: Command
    steps: int
    axis: int = 0
    path: Path | None = None

    def sample(self, first: int, last: int) -> dict[str, Array]:
        """Return the commands of some of the steps, as the twin takes them: without an axis if there is but one."""
        done = np.arange(first + 1, last + 1)
        columns = {
            name: between(start, end, done / self.steps)
            for name, start, end in zip(Command._fields, self.start, self.end, strict=True)
        }
        if self.path is not None:
            columns["handle_angle"][:, self.axis] = self.path(done)
        single = self.start.handle_angle.size == 1
        return {name: values[:, 0] if single else values for name, values in columns.items()}


def between(start: float | Array, end: float | Array, fraction: Array) -> Array:
    """Return what lies between two values, or arrays of them, at fractions of the way; exact at either end."""
    first, last = np.asarray(start, float), np.asarray(end, float)
    along = fraction.reshape(-1, *(1,) * first.ndim)
    return np.where(along < 1, first + along * (last - first), last)


def sampled(segments: Sequence[Segment], size: int) -> Iterator[dict[str, Array]]:
    """Yield the commands of segments, one after another, in blocks of at most `size` steps."""
    pieces: list[dict[str, Array]] = []
    room = size
    for segment in segments:
        first = 0
        while first < segment.steps:
            last = min(first + room, segment.steps)
            pieces.append(segment.sample(first, last))
            room -= last - first
            first = last
            if room == 0:
                yield joined(pieces)
                pieces, room = [], size
    if pieces:
        yield joined(pieces)


def joined(blocks: Sequence[dict[str, Array]]) -> dict[str, Array]:
    """Return blocks of commands as one."""
    return {name: np.concatenate([block[name] for block in blocks]) for name in Command._fields}
