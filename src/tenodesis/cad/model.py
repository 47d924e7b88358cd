"""An instrument as solids: its parts, from the instrument's file and a process."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import numpy as np

from tenodesis import kinematics
from tenodesis.cad import kernel as k
from tenodesis.cad.backbone_parts import Backbone, backbone, backbone_parts, check_ends, section
from tenodesis.cad.bench_parts import (
    Hardware,
    Rig,
    base_length,
    base_part,
    drive_parts,
    end_effector_part,
    grip_part,
    rig_parts,
    stem_part,
    tip_pin_part,
)
from tenodesis.cad.between_parts import between_part, check_between
from tenodesis.cad.gears import Gear, GearJoint, gear_joint, gear_parts
from tenodesis.cad.lever_parts import Lever, check_lever, lever_length, lever_parts, spring
from tenodesis.cad.parts import PROCESSES, End, Part, Process, Sizes, ferrule, refuse, transition_length, turned
from tenodesis.cad.parts import process as process_of
from tenodesis.cad.pulley_parts import PulleyJoint, pulley_joint, pulley_parts
from tenodesis.cad.wrist_parts import (
    FACTORS,
    MORE_WRAP,
    Jaw,
    Passing,
    Wrist,
    begin_of_finger,
    jaw_row,
    on_wrist,
    wrist,
    wrist_parts,
)
from tenodesis.errors import InstrumentError
from tenodesis.instrument import FullForm, Instrument, InstrumentLike, Joint, Tendon, as_instrument
from tenodesis.instrument.instrument import arm_of
from tenodesis.instrument.joints import SIGNS, Crossing
from tenodesis.instrument.lengths import STEM_PER_RADIUS
from tenodesis.kinematics.chain import bend_side, crossed, end_length
from tenodesis.scaling import catalogue as catalogues

_MODULES = (0.1e-3, 0.12e-3, 0.15e-3, 0.2e-3, 0.25e-3)
"""Modules below the catalogue's, of gears that are made for the purpose, m (JIS B 1701-2 series I, not looked up)."""
_LEAST_TEETH = 12
_CABLE_RADIUS = 15e-3  # m, the paper's load rig
_RODS = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)
_MACHINE_ROUNDING = 1e-6
_SAME_PLACE = 1e-6  # mm
LEAST_ARM = 1e-6  # m, of a tendon at a second jaw, below which it is a coupling's rounding
_LEAST_SHAFT = 5.0  # mm, of the grip before where the hand acts
_BEYOND_RANGE = {"tip": math.radians(10), "handle": math.radians(5)}
"""By how much a joint turns farther than its working range before its parts touch."""

AnyJoint: TypeAlias = GearJoint | PulleyJoint | Backbone | Lever | Wrist | Jaw
Ways: TypeAlias = dict[str, dict[str, tuple[float, float]]]
"""Where tendons are at a joint, mm, in its own frame: by joint and by tendon."""


class Station(NamedTuple):
    """A joint of the instrument, the sizes of its parts, and where it is."""

    joint: Joint
    sizes: AnyJoint
    end: End


@dataclass(frozen=True)
class Model:
    """The solids of an instrument; use :func:`build`."""

    given: Instrument
    """The instrument as it was given, with all its axes."""
    instrument: Instrument
    """What was built of it: all of its joints, or of a planar one the bending axis, called yaw."""
    axis: str | None
    """Name of that axis in the instrument given; None where all joints were built."""
    process: Process
    parts: tuple[Part, ...]
    stations: tuple[Station, ...]
    """Its joints, from the stem outward, those of the tip first."""
    ways: Ways
    """Where tendons are at a joint, mm, in its own frame: by joint and by tendon."""
    rig: Rig | None
    """Where the load rig stands; None of jaws, whose eyes are smaller than its pin."""

    @property
    def joints(self) -> tuple[AnyJoint, ...]:
        """Sizes of its joints, from the stem outward, those of the tip first."""
        return tuple(one.sizes for one in self.stations)

    def part(self, name: str) -> Part:
        """Return a part by its name. Raises KeyError if there is none."""
        found = next((part for part in self.parts if part.name == name), None)
        if found is None:
            raise KeyError(name)
        return found

    @property
    def bearing(self) -> Station:
        """The joint whose link bears the force at the tip."""
        return _bearing(self.at(tip=True))

    def at(self, *, tip: bool) -> tuple[Station, ...]:
        """Return the joints at one end, from the stem outward."""
        return tuple(one for one in self.stations if one.end.tip == tip)


