"""Simple solids of the CAD kernel, build123d, in mm; it is imported when the first solid is made."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tenodesis.errors import InstrumentError
from tenodesis.extras import require
from tenodesis.run import Array

MM = 1e3
"""Kernel units, mm, per metre."""

Solid: TypeAlias = Any
"""A shape of the kernel, mm."""
Location: TypeAlias = Any
"""A position and orientation of the kernel, mm and degrees."""
Point: TypeAlias = tuple[float, float, float]

UP: Point = (0.0, 0.0, 1.0)
_FINER = (1.0, 0.7, 0.5, 0.35, 0.2)
"""Shares of the turn that a mesh is made with."""
_VOLUME = 1e-8
"""Relative error to which a volume is integrated, face by face."""


def kernel() -> Any:
    """Return the module build123d. Raises MissingExtraError if it is not installed."""
    return require("build123d", "cad")


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0, turn: Point = (0.0, 0.0, 0.0)) -> Location:
    """Return a place, and a turn about x, y and z in degrees."""
    return kernel().Location((x, y, z), turn)


def placed(position: Array, quaternion: Array) -> Location:
    """Return a place from a position, mm, and a unit quaternion w, x, y, z."""
    w, *v = (float(one) for one in quaternion)
    sine = math.hypot(*v)
    x, y, z = (float(one) for one in position)
    if sine < 1e-15:
        return at(x, y, z)
    return kernel().Location((x, y, z), tuple(one / sine for one in v), math.degrees(2 * math.atan2(sine, w)))


def turned_about_y(angle: float) -> Location:
    """Return a turn about y by an angle in rad, positive from z toward x."""
    return at(turn=(0.0, math.degrees(angle), 0.0))


FLIP: Point = (180.0, 0.0, 0.0)
"""Turn about x that points a part the other way along z and keeps its x."""


def box(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> Solid:
    """Return a box by its bounds."""
    sides = [high - low for low, high in (x, y, z)]
    middle = [(low + high) / 2 for low, high in (x, y, z)]
    return kernel().Pos(*middle) * kernel().Box(*sides)


def rod(start: Point, end: Point, radius: float) -> Solid:
    """Return a cylinder between two points."""
    way = np.subtract(end, start)
    plane = kernel().Plane(origin=start, z_dir=tuple(way))
    return kernel().Solid.make_cylinder(radius, float(np.linalg.norm(way)), plane)


def bar(points: Sequence[tuple[float, float]], low: float, high: float) -> Solid:
    """Return a prism along y between two bounds, of a polygon in x and z."""
    b = kernel()
    corners = [(x, high, z) for x, z in points]
    return prism(
        [b.Edge.make_line(one, two) for one, two in zip(corners, [*corners[1:], corners[0]], strict=True)], high - low
    )


def prism(edges: Sequence[Any], height: float) -> Solid:
    """Return the prism toward -y of a closed outline of edges in a plane square to y."""
    b = kernel()
    face = b.Face(b.Wire(edges))
    return b.Solid.extrude(face, (0, -height, 0))


def coil(wire: float, diameter: float, coils: float, pitch: float, start: Point) -> Solid:
    """Return a wire coiled about y from a height on, its mean diameter, number of coils and pitch given."""
    b = kernel()
    helix = b.Helix(pitch, coils * pitch, diameter / 2)
    section = b.Plane(origin=helix @ 0, z_dir=helix % 0) * b.Circle(wire / 2)
    return b.Pos(*start) * at(turn=(-90, 0, 0)) * b.sweep(section, path=helix)


def stadium(length: float, radius: float, low: float, high: float) -> Solid:
    """Return a plate with round ends about (0, 0) and (0, length) in x and z, between two bounds of y."""
    body = box((-radius, radius), (low, high), (0.0, length))
    for z in (0.0, length):
        body += rod((0, low, z), (0, high, z), radius)
    return body


def grooved(body: Solid, bottom: float, y: float, half: float, out: float) -> Solid:
    """Return a wheel about y with a groove from the radius of its round bottom out to another, of half a width."""
    b = kernel()
    centre, low, high = bottom + half, (0.0, y - half, 0.0), (0.0, y + half, 0.0)
    body -= b.Solid.make_torus(centre, half, b.Plane(origin=(0, y, 0), z_dir=(0, 1, 0)))
    return body - (rod(low, high, out) - rod(low, high, centre))


def surface(face: Any) -> Any:
    """Return a face's surface as the kernel describes it: Cylinder(), Torus() and so on by its type."""
    return require("OCP.BRepAdaptor", "cad").BRepAdaptor_Surface(face.wrapped)


def curve(edge: Any) -> Any:
    """Return an edge's curve as the kernel describes it, a place by Value() of its parameter."""
    return require("OCP.BRepAdaptor", "cad").BRepAdaptor_Curve(edge.wrapped)


def bounds(solid: Solid) -> tuple[Array, Array]:
    """Return a box about a solid, its least and its greatest corner (3,), not wider than need be by more than a bit."""
    around = require("OCP.Bnd", "cad").Bnd_Box()
    require("OCP.BRepBndLib", "cad").BRepBndLib.Add_s(solid.wrapped, around, False)
    low, high = around.CornerMin(), around.CornerMax()
    return np.array([low.X(), low.Y(), low.Z()]), np.array([high.X(), high.Y(), high.Z()])


def volume(solid: Solid) -> float:
    """Return a solid's volume, mm³, within a few parts in 10⁸; the kernel's usual one may be off by 10⁻⁵."""
    found = require("OCP.GProp", "cad").GProp_GProps()
    require("OCP.BRepGProp", "cad").BRepGProp.VolumeProperties_s(solid.wrapped, found, _VOLUME, False, False)
    return float(found.Mass())


def common(one: Solid, other: Solid) -> Solid:
    """Return what two solids share, a compound that may be empty."""
    shared = require("OCP.BRepAlgoAPI", "cad").BRepAlgoAPI_Common(one.wrapped, other.wrapped)
    return kernel().Compound(shared.Shape())


def common_volume(one: Solid, other: Solid) -> float:
    """Return the volume that two solids share, mm³."""
    return float(common(one, other).volume)


class Mesh(NamedTuple):
    """The surface of a solid as triangles: corners (n, 3), mm, and their numbers by triangle (m, 3)."""

    points: Array
    faces: NDArray[np.intp]


def meshed(solid: Solid, chord: float, turn: float) -> Mesh:
    """Return a solid's mesh, off it by a chord, mm, and a turn, rad, at most.

    At some turns the kernel leaves a face of a few solids out; finer ones are tried until it has all of them.
    """
    for finer in _FINER:
        require("OCP.BRepTools", "cad").BRepTools.Clean_s(solid.wrapped)
        try:
            points, faces = solid.tessellate(chord, finer * turn)
        except AttributeError:
            continue
        return Mesh(np.array([(point.X, point.Y, point.Z) for point in points]), np.array(faces))
    raise InstrumentError("the kernel has no mesh of a part; change a dimension a little.", key="mesh")
