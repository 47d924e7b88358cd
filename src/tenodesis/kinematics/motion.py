"""Forward kinematics, Jacobian and inverse kinematics of the chain through the port."""

from collections.abc import Mapping
from math import degrees, pi, prod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tenodesis import _core
from tenodesis.errors import ArgumentError, NoSolutionError
from tenodesis.instrument import InstrumentLike, ShortForm, as_short_form
from tenodesis.kinematics.dimensions import chain, dimensions, limits
from tenodesis.run import TENDONS
from tenodesis.statics.query import FloatOrArray, common_shape, numbers
from tenodesis.threads import threads

_Array = NDArray[np.float64]

_FARTHEST = 1e6  # m

COORDINATES = ("pan", "tilt", "spin", "insertion", "yaw", "pitch", "roll")
"""The coordinates that determine the pose of the tip, in the order of the Jacobian's columns."""


class Posture(NamedTuple):
    """Coordinates of every joint, rad and m, numbers or arrays that broadcast."""

    pan: ArrayLike = 0.0
    """Of the stem about the port, toward x."""
    tilt: ArrayLike = 0.0
    """Of the stem about the port, toward y, within the panned plane."""
    spin: ArrayLike = 0.0
    """Of the stem about itself."""
    insertion: ArrayLike | None = None
    """Of the stem's distal end beyond the port, m; by default the instrument's at rest."""
    yaw: ArrayLike = 0.0
    """Output angle of the yaw joint."""
    pitch: ArrayLike = 0.0
    """Output angle of the pitch joint."""
    roll: ArrayLike = 0.0
    """Of the end-effector about itself."""
    handle_yaw: ArrayLike | None = None
    """Handle angle; by default that which gives the output angle without a load (eq. 18)."""
    handle_pitch: ArrayLike | None = None
    """Likewise of the pitch joint."""


class Frame(NamedTuple):
    """Position (..., 3), m, and orientation of a body, a quaternion w, x, y, z (..., 4)."""

    position: _Array
    quaternion: _Array


class Frames(NamedTuple):
    """What to draw of an instrument: frames by body, and polylines (..., points, 3) by tendon, m.

    Bodies are "stem" (at its distal end), "yaw_carrier" and "yaw_far" (the link between the centres of a gear pair, at
    the near one, and the far gear at its own), likewise for pitch, "end_effector" (at the last far body, rolled), "tip"
    (where the force acts), and at the other end "handle_yaw_carrier", "handle_yaw_far", likewise for pitch, and "grip"
    (where the hand acts). The z axis of each points along it, from handle to tip. Tendons are "yaw_agonist",
    "yaw_antagonist" and likewise for pitch, from the handle's end to the tip's.
    """

    bodies: Mapping[str, Frame]
    tendons: Mapping[str, _Array]


def forward(inst: InstrumentLike, posture: Posture) -> Frame:
    """Return position (..., 3), m, and orientation (..., 4) of the tip at a posture (Fig. 1).

    Raises
    ------
    ValueError
        A coordinate is not finite, a bending angle is half a turn or more, or the instrument lacks its axis.
    InstrumentError
        The instrument's lengths leave no stem.
    """
    inst = as_short_form(inst)
    rows, shape = _rows(inst, posture)
    out = np.empty((len(rows), 7))
    _core.chain_tip(chain(inst), rows, out, threads())
    return _frame(out, shape)


def frames(inst: InstrumentLike, posture: Posture) -> Frames:
    """Return the frames of all bodies and the polylines of all tendons at a posture, m; errors as :func:`forward`.

    Where a handle angle is left out and the handle cannot bend so far, the handle's bodies and the tendons are NaN.
    """
    inst = as_short_form(inst)
    bound = chain(inst)
    rows, shape = _rows(inst, posture)
    names, length = bound.frame_names, bound.path_length
    out = np.empty((len(rows), len(names), 7))
    _core.chain_frames(bound, rows, out, threads())
    bodies = {name: _frame(out[:, i], shape) for i, name in enumerate(names)}
    tendons = [f"{axis}_{side}" for axis in inst.axes for side in TENDONS]
    points = np.empty((len(rows), len(tendons) * length, 3))
    _core.chain_paths(bound, rows, points)
    paths = points.reshape(*shape, len(tendons), length, 3)
    return Frames(bodies, {name: paths[..., i, :, :] for i, name in enumerate(tendons)})


