"""Checks of solids: their tendons and tip against the model, and whether their meshes can be printed."""

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tenodesis import kinematics
from tenodesis.cad import kernel as k
from tenodesis.cad.assembly import Placing, arcs_of, frames_of, matrix, size_of
from tenodesis.cad.backbone_parts import Backbone
from tenodesis.cad.bench_parts import TIP_PIN
from tenodesis.cad.kernel import Location, Solid
from tenodesis.cad.lever_parts import Lever
from tenodesis.cad.model import LEAST_ARM, Model, Station
from tenodesis.cad.parts import Part
from tenodesis.cad.pulley_parts import PulleyJoint
from tenodesis.cad.wrist_parts import Jaw, Lane, Wrist
from tenodesis.extras import require
from tenodesis.instrument import Tendon
from tenodesis.instrument.instrument import arm_of
from tenodesis.kinematics.chain import bend_side
from tenodesis.run import Array
from tenodesis.statics import chain

_SAME = 1e-6  # mm
_ALONG = 0.999  # of a unit vector
_NEAR = 1e-4  # mm
_ROUNDING = 1e-9  # rad


def tendon_lengths(model: Model, output_angles: ArrayLike, handle_angles: ArrayLike = 0.0) -> Array:
    """Return the lengths of all tendons over their joints, m (..., tendons), read from the solids.

    Tunnels are the cylindrical faces of the parts, pulleys the round bottoms of their grooves; a tendon goes straight
    between the mouths of tunnels, on their axes, and round a pulley at its groove's bottom plus half a rope. Angles are
    in rad, those of one joint (...), of several (..., joints), and broadcast.
    """
    outputs, handles = (
        _rows(model, angles, tip=tip) for angles, tip in ((output_angles, True), (handle_angles, False))
    )
    shape = np.broadcast_shapes(outputs.shape[:-1], handles.shape[:-1])
    outputs, handles = (
        np.broadcast_to(rows, (*shape, rows.shape[-1])).reshape(math.prod(shape), rows.shape[-1])
        for rows in (outputs, handles)
    )
    full = model.instrument.expanded
    ways = [[_way(model, one, tendon.name) for one in _crossed(model, tendon)] for tendon in full.tendons]
    found = np.empty((len(outputs), len(ways)))
    for number, (output, handle) in enumerate(zip(outputs, handles, strict=True)):
        frame = frames_of(model, output, handle)
        found[number] = [sum(way(frame, output, handle) for way in own) for own in ways]
    return 1e-3 * found.reshape(*shape, len(ways))


def tip_places(model: Model, output_angles: ArrayLike, joint: str | None = None) -> Array:
    """Return where the end-effector's eye is from the stem's distal end, m (..., 3), read from the face of its bore.

    Angles are in rad, those of one joint (...), of several (..., joints). The eye is that of the last joint that has
    one, or of the joint named, as each of two jaws has its own.
    """
    station = model.bearing if joint is None else next(one for one in model.stations if one.joint.name == joint)
    far, eye_radius = station.end.far, (station.sizes.eye if isinstance(station.sizes, Jaw) else TIP_PIN) / 2
    eyes = [
        (abs(float(bore.middle[2])), part, bore)
        for part in model.parts
        if part.body == far and part.made
        for bore in _bores(part.solid)
        if abs(bore.radius - eye_radius) < _SAME and abs(bore.way[2]) < 1 - _ALONG
    ]
    _, part, bore = max(eyes, key=lambda one: one[0])
    eye = bore.middle - (bore.middle @ bore.way) * bore.way
    angles = _rows(model, output_angles, tip=True)
    still = np.zeros(len(model.at(tip=False)))
    places = [
        matrix(frames_of(model, row, still)(part, k.at()) * part.places[0]) @ np.append(eye, 1.0)
        for row in angles.reshape(-1, angles.shape[-1])
    ]
    return 1e-3 * np.array(places)[:, :3].reshape(*angles.shape[:-1], 3)


def _rows(model: Model, angles: ArrayLike, *, tip: bool) -> Array:
    """Return angles with the joints of an end in the last axis; a single 0 stands for all zeros."""
    given, count = np.asarray(angles, float), len(model.at(tip=tip))
    if count == 1:
        return given[..., np.newaxis]
    return np.broadcast_to(given, (count,)) if given.ndim == 0 else given


def _crossed(model: Model, tendon: Tendon) -> list[Station]:
    """Return the joints that a tendon crosses, without jaws at whose axis it has no more than a coupling's rounding.

    Of the arcs of backbones it is the last, since its way is that along all of them.
    """
    crossings = {crossing.joint: crossing for crossing in tendon.route}
    own = [one for one in model.stations if one.joint.name in crossings]
    arcs = [one for one in own if isinstance(one.sizes, Backbone)]
    return [
        one
        for one in own
        if one not in arcs[:-1]
        and (not isinstance(one.sizes, Jaw) or abs(arm_of(crossings[one.joint.name], one.joint)) > LEAST_ARM)
    ]


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


_Way = Callable[[Placing, Array, Array], float]


