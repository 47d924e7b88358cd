"""An instrument as a MuJoCo model (MJCF): its tendons are strings along their routes, wound by motors."""

from collections.abc import Iterator, Mapping
from itertools import pairwise
from math import pi
from typing import NamedTuple
from xml.etree.ElementTree import Comment, Element, SubElement, indent, tostring

import numpy as np
from numpy.typing import ArrayLike

from tenodesis.instrument import InstrumentLike, Joint, Tendon
from tenodesis.kinematics.chain import Array, Skeleton, bend_side, crossed, skeleton
from tenodesis.kinematics.parts import STEEL, RigidPart, joint_positions, moving, parts, text
from tenodesis.kinematics.urdf import origin_of

TIME_STEP = 1e-3  # s
# MuJoCo's softest tie that keeps the halves of a joint together to about 1e-6 rad at this time step.
_TIE = {"solref": f"{2 * TIME_STEP} 1", "solimp": "0.9999 0.9999 0.001 0.5 2"}
_LEAST_MASS, _LEAST_INERTIA = "1e-6", "1e-9 1e-9 1e-9"
# Inertia has no part in where the tip settles, so that it is chosen to suit the time step: every joint then moves at
# this rate (rad/s).
_RATE = 200.0
_LAG = 0.01  # s: all motions decay at this rate, since every spring has its damper
_HOLD = 1e6  # stiffness of the hand, over that of the tendons about its joint
_HOLD_PORT = 1e4  # of the port's joints and the roll, over that of the stiffest joint
_HOLD_LENGTH = 2e4  # N/m, of the insertion
_STRONGEST = 1e6  # N, beyond any tension
_WRENCH = ("force_x", "force_y", "force_z", "moment_x", "moment_y", "moment_z")

NOTE = """Written by tenodesis. Units: m, rad, kg, N. {origin}
Controls: the angle of each handle joint's first hinge (rad), the same as of its others; the port's joints and the roll,
where there are any; the length that each tendon's motor winds (m), without effect where it has none; force and moment
at each end, in its axes (N, N m).
What this format does not contain:
- rolling contact: a gear pair is two hinges, half its angle each, tied by an equality constraint, which is soft: set
  both, or let it settle; so is a pulley that turns by more than 80 deg, since a string leaves a cylinder where it is
  bent by a right angle;
- friction of the tendons on pulleys and in sheaths, with the bends that cause it; drives, sensors and the controller;
- where tendons run between joints: one that passes a joint which its route does not name has a gap there;
- masses and inertias: parts are drawn, and weigh, as solid steel, and joints have the inertia and damping that suit
  the time step, so that the model settles where the instrument does but not as fast;
- stiffness of tendons that grows with tension, of which that at rest is taken, and tendons' own damping;
- contact: jaws pass through each other and grip no object;
- limits by tendons and loads: joint ranges are mechanical stops, or working ranges where none are given.{more}"""
_CONTINUUM = """
- the arc of a backbone: it is a row of hinges, eight tied to each other, or six in each of several arcs, not tied; it
  does not yield in directions in which the file does not let it bend or twist."""


class _Guide(NamedTuple):
    """A site that leads a string, or a cylinder that it wraps around."""

    body: str
    name: str
    local: Array
    at: Array
    """Of the straight instrument, from the stem's tip end, m."""
    cylinder: "_Cylinder | None" = None


class _Cylinder(NamedTuple):
    """Radius (m), axis, and a place on the side on which the string is, all in the body's frame."""

    radius: float
    axis: Array
    side: Array
    hidden: bool