def build(
    inst: InstrumentLike,
    *,
    process: str | Process = "sla",
    axis: str | None = None,
    modules: Mapping[str, float] | None = None,
    hardware: Hardware | None = None,
    rig: bool = True,
) -> Model:
    """Return the solids of an instrument on its bench: of a planar one of one bending axis.

    Parameters
    ----------
    inst
        The instrument: planar, or of gear pairs one on the other, with one pulley on the last of them at either end.
    process
        How its parts are made: fdm, sla, milled, or a process of your own.
    axis
        Which bending axis of a planar one; by default the first.
    modules
        Modules of gears by end, "distal" and "proximal", m; by default the largest of the standard catalogue and then
        of finer series with a whole number of teeth, at least 12.
    hardware
        Motors, load cells, sheaths and bearings, which are bought.
    rig
        Whether to add the load rig, the drives and their mounts.

    Raises
    ------
    InstrumentError
        A dimension cannot be made: radii that fit no whole number of teeth, walls thinner than the process allows, a
        joint that touches before its range; the message names the dimension, its value and what would do. Or its
        joints are of other kinds.
    MissingExtraError
        build123d is not installed.
    """
    given = as_instrument(inst)
    built, axis = _built(given, axis)
    full = built.expanded
    chosen = process_of(process)
    bought = hardware or Hardware()
    _check_joints(full, full.joints if built.short_form is not None else built.as_given("joints"))
    if built.tendon_diameter is None:
        raise InstrumentError(
            f"{built.name} has no tendon_diameter; tunnels and grooves need it: give it, 0.5 mm say.",
            key="tendon_diameter",
            allowed="given",
        )
    sizes = Sizes(chosen, k.MM * built.tendon_diameter)
    stations, ways = _stations(built, full, sizes, bought, dict(modules or {}))
    tips, hands = (tuple(one for one in stations if one.end.tip == tip) for tip in (True, False))
    for own in (tips, hands):
        _check_lengths(built, own, sizes)
        _check_row(own, sizes)
    turn = tips[0].end.turn
    parts: list[Part] = []
    for own in (tips, hands):
        parts += _joint_parts(own, sizes, turn)
    where, tip, first = _rig(full, tips, turn), _bearing(tips), tips[0].end
    behind = -first.stem_length
    if hands:
        hand = _bearing(hands)
        length = k.MM * (hand.joint.end_effector_length or 0.0)
        parts.append(grip_part(hand.end, sizes, length, _foot(hands, sizes)))
        behind += _along(hands, hand) - _along(hands, hands[0]) - 1.4 * length
    else:
        parts.append(base_part(first, sizes))
    parts.append(stem_part(first, hands[0].end.near_length if hands else base_length(first)))
    reach = k.MM * (tip.joint.end_effector_length or 0.0)
    if _holds_rod(tips):
        parts.append(end_effector_part(tip.end, sizes, reach, _foot(tips, sizes), turn))
    if rig:
        if where is not None:
            parts.append(tip_pin_part(tip.end, reach, -where.level - 4.0, turn))
            parts += rig_parts(where, sizes, bought, first.stem_radius)
        drawn = sum(tendon.start == "spool" for tendon in full.tendons)
        parts += drive_parts(sizes, bought, k.MM * full.own_drives.spool_radius, behind - 120, drawn)
    parts = [part if part.density else replace(part, density=chosen.density) for part in parts]
    # The inertia of a roll that is left out is not in the solids: the file written is of what is built.
    return Model(given if axis else built, built, axis, chosen, tuple(parts), stations, ways, where)


def _check_lengths(inst: Instrument, stations: tuple[Station, ...], sizes: Sizes) -> None:
    """Refuse lengths beyond the last joint that what is fixed there takes whole."""
    if not stations or not (stations[0].end.tip is False or _holds_rod(stations)):
        return
    last = _bearing(stations)
    length, foot = k.MM * (last.joint.end_effector_length or 0.0), _foot(stations, sizes)
    taken = foot + last.end.far_collar
    more, what = (4.0, "the far half of the joint") if last.end.tip else (_LEAST_SHAFT, "what is before the grip")
    if taken + more > length:
        refuse(
            _key(inst, last.joint, "end_effector_length"),
            length,
            f"{what} takes {taken:.3g} mm of it",
            f"at least {taken + more:.3g} mm",
        )


def _holds_rod(stations: tuple[Station, ...]) -> bool:
    """Return whether the last body at the tip holds the rod of the bench's end-effector, and is no jaw."""
    return not isinstance(stations[-1].sizes, Lever | Jaw)


def _built(given: Instrument, axis: str | None) -> tuple[Instrument, str | None]:
    """Return what is built of an instrument: all of it, or one bending axis of a planar one, called yaw."""
    short = given.short_form
    if short is None:
        if axis is not None:
            raise InstrumentError(
                f"{given.name} lists joints and tendons, all of which are built; leave the axis out.",
                key="axis",
                value=axis,
                allowed="left out",
            )
        return _without_roll(given), None
    axis = axis or short.axes[0]
    planar = short.axis(axis)
    return (planar if planar.axes == ("yaw",) else planar.replace(axes=("yaw",))), axis


def _without_roll(inst: Instrument) -> Instrument:
    """Return an instrument without a roll of the whole stem, by tendons of its own: the bench turns the stem."""
    full = inst.expanded
    first = full.tip_joints[0] if full.tip_joints else None
    if first is None or len(full.tip_joints) == 1 or abs(first.axis_vector[2]) < 1 - _MACHINE_ROUNDING:
        return inst
    own = {tendon.name for tendon in full.tendons if any(one.joint == first.name for one in tendon.route)}
    if any(len(tendon.route) > 1 for tendon in full.tendons if tendon.name in own):
        return inst
    joints = [joint for joint in inst.as_given("joints") if joint.name != first.name]
    tables = [joint.model_dump(exclude_unset=True) for joint in joints]
    tables = [{key: value for key, value in one.items() if value != first.name or key != "on"} for one in tables]
    tendons = [one.model_dump(exclude_unset=True) for one in inst.as_given("tendons") if one.name not in own]
    return inst.replace(joints=tables, tendons=tendons)


