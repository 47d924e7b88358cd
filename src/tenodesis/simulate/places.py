"""What a protocol acts on: joints of a handle or what spools bend, their tendons, and components of the load."""

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal, NamedTuple, Self, cast

import numpy as np

from tenodesis.control.pairs import compensated, pairs
from tenodesis.errors import ArgumentError, ProtocolError
from tenodesis.instrument import FullForm, Instrument, Joint, expanded
from tenodesis.run import ACROSS, COMPONENTS, TENDONS, Array
from tenodesis.statics import chain, load_matrix

_TRIED, _REFINED = 65, 5
"""Angles of a handle between which one that turns the tip is looked for, and how often, closer each time."""
_NEAR = 1e-15
"""Difference of angles that is rounding, rad."""


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


@dataclass(frozen=True, eq=False)
class Place:
    """What a phase acts on: what bends at the tip, and the joint of the handle that moves it, or else the spools."""

    inst: FullForm
    joint: Joint | None
    """Of the handle; None without one."""
    number: int
    """Of that joint, or without a handle of what bends."""
    bends: Sequence[int]
    """Joints of the tip that turn, one or the arcs of a backbone; empty where it moves none."""
    tendons: tuple[int, ...] = ()
    """Numbers of the tendons that a spool winds about them; of a pair agonist and antagonist."""
    load: Where | None = None
    """Where a force on it stands that opposes flexion; None where none at the tip does."""
    levers: Sequence[float] = ()
    """Moments about the straight joints by such a force, m."""
    rig_arm: float = 0.0
    """Moment of a load rig by such a force, m."""

    @property
    def name(self) -> str:
        """Name of what moves."""
        return self.joint.name if self.joint is not None else self.inst.tip_joints[self.bends[0]].bend

    def where(self, name: str) -> Where:
        """Return where a value of this place stands in a command."""
        if name == "handle_angle":
            return Where(name if self.joint is not None else "aim", slice(self.number, self.number + 1))
        if name == "spool_velocity":
            return Where(name, list(self.tendons))
        own = cast("Where", self.load)
        if name == "force":
            return own
        return Where.of_component("fz") if own.field == "wrench" else own._replace(field=name)

    def limits(self, kind: Literal["limits", "stops"]) -> tuple[float, float]:
        """Return the ends of the working range of what bends, or its mechanical stops, rad."""
        low, high = np.sum([getattr(self.inst.tip_joints[n], kind) for n in self.bends], axis=0)
        return float(low), float(high)

    @property
    def range(self) -> tuple[float, float]:
        """Ends of the angles that move it, rad."""
        return self.limits("limits") if self.joint is None else self.joint.limits

    def output_angles(self, angles: Array) -> Array:
        """Return the angles (n,), rad, to which angles of the handle, or of spools, turn what bends without load."""
        if self.joint is None:
            return angles
        held = np.zeros((len(angles), len(self.inst.handle_joints)))
        held[:, self.number] = angles
        return np.asarray(chain.output_angles(self.inst, held)[:, self.bends].sum(axis=1))

    def handle_angle(self, output_angle: float) -> float:
        """Return the angle that :meth:`output_angles` turns to an output angle, rad; NaN if there is none."""
        if self.joint is None:
            return output_angle
        if abs(self.output_angles(np.zeros(1))[0] - output_angle) < _NEAR:
            return 0.0
        low, high = self.range
        for _ in range(_REFINED):
            tried = np.linspace(low, high, _TRIED)
            left = self.output_angles(tried) - output_angle
            turns = np.flatnonzero(left[:-1] * left[1:] <= 0)
            if not turns.size:
                return math.nan
            at = turns[np.argmin(np.abs(tried[turns]))]
            low, high = tried[at], tried[at + 1]
        return float(low - left[at] * (high - low) / (left[at + 1] - left[at]))

    @property
    def reach(self) -> float:
        """Largest angle, rad, that keeps the unloaded tip within its range."""
        most = min(map(abs, self.range))
        if self.joint is None or not self.bends:
            return most
        return float(np.fmin.reduce([most, *(abs(self.handle_angle(end)) for end in self.limits("limits"))]))