def jacobian(inst: InstrumentLike, posture: Posture) -> _Array:
    """Return the Jacobian of the tip (..., 6, 7): velocity (m/s) over angular velocity (rad/s) in the port's frame.

    Columns are pan, tilt, spin, insertion, yaw, pitch, roll; zero for an axis that the instrument does not have. Errors
    are those of :func:`forward`.
    """
    inst = as_short_form(inst)
    rows, shape = _rows(inst, posture)
    out = np.empty((len(rows), 6, len(COORDINATES)))
    _core.chain_jacobian(chain(inst), rows, out, threads())
    return np.ascontiguousarray(out[..., _column_order(inst)]).reshape(*shape, 6, len(COORDINATES))


def inverse(
    inst: InstrumentLike,
    position: ArrayLike,
    quaternion: ArrayLike,
    spin: ArrayLike = 0.0,
    *,
    near: Posture | None = None,
) -> Posture:
    """Return the posture that brings the tip to a goal, by Newton's method in two unknowns (Fig. 1).

    Parameters
    ----------
    position
        Of the tip in the port's frame (..., 3), m.
    quaternion
        Orientation of the tip (..., 4), w, x, y, z, of length one to 1e-6.
    spin
        Spin of the stem, rad. With yaw and pitch the chain has one joint more than a goal needs, and keeps this spin;
        with one bending axis the spin follows from the goal, within a quarter turn of this one.
    near
        Where to start from, by pan and tilt: the posture before, on a path. With the second joint bent by more than
        about 60 deg a goal may have several postures.

    Returns
    -------
    Posture
        Its tip is at the goal within 1e-13 m and rad for instruments of up to a metre. Joint limits are not
        considered, see :func:`within_limits`. In arrays, NaN where no posture was found.

    Raises
    ------
    ValueError
        An argument is not finite, or has no such shape, a position is beyond 1000 km, or the quaternion's length is not
        one.
    NoSolutionError
        A single goal is not reached, or is where two joints turn about one axis.
    InstrumentError
        The instrument's lengths leave no stem.
    """
    inst = as_short_form(inst)
    places, turns = finite("position", position, 3), finite("quaternion", quaternion, 4)
    if places.size and not np.abs(places).max() <= _FARTHEST:
        worst = places.flat[int(np.abs(places).argmax())]
        raise ArgumentError(key="position", value=float(worst), allowed=f"from {-_FARTHEST:g} to {_FARTHEST:g} m")
    if near is not None:
        near = _posture("near", near)
    start = [finite("spin", spin)]
    start += [np.full((), np.nan)] * 2 if near is None else [finite("pan", near.pan), finite("tilt", near.tilt)]
    angles = {key: angle.shape for key, angle in zip(("spin", "pan", "tilt"), start, strict=True)}
    shape = common_shape({"position[..., 0]": places.shape[:-1], "quaternion[..., 0]": turns.shape[:-1]} | angles)
    lengths = np.linalg.norm(turns, axis=-1, keepdims=True)
    if lengths.size and not np.abs(lengths - 1).max() <= 1e-6:
        worst = lengths.flat[np.abs(lengths - 1).argmax()]
        raise ArgumentError(
            f"quaternion has length {worst:.6g}; it must be a unit quaternion, w, x, y, z.",
            key="quaternion",
            value=float(worst),
            allowed="a unit quaternion",
        )
    count = prod(shape)
    goals = np.empty((count, 7))
    goals[:, :3] = np.broadcast_to(places, (*shape, 3)).reshape(count, 3)
    goals[:, 3:] = np.broadcast_to(turns / lengths, (*shape, 4)).reshape(count, 4)
    out, reach = np.empty((count, len(COORDINATES))), np.empty(count, np.uint8)
    starts = np.stack([np.broadcast_to(angle, shape).reshape(count) for angle in start], axis=-1)
    _core.chain_inverse(chain(inst), goals, starts, out, reach, threads())
    if shape == () and reach[0] != _core.Reach.OK:
        raise NoSolutionError(_unreached(inst, goals[0], _core.Reach(int(reach[0]))))
    columns = out[:, _column_order(inst)].T
    found = [float(column[0]) if shape == () else column.reshape(shape) for column in columns]
    return Posture(**dict(zip(COORDINATES, found, strict=True)))


