"""The solids that an instrument is drawn with: which body each belongs to, its mesh and its colour."""

from math import pi
from typing import NamedTuple

import numpy as np
import trimesh
from trimesh import Trimesh

from tenodesis.instrument import FullForm, Joint
from tenodesis.kinematics.chain import bend_side, skeleton
from tenodesis.kinematics.parts import moving, parts
from tenodesis.run import Array

METAL = (176, 184, 194)
STEEL = (120, 130, 144)
GRIP = (58, 70, 86)
GEAR = (196, 160, 90)

_TEETH = 16  # even, so that a gear looks the same from both ends of the stem
_AXIS_ALONG_Y = np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""Turns a mesh along z to lie along y: x becomes z, y becomes x."""


class Solid(NamedTuple):
    """A closed mesh, in m, at rest on a body of :class:`tenodesis.kinematics.Frames`, in that body's frame."""

    name: str
    body: str
    mesh: Trimesh
    colour: tuple[int, int, int]
    opacity: float | None = None


def solids(inst: FullForm) -> list[Solid]:
    """Return all solids of an instrument, on the bodies of :func:`tenodesis.kinematics.frames`."""
    of = skeleton(inst)
    tree = {part.name: part for part in parts(inst, "urdf")}
    found = []
    for part in tree.values():
        # Carriers are the links between gears, and chords of backbones, which are drawn as lines.
        if part.cylinder is None or part.name.endswith("_carrier"):
            continue
        start, end, radius = part.cylinder
        if part.name.endswith("grip"):
            found += _grip(part.name, radius / 2, end)
        elif part.name not in ("end_effector", "tip"):
            opacity = 0.35 if part.parent is None else None
            found.append(Solid(f"{part.name}_rod", part.name, rod(radius, start, end), METAL, opacity))
    if of.port is not None and of.rolls:
        jaws, length = of.port.jaw_length, tree["tip"].offset
        found += _end_effector(tree["end_effector"].name, (tree["stem"].cylinder or (0.0,) * 3)[2], length, jaws)
    for joint in inst.joints:
        if of.inside(joint) is not None:
            continue  # the joint within it stands for both
        first = tree[moving(of, of.around(joint) or joint, "urdf")[0]]
        reach = joint.radius if joint.place == "tip" else -joint.radius
        found += _joint(joint, reach, str(first.parent), first.offset)
    return found


def _end_effector(body: str, radius: float, length: float, jaw_length: float) -> list[Solid]:
    """Return an end-effector of a length on a stem of a radius, m."""
    root = length - jaw_length
    jaws = _joined(*(_jaw(1.4 * radius, jaw_length, root, side) for side in (1, -1)))
    return [Solid("wrist", body, rod(0.7 * radius, 0, root), METAL), Solid("jaws", body, jaws, STEEL)]


def rod(radius: float, low: float, high: float, sides: int = 24) -> Trimesh:
    """Return a cylinder along z."""
    mesh = trimesh.creation.cylinder(radius, high - low, sections=sides)
    return _moved(mesh, (0, 0, (low + high) / 2))


def _grip(body: str, radius: float, length: float) -> list[Solid]:
    """Return a grip of a length on a stem of a radius, m, from its end toward the handle's joints."""
    grip = _joined(rod(1.5 * radius, 0, 0.65 * length), rod(1.8 * radius, 0, 0.07 * length))
    shaft = rod(0.7 * radius, 0.65 * length, length)
    return [Solid(f"{body}_shaft", body, shaft, METAL), Solid(f"{body}_hold", body, grip, GRIP)]