def _check_joints(full: FullForm, given: Sequence[Joint]) -> None:
    """Refuse joints of which no parts are made; `given` are those of the file."""
    if not full.tip_joints:
        raise InstrumentError(f"{full.name} has no joint at the tip.", key="joints", allowed="one at least")
    if _is_backbone(full):
        _check_backbones([joint for joint in given if joint.place == "tip"])
    for place, joints in (("tip", full.tip_joints), ("handle", full.handle_joints)):
        jaws = place == "tip" and _carries_jaws(full)
        for number, joint in enumerate(joints):
            key = f"joints.{joint.bend}"
            if joint.tied_to is not None and not joint.arc:
                raise InstrumentError(
                    f"{key}.tied_to is {joint.tied_to!r}: a file does not say by what, gears, links or ropes, nor "
                    "their sizes; no parts are made of it, and it must be left out.",
                    key=f"{key}.tied_to",
                    value=joint.tied_to,
                    allowed="left out",
                )
            on = joints[0] if jaws else joints[number - 1]
            before = on.name if number else "stem"
            # A joint that says nothing stands on the one before.
            if len(joints) > 1 and (joint.on or joints[max(number - 1, 0)].name if number else before) != before:
                raise InstrumentError(
                    f"{key}.on is {joint.on!r}: parts are made of joints in a row, and of pulleys side by side on one; "
                    f"it must be {before!r}.",
                    key=f"{key}.on",
                    value=joint.on,
                    allowed=before,
                )
            if jaws and number > 1 and (joint.offset, joint.axis) != (joints[1].offset, joints[1].axis):
                raise InstrumentError(
                    f"{key}.offset is {k.MM * joint.offset:.4g} mm: pulleys side by side are on one pin; it must be "
                    f"that of {joints[1].name}, {k.MM * joints[1].offset:.4g} mm, and so its axis.",
                    key=f"{key}.offset",
                    value=joint.offset,
                    allowed=f"{k.MM * joints[1].offset:.4g} mm",
                )
            if joint.mechanism == "continuum" and (place == "handle" or not _is_backbone(full)):
                raise InstrumentError(
                    f"{key}.mechanism is 'continuum': parts are made of backbones at the tip, without other joints; it "
                    "must be 'tendon-gear' or 'pulley'.",
                    key=f"{key}.mechanism",
                    value=joint.mechanism,
                    allowed="tendon-gear or pulley",
                )
            is_lever = joint.mechanism == "pulley" and joint.end_effector_length is None
            if (
                len(joints) > 1
                and not jaws
                and joint.mechanism not in {"tendon-gear", "continuum"}
                and not (number == len(joints) - 1 and is_lever)
            ):
                raise InstrumentError(
                    f"{key}.mechanism is {joint.mechanism!r}: of several joints at an end, parts are made of "
                    "tendon-gear, with one pulley with a lever on the last of them, without an end_effector_length, or "
                    "of a pulley that carries pulleys; it must be 'tendon-gear'.",
                    key=f"{key}.mechanism",
                    value=joint.mechanism,
                    allowed="tendon-gear",
                )
            if _turn(joint) % 90 > 1e-9 and _turn(joint) % 90 < 90 - 1e-9:
                raise InstrumentError(
                    f"{key}.axis is {joint.axis}: parts are made of joints that are turned against each other by "
                    "quarter turns; it must be yaw or pitch.",
                    key=f"{key}.axis",
                    value=joint.axis,
                    allowed="yaw or pitch",
                )
            if abs(joint.axis_vector[2]) > 1e-9:
                raise InstrumentError(
                    f"{key}.axis is {joint.axis}: no parts are made of joints that roll; it must be yaw or pitch.",
                    key=f"{key}.axis",
                    value=joint.axis,
                    allowed="yaw or pitch",
                )


def _is_backbone(full: FullForm) -> bool:
    """Return whether the joints of the tip are arcs of backbones."""
    return all(joint.mechanism == "continuum" or joint.is_twist for joint in full.tip_joints)


def _check_backbones(joints: Sequence[Joint]) -> None:
    """Refuse backbones of which no parts are made: all but those of a row of arcs, in a plane each, on one rod."""
    rigidity = joints[0].backbone_rigidity
    reasons = {
        "torsional_rigidity": (None, "discs on one rod cannot turn against each other", "left out"),
        "planes": (1, "parts are made of backbones that bend in one plane each", "1"),
        "within": (None, "parts are made of backbones that bend in one plane each", "left out"),
        "offset": (0.0, "a backbone begins where the part before it ends", "0"),
        "backbone_rigidity": (rigidity, "one rod goes through all segments", f"{rigidity:g} N*m^2"),
    }
    for joint in joints:
        for name, (wanted, because, allowed) in reasons.items():
            value, key = getattr(joint, name), f"joints.{joint.name}.{name}"
            if value != wanted:
                raise InstrumentError(
                    f"{key} is {value}: {because}; it must be {allowed}.", key=key, value=value, allowed=allowed
                )


def _carries_jaws(full: FullForm) -> bool:
    """Return whether the joints of the tip are a pulley and others on it."""
    return len(full.tip_joints) > 1 and all(joint.mechanism == "pulley" for joint in full.tip_joints)


def _turn(joint: Joint) -> float:
    """Return the turn about the stem of the side that a joint bends to, deg."""
    x, y, _ = bend_side(joint.axis_vector)
    return round(math.degrees(math.atan2(y, x)), 9)


def _stop(joint: Joint) -> float:
    """Return the angle up to which a joint is sized, rad."""
    most = joint.range + _BEYOND_RANGE[joint.place] / joint.arc_count
    return min(max(map(abs, joint.stops)), most) if joint.place == "tip" else most


def _key(inst: Instrument, joint: Joint, key: str = "radius") -> str:
    """Return the key of a joint's dimension in the instrument's file."""
    short, tip = inst.short_form, joint.place == "tip"
    if short is None:
        return f"joints.{joint.bend}.{key}"
    if key == "end_effector_length":
        return key if tip else "handle_length"
    if key != "radius":
        return key
    wanted = "distal_radius" if tip else "proximal_radius"
    return next(field for field, name in short.parameter_fields.items() if name == wanted)


def _bearing(stations: tuple[Station, ...]) -> Station:
    """Return the last joint at an end that is no lever: what it turns bears the force, or the hand."""
    return next(one for one in reversed(stations) if not isinstance(one.sizes, Lever))