@dataclass(frozen=True)
class Places:
    """The places of an instrument by name."""

    inst: Instrument
    joints: Mapping[str, Place]
    """By joint of the handle, without one by what bends at the tip."""
    axes: Mapping[str, Place]
    """By axis, of the joints at the tip that a pair of tendons of their own moves, or without a handle spools alone."""
    takes_forces: bool
    """Whether loads are commanded as forces by axis, since the axes do not act on each other, or as a wrench."""

    @classmethod
    def of(cls, inst: Instrument) -> Self:
        """Return the places of an instrument."""
        whole, alone, own = expanded(inst), inst.short_form is not None, pairs(inst)
        bends = list(whole.bends.values())
        turned = chain.coupling(whole) @ whole.tendon_arms("handle")
        handles = np.array([turned[arcs].sum(axis=0) for arcs in bends])
        arms, lever = whole.tendon_arms("tip"), load_matrix(whole, 0.0)
        rigs: list[float] = []
        with suppress(ArgumentError):  # without pairs, or with pairs of several mechanisms
            rigs = [plane.rig_arm for plane in compensated(inst).planar]
        paired = {pair.handle: (n, pair) for n, pair in enumerate(own.values())}

        def place(joint: Joint | None, number: int) -> Place:
            n, pair = paired.get(number, (0, None)) if joint is not None else (0, None)
            if pair is not None:
                arcs: Sequence[int] = next(arcs for arcs in bends if pair.joint in arcs)
            elif joint is None:
                arcs = bends[number]
            else:
                arcs = bends[int(np.argmax(np.abs(handles[:, number])))] if handles[:, number].any() else ()
            if not arcs:
                return Place(whole, joint, number, ())
            turning = (int(m) for m in np.flatnonzero(arms[:, arcs[0]]))
            tendons = pair[2:] if pair is not None else tuple(m for m in turning if whole.tendons[m].start == "spool")
            across = ACROSS.get(str(whole.tip_joints[arcs[0]].axis))
            levers = np.abs(lever[arcs, COMPONENTS.index(across)]) if across is not None else np.zeros(1)
            if across is None or not levers.all():
                return Place(whole, joint, number, arcs, tendons)
            load = Where("force", slice(n, n + 1)) if alone else Where.of_component(across, -1.0)
            rig = rigs[n] if rigs and pair is not None else float(levers.mean())
            return Place(whole, joint, number, arcs, tendons, load, levers.tolist(), rig)

        if not whole.handle_joints:
            joints = {name: place(None, n) for n, name in enumerate(whole.bends)}
            axes: dict[str, Place] = {}
            for at in joints.values():
                if at.load is not None:
                    axes.setdefault(str(whole.tip_joints[at.bends[0]].axis), at)
            return cls(inst, joints, axes, takes_forces=False)
        joints = {joint.name: place(joint, n) for n, joint in enumerate(whole.handle_joints)}
        by_number = list(joints.values())
        return cls(inst, joints, {axis: by_number[pair.handle] for axis, pair in own.items()}, alone)

    def spool_speeds(self, time_step: float) -> Callable[[Array], Array]:
        """Return speeds of the spools, rad/s, (n, tendons), by unloaded angles, rad, (n + 1, bends), a time step apart.

        Takes that time, s. The angles are those at which a law of all joints aims, while no tendon is slack: springs
        and backbones take their share of what is wound.
        """
        inst = expanded(self.inst)
        arms, straight = inst.tendon_arms("tip"), np.zeros(len(inst.tip_joints))
        turned = chain.rates(inst, np.zeros(len(inst.handle_joints))).by_stroke @ arms
        wound = arms @ np.linalg.pinv(turned) / chain.coordinates(inst.tip_joints, straight)[1]
        wound /= inst.own_drives.spool_radius * time_step
        bent = np.array([inst.bent(row) for row in np.eye(len(inst.bends))])

        def speeds(aims: Array) -> Array:
            angles = aims @ bent
            at, _ = chain.coordinates([*inst.tip_joints] * len(aims), angles.ravel())
            return np.asarray(np.diff(at.reshape(angles.shape), axis=0) @ wound.T)

        return speeds

    @property
    def first(self) -> Place:
        """What a phase acts on that names nothing."""
        return next(iter((*self.axes.values(), *self.joints.values())))

    @property
    def wound(self) -> list[int]:
        """Numbers of the tendons that a spool winds."""
        return [n for n, tendon in enumerate(self.inst.tendons) if tendon.start == "spool"]

    def tendon_name(self, number: int) -> str:
        """Return the name of a tendon in a sentence: by its joint and side where it is one of a pair."""
        for axis, place in self.axes.items():
            if number in place.tendons and len(place.tendons) == len(TENDONS):
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
            allowed = " or ".join(places)
            what = f"{allowed}, which {self.inst.name} has"
            raise ProtocolError(f"{key} is {name}; it must be {what}", key=key, value=name, allowed=allowed)
        return places[name]

    def listed(self, key: str, name: str) -> Place:
        """Return the place of what moves a joint, named within a key; raises ProtocolError if there is none."""
        _check_listed(key, name, self.joints, "joints of the handle" if self.inst.handle_joints else "joints")
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