def _mouths(part: Part, place: tuple[float, float], tunnel: float) -> list[Array]:
    """Return the mouths of a tunnel at a place across a part, mm, by their height; none if it has no such tunnel."""
    ends = [
        end
        for bore in _bores(part.solid)
        if abs(bore.radius - tunnel / 2) < _SAME
        and abs(bore.way[2]) > _ALONG
        and np.hypot(*(bore.middle[:2] - place)) < _NEAR
        for end in bore.ends
    ]
    return sorted(ends, key=lambda end: float(end[2]))


def _within(place: Location, across: Location) -> tuple[float, float]:
    """Return where a tendon is across a part at a place, mm."""
    local = (place.inverse() * k.at(across.position.X, across.position.Y, place.position.Z)).position
    return local.X, local.Y


def _way(model: Model, station: Station, tendon: str) -> _Way:
    """Return the function of a tendon's length over one joint, mm, with what its parts' faces say."""
    joint, end = station.sizes, station.end
    rope = k.MM * (model.instrument.tendon_diameter or 0.0)
    own = [one.joint.name for one in model.at(tip=end.tip)]
    number = own.index(station.joint.name)
    x, y = model.ways[station.joint.name][tendon]
    side = 1 if x > 0 else -1
    lane = next((lane for lane in getattr(joint, "lanes", ()) if lane.way.tendon == tendon), None)
    if isinstance(joint, Wrist) and lane is not None:
        return _past(model, station, joint, lane, rope)
    if isinstance(joint, PulleyJoint | Lever | Wrist | Jaw):
        pulley = joint if isinstance(joint, PulleyJoint) else joint.pulley
        wrap, tip = pulley.wrap, end.tip
        level = -side * pulley.shift - (joint.level if isinstance(joint, Jaw) else 0.0)
        radius = _groove(model, end.far, level, rope)

        def wound(_frame: Placing, output: Array, handle: Array) -> float:
            # The tendon meets the pulley where its way along the stem touches the circle; bending unwinds the agonist
            # at the tip and winds it on at the handle.
            return float(radius * (wrap - side * (output if tip else -handle)[number]))

        return wound
    tunnel = rope + k.MM * model.process.bore
    if isinstance(joint, Backbone):
        return _along(model, station, (x, y), tunnel)
    stations = []
    for body, far in ((end.near, False), (end.carrier, False), (end.far, True)):
        # Where it is in the frame of the body, and which end of the tunnel is toward the joint.
        across = (end.place() if body != end.far else end.place(far=True)) * k.at(x, -y if far == end.tip else y)
        axis = 0.0 if far else end.start
        mouths = [
            (abs((place * k.at(*mouth)).position.Z - axis), (part, place, mouth))
            for part in model.parts
            if part.body == body and part.made
            for place in part.places
            for mouth in _mouths(part, _within(place, across), tunnel)
        ]
        stations += [one for _, one in sorted(mouths, key=lambda one: one[0])[:1]]
    return _straight(stations)


def _along(model: Model, station: Station, at: tuple[float, float], tunnel: float) -> _Way:
    """Return the function of a tendon's length along a tip's backbones, to the end of an arc, mm."""
    across = k.at(turn=(0, 0, station.end.turn)) * k.at(*at)
    arcs, straight = arcs_of(model, np.zeros(len(model.at(tip=True)))), frames_of(model, 0.0, 0.0)
    end = next(begin + size_of(one).length for one, _, begin in arcs if one is station)
    found = [
        ((straight(part, place) * place * k.at(*mouth)).position.Z, (part, place, mouth))
        for part in model.parts
        if part.body in ("stem", "arc", arcs[-1][0].end.far) and part.made
        for place in part.places
        for mouth in _mouths(part, _within(place, across), tunnel)
    ]
    # From the socket's face to the disc or plate on which it ends; it passes both mouths of the discs between.
    passed = sorted((one for one in found if -_NEAR < one[0] < end + _NEAR), key=lambda one: one[0])
    return _straight([one for _, one in passed])


def _straight(stations: Sequence[tuple[Part, Location, Array]]) -> _Way:
    """Return the function of a tendon's length from mouth to mouth of tunnels, at places of parts, mm."""

    def straight(frame: Placing, _output: Array, _handle: Array) -> float:
        points = [(matrix(frame(part, place) * place) @ np.append(point, 1.0))[:3] for part, place, point in stations]
        return float(sum(np.linalg.norm(two - one) for one, two in pairwise(points)))

    return straight


