"""An instrument as a URDF robot description."""

import math
from collections.abc import Mapping, Sequence
from xml.etree.ElementTree import Comment, Element, SubElement, indent, tostring

from tenodesis.instrument import InstrumentLike
from tenodesis.kinematics.chain import Skeleton, skeleton
from tenodesis.kinematics.parts import STEEL, PartJoint, RigidPart, parts, text

_KINDS = {"hinge": "revolute", "slide": "prismatic"}
# A link without mass does not load in MuJoCo and makes the mass matrix of others singular.
_LEAST_MASS, _LEAST_INERTIA = 1e-6, 1e-9
# URDF requires an effort and a velocity at every limited joint; the instrument file has neither.
_EFFORT, _VELOCITY = "1000", "100"

NOTE = """Written by tenodesis. Units: m, rad, kg. {origin}
What this format does not contain:
- tendons: nothing ties the tip to the handle, nor a joint to others that its tendons cross, and nothing is elastic; set
  both handle and tip. What the tip of a planar instrument does without a load, 2 asin(R/r sin(handle angle / 2)) for
  gears, no mimic can express, since it is not linear;
- springs in the joints;
- rolling contact: a gear pair is two revolute joints, half its angle each, the second a mimic of the first, which tools
  may ignore;
- friction, drives, sensors, the controller, and limits by loads: joint limits are mechanical stops, or working ranges
  where none are given;
- contact: jaws are two joints of their own, and grip no object;
- efforts and velocities: their values are there only because the format needs them;
- masses: parts are drawn, and weighed, as solid steel; where the file has dynamics.tip_inertia, the parts that turn
  with the tip weigh what gives that inertia; links between a part's joints weigh 1 mg.{more}"""
_CONTINUUM = """
- the arc of a backbone: it is its chord between two revolute joints; how much the chord shortens, the joint named
  chord, no mimic can express."""


def urdf(inst: InstrumentLike) -> str:
    """Return an instrument as the text of a URDF file: links as the bodies of :func:`frames`, on the port.

    Without a port in the file the base is the stem's tip end. Positions of its joints are those of
    :func:`joint_positions`. What the format does not contain stands in its first lines. Raises InstrumentError if the
    instrument's lengths leave no stem.
    """
    of = skeleton(inst)
    tree = parts(inst, "urdf")
    density = _densities(of, tree)
    note = NOTE.format(
        origin=origin_of(of), more=_CONTINUUM if any(joint.mechanism == "continuum" for joint in of.inst.joints) else ""
    )
    base = "base" if of.port is None else "port"
    root = Element("robot", name=of.inst.name.replace(" ", "_"))
    root.append(Comment(f"\n{note}\n"))
    SubElement(root, "link", name=base)
    for part in tree:
        parent = part.parent or base
        # A link has one joint, so that those of one part stand on links of their own.
        for place, joint in enumerate(part.joints):
            last = place + 1 == len(part.joints)
            child = part.name if last else f"{joint.name}_link"
            if not last:
                _inertial(SubElement(root, "link", name=child), 0.0, _LEAST_MASS, _LEAST_INERTIA, _LEAST_INERTIA)
            _joint(root, joint, parent, child, part.offset if place == 0 else 0.0)
            parent = child
        if not part.joints:
            fixed = SubElement(root, "joint", name=f"{part.name}_fixed", type="fixed")
            _between(fixed, parent, part.name, part.offset)
        _link(root, part, density[part.name])
    indent(root)
    return '<?xml version="1.0"?>\n' + tostring(root, encoding="unicode") + "\n"


def origin_of(of: Skeleton) -> str:
    """Return where the origin of a model is, as a sentence."""
    if of.port is None:
        return "The stem's tip end is the origin; z points along it to the tip."
    return "The port is the origin; z points into the patient."


def _joint(root: Element, joint: PartJoint, parent: str, child: str, offset: float) -> None:
    element = SubElement(root, "joint", name=joint.name, type=_KINDS[joint.kind])
    _between(element, parent, child, offset)
    SubElement(element, "axis", xyz=" ".join(text(one) for one in joint.axis))
    SubElement(element, "limit", lower=text(joint.least), upper=text(joint.most), effort=_EFFORT, velocity=_VELOCITY)
    if joint.same_as is not None:
        SubElement(element, "mimic", joint=joint.same_as, multiplier=f"{joint.ratio:g}", offset="0")


def _between(joint: Element, parent: str, child: str, offset: float) -> None:
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    SubElement(joint, "origin", xyz=f"0 0 {text(offset)}", rpy="0 0 0")


def _link(root: Element, part: RigidPart, density: float) -> None:
    link = SubElement(root, "link", name=part.name)
    if part.cylinder is None:
        _inertial(link, 0.0, _LEAST_MASS, _LEAST_INERTIA, _LEAST_INERTIA)
        return
    start, end, radius = part.cylinder
    _inertial(link, (start + end) / 2, *_mass(part, density))
    visual = SubElement(link, "visual")
    SubElement(visual, "origin", xyz=f"0 0 {text((start + end) / 2)}", rpy="0 0 0")
    SubElement(SubElement(visual, "geometry"), "cylinder", radius=text(radius), length=text(end - start))


def _inertial(link: Element, along: float, mass: float, across: float, about: float) -> None:
    element = SubElement(link, "inertial")
    SubElement(element, "origin", xyz=f"0 0 {text(along)}", rpy="0 0 0")
    SubElement(element, "mass", value=text(mass))
    moments = {"ixx": across, "iyy": across, "izz": about, "ixy": 0.0, "ixz": 0.0, "iyz": 0.0}
    SubElement(element, "inertia", {key: text(value) for key, value in moments.items()})


def _mass(part: RigidPart, density: float) -> tuple[float, float, float]:
    """Return mass, kg, and inertia across and along its axis, kg·m², of a part that has a cylinder."""
    assert part.cylinder is not None
    start, end, radius = part.cylinder
    length = end - start
    mass = density * math.pi * radius**2 * length
    return mass, mass * (3 * radius**2 + length**2) / 12, mass * radius**2 / 2


def _densities(of: Skeleton, tree: Sequence[RigidPart]) -> Mapping[str, float]:
    """Return the density of each part, kg/m³: steel, or what gives the tip the inertia that the file has."""
    named = {part.name: part for part in tree}
    found = dict.fromkeys(named, STEEL)
    wanted = getattr(of.given.dynamics, "tip_inertia", None)
    if wanted is None:
        return found
    last = of.inst.tip_joints[-1]
    carrier, far = named.get(f"{last.name}_carrier"), named[f"{last.name}_far"]
    turning = [far, *(named[of.end(last, kind)] for kind in ("end_effector", "tip"))]
    # A carrier turns by half the angle, and takes the far part along, as if that turned about its middle.
    steel = 0.0 if carrier is None else _inertia(carrier, 0.0) / 4
    place = 0.0 if carrier is None else far.offset / 2
    for part in turning:
        place += 0.0 if part is far else part.offset
        steel += _inertia(part, place)
    for part in (*turning, *(() if carrier is None else (carrier,))):
        found[part.name] = STEEL * wanted / steel
    return found


def _inertia(part: RigidPart, place: float) -> float:
    """Return the inertia of a part of steel, kg·m², about an axis across it, where its frame is at a place, m."""
    if part.cylinder is None:
        return 0.0
    mass, across, _ = _mass(part, STEEL)
    return across + mass * (place + (part.cylinder[0] + part.cylinder[1]) / 2) ** 2