def mjcf(inst: InstrumentLike) -> str:
    """Return an instrument as the text of a MuJoCo model: bodies as in :func:`frames`, tendons as strings, motors.

    Handle and port are held. Positions of its joints are those of :func:`joint_positions`; behind a port, the keyframe
    "rest" is the straight instrument. What the format does not contain stands in its first lines. Raises
    InstrumentError if the instrument's lengths leave no stem.
    """
    of = skeleton(inst)
    is_continuum = any(joint.mechanism == "continuum" for joint in of.inst.joints)
    root = _model(of.inst.name, NOTE.format(origin=origin_of(of), more=_CONTINUUM if is_continuum else ""))
    world = SubElement(root, "worldbody")
    strings, ties, servos = (SubElement(root, name) for name in ("tendon", "equality", "actuator"))
    tree = {part.name: part for part in parts(inst, "mjcf")}
    if of.port is not None:
        SubElement(world, "site", name="port", size=text((tree["stem"].cylinder or (0.0,) * 3)[2] * 2))
    stiffness = _joint_stiffnesses(of)
    held = _held(of, tree, max(stiffness.values()))
    motion = _motion(of, stiffness) | {
        name: {"armature": text(gain / _RATE**2), "damping": text(_LAG * gain)} for name, gain in held.items()
    }
    bodies: dict[str | None, Element] = {None: world}
    for part in tree.values():
        bodies[part.name] = _body(bodies[part.parent], part, motion)
        for hinge in part.joints:
            if hinge.same_as is not None:
                ratio = {} if hinge.ratio == 1 else {"polycoef": f"0 {text(hinge.ratio)} 0 0 0"}
                SubElement(ties, "joint", joint1=hinge.name, joint2=hinge.same_as, attrib=ratio)
    _hold(servos, of, stiffness)
    for tendon, own, pretension in zip(of.inst.tendons, of.inst.stiffnesses, of.inst.pretensions, strict=True):
        branches = _branches(of, tendon, tree)
        _string(strings, bodies, tendon, own, branches)
        _motor(servos, tendon, own, own * sum(map(_length, branches)) - pretension)
    for end in of.inst.bearing:
        _load(servos, of.end(of.inst.tip_joints[end], "tip"))
    for name, gain in held.items():
        SubElement(servos, "position", name=name, joint=name, kp=text(gain))
    if held:
        rest = joint_positions(inst, 0.0, format="mjcf")
        key = SubElement(SubElement(root, "keyframe"), "key", name="rest")
        key.set("qpos", _vector([rest[joint.name] for part in tree.values() for joint in part.joints]))
        key.set("ctrl", _vector([rest.get(servo.get("name", ""), 0.0) for servo in servos]))
    indent(root)
    return tostring(root, encoding="unicode") + "\n"


def _model(name: str, note: str) -> Element:
    """Return a model without bodies, in radians, whose first lines are a note; ties and strings have its defaults."""
    root = Element("mujoco", model=name)
    root.append(Comment(f"\n{note}\n"))
    SubElement(root, "compiler", angle="radian", autolimits="true")
    # MuJoCo's tolerance is relative to the mean inertia, which is that of what is held.
    option = {"integrator": "implicitfast", "gravity": "0 0 0", "tolerance": "1e-12"}
    SubElement(root, "option", option, timestep=f"{TIME_STEP}")
    default = SubElement(root, "default")
    SubElement(default, "geom", contype="0", conaffinity="0", density=text(STEEL), rgba="0.7 0.73 0.76 1")
    SubElement(default, "equality", _TIE)
    SubElement(default, "tendon", width="2e-4", rgba="0.7 0.14 0.18 1")
    SubElement(default, "site", size="2e-4", group="3")
    return root


def _body(parent: Element, part: RigidPart, motion: Mapping[str, Mapping[str, str]]) -> Element:
    """Add a part to the one that it stands on, with attributes of how each of its joints moves."""
    element = SubElement(parent, "body", name=part.name)
    if part.offset:
        element.set("pos", f"0 0 {text(part.offset)}")
    for joint in part.joints:
        SubElement(
            element,
            "joint",
            name=joint.name,
            type=joint.kind,
            axis=_vector(joint.axis),
            range=_vector([joint.least, joint.most]),
            attrib=dict(motion[joint.name]),
        )
    if part.cylinder is None:
        SubElement(element, "inertial", pos="0 0 0", mass=_LEAST_MASS, diaginertia=_LEAST_INERTIA)
    else:
        start, end, radius = (text(value) for value in part.cylinder)
        SubElement(element, "geom", type="cylinder", fromto=f"0 0 {start} 0 0 {end}", size=radius)
    SubElement(element, "site", name=f"{part.name}_origin")
    return element