def _past(model: Model, station: Station, joint: Wrist, lane: Lane, rope: float) -> _Way:
    """Return the function of a tendon's length over a joint that it passes on wheels, from tunnel to tunnel, mm.

    It is straight from its tunnel in the fork to the guide wheel, between the wheels on their common tangent, and from
    its wheel on to its tunnel in the body that bends.
    """
    end, side, tunnel = station.end, lane.way.side, rope + k.MM * model.process.bore
    guide, wheel = (_wheel_at(model, station, (x, lane.y, z), rope) for x, z in (lane.guide, (0.0, 0.0)))
    fork, body = model.part(f"{end.prefix}_fork"), model.part(f"{end.prefix}_body")
    before = _mouths(fork, joint.stem_place(lane.way.tendon, side), tunnel)[-1]
    beyond = _mouths(body, (side * wheel[1], -lane.y), tunnel)[-1]
    (centre, small), (middle, radius) = guide, wheel
    between = centre - middle
    distance = float(np.hypot(between[0], between[2]))
    free = np.sqrt(distance**2 - (radius + small) ** 2)
    # The tangent's turn from the line of centres, and that line's from the stem.
    wrap = np.arctan2(-side * between[0], -between[2]) + np.arcsin((radius + small) / distance)
    straight = np.hypot(before[2] - centre[2], before[0] - (centre[0] - side * small)) - beyond[2]
    number = [one.joint.name for one in model.at(tip=True)].index(station.joint.name)

    def past(_frame: Placing, output: Array, _handle: Array) -> float:
        return float(straight + free + small * wrap + radius * (wrap - side * output[number]))

    return past


def _wheel_at(model: Model, station: Station, place: k.Point, rope: float) -> tuple[Array, float]:
    """Return centre, in the frame of the joint, and radius to the rope's centre of the wheel nearest to a place, mm."""
    back = station.end.place().inverse()
    found = [
        (np.array([*(back * where).position]), radius)
        for part in model.parts
        if part.body == station.end.near and part.made
        for radius in _grooves(part, rope).values()
        for where in part.places
    ]
    return min(found, key=lambda one: float(np.linalg.norm(one[0] - place)))


def _groove(model: Model, body: str, level: float, rope: float) -> float:
    """Return the radius to a rope's centre of the groove of a body at a height along its pulley's axis, mm."""
    part = next(one for one in model.parts if one.body == body and _grooves(one, rope))
    return min(_grooves(part, rope).items(), key=lambda one: abs(one[0] - level))[1]


def _grooves(part: Part, rope: float) -> dict[float, float]:
    """Return the radii to a rope's centre of the grooves of a part, by their heights along its axis, mm."""
    radii = {}
    for face in part.solid.faces().filter_by(k.kernel().GeomType.TORUS):
        torus = k.surface(face).Torus()
        radii[torus.Axis().Location().Y()] = torus.MajorRadius() - torus.MinorRadius() + rope / 2
    return radii


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

    The tendons' stretch is what the statics' tensions mean; the solids' is the change of the length of the way through
    their tunnels and grooves. Pretension is high, so that no tendon of a pair goes slack; one that a spring holds is
    compared while it is taut. Of several joints all are bent at once, at random.
    """
    full = model.instrument.expanded
    tip = model.bearing.joint
    stiffness = float(full.stiffnesses[0])
    radius = full.tip_joints[0].radius
    force = 0.05 * stiffness * radius**2 / (tip.end_effector_length or radius)
    tight = model.instrument.replace(pretension=min(stiffness * radius, 1e4), breaking_load=None).expanded
    limits = np.array([joint.limits for joint in full.tip_joints])
    most = full.bend_limits[:, 1]
    ranges = np.array([joint.range for joint in full.handle_joints])
    if len(ranges) == 1:
        handles = np.linspace(-ranges, ranges, 20 * count + 1)
    else:
        handles = ranges * np.random.default_rng(0).uniform(-1.0, 1.0, (20 * count, len(ranges)))
    # Without a handle its drives draw the tendons.
    wanted = most * np.random.default_rng(1).uniform(-1.0, 1.0, (len(handles), len(most)))
    bent = np.array([full.bent(row) for row in wanted])
    strokes = (0.0 if len(ranges) else 1.0) * bent @ full.tendon_arms("tip").T
    wrench = np.zeros(6)
    wrench[:3] = -force * bend_side(full.tip_joints[0].axis_vector)
    found = chain.equilibrium(tight, handles, wrench, strokes=strokes)
    angles = np.asarray(found.output_angle)
    inside = ((angles >= limits[:, 0] - _ROUNDING) & (angles <= limits[:, 1] + _ROUNDING)).all(axis=1)
    usable = np.flatnonzero(inside)
    chosen = usable[np.linspace(0, usable.size - 1, min(count, usable.size)).astype(int)]
    handles, angles, strokes = handles[chosen], angles[chosen], strokes[chosen]
    tensions = np.asarray(found.tensions)[chosen]
    taut = tensions > 0
    stretch = np.where(taut, tight.stretches(np.where(taut, tensions, 1.0)), np.nan)
    rows = (angles, handles) if len(model.at(tip=True)) > 1 else (angles[:, 0], handles[:, 0])
    ways = tendon_lengths(model, *rows) - tendon_lengths(model, 0.0)
    frames = kinematics.frames(full, angles)
    off = [
        tip_places(model, rows[0], one.joint.name)
        - (frames.bodies[f"{one.joint.name}_tip"].position - frames.bodies["stem"].position)
        for one in model.at(tip=True)
        if one.joint.end_effector_length is not None
    ]
    return Agreement(
        len(chosen), float(np.nanmax(np.abs(ways + strokes - stretch))), float(np.linalg.norm(off, axis=-1).max())
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