def _lever(stations: tuple[Station, ...]) -> Lever | None:
    last = stations[-1].sizes
    return last if isinstance(last, Lever) else None


def _check_row(stations: tuple[Station, ...], sizes: Sizes) -> None:
    """Refuse joints that are too near to each other."""
    for one, other in pairwise(stations):
        if not isinstance(one.sizes, GearJoint):
            continue
        if isinstance(other.sizes, GearJoint):
            check_between(one.sizes, other.sizes, other.end, sizes)
        elif isinstance(other.sizes, Lever):
            check_lever(one.sizes, one.end, other.sizes, other.end, sizes, other.end.passing[0])


def _joint_parts(stations: tuple[Station, ...], sizes: Sizes, turn: float) -> list[Part]:
    """Return the parts of the joints at one end; `turn` is that of the plane that the load rig moves in, deg."""
    parts: list[Part] = []
    for number, (_, joint, end) in enumerate(stations):
        beyond = stations[number + 1] if number + 1 < len(stations) else None
        if isinstance(joint, GearJoint):
            parts += gear_parts(joint, end, sizes)
            if beyond is not None and isinstance(beyond.sizes, GearJoint):
                parts.append(between_part(joint, end, beyond.sizes, beyond.end, sizes))
            elif beyond is not None and isinstance(beyond.sizes, Lever):
                across = turn - beyond.end.turn
                parts += lever_parts(joint, end, beyond.sizes, beyond.end, sizes, beyond.end.passing[0], across)
        elif isinstance(joint, PulleyJoint):
            parts += pulley_parts(joint, end, sizes)
        elif isinstance(joint, Backbone) and not number:
            parts += backbone_parts(
                [(one.sizes, one.end) for one in stations if isinstance(one.sizes, Backbone)], sizes
            )
        elif isinstance(joint, Wrist):
            parts += wrist_parts(joint, end, [one.end for one in stations[1:]], sizes)
    return parts


def gear_of(key: str, radius: float, module: float | None = None) -> tuple[float, int]:
    """Return module, m, and number of teeth of gears of a pitch radius, m.

    Raises InstrumentError if no module has a whole number of teeth, and names the nearest radius that has.
    """
    stock = catalogues.load().gears
    series = sorted({*_MODULES, *(stock.modules if stock else ())}) if module is None else [module]
    nearest: tuple[float, float, int] | None = None
    for one in reversed(series):
        teeth = 2 * radius / one
        whole = max(round(teeth), _LEAST_TEETH)
        if abs(teeth - whole) < _MACHINE_ROUNDING * whole:
            return one, whole
        off = abs(one * whole / 2 - radius)
        if nearest is None or off < nearest[0] - 1e-12:
            nearest = (off, one, whole)
    assert nearest is not None
    _, one, whole = nearest
    return refuse(
        key,
        k.MM * radius,
        "no gear has that pitch radius"
        if module is None
        else f"gears of module {k.MM * module:.4g} mm have no such pitch radius",
        f"half a module times a whole number of teeth, such as {k.MM * one * whole / 2:.6g} mm (module "
        f"{k.MM * one:.4g} mm, {whole} teeth)",
    )


def _stations(
    inst: Instrument, full: FullForm, sizes: Sizes, bought: Hardware, modules: Mapping[str, float]
) -> tuple[tuple[Station, ...], Ways]:
    """Return the joints of an instrument with their sizes and places, those of the tip first, and its tendons' ways."""
    seat = (k.MM * bought.sheath + sizes.bore) / 2
    alone = full.handle_joints if _carries_jaws(full) else (*full.tip_joints, *full.handle_joints)
    found: list[tuple[Joint, AnyJoint]] = []
    if _carries_jaws(full):
        found = [*zip(full.tip_joints, fitting(inst, full, sizes), strict=True)]
    elif _is_backbone(full):
        found = [*zip(full.tip_joints, _backbones(inst, full, sizes), strict=True)]
        alone = full.handle_joints
    found += [(joint, _sized(inst, full, joint, sizes, seat, modules)) for joint in alone]
    ways = _ways(full, {joint.name: (joint, one) for joint, one in found}, sizes)
    found = [
        (joint, one.passed(_passing(ways[joint.name]), sizes) if isinstance(one, GearJoint) else one)
        for joint, one in found
    ]
    ends = _ends(inst, full, sizes, seat, found, ways)
    return tuple(Station(joint, one, end) for (joint, one), end in zip(found, ends, strict=True)), ways


def _sized(  # noqa: PLR0917
    inst: Instrument, full: FullForm, joint: Joint, sizes: Sizes, seat: float, modules: Mapping[str, float]
) -> AnyJoint:
    """Return the sizes of a joint's parts."""
    key, stop, tip = _key(inst, joint), _stop(joint), joint.place == "tip"
    radius = k.MM * joint.radius
    if joint.mechanism == "tendon-gear":
        module, teeth = gear_of(key, joint.radius, modules.get("distal" if tip else "proximal"))
        gear = Gear(k.MM * module, teeth, k.MM * sizes.process.backlash)
        return gear_joint(sizes, key, radius, gear, stop)
    joints = full.tip_joints if tip else full.handle_joints
    if len(joints) == 1:
        return pulley_joint(sizes, key, radius, stop, None if tip else seat)
    bending = {
        crossing.side: tendon
        for tendon in full.tendons
        for crossing in tendon.route
        if crossing.joint == joint.name and crossing.side in ("agonist", "antagonist")
    }
    sides = tuple(int(SIGNS[side]) for side in ("agonist", "antagonist") if side in bending)
    pulley = pulley_joint(sizes, key, radius, stop, None if tip else seat, sides)
    own = joint.stiffness or 0.0
    coil = (
        spring(sizes, f"joints.{joint.name}.stiffness", pulley.pin, 1e3 * own / 2, pulley.rim) if own and tip else None
    )
    bearing = joints[-2].end_effector_length or 0.0
    held = full.grip.length if full.grip is not None and joint.name in full.grip.jaws else None
    low, high = joint.limits
    opens = full.grip_arms[full.tip_joints.index(joint)] if tip else 0.0
    stem = k.MM * _stem_diameter(full) / 2
    return Lever(
        pulley,
        joint.range,
        k.MM * joint.offset,
        coil,
        lever_length(tip=tip, radius=radius, held=k.MM * (held or 0.0)),
        (low if opens >= 0 else high) if tip else 0.0,
        k.MM * (bearing - joint.offset) if tip else 0.0,
        max(2 * sizes.wall, 0.35 * stem if tip else 0.3 * radius, 0.4 * radius),
    )


