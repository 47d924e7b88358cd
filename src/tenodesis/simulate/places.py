"""What a protocol acts on: joints of an instrument's handle, pairs of tendons, and components of the load."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple, Self

from tenodesis import statics
from tenodesis.control.pairs import compensated, pairs
from tenodesis.errors import ArgumentError, ProtocolError
from tenodesis.instrument import Instrument, Joint, ShortForm
from tenodesis.run import ACROSS, COMPONENTS, TENDONS


class Where(NamedTuple):
    """Where a value stands in a command: a field, its columns, and the sign there."""

    field: str
    columns: slice | list[int]
    sign: float = 1.0

    @classmethod
    def of_component(cls, name: str, sign: float = 1.0) -> Self:
        """Return where a component of the wrench stands."""
        n = COMPONENTS.index(name)
        return cls("wrench", slice(n, n + 1), sign)


class Place(NamedTuple):
    """What a phase acts on: a joint of the handle, and the joint of the tip that follows it by a pair of tendons."""

    joint: Joint | None = None
    """Of the handle; None without one."""
    handle: int = 0
    """Its number."""
    plane: ShortForm | None = None
    """The instrument of the tip's joint alone, if that has a pair of tendons of its own."""
    tip: int = 0
    """Its number."""
    tendons: tuple[int, ...] = ()
    """Numbers of the pair, agonist and antagonist."""
    across: str | None = None
    """Component of the wrench that a force on it opposes; None where forces are commanded by axis."""

    def where(self, name: str) -> Where:
        """Return where a value of this place stands in a command."""
        if name == "handle_angle":
            return Where(name, slice(self.handle, self.handle + 1))
        if name == "spool_velocity":
            return Where(name, list(self.tendons))
        if self.across is None:
            return Where(name, slice(self.tip, self.tip + 1))
        return Where.of_component(self.across, -1.0) if name == "force" else Where.of_component("fz")

    @property
    def reach(self) -> float:
        """Largest handle angle, rad, that keeps the unloaded tip within its range; 0 without a handle."""
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
    """By axis, of the joints at the tip with a pair of tendons of their own."""
    takes_forces: bool
    """Whether loads are commanded as forces by axis, since the axes do not act on each other, or as a wrench."""

    @classmethod
    def of(cls, inst: Instrument) -> Self:
        """Return the places of an instrument."""
        try:
            planar = compensated(inst)
        except ArgumentError:
            return cls(inst, {joint.name: Place(joint, n) for n, joint in enumerate(inst.handle_joints)}, {}, False)
        # An instrument of such axes alone is what its controller is made for.
        alone = planar is inst
        axes = {}
        for (axis, pair), plane in zip(pairs(inst).items(), planar.planar, strict=True):
            joint, tendons = inst.handle_joints[pair.handle], (pair.agonist, pair.antagonist)
            axes[axis] = Place(joint, pair.handle, plane, pair.joint, tendons, None if alone else ACROSS[axis])
        paired = {place.handle: place for place in axes.values()}
        joints = {joint.name: paired.get(n, Place(joint, n)) for n, joint in enumerate(inst.handle_joints)}
        return cls(inst, joints, axes, alone)

    @property
    def first(self) -> Place:
        """What a phase acts on that names nothing."""
        return next(iter((*self.axes.values(), *self.joints.values())), Place())

    @property
    def wound(self) -> list[int]:
        """Numbers of the tendons that a spool winds."""
        return [n for n, tendon in enumerate(self.inst.tendons) if tendon.start == "spool"]

    def tendon_name(self, number: int) -> str:
        """Return the name of a tendon in a sentence: by its joint and side where it is one of a pair."""
        for axis, place in self.axes.items():
            if number in place.tendons:
                return f"the {TENDONS[place.tendons.index(number)]} of {axis}"
        return f"tendon {self.inst.tendons[number].name}"

    def named(self, key: str, name: str) -> Place:
        """Return the place of a name that is given by a key, axis or joint; raises ProtocolError if it has none."""
        if key == "axis" and not self.axes:
            raise ProtocolError(
                f"axis is given, but no joint of {self.inst.name} has a handle joint and a pair of tendons of its own; "
                "give joint",
                key=key,
                value=name,
                allowed="joint",
            )
        places = self.axes if key == "axis" else self.joints
        if name not in places:
            allowed = " or ".join(places) or "left out"
            has = f", which {self.inst.name} has" if places else f", since {self.inst.name} has no joint at its handle"
            raise ProtocolError(f"{key} is {name}; it must be {allowed}{has}", key=key, value=name, allowed=allowed)
        return places[name]

    def listed(self, key: str, name: str) -> Place:
        """Return the place of a joint of the handle, named within a key; raises ProtocolError if there is none."""
        _check_listed(key, name, self.joints, "joints of the handle")
        return self.joints[name]

    def tendon(self, key: str, name: str) -> int:
        """Return the number of a tendon with a spool, named within a key; raises ProtocolError if there is none."""
        numbers = {self.inst.tendons[n].name: n for n in self.wound}
        _check_listed(key, name, numbers, "tendons with a spool")
        return numbers[name]

    def component(self, name: str) -> Iterator[Where]:
        """Yield where a component of the wrench stands in a command; raises ProtocolError if it stands nowhere."""
        if not self.takes_forces:
            yield Where.of_component(name)
            return
        own = {ACROSS[axis]: [place] for axis, place in self.axes.items()} | {"fz": list(self.axes.values())}
        if name not in own:
            allowed = " or ".join(own)
            raise ProtocolError(
                f"wrench.{name} is given, but {self.inst.name} takes forces by axis; give {allowed}",
                key=f"wrench.{name}",
                allowed=allowed,
            )
        for place in own[name]:
            yield place.where("radial_force") if name == "fz" else place.where("force")._replace(sign=-1.0)


def _check_listed(key: str, name: str, named: Collection[str], what: str) -> None:
    if name not in named:
        allowed = ", ".join(named) or "none"
        raise ProtocolError(
            f"{key} names {name}; it must name {what}: {allowed}", key=f"{key}.{name}", value=name, allowed=allowed
        )