def _hold(servos: Element, of: Skeleton, stiffness: Mapping[str, float]) -> None:
    """Add what holds the joints of the handle."""
    for joint in of.inst.handle_joints:
        halves = moving(of, joint, "mjcf")
        gain = text(_HOLD * len(halves) * stiffness[joint.name])
        SubElement(servos, "position", name=joint.name, joint=halves[0], kp=gain)


def _motor(servos: Element, tendon: Tendon, stiffness: float, at_rest: float) -> None:
    """Add a motor in series with a tendon."""
    motor = SubElement(servos, "general", name=tendon.name, tendon=tendon.name, biastype="affine")
    motor.set("gainprm", text(-stiffness if tendon.start == "spool" else 0.0))
    motor.set("biasprm", f"{text(at_rest)} {text(-stiffness)} 0")
    # Its force shortens, so that it is negative: it pulls, and never pushes.
    motor.set("forcerange", f"{text(-_STRONGEST)} 0")


def _load(servos: Element, end: str) -> None:
    """Add the wrench at an end."""
    for row, kind in zip(np.eye(6), _WRENCH, strict=True):
        name = f"{end.removesuffix('_tip')}_{kind}"
        SubElement(servos, "motor", name=name, site=f"{end}_origin", gear=_vector(row))


def _held(of: Skeleton, tree: Mapping[str, RigidPart], stiffest: float) -> dict[str, float]:
    """Return the stiffness, N m/rad or N/m, that holds each joint that no tendon crosses: the port's and the roll."""
    bending = {name for joint in of.inst.joints for name in moving(of, joint, "mjcf")}
    free = [joint for part in tree.values() for joint in part.joints if joint.name not in bending]
    return {joint.name: _HOLD_LENGTH if joint.kind == "slide" else _HOLD_PORT * stiffest for joint in free}


def _motion(of: Skeleton, stiffness: Mapping[str, float]) -> dict[str, dict[str, str]]:
    """Return stiffness, damping and inertia of every bending joint's hinges, as attributes, by its name."""
    found: dict[str, dict[str, str]] = {}
    for joint in of.inst.joints:
        names, at_tip = moving(of, joint, "mjcf"), joint.place == "tip"
        about = stiffness[joint.name] * (1.0 if at_tip else _HOLD)
        values = {"armature": about / _RATE**2, "damping": _LAG * (joint.own_stiffness if at_tip else about)}
        if at_tip:
            values["stiffness"] = joint.own_stiffness
        own = {key: text(len(names) * value) for key, value in values.items()}
        if joint.cubic_stiffness:
            # The sum of the parts' moments at their shares of the angle.
            own["stiffness"] += f" 0 {text(len(names) ** 3 * joint.cubic_stiffness)}"
        found |= dict.fromkeys(names, own)
    return found


def _joint_stiffnesses(of: Skeleton) -> dict[str, float]:
    """Return about how stiff each straight joint is by its tendons and its own spring, N m/rad."""
    found = {joint.name: joint.own_stiffness for joint in of.inst.joints}
    for tendon, own in zip(of.inst.tendons, of.inst.stiffnesses, strict=True):
        for joint, offset in crossed(of.inst, tendon):
            found[joint.name] += float(own * (offset @ bend_side(joint.axis_vector)) ** 2)
    return found


def _branches(of: Skeleton, tendon: Tendon, tree: Mapping[str, RigidPart]) -> list[list[_Guide]]:
    """Return what leads a tendon from the handle's end to the tip; a new list behind joints that it does not cross.

    There it runs at a constant length.
    """
    passed = crossed(of.inst, tendon)
    found: list[list[_Guide]] = [[]]
    if passed[0][0].place == "tip" and tree[moving(of, passed[0][0], "mjcf")[0]].parent == "stem":
        start = passed[0][1] - _along(of.stem_length)
        found[0].append(_Guide("stem", f"{tendon.name}_start", start, start))
    for joint, offset in passed:
        radii = [one.radius or joint.radius for one in tendon.route if one.joint == joint.name]
        for time, radius in enumerate(radii):
            name = f"{tendon.name}_again_{time}" if time else tendon.name
            steps = list(_guides(of, joint, offset * radius / radii[-1], name, tree))
            if joint.place == "handle":
                steps = [step[::-1] for step in reversed(steps)]
            for step in steps:
                # Where it runs back over a pulley, another part of it does.
                if time or (found[-1] and found[-1][-1].body != step[0].body):
                    found.append([])
                found[-1] += step
    return found