def _backbones(inst: Instrument, full: FullForm, sizes: Sizes) -> list[Backbone]:
    """Return the sizes of the arcs of a tip of backbones."""
    places = _places(full, sizes)
    beside = any(x and y for ways in places.values() for x, y in ways.values())
    joints, found = full.tip_joints, []
    rod = section(joints[0].backbone_rigidity or 0.0, strip=beside)
    for number, joint in enumerate(joints):
        ways = places[joint.name]
        beyond = places[joints[number + 1].name] if number + 1 < len(joints) else {}
        key = _key(inst, joint)
        if not ways:
            raise InstrumentError(f"no tendon bends {key.rpartition('.')[0]}.", key=key, allowed="crossed by a tendon")
        found.append(
            backbone(
                sizes,
                (key, _key(inst, joint, "backbone_length")),
                tuple(ways.values()),
                tuple(way for name, way in ways.items() if name not in beyond),
                k.MM * (joint.backbone_length or 0.0),
                joint.arc_count,
                rod,
                _stop(joint),
            )
        )
        if rod.wide and _turn(joint) != _turn(joints[0]):
            raise InstrumentError(
                f"joints.{joint.bend}.axis is {joint.axis}: tendons side by side need a strip for a backbone, which "
                f"bends in one plane; it must be that of {joints[0].bend}, or tendons must have places of their own.",
                key=f"joints.{joint.bend}.axis",
                value=joint.axis,
                allowed=str(joints[0].axis),
            )
    check_ends(found, sizes, "tendon_diameter")
    return found


def _places(full: FullForm, sizes: Sizes) -> Ways:
    """Return where tendons are at the joints of a tip of backbones, mm; of those at one place all side by side.

    Those of a pair are opposite each other across the axis, so that both together do not bend the backbone aside.
    """
    found: Ways = {joint.name: {} for joint in full.tip_joints}
    straight: dict[str, tuple[float, float]] = {}
    for tendon in full.tendons:
        passed = [(joint, offset) for joint, offset in crossed(full, tendon) if joint.place == "tip"]
        for number, (joint, offset) in enumerate(passed):
            place = (k.MM * float(offset[0]), k.MM * float(offset[1]))
            skips = joint.name != full.tip_joints[number].name
            if skips or math.dist(straight.setdefault(tendon.name, place), place) > _SAME_PLACE:
                key = f"tendons.{tendon.name}.route"
                raise InstrumentError(
                    f"{key} goes aside at {joint.bend}: a tendon passes straight through all discs before it; it must "
                    "be at one place of all of them.",
                    key=key,
                    value=joint.bend,
                    allowed="straight",
                )
            x, y = turned(place, -_turn(joint))
            found[joint.name][tendon.name] = (0.0 if abs(x) < _SAME_PLACE else x, 0.0 if abs(y) < _SAME_PLACE else y)
    apart = ferrule(sizes)[0] + sizes.tunnel / 2 + sizes.wall
    for name, place in straight.items():
        alike = [other for other, its in straight.items() if math.dist(its, place) < _SAME_PLACE]
        aside = (alike.index(name) - (len(alike) - 1) / 2) * apart
        for ways in found.values() if aside else ():
            if name in ways:
                x, y = ways[name]
                ways[name] = (x, y + math.copysign(aside, x * aside))
    return found


def fitting(inst: Instrument, full: FullForm, sizes: Sizes) -> tuple[AnyJoint, ...]:
    """Return the sizes of a wrist; refuses one that does not fit, and names a process and a scale at which it would."""
    try:
        return _wrist(inst, full, sizes, 1.0)
    except InstrumentError as problem:
        others = [name for name in PROCESSES if name != sizes.process.name and _fits(inst, full, name, sizes.rope, 1.0)]
        factor = next((one for one in FACTORS if _fits(inst, full, sizes.process, sizes.rope, one)), None)
        ways = [f"process {' or '.join(others)}"] if others else []
        ways += [f"all lengths times {factor:g}"] if factor else []
        if not ways:
            raise
        allowed = f"{problem.allowed}, or {', or '.join(ways)}"
        text = f"{str(problem).removesuffix('.')}, or {', or '.join(ways)}."
        raise InstrumentError(text, key=problem.key, value=problem.value, allowed=allowed) from problem


