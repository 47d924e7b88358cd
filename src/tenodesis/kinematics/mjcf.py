"""An instrument as a MuJoCo model (MJCF)."""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple
from xml.etree.ElementTree import Comment, Element, SubElement, indent, tostring

from tenodesis.instrument import InstrumentLike, ShortForm, as_short_form
from tenodesis.instrument.lengths import Dimensions
from tenodesis.kinematics.dimensions import dimensions
from tenodesis.kinematics.motion import Posture, frames
from tenodesis.kinematics.parts import STEEL, TOWARD, Joint, Part, joint_positions, parts, text

TIME_STEP = 1e-3  # s
# MuJoCo's softest tie that keeps the halves of a joint together to about 1e-6 rad at this time step.
_TIE = {"solref": f"{2 * TIME_STEP} 1", "solimp": "0.9999 0.9999 0.001 0.5 2"}
_LEAST_MASS, _LEAST_INERTIA = "1e-6", "1e-9 1e-9 1e-9"
_SIDES = {"agonist": 1.0, "antagonist": -1.0}
# Inertia has no part in where the tip settles, so that it is chosen to suit the time step: every joint then moves at
# this rate (rad/s), overdamped.
RATE, _DAMPING_RATIO = 200.0, 1.2
_HOLD_LENGTH = 2e4  # N/m, of the servo that holds the insertion
HOLD = 100.0  # stiffness of what the hand holds, over that of the handle's tendons
_FAR = 100.0  # m, beyond any length that is drawn

NOTE = """Written by tenodesis. Units: m, rad, kg, N. The port is the origin; z points into the patient.
What this format does not contain:
- rolling contact: a gear pair is two hinges, half its angle each, tied by an equality constraint, which is soft: set
  both, or let it settle;
- friction of the tendons, sheaths, spools, drives, sensors and the controller;
- masses and inertias: parts are drawn, and weigh, as solid steel, and joints have the inertia and damping that suit
  the time step, so that the model settles where the instrument does but not as fast;{more}
- limits of the tip by tendons and loads: joint ranges are mechanical stops."""
_BY_WHAT_THEY_DRAW = """
- the path of the tendons: they are coupled to the joints by their excursions, and are not visible;"""
_CONTINUUM = """
- the arc of a backbone: it is its chord between two hinges, shortened by a polynomial (within 1e-4 of its length up to
  a quarter turn), without the backbone's own stiffness in other directions;"""


def mjcf(inst: InstrumentLike) -> str:
    """Return an instrument as the text of a MuJoCo model: bodies as in :func:`frames`, tendons as strings, held joints.

    Positions of its joints are those of :func:`joint_positions`; the keyframe "rest" is the straight instrument. Raises
    InstrumentError if the instrument's lengths leave no stem.
    """
    inst = as_short_form(inst)
    lengths, tree = dimensions(inst), parts(inst)
    more = "" if inst.joint_type == "tendon-gear" else _BY_WHAT_THEY_DRAW
    more += _CONTINUUM if inst.joint_type == "continuum" else ""
    root = model(inst.name, NOTE.format(more=more))
    world = SubElement(root, "worldbody")
    SubElement(world, "site", name="port", size=text(lengths.stem_diameter))
    bodies: dict[str | None, Element] = {None: world}
    for part in tree:
        bodies[part.name] = body(
            bodies[part.parent], part, {joint.name: overdamped(_stiffness(inst, joint)) for joint in part.joints}
        )
    tendons, ties, servos = (SubElement(root, name) for name in ("tendon", "equality", "actuator"))
    joints = [joint for part in tree for joint in part.joints]
    for joint in joints:
        _tie(ties, inst, joint)
    for axis in inst.axes:
        _strings(tendons, bodies, inst, lengths, axis)
    rest = joint_positions(inst, Posture())
    held = [joint for joint in joints if joint.same_as is None and joint.name in _held(inst)]
    for joint in held:
        gain = text(_stiffness(inst, joint))
        SubElement(servos, "position", name=joint.name, joint=joint.name, kp=gain)
    toward = TOWARD[inst.axes[0]]
    against = " ".join(f"{-component:g}" for component in toward)
    SubElement(servos, "motor", name="force", site="tip_force", gear=f"{against} 0 0 0")
    control = [rest[joint.name] for joint in held] + [0.0]
    key = SubElement(SubElement(root, "keyframe"), "key", name="rest")
    key.set("qpos", " ".join(text(rest[joint.name]) for joint in joints))
    key.set("ctrl", " ".join(text(value) for value in control))
    return written(root)


def model(name: str, note: str) -> Element:
    """Return a model without bodies, in radians, whose first lines are a note; ties and strings have its defaults."""
    root = Element("mujoco", model=name)
    root.append(Comment(f"\n{note}\n"))
    SubElement(root, "compiler", angle="radian", autolimits="true")
    SubElement(root, "option", timestep=f"{TIME_STEP}", integrator="implicitfast", gravity="0 0 0")
    default = SubElement(root, "default")
    SubElement(default, "geom", contype="0", conaffinity="0", density=text(STEEL), rgba="0.7 0.73 0.76 1")
    SubElement(default, "equality", _TIE)
    SubElement(default, "tendon", width="2e-4", rgba="0.7 0.14 0.18 1")
    SubElement(default, "site", size="2e-4", group="3")
    return root


def written(root: Element) -> str:
    """Return a model as text."""
    indent(root)
    return tostring(root, encoding="unicode") + "\n"


