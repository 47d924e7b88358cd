"""Commands at an instant and along a segment of time, the shapes of strokes, and the interface of a plant."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import Any, Literal, NamedTuple, Protocol, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tenodesis.control import Controller
from tenodesis.coupled import CoupledInstrument, Held
from tenodesis.instrument import ShortForm
from tenodesis.run import Array, Run
from tenodesis.twin import Contact

PathByStep: TypeAlias = Callable[[NDArray[np.int64]], Array]
"""Values (n,), rad or N, after numbers of steps (n,), counted from 1."""
Moved: TypeAlias = Literal["handle_angle", "force"]
"""What may follow a path of its own."""

ShapeName: TypeAlias = Literal["triangle", "sine", "smooth"]


class Shape(NamedTuple):
    """Shape of a stroke: position over time, both as fractions, and the ratio of its largest to its mean speed."""

    way: Callable[[Array], Array]
    peak: float


SHAPES: dict[ShapeName, Shape] = {
    "triangle": Shape(np.copy, 1.0),
    "sine": Shape(lambda time: (1 - np.cos(np.pi * time)) / 2, np.pi / 2),
    "smooth": Shape(lambda time: time**3 * (10 + time * (6 * time - 15)), 15 / 8),
}
SMOOTH = SHAPES["smooth"]
"""The stroke of minimum jerk."""


def arriving(speed: float) -> Callable[[Array], Array]:
    """Return the stroke of minimum jerk that ends with a speed, as a share of its mean speed, up to 2.5."""
    return lambda time: time**3 * (10 - 4 * speed + time * (7 * speed - 15 + time * (6 - 3 * speed)))


class Command(NamedTuple):
    """Command at an instant, by axis: handle angle (rad), forces (N), spool velocities (rad/s), and tissue.

    Without an entry for tissue the plant need not know of it.
    """

    handle_angle: Array
    force: Array
    radial_force: Array
    spool_velocity: Array
    contact: tuple[Contact | None, ...] | None = None

    @classmethod
    def rest(cls, axes: int, *, tissue: bool = False) -> Self:
        """Return the command of an instrument that is straight, unloaded and not driven; tissue: it may get some."""
        contact = (None,) * axes if tissue else None
        return cls(np.zeros(axes), np.zeros(axes), np.zeros(axes), np.zeros((axes, 2)), contact)

    @property
    def values(self) -> dict[str, Array]:
        """What may change along a segment, by name."""
        return {name: getattr(self, name) for name in VALUES}

    @property
    def constant(self) -> dict[str, Any]:
        """What stays along a segment, by name."""
        return {} if self.contact is None else {"contact": self.contact}

    def on(self, axis: int, **changes: float | Sequence[float] | Array | None) -> Self:
        """Return this command with values changed on an axis; None leaves a value unchanged."""
        changed = {}
        for name, value in changes.items():
            if value is not None:
                changed[name] = getattr(self, name).copy()
                changed[name][axis] = value
        return self._replace(**changed)

    def touching(self, axis: int, contact: Contact | None) -> Self:
        """Return this command with tissue on an axis, or without."""
        before = self.contact or (None,) * self.handle_angle.size
        return self._replace(contact=(*before[:axis], contact, *before[axis + 1 :]))


VALUES = ("handle_angle", "force", "radial_force", "spool_velocity")


class Between(NamedTuple):
    """What is between the jaws, as :class:`tenodesis.coupled.Held`; without an opening as far as they are open."""

    opening: float | None
    stiffness: float
    damping: float

    def held(self, opening: float) -> Held:
        """Return it between jaws that are open by a length, m."""
        return Held(opening if self.opening is None else self.opening, self.stiffness, self.damping)


class CoupledCommand(NamedTuple):
    """Command at an instant to an instrument whose joints share tendons.

    Angles of the handle's joints (rad), wrench at the tip (6,), force that presses the jaws apart (1,), velocities of
    the tendons' spools (rad/s), and what is between the jaws.
    """

    handle_angle: Array
    wrench: Array
    grip_force: Array
    spool_velocity: Array
    between: Between | None = None

    @classmethod
    def rest(cls, inst: CoupledInstrument) -> Self:
        """Return the command of an instrument that is straight, unloaded and not driven."""
        handles, tendons = len(inst.handle_joints), len(inst.tendons)
        return cls(np.zeros(handles), np.zeros(6), np.zeros(1), np.zeros(tendons))

    @property
    def values(self) -> dict[str, Array]:
        """What may change along a segment, by name."""
        return {name: values for name, values in self._asdict().items() if name != "between"}

    @property
    def constant(self) -> dict[str, Any]:
        """What stays along a segment, by name."""
        return {"between": self.between}

    def on(self, axis: int, **changes: float | Sequence[float] | Array | None) -> Self:
        """Return this command with values changed, the handle's angle for one of its joints; None changes nothing."""
        changed = {name: getattr(self, name).copy() for name, value in changes.items() if value is not None}
        for name, values in changed.items():
            if values.size:
                values[axis if name == "handle_angle" else slice(None)] = changes[name]
        return self._replace(**changed)


