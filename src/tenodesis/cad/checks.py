"""Checks of solids: against the model, and whether their meshes can be printed."""

from typing import NamedTuple

import numpy as np

from tenodesis import kinematics, statics
from tenodesis.cad import kernel as k
from tenodesis.cad.assembly import matrix
from tenodesis.cad.kernel import Solid
from tenodesis.cad.model import Model
from tenodesis.cad.parts import Part
from tenodesis.cad.routes import tendon_lengths, tip_places
from tenodesis.extras import require
from tenodesis.kinematics import Posture
from tenodesis.run import Array

ANGLES = 50
_SAMPLES = 400
_PARALLEL = 0.95
_CHORD, _TURN = 0.02, 0.2  # mm and rad: how closely a mesh follows its solid


class Agreement(NamedTuple):
    """Largest differences between the solids and the model over the working range."""

    angles: int
    excursion: float
    """Of the tendons' lengths by the solids from those that the statics' tensions mean, m."""
    tip: float
    """Of the tip's place by the solids from the kinematics', m."""


class Printable(NamedTuple):
    """What a part's mesh says of printing it."""

    part: str
    watertight: bool
    """Closed, each edge between two faces of consistent orientation, one body."""
    triangles: int
    volume_error: float
    """Relative difference of the mesh's volume from the solid's."""
    least_wall: float
    """Thinnest wall found between nearly parallel faces, m."""
    support: float
    """Area that overhangs more steeply than the process prints without a support, m², as laid on the bed."""


def agreement(model: Model, count: int = ANGLES) -> Agreement:
    """Return how solids and model agree at angles over the working range, the tip under a force.

    The tendons' stretch is the statics' tension less the pretension, over the stiffness; the solids' is the change of
    the length of the way through their tunnels and grooves. Pretension is high, so that no tendon goes slack.
    """
    inst = model.instrument
    stiffness = inst.tendon_stiffness
    radius = kinematics.dimensions(inst).distal_radii[0]
    force = 0.05 * stiffness * radius**2 / inst.end_effector_length
    tight = inst.replace(pretension=min(stiffness * radius, 1e4), breaking_load=None)
    handles = np.linspace(-inst.handle_range, inst.handle_range, 20 * count + 1)
    angles = statics.output_angle(tight, handles, force)
    usable = np.flatnonzero(np.abs(angles) <= inst.output_range)
    chosen = usable[np.linspace(0, usable.size - 1, count).astype(int)]
    handles, angles = handles[chosen], np.asarray(angles)[chosen]
    tensions = np.stack(statics.tensions(tight, handles, force))
    stretch = (tensions - tight.pretension) / stiffness
    ways = tendon_lengths(model, angles, handles) - tendon_lengths(model, 0.0)
    frames = kinematics.frames(inst, Posture(yaw=angles, handle_yaw=0.0))
    expected = frames.bodies["tip"].position - frames.bodies["stem"].position
    found = tip_places(model, angles)
    return Agreement(
        count, float(np.abs(ways - stretch.T).max()), float(np.linalg.norm(found - expected, axis=1).max())
    )


_LYING: tuple[k.Point, ...] = ((0, 0, 0), (180, 0, 0), (90, 0, 0), (-90, 0, 0), (0, 90, 0), (0, -90, 0))
"""Turns about x, y and z, deg, in which a part may lie on the bed."""


def laid(model: Model, part: Part) -> Solid:
    """Return a part as it lies on the printer's bed with the least area to support, mm."""
    points, faces = k.meshed(part.solid, 0.2, 0.4)
    corners = points[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(across, axis=1) / 2
    normals = across / np.where(areas > 0, 2 * areas, 1)[:, np.newaxis]
    needed = []
    for turn in _LYING:
        # The bed's normal in the part's frame.
        up = matrix(k.at(turn=turn))[2, :3]
        needed.append(float(areas[_steep(model, normals @ up, corners.mean(1) @ up, (corners @ up).min())].sum()))
    turned = k.at(turn=_LYING[int(np.argmin(needed))]) * part.solid
    low = turned.bounding_box().min
    return k.at(-low.X, -low.Y, -low.Z) * turned


def _steep(model: Model, upward: Array, heights: Array, bed: float) -> Array:
    """Return which faces overhang too steeply and are not on the bed."""
    found: Array = (upward < -np.sin(np.radians(model.process.overhang)) - 1e-6) & (heights > bed + 0.05)
    return found


def printable(model: Model, part: Part, path: str) -> Printable:
    """Return what the mesh of a part says, from its STL file, as :func:`laid` put it."""
    mesh = require("trimesh", "cad").load_mesh(path)
    closed = bool(mesh.is_watertight and mesh.is_winding_consistent and mesh.body_count == 1)
    middles, normals, areas = mesh.triangles_center, mesh.face_normals, mesh.area_faces
    steep = _steep(model, normals[:, 2], middles[:, 2], 0.0)
    return Printable(
        part.name,
        closed,
        len(mesh.faces),
        float(mesh.volume / part.solid.volume - 1),
        _least_wall(np.asarray(mesh.triangles), np.asarray(normals), np.asarray(areas)) * 1e-3,
        float(areas[steep].sum()) * 1e-6,
    )


def write_mesh(model: Model, part: Part, path: str) -> None:
    """Write a part as an STL file, laid on the bed, mm."""
    k.kernel().export_stl(laid(model, part), path, tolerance=_CHORD, angular_tolerance=_TURN)


def _least_wall(triangles: Array, normals: Array, areas: Array) -> float:
    """Return the least distance, mm, through the mesh from points on it, straight in, to a nearly parallel face."""
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(triangles), _SAMPLES, p=areas / areas.sum())
    weights = rng.dirichlet((1.0, 1.0, 1.0), _SAMPLES)
    points = np.einsum("ij,ijk->ik", weights, triangles[chosen])
    first, along, across = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    least = np.inf
    for point, way in zip(points, -normals[chosen], strict=True):
        turned = np.cross(way, across)
        determinant = np.einsum("ij,ij->i", along, turned)
        with np.errstate(divide="ignore", invalid="ignore"):
            offset = point - first
            second = np.einsum("ij,ij->i", offset, turned) / determinant
            crossed = np.cross(offset, along)
            third = crossed @ way / determinant
            distance = np.einsum("ij,ij->i", across, crossed) / determinant
            hit = (second >= 0) & (third >= 0) & (second + third <= 1) & (distance > 1e-4)
        if not hit.any():
            continue
        nearest = np.flatnonzero(hit)[distance[hit].argmin()]
        if normals[nearest] @ way > _PARALLEL:
            least = min(least, float(distance[nearest]))
    return least
