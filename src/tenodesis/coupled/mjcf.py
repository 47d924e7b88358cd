"""A coupled instrument as a MuJoCo model (MJCF): its tendons are strings along their routes, wound by motors."""

from collections.abc import Iterator, Mapping
from itertools import pairwise
from math import pi
from typing import NamedTuple
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from numpy.typing import ArrayLike

from tenodesis.coupled.description import CoupledInstrument, Crossing, Joint, Tendon
from tenodesis.coupled.motion import STEM, Array, bend_side, crossed, crossing_offset
from tenodesis.coupled.parts import moving, parts
from tenodesis.coupled.reading import CoupledLike, load
from tenodesis.coupled.statics import straight_arms
from tenodesis.kinematics.mjcf import RATE, body, model, written
from tenodesis.kinematics.parts import Part, text

_LAG = 0.01  # s: all motions decay at this rate, since every spring has its damper
_HOLD = 1e6  # stiffness of the hand, over that of the tendons about its joint
_STRONGEST = 1e6  # N, beyond any tension
_WRENCH = ("force_x", "force_y", "force_z", "moment_x", "moment_y", "moment_z")

NOTE = """Written by tenodesis. Units: m, rad, kg, N. The stem's tip end is the origin; z points along it to the tip.
Controls: the angle of each handle joint's first hinge (rad), the same as of its others; the length that each tendon's
motor winds (m), without effect where it has none; force and moment at each end, in its axes (N, N m).
What this format does not contain:
- friction of the tendons on pulleys and in sheaths, with the bends that cause it; drives, sensors and the controller;
- rolling contact: a gear pair is two hinges, half its angle each, tied by an equality constraint, which is soft; so is
  a pulley that turns by more than 80 deg, since a string leaves a cylinder where it is bent by a right angle;
- where tendons run between joints: one that passes a joint which its route does not name has a gap there;
- masses and inertias: parts are drawn, and weigh, as solid steel, and joints have the inertia and damping that suit
  the time step, so that the model settles where the instrument does but not as fast;
- contact: jaws pass through each other and grip no object;
- limits by tendons and loads: working ranges are mechanical stops.{more}"""
_CONTINUUM = """
- the arc of a backbone: it is a row of eight hinges tied to each other, which does not yield in other directions."""


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


def mjcf(inst: CoupledLike) -> str:
    """Return an instrument as the text of a MuJoCo model: bodies, tendons as strings, held handle, motors.

    Positions of its joints are those of :func:`joint_positions`; all are zero while the instrument is straight. What
    the format does not contain stands in its first lines.
    """
    inst = load(inst)
    is_continuum = any(joint.mechanism == "continuum" for joint in inst.joints)
    root = model(inst.name, NOTE.format(more=_CONTINUUM if is_continuum else ""))
    world = SubElement(root, "worldbody")
    strings, ties, servos = (SubElement(root, name) for name in ("tendon", "equality", "actuator"))
    tree = {part.name: part for part in parts(inst, "mjcf")}
    stiffness = _joint_stiffnesses(inst)
    motion = _motion(inst, stiffness)
    bodies: dict[str | None, Element] = {None: world}
    for part in tree.values():
        bodies[part.name] = body(bodies[part.parent], part, motion)
        for hinge in part.joints:
            if hinge.same_as is not None:
                SubElement(ties, "joint", joint1=hinge.name, joint2=hinge.same_as)
    for joint in inst.handle_joints:
        held = moving(joint, "mjcf")
        gain = text(_HOLD * len(held) * stiffness[joint.name])
        SubElement(servos, "position", name=joint.name, joint=held[0], kp=gain)
    for tendon, own, pretension in zip(inst.tendons, inst.stiffnesses, inst.pretensions, strict=True):
        string = SubElement(strings, "spatial", name=tendon.name, damping=text(_LAG * own))
        branches = _branches(inst, tendon, tree)
        for place, branch in enumerate(branches):
            if place:
                SubElement(string, "pulley", divisor="1")
            for guide in branch:
                _lead(string, bodies[guide.body], guide)
        at_rest = own * sum(map(_length, branches)) - pretension
        # A motor in series with the tendon. Its force shortens, so that it is negative: it pulls, and never pushes.
        motor = SubElement(servos, "general", name=tendon.name, tendon=tendon.name, biastype="affine")
        motor.set("gainprm", text(-own if tendon.start == "spool" else 0.0))
        motor.set("biasprm", f"{text(at_rest)} {text(-own)} 0")
        motor.set("forcerange", f"{text(-_STRONGEST)} 0")
    for end in inst.bearing:
        name = inst.tip_joints[end].name
        for row, kind in zip(np.eye(6), _WRENCH, strict=True):
            SubElement(servos, "motor", name=f"{name}_{kind}", site=f"{name}_tip_origin", gear=_vector(row))
    return written(root)


