"""Where the tendons and the tip are, read from the faces of the solids."""

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tenodesis.cad import kernel as k
from tenodesis.cad.assembly import Placing, frames_of, matrix, own_place
from tenodesis.cad.gear_joint import GearJoint
from tenodesis.cad.kernel import Solid
from tenodesis.cad.model import Model
from tenodesis.cad.parts import Part
from tenodesis.cad.pulley_parts import PulleyJoint
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
