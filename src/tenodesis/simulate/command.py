"""Commands at an instant and along a segment of time, the shapes of strokes, and the interface of a plant."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import Any, Literal, NamedTuple, Protocol, Self, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from tenodesis.instrument import Instrument
from tenodesis.run import COMPONENTS, Array, Run
from tenodesis.simulate.places import Place, Places, Where
from tenodesis.twin import Contact, Held

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


class Between(NamedTuple):
    """What is between the jaws, as :class:`tenodesis.twin.Held`; without an opening as far as they are open."""

    opening: float | None
    stiffness: float
    damping: float

    def held(self, opening: float) -> Held:
        """Return it between jaws that are open by a length, m."""
        return Held(opening if self.opening is None else self.opening, self.stiffness, self.damping)


class Command(NamedTuple):
    """Command at an instant.

    Angles of the handle's joints (rad), velocities of the tendons' spools (rad/s), and loads: forces by axis (N), or a
    wrench at the tip (6,) and a force that presses the jaws apart (1,). What is None the plant need not know of.
    """

    handle_angle: Array
    spool_velocity: Array
    force: Array | None = None
    radial_force: Array | None = None
    wrench: Array | None = None
    grip_force: Array | None = None
    contact: tuple[Contact | None, ...] | None = None
    """Tissue by joint of the tip."""
    between: Between | None = None
    spool_tension: Array | None = None
    """That the drives hold whatever their spools do for it, N; 0: a drive follows its spool's velocity."""
    aim: Array | None = None
    """Without a handle: unloaded angles to which spools turn what bends at the tip, rad."""
    speeds: Callable[[Array], Array] | None = None
    """Of the spools for that, as of :meth:`Places.spool_speeds`."""

    @classmethod
    def rest(cls, places: Places, time_step: float, *, tissue: bool = False, tension: bool = False) -> Self:
        """Return the command of an instrument that is straight, unloaded and not driven, at a time step (s).

        tissue, tension: it may get tissue, and drives that hold tensions.
        """
        joints, axes, tendons = len(places.inst.tip_joints), len(places.axes), len(places.inst.tendons)
        still = cls(
            np.zeros(len(places.inst.handle_joints)),
            np.zeros(tendons),
            spool_tension=np.zeros(tendons) if tension else None,
        )
        if not places.inst.handle_joints:
            still = still._replace(aim=np.zeros(len(places.joints)), speeds=places.spool_speeds(time_step))
        contact = (None,) * joints if tissue else None
        if places.takes_forces:
            return still._replace(force=np.zeros(axes), radial_force=np.zeros(axes), contact=contact)
        return still._replace(wrench=np.zeros(len(COMPONENTS)), grip_force=np.zeros(1), contact=contact)

    @property
    def values(self) -> dict[str, Array]:
        """What may change along a segment, by name."""
        named = {name: getattr(self, name) for name in ("handle_angle", "aim", *LOADS, *_OF_SPOOLS)}
        return {name: values for name, values in named.items() if values is not None}

    @property
    def constant(self) -> dict[str, Any]:
        """What stays along a segment, by name."""
        named = {"contact": self.contact, "between": self.between}
        return {name: value for name, value in named.items() if value is not None}

    @property
    def is_loaded(self) -> bool:
        """Whether a load is on the tip."""
        return any(self.values[name].any() for name in LOADS if name in self.values)

    def with_value(self, where: Where, value: float | Sequence[float]) -> Self:
        """Return this command with a value changed."""
        values = getattr(self, where.field).copy()
        values[where.columns] = where.sign * np.asarray(value)
        return self._replace(**{where.field: values})

    def on(self, place: Place, **changes: float | Sequence[float] | None) -> Self:
        """Return this command with values changed at a place; None leaves a value unchanged."""
        command = self
        for name, value in changes.items():
            if value is not None:
                command = command.with_value(place.where(name), value)
        return command

    def at(self, place: Place, name: str) -> float:
        """Return a value at a place."""
        where = place.where(name)
        return where.sign * float(getattr(self, where.field)[where.columns][0])

    def touching(self, contacts: Mapping[int, Contact | None]) -> Self:
        """Return this command with tissue on joints of the tip, by number, or without."""
        return self._replace(contact=tuple(contacts.get(n, one) for n, one in enumerate(self.contact or ())))


LOADS = ("force", "radial_force", "wrench", "grip_force")
_OF_SPOOLS = ("spool_velocity", "spool_tension")


@dataclass(frozen=True)
class Segment:
    """A part of a phase: every command goes linearly from start to end, where the last step is.

    Where there is a path for a command, it gives that of one place instead. What does not change is that of the start.
    """

    start: Command
    end: Command
    steps: int
    place: Place | None = None
    paths: Mapping[Moved, PathByStep] = field(default_factory=dict)

    def sample(self, first: int, last: int) -> dict[str, Array]:
        """Return the commands from step `first` + 1 to step `last`; a single column has no dimension of its own."""
        done = np.arange(first, last + 1)
        columns = {
            name: between(start, end, done / self.steps)
            for (name, start), end in zip(self.start.values.items(), self.end.values.values(), strict=True)
        }
        for name, path in self.paths.items():
            where = cast("Place", self.place).where(name)
            columns[where.field][:, where.columns] = where.sign * path(done)[:, np.newaxis]
        aims = columns.pop("aim", None)
        columns = {name: values[1:] for name, values in columns.items()}
        if aims is not None and self.start.speeds is not None:
            columns["spool_velocity"] += self.start.speeds(aims)
        single = [name for name, values in columns.items() if values.shape[1] == 1 and name not in _OF_SPOOLS]
        return columns | {name: columns[name][:, 0] for name in single}


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
    def inst(self) -> Instrument:
        """The instrument."""

    @property
    def time_step(self) -> float:
        """Time step, s."""

    @property
    def spool_radius(self) -> float:
        """Radius of the spools, m."""

    @property
    def run(self) -> Callable[..., Run]:
        """Continue from the present state by as many time steps as there are commands, and return what is measured.

        It takes those of :class:`Command` that the instrument or the protocol has, as :meth:`tenodesis.twin.Twin.run`
        does: handle_angle, spool_velocity and spool_tension, loads, tissue or what the jaws hold; and a controller with
        its requests if there is one.
        """
