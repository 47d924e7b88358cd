"""Checks of solids: their tendons and tip against the model, and whether their meshes can be printed."""

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tenodesis import kinematics, statics
from tenodesis.cad import kernel as k
from tenodesis.cad.assembly import Placing, frames_of, matrix, own_place
from tenodesis.cad.gears import GearJoint
from tenodesis.cad.kernel import Solid
from tenodesis.cad.model import Model
from tenodesis.cad.parts import Part
from tenodesis.cad.pulley_parts import PulleyJoint
from tenodesis.extras import require
from tenodesis.kinematics import Posture
from tenodesis.run import Array

_SAME = 1e-6  # mm
_ALONG = 0.999  # of a unit vector


def tendon_lengths(model: Model, output_angles: ArrayLike, handle_angles: ArrayLike = 0.0) -> Array:
    """Return the lengths of agonist and antagonist over both joints, m (..., 2), read from the solids.

    Tunnels are the cylindrical faces of the parts, pulleys the round bottoms of their grooves; a tendon goes straight
    between the mouths of tunnels, on their axes, and round a pulley at its groove's bottom plus half a rope. Angles are
    in rad and broadcast.
    """
    outputs, handles = np.broadcast_arrays(np.asarray(output_angles, float), np.asarray(handle_angles, float))
    ways = [_way(model, side, tip=tip) for side in (1, -1) for tip in (True, False)]
    found = np.empty((outputs.size, 2))
    for number, (output, handle) in enumerate(zip(outputs.flat, handles.flat, strict=True)):
        frame = frames_of(model, float(output), float(handle))
        lengths = [way(frame, float(output), float(handle)) for way in ways]
        found[number] = lengths[0] + lengths[1], lengths[2] + lengths[3]
    return 1e-3 * found.reshape(*outputs.shape, 2)


def tip_places(model: Model, output_angles: ArrayLike) -> Array:
    """Return where the end-effector's eye is from the stem's distal end, m (..., 3), read from the face of its bore."""
    part = model.part("end_effector")
    axes = [axis for axis in _bores(part.solid) if abs(axis.way[1]) > _ALONG]
    eye = max(axes, key=lambda axis: float(axis.middle[2])).middle * (1, 0, 1)
    angles = np.asarray(output_angles, float)
    places = [matrix(frames_of(model, float(angle), 0.0)(part, k.at())) @ np.append(eye, 1.0) for angle in angles.flat]
    return 1e-3 * np.array(places)[:, :3].reshape(*angles.shape, 3)


class _Bore(NamedTuple):
    """A cylindrical face: direction, middle and ends of its axis, mm, and its radius."""

    way: Array
    middle: Array
    ends: tuple[Array, Array]
    radius: float


def _bores(solid: Solid) -> Iterator[_Bore]:
    """Yield the cylindrical faces of a solid, with their extent along their axes."""
    b = k.kernel()
    for face in solid.faces().filter_by(b.GeomType.CYLINDER):
        cylinder = k.surface(face).Cylinder()
        axis, origin = cylinder.Axis().Direction(), cylinder.Axis().Location()
        way = np.array([axis.X(), axis.Y(), axis.Z()])
        point = np.array([origin.X(), origin.Y(), origin.Z()])
        along = [float(np.dot(np.array([*vertex]) - point, way)) for vertex in face.vertices()]
        ends = (point + min(along) * way, point + max(along) * way)
        yield _Bore(way, (ends[0] + ends[1]) / 2, ends, cylinder.Radius())


_Way = Callable[[Placing, float, float], float]


def _mouths(part: Part, side: int, tunnel: float) -> tuple[Array, Array]:
    """Return the mouths of a tunnel of a part, mm: toward its z, and at the other end."""
    ends = [
        end
        for bore in _bores(part.solid)
        if abs(bore.radius - tunnel / 2) < _SAME and abs(bore.way[2]) > _ALONG and side * bore.middle[0] > _SAME
        for end in bore.ends
    ]
    return max(ends, key=lambda end: float(end[2])), min(ends, key=lambda end: float(end[2]))


def _way(model: Model, side: int, *, tip: bool) -> _Way:
    """Return the function of a tendon's length over one joint, mm, with what its parts' faces say; side 1: agonist."""
    joint = model.joints[0 if tip else 1]
    rope = k.MM * (model.instrument.tendon_diameter or 0.0)
    prefix = "tip" if tip else "handle"
    if isinstance(joint, PulleyJoint):
        return _wound(model.part(f"{prefix}_pulley"), joint.wrap, rope, side, tip=tip)
    tunnel = rope + k.MM * model.process.bore
    gears = (f"{prefix}_gear_near", f"{prefix}_gear_far")
    names = gears if isinstance(joint, GearJoint) else ("tip_socket", "tip_disc", "tip_plate")
    stations = []
    for part in map(model.part, names):
        ahead, behind = _mouths(part, side, tunnel)
        # A tendon passes both mouths of a disc.
        points = (behind, ahead) if part.body == "arc" else (ahead,)
        stations += [(part, place, point) for place in part.places for point in points]

    def straight(frame: Placing, _output: float, _handle: float) -> float:
        points = [
            (matrix(frame(part, place) * own_place(place, part)) @ np.append(point, 1.0))[:3]
            for part, place, point in stations
        ]
        return float(sum(np.linalg.norm(two - one) for one, two in pairwise(points)))

    return straight


def _wound(part: Part, wrap: float, rope: float, side: int, *, tip: bool) -> _Way:
    radii = {}
    for face in part.solid.faces().filter_by(k.kernel().GeomType.TORUS):
        torus = k.surface(face).Torus()
        radii[torus.Axis().Location().Y() > 0] = torus.MajorRadius() - torus.MinorRadius() + rope / 2

    def wound(_frame: Placing, output: float, handle: float) -> float:
        # The tendon meets the pulley where its way along the stem touches the circle; bending unwinds the agonist at
        # the tip and winds it on at the handle.
        return float(radii[side > 0] * (wrap - side * (output if tip else -handle)))

    return wound


ANGLES = 50
_SAMPLES = 400
_PARALLEL = 0.95
_OFF = 1e-4  # mm, by which a ray begins below the face that it leaves from
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
        _least_wall(mesh) * 1e-3,
        float(areas[steep].sum()) * 1e-6,
    )


def write_mesh(model: Model, part: Part, path: str) -> None:
    """Write a part as an STL file, laid on the bed, mm."""
    k.kernel().export_stl(laid(model, part), path, tolerance=_CHORD, angular_tolerance=_TURN)


def _least_wall(mesh: Any) -> float:
    """Return the least distance, mm, through a mesh from points on it, straight in, to a nearly parallel face."""
    rng = np.random.default_rng(0)
    normals, areas = np.asarray(mesh.face_normals), np.asarray(mesh.area_faces)
    chosen = rng.choice(len(areas), _SAMPLES, p=areas / areas.sum())
    points = np.einsum("ij,ijk->ik", rng.dirichlet((1.0, 1.0, 1.0), _SAMPLES), np.asarray(mesh.triangles)[chosen])
    ways = -normals[chosen]
    hits, rays, faces = mesh.ray.intersects_location(points + _OFF * ways, ways, multiple_hits=False)
    parallel = np.einsum("ij,ij->i", normals[faces], ways[rays]) > _PARALLEL
    return float(np.linalg.norm(hits - points[rays], axis=1)[parallel].min(initial=np.inf))
