"""An instrument as a URDF robot description."""

import math
from xml.etree.ElementTree import Comment, Element, SubElement, indent, tostring

from tenodesis.instrument import InstrumentLike, as_instrument
from tenodesis.kinematics.parts import STEEL, Joint, Part, parts, text

_KINDS = {"hinge": "revolute", "slide": "prismatic"}
# URDF requires an effort and a velocity at every limited joint; the instrument file has neither.
_EFFORT, _VELOCITY = "1000", "100"

NOTE = """Written by tenodesis. Units: m, rad, kg. The port is the origin; z points into the patient.
What this format does not contain:
- tendons: nothing ties the tip to the handle; the output angle without a load is 2 asin(R/r sin(handle angle / 2))
  for gears, which no mimic can express, since it is not linear; set both handle and tip;
- rolling contact: a gear pair is two revolute joints, half its angle each, the second a mimic of the first, which tools
  may ignore;
- friction, drives, sensors, the controller, and limits by loads: joint limits are mechanical stops;
- efforts and velocities: their values are there only because the format needs them;
- masses: parts are drawn, and weighed, as solid steel.{more}"""
_CONTINUUM = """
- the arc of a backbone: it is its chord between two revolute joints; how much the chord shortens, the joint named
  chord, no mimic can express."""


def urdf(inst: InstrumentLike) -> str:
    """Return an instrument as the text of a URDF file: links as the bodies of :func:`frames`, the port its base.

    Positions of its joints are those of :func:`joint_positions`. Raises InstrumentError if the instrument's lengths
    leave no stem.
    """
    inst = as_instrument(inst)
    tree = parts(inst)
    root = Element("robot", name=inst.name.replace(" ", "_"))
    root.append(Comment(f"\n{NOTE.format(more=_CONTINUUM if inst.joint_type == 'continuum' else '')}\n"))
    SubElement(root, "link", name="port")
    for part in tree:
        parent = part.parent or "port"
        # A link has one joint, so that those of one part stand on links of their own.
        for place, joint in enumerate(part.joints):
            last = place + 1 == len(part.joints)
            child = part.name if last else f"{joint.name}_link"
            if not last:
                SubElement(root, "link", name=child)
            _joint(root, joint, parent, child, part.offset if place == 0 else 0.0)
            parent = child
        if not part.joints:
            fixed = SubElement(root, "joint", name=f"{part.name}_fixed", type="fixed")
            _between(fixed, parent, part.name, part.offset)
        _link(root, part)
    indent(root)
    return '<?xml version="1.0"?>\n' + tostring(root, encoding="unicode") + "\n"


def _joint(root: Element, joint: Joint, parent: str, child: str, offset: float) -> None:
    element = SubElement(root, "joint", name=joint.name, type=_KINDS[joint.kind])
    _between(element, parent, child, offset)
    SubElement(element, "axis", xyz=" ".join(text(one) for one in joint.axis))
    SubElement(element, "limit", lower=text(joint.least), upper=text(joint.most), effort=_EFFORT, velocity=_VELOCITY)
    if joint.same_as is not None:
        SubElement(element, "mimic", joint=joint.same_as, multiplier="1", offset="0")


def _between(joint: Element, parent: str, child: str, offset: float) -> None:
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    SubElement(joint, "origin", xyz=f"0 0 {text(offset)}", rpy="0 0 0")


def _link(root: Element, part: Part) -> None:
    link = SubElement(root, "link", name=part.name)
    if part.cylinder is None:
        return
    start, end, radius = part.cylinder
    length = end - start
    mass = STEEL * math.pi * radius**2 * length
    across, along = mass * (3 * radius**2 + length**2) / 12, mass * radius**2 / 2
    for kind in ("inertial", "visual"):
        element = SubElement(link, kind)
        SubElement(element, "origin", xyz=f"0 0 {text((start + end) / 2)}", rpy="0 0 0")
        if kind == "inertial":
            SubElement(element, "mass", value=text(mass))
            moments = {"ixx": across, "iyy": across, "izz": along, "ixy": 0.0, "ixz": 0.0, "iyz": 0.0}
            SubElement(element, "inertia", {key: text(value) for key, value in moments.items()})
        else:
            SubElement(SubElement(element, "geometry"), "cylinder", radius=text(radius), length=text(length))
