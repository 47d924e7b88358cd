"""Solids to draw an instrument with: vertices (n, 3) and faces (m, 3)."""

from math import pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tenodesis.run import Array

_TEETH = 16  # even, so that a gear looks the same from both ends of the stem


class Solid(NamedTuple):
    """A closed surface."""

    vertices: Array
    faces: NDArray[np.uint32]


def prism(outline: Array, low: float, high: float) -> Solid:
    """Return an outline (n, 2) that is star-shaped about its origin, along z from low to high."""
    n = len(outline)
    ring = np.arange(n)
    after = (ring + 1) % n
    vertices = np.zeros((2 * n + 2, 3))
    vertices[:n, :2] = vertices[n : 2 * n, :2] = outline
    vertices[:n, 2], vertices[n : 2 * n, 2] = low, high
    vertices[2 * n, 2], vertices[2 * n + 1, 2] = low, high
    bottom = np.stack([after, ring, np.full(n, 2 * n)], 1)
    top = np.stack([ring + n, after + n, np.full(n, 2 * n + 1)], 1)
    sides = np.concatenate([np.stack([ring, after, after + n], 1), np.stack([ring, after + n, ring + n], 1)])
    return Solid(vertices, np.concatenate([bottom, top, sides]).astype(np.uint32))


def rod(radius: float, low: float, high: float, sides: int = 24) -> Solid:
    """Return a cylinder about z."""
    return prism(_circle(radius, sides), low, high)


def gear(radius: float, thickness: float, *, shifted: bool = False) -> Solid:
    """Return a spur gear about y of a pitch radius; teeth point along z either way, or gaps if shifted."""
    step = 2 * pi / _TEETH
    phase = step / 2 if shifted else 0.0
    depth = 0.11 * radius
    # Flanks that leave a little play, so that the teeth of a pair are seen one by one.
    shape = [(-0.42, -1.0), (-0.24, -1.0), (-0.12, 0.85), (0.12, 0.85), (0.24, -1.0), (0.42, -1.0)]
    around = np.array([phase + step * (n + part) for n in range(_TEETH) for part, _ in shape])
    reach = np.array([radius + depth * height for _ in range(_TEETH) for _, height in shape])
    outline = np.stack([reach * np.cos(around), reach * np.sin(around)], 1)
    return _about_y(prism(outline, -thickness / 2, thickness / 2))


def disc(radius: float, thickness: float, sides: int = 40) -> Solid:
    """Return a disc about y."""
    return _about_y(prism(_circle(radius, sides), -thickness / 2, thickness / 2))


def plate(width: float, thickness: float, low: float, high: float) -> Solid:
    """Return a plate in the plane of x and z, with round ends at two heights."""
    around = np.linspace(-pi / 2, pi / 2, 12)
    end = np.stack([np.cos(around), np.sin(around)], 1) * width / 2
    middle, half = (low + high) / 2, (high - low) / 2
    outline = np.concatenate([end + np.array([half, 0]), -end - np.array([half, 0])])
    return moved(_about_y(prism(outline, -thickness / 2, thickness / 2)), (0, 0, middle))


def jaw(width: float, length: float, root: float, side: int) -> Solid:
    """Return one of two jaws along z that begins at a root and tapers; side is 1 or -1."""
    profile = np.array([(0.04, 0), (1, 0), (0.95, 0.55), (0.35, 1), (0.04, 1)]) * (side * width / 2, length)
    profile = profile[:: -1 if side > 0 else 1]
    centre = profile.mean(0)
    solid = _about_y(prism(profile[:, ::-1] - centre[::-1], -width / 3, width / 3))
    return moved(solid, (centre[0], 0, centre[1] + root))


def moved(solid: Solid, by: tuple[float, float, float]) -> Solid:
    """Return a solid somewhere else."""
    return Solid(solid.vertices + np.asarray(by, float), solid.faces)


def turned(solid: Solid) -> Solid:
    """Return a solid a quarter turn about z: what lay along x lies along y."""
    x, y, z = solid.vertices.T
    return Solid(np.stack([-y, x, z], 1), solid.faces)


def joined(*solids: Solid) -> Solid:
    """Return several solids as one."""
    starts = np.cumsum([0, *(len(solid.vertices) for solid in solids)])
    faces = [solid.faces + np.uint32(start) for solid, start in zip(solids, starts, strict=False)]
    return Solid(np.concatenate([solid.vertices for solid in solids]), np.concatenate(faces))


def _circle(radius: float, sides: int) -> Array:
    around = np.linspace(0, 2 * pi, sides, endpoint=False)
    return radius * np.stack([np.cos(around), np.sin(around)], 1)


def _about_y(solid: Solid) -> Solid:
    """Return what was about z, seen along it with x to z and y to x, about y."""
    x, y, z = solid.vertices.T
    return Solid(np.stack([y, z, x], 1), solid.faces)