def _over(full: FullForm) -> list[tuple[Tendon, Crossing, int, Crossing]]:
    """Return tendons that pass the first joint of the tip to one on it: with that joint's number and both crossings."""
    first, *others = full.tip_joints
    found = []
    for tendon in full.tendons:
        crossings = {crossing.joint: crossing for crossing in tendon.route}
        numbers = [number for number, joint in enumerate(others) if joint.name in crossings]
        if not numbers or first.name not in crossings:
            continue
        arms = [abs(arm_of(crossings[others[number].name], others[number])) for number in numbers]
        if sum(arms) - max(arms) > LEAST_ARM:
            key, other = f"tendons.{tendon.name}.route.radius", others[numbers[int(np.argsort(arms)[-2])]].name
            refuse(
                key,
                k.MM * (sum(arms) - max(arms)),
                f"at {other} beside that at another jaw, and as a solid a tendon ends at a pulley of one of them",
                "0 there, as --jaw-angle pulleys imports tool files of pulleys",
            )
        number = numbers[int(np.argmax(arms))]
        found.append((tendon, crossings[first.name], number, crossings[others[number].name]))
    return found


def _sign(crossing: Crossing) -> int:
    return int(SIGNS[crossing.side or "middle"])


def _same_side(full: FullForm, joint: Joint) -> float:
    """Return 1 if tendons pass the first joint on the side on which they bend another, -1 if on the other."""
    own = [(over, at) for _, over, _, at in _over(full) if at.joint == joint.name]
    return math.copysign(1.0, sum(_sign(over) * _sign(at) for over, at in own))


def _passing_tendons(full: FullForm, jaws: Sequence[Jaw], turn: float, scale: float) -> list[Passing]:
    """Return the tendons that pass the first joint of the tip, as solids have them, lengths at a scale.

    Radii that differ by a coupling's rounding are one.
    """
    first, found = full.tip_joints[0], list[Passing]()
    for tendon, over, number, at in _over(full):
        jaw, side = jaws[number], _sign(at)
        target = turned((side * jaw.pulley.radius, jaw.level + side * jaw.pulley.shift), turn)
        radius = scale * (first.radius if over.radius is None else over.radius)
        radius = next((one.radius for one in found if abs(one.radius - radius) < k.MM * LEAST_ARM), radius)
        wrap = max(over.base_wrap, first.range + MORE_WRAP)
        found.append(Passing(tendon.name, _sign(over), radius, wrap, target))
    return found


def _fits(inst: Instrument, full: FullForm, process: str | Process, rope: float, factor: float) -> bool:
    try:
        _wrist(inst, full, Sizes(process_of(process), factor * rope), factor)
    except InstrumentError:
        return False
    return True


def _wrist(inst: Instrument, full: FullForm, sizes: Sizes, factor: float) -> tuple[AnyJoint, ...]:
    """Return the sizes of a wrist and of the jaws on it, all lengths of the instrument times a factor."""
    first, *others = full.tip_joints
    scale = factor * k.MM
    stem = scale * _stem_diameter(full) / 2
    pulleys = [
        on_wrist(pulley_joint(sizes, _key(inst, joint), scale * joint.radius, _stop(joint), None), sizes)
        for joint in full.tip_joints
    ]
    turn = _turn(others[0]) - _turn(first)
    pulleys[1:] = [
        pulley._replace(shift=math.copysign(pulley.shift, -_same_side(full, joint) * math.sin(math.radians(turn))))
        for pulley, joint in zip(pulleys[1:], others, strict=True)
    ]
    levels, width = jaw_row(sizes, pulleys[1:])
    begin = begin_of_finger(max(one.radius for one in pulleys[1:]), sizes)
    opens = full.grip_arms[1:]
    jaws = tuple(
        Jaw(
            pulley,
            level,
            scale * joint.offset,
            float(np.sign(sign)),
            scale * (end_length(full, joint) or 0.0),
            max(2 * sizes.wall, 0.2 * stem),
            width,
            begin,
        )
        for pulley, level, joint, sign in zip(pulleys[1:], levels, others, opens, strict=True)
    )
    passing = _passing_tendons(full, jaws, turn, scale)
    made = wrist(
        sizes,
        {"radius": _key(inst, first), "offset": _key(inst, others[0], "offset"), "stem": "stem_diameter"},
        pulleys[0],
        passing,
        jaws,
        ranges=(first.range, max(joint.range for joint in others)),
        jaw_turn=turn,
        stem=stem,
    )
    return (made, *jaws)


def _ways(full: FullForm, sized: Mapping[str, tuple[Joint, AnyJoint]], sizes: Sizes) -> Ways:
    """Return where all tendons are at all joints.

    Those that pass a gear pair in its middle plane do so as far along its axis as at the next joint that they bend
    where that is beyond the links, and on its axis otherwise. Raises InstrumentError if two would.
    """
    found: Ways = {name: {} for name in sized}
    for tendon in full.tendons:
        for joint, offset in crossed(full, tendon):
            x, y = turned((k.MM * float(offset[0]), k.MM * float(offset[1])), -_turn(joint))
            if math.hypot(x, y) < _SAME_PLACE:
                x, y = 0.0, 0.0
            if abs(x) < _SAME_PLACE:
                one = sized[joint.name][1]
                x = 0.0
                if isinstance(one, GearJoint) and abs(y) < one.nearest_passage(sizes):
                    y = 0.0
            else:
                y = 0.0
            found[joint.name][tendon.name] = (x, y)
    for name, ways in found.items():
        middle = [tendon for tendon, way in ways.items() if way == (0.0, 0.0)]
        if len(middle) > 1 and isinstance(sized[name][1], GearJoint):
            raise InstrumentError(
                f"joints.{name}.radius is {k.MM * sized[name][0].radius:.4g} mm: {' and '.join(middle)} would both "
                "pass on its axis; give the joints beyond larger radii, so that one of them passes beside its links.",
                key=f"joints.{name}.radius",
                value=sized[name][0].radius,
                allowed="larger radii beyond",
            )
    return found | (_places(full, sizes) if _is_backbone(full) else {})