def within_limits(inst: InstrumentLike, posture: Posture) -> FloatOrArray:
    """Return whether every coordinate of the tip is within its limits, see :func:`limits`; False where any is NaN.

    Raises ValueError if a coordinate is no number, and InstrumentError if the instrument's lengths leave no stem.
    """
    inst = as_short_form(inst)
    posture = _posture("posture", posture)
    inside: Any = True
    for name, (least, most) in limits(inst)._asdict().items():
        value = getattr(posture, name)
        value = dimensions(inst).insertion if value is None else numbers(name, value)
        slack = 1e-9 * (1 + abs(most))
        inside = inside & (value >= least - slack) & (value <= most + slack)
    return inside if np.ndim(inside) else bool(inside)


def _posture(key: str, value: Posture) -> Posture:
    if not isinstance(value, Posture):
        raise TypeError(f"{key} is {value!r}; it must be a Posture.")
    return value


def finite(key: str, value: ArrayLike, length: int | None = None) -> _Array:
    """Return an argument as finite float64, with its last dimension checked."""
    array = numbers(key, value)
    if length is not None and (array.ndim == 0 or array.shape[-1] != length):
        raise ArgumentError(f"{key} has shape {array.shape}; it must be (..., {length}).", key=key, value=array.shape)
    if not np.isfinite(array).all():
        first = array.flat[int(np.argmax(~np.isfinite(array)))]
        raise ArgumentError(key=key, value=float(first), allowed="a finite number")
    return array


def _rows(inst: ShortForm, posture: Posture) -> tuple[_Array, tuple[int, ...]]:
    """Return a posture as rows of the core's coordinates, and the shape that it broadcasts to."""
    rest = dimensions(inst).insertion
    values: dict[str, Any] = _posture("posture", posture)._asdict()
    if values["insertion"] is None:
        values["insertion"] = rest
    given = {key: finite(key, value) for key, value in values.items() if value is not None}
    for axis in ("yaw", "pitch"):
        for key in (axis, f"handle_{axis}"):
            angle = given.get(key, np.zeros(()))
            if axis not in inst.axes and angle.any():
                worst = float(angle.flat[int(np.abs(angle).argmax())])
                raise ArgumentError(f"{key} is {worst:g} rad; {inst.name} has no such axis.", key=key, value=worst)
            if angle.size and not np.abs(angle).max() < pi:
                worst = angle.flat[int(np.abs(angle).argmax())]
                raise ArgumentError(
                    f"{key} is {worst:.6g} rad ({degrees(worst):.6g} deg); it must be less than half a turn.",
                    key=key,
                    value=float(worst),
                    allowed="less than half a turn",
                )
    shape = common_shape({key: value.shape for key, value in given.items()})
    rows = np.zeros((prod(shape), 9))
    bends = list(inst.axes)
    for place, key in [
        *enumerate(("pan", "tilt", "spin", "insertion")),
        *((4 + i, axis) for i, axis in enumerate(bends)),
        (6, "roll"),
        *((7 + i, f"handle_{axis}") for i, axis in enumerate(bends)),
    ]:
        value = given.get(key)
        rows[:, place] = np.nan if value is None else np.broadcast_to(value, shape).reshape(-1)
    return rows, shape


def _column_order(inst: ShortForm) -> list[int]:
    """Return the index of each coordinate in the core: bending joints from the stem outward."""
    bends = [*inst.axes, *({"yaw", "pitch"} - set(inst.axes))]
    return [0, 1, 2, 3, 4 + bends.index("yaw"), 4 + bends.index("pitch"), 6]


def _frame(rows: _Array, shape: tuple[int, ...]) -> Frame:
    return Frame(rows[:, :3].reshape(*shape, 3), rows[:, 3:].reshape(*shape, 4))


def _unreached(inst: ShortForm, goal: _Array, reach: _core.Reach) -> str:
    place = ", ".join(f"{value:.6g}" for value in goal[:3])
    reasons = {
        _core.Reach.UNREACHABLE: "no posture brings the tip there; it must be farther from the port than the "
        "end-effector and its joints reach, or in another orientation",
        _core.Reach.SINGULAR: "two of its joints turn about the same axis there; give a goal near it",
    }
    return f"inverse of {inst.name} at position = ({place}) m: {reasons[reach]}."
