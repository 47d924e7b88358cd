"""Cross-section of the workspace: where the tip can be, and in which directions it can point there, loaded or not."""

from functools import lru_cache
from math import isfinite
from numbers import Integral, Real
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tenodesis import statics
from tenodesis.errors import ArgumentError
from tenodesis.instrument import AxisName, InstrumentLike, ShortForm, as_short_form
from tenodesis.kinematics.dimensions import limits
from tenodesis.kinematics.motion import Posture, forward, inverse

_Array = NDArray[np.float64]

_DIRECTIONS = 361  # within the working range
_HANDLE_ANGLES = 181


class Workspace(NamedTuple):
    """A cross-section of the workspace through the port, in polar coordinates about it.

    The plane is that of pan and yaw, or of tilt and pitch for an instrument that only pitches. It is the entire
    workspace of an instrument with one axis; the joints of a second axis are straight in it.
    """

    distance: _Array
    """From port to tip (n,), m."""
    angle: _Array
    """Of the way from port to tip, from z (m,), rad."""
    span: _Array
    """Width of the range of directions the end-effector can point in there (m, n), rad; 0 where the tip cannot be."""
    bend: float
    """Largest output angle to either side, rad: output_range, or what the handle's range allows under the load."""

    @property
    def area(self) -> float:
        """Area that the tip can reach, m^2."""
        return float((self._cells * (self.span > 0)).sum())

    @property
    def mean_span(self) -> float:
        """Mean of the span over the area that the tip can reach, rad; 0 if there is none."""
        area = self.area
        return float((self._cells * self.span).sum()) / area if area else 0.0

    def area_with(self, span: float) -> float:
        """Return the area, m^2, where the end-effector can point over at least this span, rad."""
        return float((self._cells * (self.span >= span)).sum())

    @property
    def _cells(self) -> _Array:
        rows, columns = np.gradient(self.angle), np.gradient(self.distance)
        return np.outer(rows, columns * self.distance)


def workspace(inst: InstrumentLike, force: float = 0.0, *, points: int = 121) -> Workspace:
    """Return the cross-section of the workspace within the limits of the joints (Fig. 1).

    It has `points` distances and as many angles. The force (N) is tangential at the tip and opposes flexion to either
    side: it limits the bend to the output angle that remains at the end of the handle's range.

    Raises ValueError if the force is negative or not finite, or there are fewer than two points, and InstrumentError if
    the instrument's lengths leave no stem.
    """
    inst = as_short_form(inst)
    bounds = limits(inst)
    if not (isinstance(force, Real) and isfinite(force) and force >= 0):
        raise ArgumentError(key="force", value=force, allowed="a finite force of at least 0 N")
    if not (isinstance(points, Integral) and points >= 2):
        raise ArgumentError(key="points", value=points, allowed="an integer of at least 2")
    bend = _largest_bend(inst.axis(_axis(inst)), force)
    ray = _ray(inst, int(points))
    least, most = bounds.insertion
    possible = (np.abs(ray.bend) <= bend) & (ray.insertion >= least) & (ray.insertion <= most)
    reach = bounds.pan[1]
    angle = np.linspace(-1.0, 1.0, points) * (reach + ray.direction[-1])
    within = possible[None] & (np.abs(ray.pivot[None] + angle[:, None, None]) <= reach)
    step = ray.direction[1] - ray.direction[0]
    return Workspace(ray.distance, angle, within.sum(axis=2) * step, bend)


class _Ray(NamedTuple):
    """Postures that bring the tip onto the port's axis, by distance (n,), m, and by pointing direction (k,), rad."""

    distance: _Array
    direction: _Array
    bend: _Array
    pivot: _Array
    insertion: _Array


@lru_cache(maxsize=8)
def _ray(inst: ShortForm, points: int) -> _Ray:
    """Return the postures on a ray; except for the pivot's limit, the section is the same all around the port."""
    axis = _axis(inst)
    pivot, turn = ("pan", (0.0, 1.0)) if axis == "yaw" else ("tilt", (-1.0, 0.0))
    bounds = limits(inst)
    least, most = bounds.insertion
    widest = getattr(bounds, axis)[1]
    ends = forward(inst, Posture(insertion=np.array([most, least]), **{axis: np.array([0.0, widest])})).position[:, 2]
    distance = np.linspace(max(ends[1], 0.02 * ends[0]), ends[0], points)
    # A tip that is bent to a side is also displaced to it, so that it points less far from the ray than it is bent.
    direction = np.linspace(-widest, widest, _DIRECTIONS)
    position = np.stack(np.broadcast_arrays(0.0, 0.0, distance[:, None]), axis=-1)
    half = direction[None, :] / 2
    x, y = (share * np.sin(half) for share in turn)
    quaternion = np.stack(np.broadcast_arrays(np.cos(half), x, y, 0.0), axis=-1)
    found = inverse(inst, position, quaternion)
    bent, pivoted, inserted = (np.asarray(getattr(found, key)) for key in (axis, pivot, "insertion"))
    return _Ray(distance, direction, bent, pivoted, inserted)


def _axis(inst: ShortForm) -> AxisName:
    """Return the axis whose plane the section is in."""
    return "yaw" if "yaw" in inst.axes else "pitch"


def _largest_bend(axis: ShortForm, force: float) -> float:
    """Return the largest output angle of an axis against a load, rad, within its working range."""
    handle = np.linspace(0.0, axis.handle_range, _HANDLE_ANGLES)
    reached = np.asarray(statics.output_angle(axis, handle, force))
    held = reached[np.isfinite(reached)]
    return float(np.clip(held.max(), 0.0, axis.output_range)) if held.size else 0.0
