"""What a protocol acts on: the joints of an instrument's handle, and the pairs of tendons of the tip's joints."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import NamedTuple, Self

from tenodesis import statics
from tenodesis.coupled import compensated, pairs
from tenodesis.errors import ProtocolError
from tenodesis.instrument import Instrument, Joint, ShortForm


class Place(NamedTuple):
    """What a phase acts on: a joint of the handle, and the axis of the tip that follows it in a plane.

    Without a handle there is no joint; there is an axis where every joint of the tip has a pair of tendons of its own.
    """

    joint: Joint | None = None
    handle: int = 0
    """Number of the joint of the handle."""
    plane: ShortForm | None = None
    """The instrument of the axis alone."""
    axis: int = 0
    """Number of the axis."""
    tendons: tuple[int, ...] = ()
    """Numbers of the axis's tendons, agonist and antagonist."""

    def columns(self, name: str) -> slice | list[int]:
        """Return the columns of a command by name that are of this place."""
        if name == "spool_velocity":
            return list(self.tendons)
        first = self.handle if name == "handle_angle" else self.axis
        return slice(first, first + 1)

    @property
    def reach(self) -> float:
        """Largest handle angle, rad, at which the unloaded tip is within its stops; 0 without a handle."""
        if self.plane is not None:
            return float(statics.reach(self.plane))
        return 0.0 if self.joint is None else self.joint.range


@dataclass(frozen=True)
class Places:
    """The places of an instrument by name."""

    inst: Instrument
    joints: Mapping[str, Place]
    """By joint of the handle."""
    axes: Mapping[str, Place]
    """By axis; empty unless every joint of the tip has a pair of tendons of its own."""
    unpaired: tuple[str, ...]
    """Joints of the tip without such a pair, or of another mechanism than the others."""

    @classmethod
    def of(cls, inst: Instrument) -> Self:
        """Return the places of an instrument."""
        found, tips = pairs(inst), inst.tip_joints
        alike = {pair.joint for pair in found.values() if tips[pair.joint].mechanism == tips[0].mechanism}
        unpaired = tuple(joint.name for n, joint in enumerate(tips) if n not in alike)
        axes = {}
        if not unpaired:
            for n, ((axis, pair), plane) in enumerate(zip(found.items(), compensated(inst).planar, strict=True)):
                joint = inst.handle_joints[pair.handle]
                axes[axis] = Place(joint, pair.handle, plane, n, (pair.agonist, pair.antagonist))
        by_handle = {place.handle: place for place in axes.values()}
        joints = {joint.name: by_handle.get(n, Place(joint, n)) for n, joint in enumerate(inst.handle_joints)}
        return cls(inst, joints, axes, unpaired)

    @property
    def first(self) -> Place:
        """What a phase acts on that names nothing."""
        return next(iter((*self.axes.values(), *self.joints.values())), Place())

    def named(self, key: str, name: str) -> Place:
        """Return the place of a name that is given by a key, axis or joint; raises ProtocolError if it has none."""
        places = self.axes if key == "axis" else self.joints
        if name not in places:
            allowed = " or ".join(places) or "left out"
            has = f", which {self.inst.name} has" if places else f", since {self.inst.name} has no joint at its handle"
            raise ProtocolError(f"{key} is {name}; it must be {allowed}{has}", key=key, value=name, allowed=allowed)
        return places[name]

    def tendon(self, key: str, name: str) -> int:
        """Return the number of a tendon with a spool, named within a key; raises ProtocolError if there is none."""
        numbers = {tendon.name: n for n, tendon in enumerate(self.inst.tendons) if tendon.start == "spool"}
        _check_listed(key, name, numbers, "tendons with a spool")
        return numbers[name]

    def joint(self, key: str, name: str) -> Place:
        """Return the place of a joint of the handle, named within a key; raises ProtocolError if there is none."""
        _check_listed(key, name, self.joints, "joints of the handle")
        return self.joints[name]


def _check_listed(key: str, name: str, named: Collection[str], what: str) -> None:
    if name not in named:
        allowed = ", ".join(named) or "none"
        raise ProtocolError(
            f"{key} names {name}; it must name {what}: {allowed}", key=f"{key}.{name}", value=name, allowed=allowed
        )