def _joint(joint: Joint, reach: float, body: str, at: float) -> list[Solid]:
    """Return the solids of a joint that begins on a body, at a place along it; a negative radius reaches to -z."""
    name = joint.name
    if joint.mechanism == "continuum" or joint.is_twist:
        return []
    radius, turned = abs(reach), about(joint.axis_vector)

    def placed(part: str, body: str, mesh: Trimesh, colour: tuple[int, int, int], along: float = 0.0) -> Solid:
        return Solid(f"{name}_{part}", body, _moved(mesh.apply_transform(turned), (0, 0, along)), colour)

    if joint.mechanism == "pulley":
        pulley = rod(radius, -0.3 * radius, 0.3 * radius, 40)
        return [placed("pulley", body, pulley.apply_transform(_AXIS_ALONG_Y), GEAR, at)]
    apart = 0.75 * radius
    links = _pair(_plate(0.6 * radius, 2 * radius, 0.12 * radius, reach), 1.05 * radius)
    return [
        placed("near_gear", body, _pair(_gear(radius), apart), GEAR, at),
        placed("far_gear", f"{name}_far", _pair(_gear(radius, shifted=True), apart), GEAR),
        placed("link", f"{name}_carrier", links, STEEL),
    ]


def about(axis: tuple[float, float, float]) -> Array:
    """Return the transform of a mesh about y, agonist toward x, to a joint's axis."""
    along, side = np.array(axis), bend_side(axis)
    found = np.eye(4)
    found[:3, :3] = np.column_stack([side, along, np.cross(side, along)])
    return found


def _pair(mesh: Trimesh, apart: float) -> Trimesh:
    """Return a mesh on either side of the plane that a joint bends in, so that the tendons are seen between."""
    return _joined(_moved(mesh.copy(), (0, apart, 0)), _moved(mesh.copy(), (0, -apart, 0)))


def _gear(radius: float, *, shifted: bool = False) -> Trimesh:
    """Return a spur gear about y of a pitch radius; teeth point along z either way, or gaps if shifted."""
    step = 2 * pi / _TEETH
    # Flanks that leave a little play, so that the teeth of a pair are seen one by one.
    tooth = np.array([(-0.42, -1.0), (-0.24, -1.0), (-0.12, 0.85), (0.12, 0.85), (0.24, -1.0), (0.42, -1.0)])
    around = (step * (np.arange(_TEETH)[:, np.newaxis] + tooth[:, 0] + (0.5 if shifted else 0.0))).ravel()
    reach = radius * (1 + 0.11 * np.tile(tooth[:, 1], _TEETH))
    outline = np.stack([reach * np.cos(around), reach * np.sin(around)], 1)
    return _prism(outline, 0.35 * radius).apply_transform(_AXIS_ALONG_Y)


def _plate(width: float, between: float, thickness: float, middle: float) -> Trimesh:
    """Return a plate in the plane of x and z with round ends, whose centres are so far apart."""
    around = np.linspace(-pi / 2, pi / 2, 12)
    end = np.stack([np.cos(around), np.sin(around)], 1) * width / 2 + (between / 2, 0)
    return _moved(_prism(np.concatenate([end, -end]), thickness).apply_transform(_AXIS_ALONG_Y), (0, 0, middle))


def _jaw(width: float, length: float, root: float, side: int) -> Trimesh:
    """Return a jaw along z that begins at a root and tapers; side is 1 or -1."""
    profile = np.array([(0.04, 0), (1, 0), (0.95, 0.55), (0.35, 1), (0.04, 1)]) * (side * width / 2, length)
    outline = profile[::-side, ::-1]
    centre = outline.mean(0)
    mesh = _prism(outline - centre, 2 * width / 3).apply_transform(_AXIS_ALONG_Y)
    return _moved(mesh, (centre[1], 0, centre[0] + root))


def _prism(outline: Array, thickness: float) -> Trimesh:
    """Return the prism about z of an outline, shape (n, 2), anticlockwise and star-shaped about its origin."""
    count = len(outline)
    ring = np.arange(count)
    fan = np.stack([np.full(count, count), ring, (ring + 1) % count], 1)
    mesh = trimesh.creation.extrude_triangulation(np.vstack([outline, (0.0, 0.0)]), fan, thickness)
    return _moved(mesh, (0, 0, -thickness / 2))


def _joined(*meshes: Trimesh) -> Trimesh:
    joined = trimesh.util.concatenate(meshes)
    assert isinstance(joined, Trimesh)
    return joined


def _moved(mesh: Trimesh, by: tuple[float, float, float]) -> Trimesh:
    mesh.apply_translation(by)
    return mesh
