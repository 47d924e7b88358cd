"""Forward kinematics, Jacobian and inverse kinematics of an instrument."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees, pi, prod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tenodesis import _core, statics
from tenodesis.errors import ArgumentError, NoSolutionError
from tenodesis.instrument import InstrumentLike, Joint, ShortForm, as_short_form
from tenodesis.kinematics.chain import Array, Skeleton, skeleton
from tenodesis.kinematics.dimensions import dimensions, limits
from tenodesis.statics.query import FloatOrArray, common_shape, numbers
from tenodesis.threads import threads

_FARTHEST = 1e6  # m

COORDINATES = ("pan", "tilt", "spin", "insertion", "yaw", "pitch", "roll")
"""The coordinates that determine the pose of the tip, in the order of the Jacobian's columns."""


class Posture(NamedTuple):
    """Coordinates of an instrument that bends by yaw and pitch, rad and m, numbers or arrays that broadcast."""

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


class Port(NamedTuple):
    """Coordinates of the stem in its port and of the end-effectors' roll, rad and m, as in a :class:`Posture`."""

    pan: ArrayLike = 0.0
    tilt: ArrayLike = 0.0
    spin: ArrayLike = 0.0
    insertion: ArrayLike | None = None
    """By default the instrument's at rest; 0 without a port in its file, so that the stem's tip end is the origin."""
    roll: ArrayLike = 0.0


AT_REST = Port()


class Frame(NamedTuple):
    """Position (..., 3), m, and orientation of a body, a quaternion w, x, y, z (..., 4)."""

    position: Array
    quaternion: Array


class Frames(NamedTuple):
    """What to draw of an instrument: frames by body, and polylines (..., points, 3) by tendon and by backbone, m.

    Bodies are "stem" (at its distal end), and of each joint "NAME_far", the link that it turns, and "NAME_carrier" (the
    link between the centres of a gear pair, at the near one; not of pulleys); of the handle of a planar instrument
    "handle_yaw_far" and so on. Beyond the last are "NAME_tip" (where the force acts, or an object is held) and
    "NAME_grip" (where the hand acts), of a planar instrument "end_effector" (rolled), "tip" and "grip". The z axis of
    each points along it, from handle to tip. Tendons run from the handle's end, or the stem's if they have no joint
    there, to the tip's; backbones, by joint, from the stem outward.
    """

    bodies: Mapping[str, Frame]
    tendons: Mapping[str, Array]
    backbones: Mapping[str, Array]


def forward(inst: InstrumentLike, posture: Posture) -> Frame:
    """Return position (..., 3), m, and orientation (..., 4) of the tip at a posture (Fig. 1).

    Raises
    ------
    ValueError
        A coordinate is not finite, a bending angle is half a turn or more, or the instrument lacks its axis.
    InstrumentError
        The instrument is not planar, or its lengths leave no stem.
    """
    return _bodies(skeleton(inst), *_rows(inst, _posture("posture", posture)))["tip"]


def tip_pose(inst: InstrumentLike, angles: ArrayLike, *, port: Port = AT_REST) -> Frame:
    """Return position (..., ends, 3), m, and orientation (..., ends, 4), w, x, y, z, of the ends at which forces act.

    There is one end, or one a jaw: those of the joints with an end_effector_length. Arguments and errors as
    :func:`frames`.
    """
    of = skeleton(inst)
    bodies = _bodies(of, *_rows(inst, angles, port=port))
    ends = [bodies[of.end(of.inst.tip_joints[end], "tip")] for end in of.inst.bearing]
    return Frame(np.stack([end.position for end in ends], -2), np.stack([end.quaternion for end in ends], -2))