def _guides(
    of: Skeleton, joint: Joint, out: Array, tendon: str, tree: Mapping[str, RigidPart]
) -> Iterator[list[_Guide]]:
    """Yield what leads a tendon over each part of a joint at an offset from its middle, outward."""
    chain = [tree[name] for name in moving(of, joint, "mjcf")]

    def guide(body: str, name: str, local: Array, cylinder: _Cylinder | None = None) -> _Guide:
        return _Guide(body, f"{tendon}_{name}", local, local + _along(_height(tree, body)), cylinder)

    if joint.mechanism == "tendon-gear":
        first = guide(str(chain[0].parent), f"{joint.name}_near", out + _along(chain[0].offset))
        yield [first, guide(chain[-1].name, chain[-1].name, out)]
        return
    side, axis = bend_side(joint.axis_vector), np.array(joint.axis_vector)
    across = (out @ side) * side
    radius = float(np.linalg.norm(across))
    ahead = radius * np.cross(side, axis) * (1 if joint.place == "tip" else -1)
    for part in chain:
        near, centre = str(part.parent), _along(part.offset)
        # It comes along the link, wraps by a quarter turn, and leaves across the next one.
        step = [guide(near, f"{part.name}_in", centre + out - ahead)]
        if radius:
            cylinder = _Cylinder(radius, axis, centre + 3 * (across + ahead), joint.mechanism == "continuum")
            step.append(guide(near, part.name, centre, cylinder))
        yield [*step, guide(part.name, f"{part.name}_out", ahead + out - 2 * across)]


def _length(guides: list[_Guide]) -> float:
    """Return the length of a string along its guides at rest, m."""
    total = 0.0
    for guide, following in pairwise(guides):
        if guide.cylinder is not None:
            # Straight to it and on from it by a radius each, and a quarter turn between.
            total += (2 + pi / 2) * guide.cylinder.radius
        elif following.cylinder is None:
            total += float(np.linalg.norm(following.at - guide.at))
    return total


def _string(
    strings: Element,
    bodies: Mapping[str | None, Element],
    tendon: Tendon,
    stiffness: float,
    branches: list[list[_Guide]],
) -> None:
    """Add a tendon along what leads it."""
    string = SubElement(strings, "spatial", name=tendon.name, damping=text(_LAG * stiffness))
    for place, branch in enumerate(branches):
        if place:
            SubElement(string, "pulley", divisor="1")
        for guide in branch:
            _lead(string, bodies[guide.body], guide)


def _lead(string: Element, body: Element, guide: _Guide) -> None:
    """Add a guide to its body, and lead a string over it."""
    if guide.cylinder is None:
        SubElement(body, "site", name=guide.name, pos=_vector(guide.local))
        SubElement(string, "site", site=guide.name)
        return
    radius, axis, side, hidden = guide.cylinder
    geom = SubElement(body, "geom", name=guide.name, type="cylinder", mass="0", pos=_vector(guide.local))
    geom.set("zaxis", _vector(axis))
    geom.set("size", f"{text(radius)} {text(radius / 4)}")
    geom.set("group", "3" if hidden else "0")
    SubElement(body, "site", name=f"{guide.name}_side", pos=_vector(side))
    SubElement(string, "geom", geom=guide.name, sidesite=f"{guide.name}_side")


def _height(tree: Mapping[str, RigidPart], name: str) -> float:
    """Return the place of a part along the straight instrument, from the stem's tip end, m."""
    part = tree[name]
    return 0.0 if part.parent is None else part.offset + _height(tree, part.parent)


def _along(height: float) -> Array:
    return np.array([0.0, 0.0, height])


def _vector(values: ArrayLike) -> str:
    return " ".join(text(value) for value in np.asarray(values, float))