AnyCommand: TypeAlias = Command | CoupledCommand


@dataclass(frozen=True)
class Segment:
    """A part of a phase: every command goes linearly from start to end, where the last step is.

    Where there is a path for a command, it gives that of one axis instead. Tissue is that of the start.
    """

    start: AnyCommand
    end: AnyCommand
    steps: int
    axis: int = 0
    paths: Mapping[Moved, PathByStep] = field(default_factory=dict)

    def sample(self, first: int, last: int) -> dict[str, Array]:
        """Return the commands from step `first` + 1 to step `last`; a single axis has no dimension of its own."""
        done = np.arange(first + 1, last + 1)
        columns = {
            name: between(start, end, done / self.steps)
            for (name, start), end in zip(self.start.values.items(), self.end.values.values(), strict=True)
        }
        for name, path in self.paths.items():
            columns[name][:, self.axis] = path(done)
        single = isinstance(self.start, Command) and self.start.handle_angle.size == 1
        return {name: values[:, 0] if single else values for name, values in columns.items()}


def between(start: float | Array, end: float | Array, fraction: Array) -> Array:
    """Return values (n, ...) at fractions (n,) of the way from start to end (...); exact at either end."""
    first, last = np.asarray(start, float), np.asarray(end, float)
    along = fraction.reshape(-1, *(1,) * first.ndim)
    return np.where(along < 1, first + along * (last - first), last)


def sampled(segments: Sequence[Segment], size: int) -> Iterator[dict[str, Any]]:
    """Yield the commands of consecutive segments in blocks of `size` steps at most; tissue or object stays in each."""
    for constant, same in groupby(segments, lambda segment: segment.start.constant):
        for block in _blocks(same, size):
            yield {**block, **constant}


def _blocks(segments: Iterable[Segment], size: int) -> Iterator[dict[str, Array]]:
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
                yield _joined(pieces)
                pieces, room = [], size
    if pieces:
        yield _joined(pieces)


def _joined(pieces: Sequence[dict[str, Array]]) -> dict[str, Array]:
    return {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}


class Plant(Protocol):
    """What a protocol runs on: a twin, or any object with its interface for commands."""

    @property
    def inst(self) -> ShortForm:
        """The instrument."""

    @property
    def time_step(self) -> float:
        """Time step, s."""

    @property
    def spool_radius(self) -> float:
        """Radius of the spools, m."""

    def run(
        self,
        *,
        handle_angle: Array,
        force: Array,
        radial_force: Array,
        spool_velocity: Array,
        contact: Sequence[Contact | None] | None = None,
    ) -> Run:
        """Continue from the present state by as many time steps as there are commands."""


class ControllablePlant(Plant, Protocol):
    """A plant that can be run with a controller in the loop, which moves the spools itself."""

    def run(
        self,
        *,
        handle_angle: Array,
        force: Array,
        radial_force: Array,
        spool_velocity: Array,
        contact: Sequence[Contact | None] | None = None,
        controller: Controller | None = None,
        request: ArrayLike = 0,
    ) -> Run:
        """Continue as :meth:`Plant.run`; a controller gets a request at each step."""