def frames(
    inst: InstrumentLike, angles: Posture | ArrayLike, handle_angles: ArrayLike = 0.0, *, port: Port = AT_REST
) -> Frames:
    """Return the frames of all bodies and the polylines of all tendons and backbones, m.

    Parameters
    ----------
    inst
        Any instrument.
    angles
        A posture, or the angles of the tip's joints, (..., joints), rad; 0 for all.
    handle_angles
        Of the handle's joints, (..., handle joints), rad; 0 for all. A posture has its own: where one is left out and
        the handle cannot bend so far, the handle's bodies and the tendons are NaN.
    port
        Where the stem is; a posture has its own.

    Raises
    ------
    ArgumentError
        An angle is not finite, or half a turn or more, or a shape does not fit the instrument.
    InstrumentError
        The instrument's lengths leave no stem, or a posture is given and it is not planar.
    """
    of = skeleton(inst)
    rows, shape = _rows(inst, angles, handle_angles, port)
    lengths = of.core.line_lengths
    points = np.empty((len(rows), sum(lengths), 3))
    _core.chain_lines(of.core, rows, points)
    paths = [path.reshape(*shape, -1, 3) for path in np.split(points, np.cumsum(lengths)[:-1], axis=1)]
    tendons = [tendon.name for tendon in of.inst.tendons]
    backbones = [
        joint.name
        for joint in (*of.inst.tip_joints, *of.inst.handle_joints)
        if joint.mechanism == "continuum" and of.inside(joint) is None
    ]
    return Frames(
        _bodies(of, rows, shape),
        dict(zip(tendons, paths, strict=False)),
        dict(zip(backbones, paths[len(tendons) :], strict=True)),
    )


def jacobian(inst: InstrumentLike, angles: Posture | ArrayLike, *, port: Port = AT_REST) -> Array:
    """Return the Jacobian: velocity (m/s) over angular velocity (rad/s) of the tip in the port's frame.

    At a posture (..., 6, 7): columns are pan, tilt, spin, insertion, yaw, pitch, roll; zero for an axis that the
    instrument does not have. At angles of the tip's joints (..., ends, 6, joints), of the ends of :func:`tip_pose`; its
    transpose gives the moments of a wrench at the ends about the joints. Errors are those of :func:`frames`.
    """
    of = skeleton(inst)
    rows, shape = _rows(inst, angles, port=port)
    joints, ends = len(of.inst.tip_joints), of.inst.bearing
    out = np.empty((len(rows), len(ends), 6, 5 + joints))
    _core.chain_jacobian(of.core, rows, list(ends), out, threads())
    if not isinstance(angles, Posture):
        return np.ascontiguousarray(out[..., 4 : 4 + joints]).reshape(*shape, len(ends), 6, joints)
    found = np.zeros((len(rows), 6, len(COORDINATES)))
    found[..., [COORDINATES.index(key) for key in _columns(as_short_form(inst))]] = out[:, 0]
    return found.reshape(*shape, 6, len(COORDINATES))


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
    keys = _columns(inst)
    out, reach = np.empty((count, len(keys))), np.empty(count, np.uint8)
    starts = np.stack([np.broadcast_to(angle, shape).reshape(count) for angle in start], axis=-1)
    _core.chain_inverse(skeleton(inst).core, goals, starts, out, reach, threads())
    if shape == () and reach[0] != _core.Reach.OK:
        raise NoSolutionError(_unreached(inst, goals[0], _core.Reach(int(reach[0]))), key="goal", value=goals[0])
    columns = [column[0].item() if shape == () else column.reshape(shape) for column in out.T]
    straight: Any = 0.0 if shape == () else np.where(reach.reshape(shape) == _core.Reach.OK, 0.0, np.nan)
    return Posture(**dict.fromkeys(COORDINATES, straight) | dict(zip(keys, columns, strict=True)))


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


def finite(key: str, value: ArrayLike, length: int | None = None) -> Array:
    """Return an argument as finite float64, with its last dimension checked."""
    array = numbers(key, value)
    if length is not None and (array.ndim == 0 or array.shape[-1] != length):
        raise ArgumentError(f"{key} has shape {array.shape}; it must be (..., {length}).", key=key, value=array.shape)
    if not np.isfinite(array).all():
        first = array.flat[int(np.argmax(~np.isfinite(array)))]
        raise ArgumentError(key=key, value=float(first), allowed="a finite number")
    return array


def angle_rows(key: str, value: ArrayLike, joints: Sequence[Joint]) -> Array:
    """Return angles with the joints in the last axis; a single 0 stands for all zeros."""
    if np.ndim(value) == 0 and not np.any(value):
        return np.zeros(len(joints))
    rows = finite(key, value, len(joints))
    if rows.size and not np.abs(rows).max() < pi:
        worst = float(rows.flat[int(np.abs(rows).argmax())])
        raise ArgumentError(key=key, value=worst, allowed="less than half a turn")
    return rows