def overdamped(stiffness: float) -> dict[str, str]:
    """Return inertia and damping of a joint that is held by a stiffness (N·m/rad or N/m), as attributes."""
    return {"armature": text(stiffness / RATE**2), "damping": text(2 * _DAMPING_RATIO * stiffness / RATE)}


def _held(inst: ShortForm) -> set[str]:
    """Return the joints that hand and port hold; the bending joints of the tip hang on their tendons planar."""
    handles = {f"handle_{axis}_carrier" for axis in inst.axes}
    return {"pan", "tilt", "spin", "insertion", "roll", *handles}


def _stiffness(inst: ShortForm, joint: Joint) -> float:
    """Return the stiffness that holds a joint, N·m/rad or N/m: of the tendons at the tip, of a servo for the hand."""
    lengths = dimensions(inst)
    tendon = max(axis.tendon_stiffness for axis in inst.planar)
    # Two tendons at an arm of a radius, by either half of the angle, each of which counts twice.
    if joint.kind == "hinge" and joint.name.removesuffix("_carrier").removesuffix("_far") in inst.axes:
        return 8 * tendon * max(lengths.distal_radii) ** 2
    if joint.kind == "hinge":
        return HOLD * 8 * tendon * max(lengths.proximal_radii) ** 2
    return _HOLD_LENGTH


def body(parent: Element, part: Part, motion: Mapping[str, Mapping[str, str]]) -> Element:
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
            axis=" ".join(text(component) for component in joint.axis),
            range=f"{text(joint.least)} {text(joint.most)}",
            attrib=dict(motion[joint.name]),
        )
    if part.cylinder is None:
        SubElement(element, "inertial", pos="0 0 0", mass=_LEAST_MASS, diaginertia=_LEAST_INERTIA)
    else:
        start, end, radius = (text(value) for value in part.cylinder)
        SubElement(element, "geom", type="cylinder", fromto=f"0 0 {start} 0 0 {end}", size=radius)
    SubElement(element, "site", name=f"{part.name}_force" if part.name == "tip" else f"{part.name}_origin")
    return element


def _tie(ties: Element, inst: ShortForm, joint: Joint) -> None:
    if joint.same_as is not None:
        SubElement(ties, "joint", joint1=joint.name, joint2=joint.same_as)
    if joint.kind == "slide" and joint.name.endswith("_chord"):
        # L (sin h / h - 1) of the half angle h, to its fourth power.
        length = -joint.least
        half = joint.name.replace("_chord", "_carrier")
        coefficients = f"0 0 {text(-length / 6)} 0 {text(length / 120)}"
        SubElement(ties, "joint", joint1=joint.name, joint2=half, polycoef=coefficients)


class _End(NamedTuple):
    """Guides of a tendon at an end of the stem: prefix of their names, heights, m, and distance from the middle, m."""

    prefix: str
    stem: float
    spacing: float
    radius: float


def _strings(
    tendons: Element, bodies: dict[str | None, Element], inst: ShortForm, lengths: Dimensions, axis: str
) -> None:
    """Add both tendons of an axis: strings through the gears' guides; on pulleys and backbones, by their excursions."""
    place = lengths.axes.index(axis)
    planar = inst.planar[place]
    stretch = planar.pretension / planar.tendon_stiffness
    handle = _End("handle_", -lengths.stem_length, -lengths.handle_joint_spacing, lengths.proximal_radii[place])
    tip = _End("", 0.0, lengths.joint_spacing, lengths.distal_radii[place])
    paths = frames(inst, Posture()).tendons
    for side, sign in _SIDES.items():
        name = f"{axis}_{side}"
        # A range of rest lengths that starts far below makes a string: it pulls, and never pushes.
        if inst.joint_type == "tendon-gear":
            span = sum(math.dist(a, b) for a, b in pairwise(paths[name]))
            string = SubElement(tendons, "spatial", name=name, springlength=f"0 {text(span - stretch)}")
            passed = lengths.axes[: place + 1]
            guides = [_guides(bodies, end, passed, sign, axis) for end in (handle, tip)]
            for guide in (*reversed(guides[0]), *guides[1]):
                SubElement(string, "site", site=guide)
        else:
            string = SubElement(tendons, "fixed", name=name, springlength=f"{text(-_FAR)} {text(-stretch)}")
            for end, slope in ((handle, sign * handle.radius), (tip, -sign * tip.radius)):
                # Both halves of the angle draw the radius times themselves.
                for half in ("carrier", "far"):
                    SubElement(string, "joint", joint=f"{end.prefix}{axis}_{half}", coef=text(slope))
        string.set("stiffness", text(planar.tendon_stiffness))


def _guides(bodies: dict[str | None, Element], end: _End, passed: Sequence[str], sign: float, axis: str) -> list[str]:
    """Add the sites that guide a tendon past the gears of an end, and return their names from the stem outward."""
    x, y, _ = (sign * end.radius * component for component in TOWARD[axis])
    side = "agonist" if sign > 0 else "antagonist"
    names, on, height = [], "stem", end.stem
    for pair in passed:
        far = f"{end.prefix}{pair}_far"
        for gear, body, along in (("fixed", on, height), ("far", far, 0.0)):
            names.append(f"{axis}_{side}_{end.prefix}{pair}_{gear}")
            SubElement(bodies[body], "site", name=names[-1], pos=f"{text(x)} {text(y)} {text(along)}")
        on, height = far, end.spacing
    return names