def _passing(ways: Mapping[str, tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    return tuple(dict.fromkeys(way for way in ways.values() if not way[0]))


def _stem_diameter(full: FullForm) -> float:
    given = full.stem_diameter
    return STEM_PER_RADIUS * max(joint.radius for joint in full.tip_joints) if given is None else given


def _ends(  # noqa: PLR0917
    inst: Instrument, full: FullForm, sizes: Sizes, seat: float, found: list[tuple[Joint, AnyJoint]], ways: Ways
) -> list[End]:
    tips, hands = ([one for one in found if one[0].place == place] for place in ("tip", "handle"))
    first, tip = tips[0]
    assert not isinstance(tip, Lever | Jaw)
    if full.stem_length is None:
        raise InstrumentError(
            f"{full.name} has no stem_length, which its tube needs: give it, 300 mm say.",
            key="stem_length",
            allowed="given",
        )
    stem = k.MM * _stem_diameter(full) / 2
    radius, shift = k.MM * first.radius, tip.shift if isinstance(tip, PulleyJoint) else 0.0
    stems = _stem_places(full, tip, ways)
    outermost = (
        max(math.hypot(*place) for place in stems.values())
        if isinstance(tip, Wrist | Backbone)
        else max(radius, *(math.hypot(*way) for way in ways[first.name].values()))
    )
    needed = math.hypot(outermost, shift) + sizes.rope / 2 + 0.02
    if stem - needed < sizes.process.wall * k.MM / 2 and stem - needed < 0.15:
        refuse(
            "stem_diameter",
            2 * stem,
            f"tendons of {sizes.rope:.3g} mm at {outermost:.4g} mm from its axis leave {max(stem - needed, 0.0):.3g} "
            "mm for the tube's wall",
            f"at least {2 * (needed + 0.15):.3g} mm",
        )
    bore = max(needed, stem - max(1.0, 0.05 * stem))
    wide, _ = ferrule(sizes)
    room = 2 * (radius - wide - sizes.wall) - sizes.bore
    most = 0.8 * radius if isinstance(tip, PulleyJoint | Wrist) else min(0.75 * radius, room)
    rods = [rod for rod in _RODS if rod <= most]
    if not rods:
        refuse(
            _key(inst, first),
            radius,
            f"no rod of {_RODS[0]:g} mm for the end-effector fits between the tendons' ends",
            f"at least {wide + sizes.wall + (_RODS[0] + sizes.bore) / 2:.3g} mm",
        )
    near_tip = tip.collar if isinstance(tip, Backbone) else tip.depth + tip.collar
    stem_length = k.MM * full.stem_length
    near_hand = _near_handle(hands, ways, outermost, stem)
    rod_hand = max(
        rod for rod in (*_RODS, 10.0) if rod <= max([_RODS[0], *(0.6 * k.MM * joint.radius for joint, _ in hands[:1])])
    )
    if near_tip + near_hand + 3 * stem > stem_length:
        short = near_tip + near_hand + 3 * stem - stem_length
        given = inst.short_form
        value = stem_length if given is None else k.MM * given.overall_length
        refuse(
            "stem_length" if given is None else "overall_length",
            value,
            f"of the stem's {stem_length:.4g} mm the ends of its joints take {near_tip + near_hand + 3 * stem:.4g} mm",
            f"at least {value + short:.4g} mm",
        )
    ends: list[End] = []
    for joints in (tips, hands):
        at_tip = joints is tips
        single = len({joint.bend for joint, _ in joints}) == 1
        # A jaw or trigger stands on the last gear pair.
        near = "stem"
        for number, (joint, one) in enumerate(joints):
            collar = getattr(one, "collar", 0.0)
            if isinstance(one, Jaw):
                near = ends[0].far
            places = ways[joint.name]
            before = ways[joints[number - 1][0].name] if number else {}
            passing = tuple(before[name] for name in places) if isinstance(one, Lever) else ()
            if isinstance(one, GearJoint):
                passing = _passing(places)
                _check_straight(inst, joints, number, ways)
            start = joint.offset if at_tip else -joint.offset - (0.0 if number else full.stem_length)
            ends.append(
                End(
                    tip=at_tip,
                    prefix=("tip" if at_tip else "handle") if single else joint.bend,
                    key=_key(inst, joint),
                    near=near,
                    carrier=f"{joint.name}_carrier",
                    far=f"{joint.name}_far",
                    turn=_turn(joint),
                    start=k.MM * start,
                    order=number,
                    last=number + 1 == len(joints),
                    passing=passing,
                    stem_ways=_stem_ways(full, one, joint, tip, ways, at_tip=at_tip) if not number else (),
                    stem_length=stem_length,
                    stem_radius=stem,
                    stem_bore=bore,
                    tendon_radius=min(abs(x) or abs(y) for x, y in stems.values())
                    if isinstance(tip, Wrist | Backbone)
                    else outermost,
                    near_length=near_tip if at_tip else near_hand,
                    far_collar=max(collar, 1.5 * rods[-1])
                    if at_tip
                    else max(collar, 1.5 * rod_hand, 4 * sizes.wall + 2 * seat),
                    rod=rods[-1] if at_tip else rod_hand,
                    seat=seat,
                    shift=shift,
                )
            )
            near = ends[-1].far
    return ends


def _near_handle(hands: list[tuple[Joint, AnyJoint]], ways: Ways, tendon_radius: float, stem: float) -> float:
    """Return how much of the stem the first joint of the handle takes, or what holds it where there is none, mm."""
    if not hands:
        return stem
    first, hand = hands[0]
    assert isinstance(hand, GearJoint | PulleyJoint)
    widest = max(k.MM * first.radius, *(math.hypot(*way) for way in ways[first.name].values()))
    return hand.depth + hand.collar + transition_length(widest, tendon_radius) + min(stem, 15.0) + stem / 2


def _check_straight(inst: Instrument, joints: list[tuple[Joint, AnyJoint]], number: int, ways: Ways) -> None:
    """Refuse tendons that would have to change sides between two gear pairs."""
    if not number:
        return
    joint, before = joints[number][0], joints[number - 1][0]
    for name, way in ways[joint.name].items():
        place = turned(way, _turn(joint) - _turn(before))
        own = ways[before.name].get(name)
        if own is None or math.dist(own, place) > _SAME_PLACE:
            raise InstrumentError(
                f"{_key(inst, joint, 'axis')} is {joint.axis}: tendon {name} would not pass straight from it to "
                f"{before.name}; it must bend across it, with room beside its links.",
                key=_key(inst, joint, "axis"),
                value=joint.axis,
                allowed=f"across that of {before.name}",
            )


def _stem_ways(
    full: FullForm, one: AnyJoint, joint: Joint, tip: AnyJoint, ways: Ways, *, at_tip: bool
) -> tuple[tuple[tuple[float, float], tuple[float, float]], ...]:
    """Return where every tendon is at the first joint of an end and where within the stem, in that joint's frame."""
    first = full.tip_joints[0]
    # Seen from its mate, the near half at the handle has y the other way.
    side = 1.0 if at_tip else -1.0
    stems, found = _stem_places(full, tip, ways), []
    for name, (x, y) in ways[joint.name].items():
        place = stems.get(name)
        if place is None:
            continue
        x_low, y_low = (
            0.0 if abs(value) < _SAME_PLACE else value for value in turned(place, _turn(first) - _turn(joint))
        )
        if isinstance(one, Wrist):
            found.append((place, place))
            continue
        at_joint = (x, math.copysign(one.shift, x) if isinstance(one, PulleyJoint) else side * y)
        found.append((at_joint, (x_low, y_low if isinstance(tip, PulleyJoint) else side * y_low)))
    return tuple(found)


def _stem_places(full: FullForm, tip: AnyJoint, ways: Ways) -> dict[str, tuple[float, float]]:
    """Return where tendons are in the stem, in the frame of the first joint of the tip."""
    own = ways[full.tip_joints[0].name]
    if isinstance(tip, Wrist):
        return {name: tip.stem_place(name, 1 if x > 0 else -1) for name, (x, _) in own.items()}
    if isinstance(tip, PulleyJoint):
        return {name: (x, math.copysign(tip.shift, x)) for name, (x, _) in own.items()}
    return own


def _along(stations: tuple[Station, ...], wanted: Station) -> float:
    """Return how far along the stem's axis the far axis of a joint is, from the stem's distal end, mm."""
    at = 0.0
    for one in stations:
        at += one.end.start + one.end.outward * k.MM * one.joint.chord
        if one is wanted:
            break
    return at


def _foot(stations: tuple[Station, ...], sizes: Sizes) -> float:
    """Return where the socket of what is fixed to the far body begins, from its axis, mm."""
    lever = _lever(stations)
    if lever is not None:
        return lever.foot(sizes, stations[0].end.seat)
    joint = stations[-1].sizes
    assert isinstance(joint, GearJoint | PulleyJoint | Backbone)
    return (joint.collar if isinstance(joint, Backbone) else joint.depth) + sizes.wall


def _rig(full: FullForm, tips: tuple[Station, ...], turn: float) -> Rig | None:
    """Return where the load rig stands: for the first joint, its slot long enough for the others; none for jaws."""
    if isinstance(tips[-1].sizes, Jaw):
        return None
    bent = []
    last = [one for one in tips if not isinstance(one.sizes, Lever)][-1]
    bearing, name = last.end, f"{last.joint.name}_tip"
    pivots = []
    for (low, high), places in zip(full.bend_limits, full.bends.values(), strict=True):
        if isinstance(tips[places[0]].sizes, Lever):
            continue
        one = tips[places[0]]
        angles = np.zeros((41, len(tips)))
        angles[:, places] = np.linspace(low, high, 41)[:, np.newaxis] / len(places)
        frames = kinematics.frames(full, angles)
        stem = frames.bodies["stem"].position
        ends = k.MM * (frames.bodies[name].position - stem)
        flat = np.zeros((1, len(tips)))
        straight = kinematics.frames(full, flat).bodies
        begin = k.MM * (straight[one.end.near].position - straight["stem"].position)[0, 2] + one.end.start
        middle = len(places) * one.sizes.length / 2 if isinstance(one.sizes, Backbone) else 0.0
        pivots.append(float(begin + middle))
        bent.append(np.hypot(np.hypot(ends[:, 0], ends[:, 1]), ends[:, 2] - pivots[-1]))
    distances = np.concatenate(bent)
    half = bearing.stem_radius
    for one in tips:
        joint = one.sizes
        across = abs(math.cos(math.radians(one.end.turn - turn))) > 0.5
        if isinstance(joint, GearJoint):
            half = max(half, joint.pin_length / 2 if across else joint.width)
        elif isinstance(joint, PulleyJoint):
            half = max(half, joint.pin_length / 2)
        elif isinstance(joint, Lever):
            half = max(half, joint.outer + joint.pulley.pin if across else joint.length)
    cable = full.conditions.cable_pulley_radius or _CABLE_RADIUS
    return Rig(
        pivots[0], k.MM * cable, float(distances.min()), float(distances.max()), half + 3.0, turn, tuple(pivots[1:])
    )