class Coordinates(NamedTuple):
    """Coordinates of a chain by name; apart, since a joint may be named as a coordinate of the stem is."""

    port: dict[str, Array]
    """Those of a :class:`Port`."""
    joints: dict[str, Array]
    """Of all joints."""


def coordinates(
    inst: InstrumentLike,
    angles: Posture | ArrayLike,
    handle_angles: ArrayLike = 0.0,
    port: Port = AT_REST,
    *,
    reachable: bool = False,
) -> Coordinates:
    """Return every coordinate (...), rad and m.

    Arguments and errors as :func:`frames`. A handle angle of a posture that its handle cannot reach is NaN, or refused
    with a NoSolutionError if it is a single one that must be reachable.
    """
    of = skeleton(inst)
    tips, handles = of.inst.tip_joints, of.inst.handle_joints
    if isinstance(angles, Posture):
        return _named(as_short_form(inst), angles, reachable=reachable)
    rows = {
        "angles": angle_rows("angles", angles, tips),
        "handle_angles": angle_rows("handle_angles", handle_angles, handles),
    }
    placed = port._replace(insertion=of.insertion if port.insertion is None else port.insertion)
    found = Coordinates({key: finite(key, value) for key, value in placed._asdict().items()}, {})
    common_shape(
        {key: value.shape[:-1] for key, value in rows.items()} | {key: value.shape for key, value in found.port.items()}
    )
    for joints, value in zip((tips, handles), rows.values(), strict=True):
        found.joints.update({joint.name: value[..., place] for place, joint in enumerate(joints)})
    return found


def _named(inst: ShortForm, posture: Posture, *, reachable: bool) -> Coordinates:
    values: dict[str, Any] = posture._asdict()
    if values["insertion"] is None:
        values["insertion"] = dimensions(inst).insertion
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
    common_shape({key: value.shape for key, value in given.items()})
    for axis, planar in zip(inst.axes, inst.planar, strict=True):
        if f"handle_{axis}" not in given:
            angle = given[axis] if reachable else np.atleast_1d(given[axis])
            given[f"handle_{axis}"] = np.reshape(statics.handle_angle(planar, angle), given[axis].shape)
    joints = (*inst.axes, *(f"handle_{axis}" for axis in inst.axes))
    return Coordinates({key: given[key] for key in Port._fields}, {key: given[key] for key in joints})


def _rows(
    inst: InstrumentLike, angles: Posture | ArrayLike, handle_angles: ArrayLike = 0.0, port: Port = AT_REST
) -> tuple[Array, tuple[int, ...]]:
    """Return coordinates as rows of the core's, and the shape that they broadcast to."""
    of = skeleton(inst)
    given = coordinates(inst, angles, handle_angles, port)
    tips, handles = ([given.joints[one.name] for one in own] for own in (of.inst.tip_joints, of.inst.handle_joints))
    columns = [*(given.port[key] for key in COORDINATES[:4]), *tips, given.port["roll"], *handles]
    shape = np.broadcast_shapes(*(column.shape for column in columns))
    rows = np.empty((prod(shape), len(columns)))
    for place, column in enumerate(columns):
        rows[:, place] = np.broadcast_to(column, shape).reshape(-1)
    return rows, shape


def _columns(inst: ShortForm) -> list[str]:
    """Return the coordinates of the tip in the core's order."""
    return [*COORDINATES[:4], *inst.axes, "roll"]


def _bodies(of: Skeleton, rows: Array, shape: tuple[int, ...]) -> dict[str, Frame]:
    places = of.bodies
    out = np.empty((len(rows), 1 + 4 * len(of.inst.tip_joints) + 3 * len(of.inst.handle_joints), 7))
    _core.chain_frames(of.core, rows, out, threads())
    return {
        name: Frame(out[:, place, :3].reshape(*shape, 3), out[:, place, 3:].reshape(*shape, 4))
        for name, place in places.items()
    }


def _unreached(inst: ShortForm, goal: Array, reach: _core.Reach) -> str:
    place = ", ".join(f"{value:.6g}" for value in goal[:3])
    reasons = {
        _core.Reach.UNREACHABLE: "no posture brings the tip there; it must be farther from the port than the "
        "end-effector and its joints reach, or in another orientation",
        _core.Reach.SINGULAR: "two of its joints turn about the same axis there; give a goal near it",
    }
    return f"inverse of {inst.name} at position = ({place}) m: {reasons[reach]}."