def _motion(inst: CoupledInstrument, stiffness: Mapping[str, float]) -> dict[str, dict[str, str]]:
    """Return stiffness, damping and inertia of every hinge, as attributes, by its name."""
    found: dict[str, dict[str, str]] = {}
    for joint in inst.joints:
        names, at_tip = moving(joint, "mjcf"), joint.place == "tip"
        about = stiffness[joint.name] * (1.0 if at_tip else _HOLD)
        values = {"armature": about / RATE**2, "damping": _LAG * (joint.own_stiffness if at_tip else about)}
        if at_tip:
            values["stiffness"] = joint.own_stiffness
        found |= {name: {key: text(len(names) * value) for key, value in values.items()} for name in names}
    return found


def _joint_stiffnesses(inst: CoupledInstrument) -> dict[str, float]:
    """Return about how stiff each straight joint is by its tendons and its own spring, N m/rad."""
    arms = np.hstack([straight_arms(inst, "handle"), straight_arms(inst, "tip")])
    joints = (*inst.handle_joints, *inst.tip_joints)
    by_tendons = inst.stiffnesses @ arms**2
    return {joint.name: float(by) + joint.own_stiffness for joint, by in zip(joints, by_tendons, strict=True)}


def _branches(inst: CoupledInstrument, tendon: Tendon, tree: Mapping[str, Part]) -> list[list[_Guide]]:
    """Return what leads a tendon from the handle's end to the tip; a new list behind joints that it does not cross.

    There it runs at a constant length.
    """
    passed = crossed(inst, tendon)
    found: list[list[_Guide]] = [[]]
    if passed[0][0].place == "tip" and tree[moving(passed[0][0], "mjcf")[0]].parent == "stem":
        start = crossing_offset(*passed[0]) - _along(inst.stem_length or STEM)
        found[0].append(_Guide("stem", f"{tendon.name}_start", start, start))
    for joint, crossing in passed:
        guides = list(_guides(joint, crossing, tendon, tree))
        if joint.place == "handle":
            guides.reverse()
        if found[-1] and found[-1][-1].body != guides[0].body:
            found.append([])
        found[-1] += guides
    return found


def _guides(joint: Joint, crossing: Crossing, tendon: Tendon, tree: Mapping[str, Part]) -> Iterator[_Guide]:
    """Yield what leads a tendon over a joint, outward."""
    out = crossing_offset(joint, crossing)
    chain = [tree[name] for name in moving(joint, "mjcf")]

    def guide(body: str, name: str, local: Array, cylinder: _Cylinder | None = None) -> _Guide:
        return _Guide(body, f"{tendon.name}_{name}", local, local + _along(_height(tree, body)), cylinder)

    if joint.mechanism == "tendon-gear":
        yield guide(str(chain[0].parent), f"{joint.name}_near", out + _along(chain[0].offset))
        yield guide(chain[-1].name, chain[-1].name, out)
        return
    radius, axis = float(np.linalg.norm(out)), np.array(joint.axis_vector)
    ahead = radius * np.cross(bend_side(joint.axis_vector), axis) * (1 if joint.place == "tip" else -1)
    for part in chain:
        near, centre = str(part.parent), _along(part.offset)
        # It comes along the link, wraps by a quarter turn, and leaves across the next one.
        yield guide(near, f"{part.name}_in", centre + out - ahead)
        if radius:
            cylinder = _Cylinder(radius, axis, centre + 3 * (out + ahead), joint.mechanism == "continuum")
            yield guide(near, part.name, centre, cylinder)
        yield guide(part.name, f"{part.name}_out", ahead - out)


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


def _height(tree: Mapping[str, Part], name: str) -> float:
    """Return the place of a part along the straight instrument, m."""
    part = tree[name]
    return part.offset + (0.0 if part.parent is None else _height(tree, part.parent))


def _along(height: float) -> Array:
    return np.array([0.0, 0.0, height])


def _vector(values: ArrayLike) -> str:
    return " ".join(text(value) for value in np.asarray(values, float))
