"""Links and tip of a coupled instrument in space, and the Jacobian, by the chain of its joints.

Frames are those of the stem: its tip end is the origin, z points along it toward the tip. Every joint turns by half its
angle, moves along its chord, and turns by the other half.
"""

from collections.abc import Iterator, Mapping, Sequence
from math import pi
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tenodesis.coupled.description import SIGNS, CoupledInstrument, Crossing, Joint, Tendon
from tenodesis.coupled.reading import CoupledLike, load
from tenodesis.errors import ArgumentError
from tenodesis.kinematics import Frame, Frames
from tenodesis.kinematics.motion import finite
from tenodesis.statics.query import common_shape

Array: TypeAlias = NDArray[np.float64]

STEM = 0.1
"""Length of the stem where a file gives none, m."""
_STATIONS = np.linspace(0.0, 1.0, 9)  # along a backbone, of its tendons' points
_Z = np.array([0.0, 0.0, 1.0])


class _Bent(NamedTuple):
    """A joint at its angles (...): where it begins, its middle, where it ends, and its axis there."""

    near: Frame
    middle: Frame
    far: Frame
    axis: Array


def frames(inst: CoupledLike, angles: ArrayLike, handle_angles: ArrayLike = 0.0) -> Frames:
    """Return the frames of all links and the polylines of all tendons, m; for a view and for exported models.

    Bodies are "stem" (at its tip end), of each joint "NAME_far", the link that it turns, and "NAME_carrier" between
    near and far end, turned by half the angle, at the near one (not of pulleys), and "NAME_tip" where forces act or an
    object is held, "NAME_grip" where the hand acts. The z axis of each points along it, from handle to tip. A tendon
    without a joint at the handle begins at the stem's handle end.

    Parameters
    ----------
    inst
        A coupled instrument, or a planar one, or its name or path.
    angles
        Of the tip's joints, (..., joints), rad; 0 for all.
    handle_angles
        Of the handle's joints, (..., handle joints), rad; 0 for all.

    Raises
    ------
    ArgumentError
        An angle is not finite, or half a turn or more, or a shape does not fit the instrument.
    """
    inst = load(inst)
    tips, handles = inst.tip_joints, inst.handle_joints
    rows = {
        "angles": angle_rows("angles", angles, tips),
        "handle_angles": angle_rows("handle_angles", handle_angles, handles),
    }
    shape = common_shape({key: value.shape[:-1] for key, value in rows.items()})
    tip, handle = (np.broadcast_to(value, (*shape, value.shape[-1])) for value in rows.values())
    stem = _frame(np.zeros((*shape, 3)), np.broadcast_to([1.0, 0, 0, 0], (*shape, 4)))
    bottom = _beyond(stem, -(inst.stem_length or STEM))
    bent = _chain(handles, range(-1, len(handles) - 1), handle, bottom, -1.0)
    bent |= _chain(tips, inst.parents, tip, stem, 1.0)
    bodies = {"stem": stem}
    for joint in inst.joints:
        if joint.mechanism != "pulley":
            bodies[f"{joint.name}_carrier"] = bent[joint.name].middle
        far = bodies[f"{joint.name}_far"] = bent[joint.name].far
        reach = end_length(inst, joint)
        if reach is not None:
            at_tip = joint.place == "tip"
            bodies[f"{joint.name}_{'tip' if at_tip else 'grip'}"] = _beyond(far, reach if at_tip else -reach)
    given = dict(zip([joint.name for joint in (*handles, *tips)], np.moveaxis(np.concatenate([handle, tip], -1), -1, 0),
                     strict=True))  # fmt: skip
    return Frames(bodies, {tendon.name: _path(inst, tendon, bent, given, bottom) for tendon in inst.tendons})


def tip_pose(inst: CoupledLike, angles: ArrayLike) -> Frame:
    """Return position (..., ends, 3), m, and orientation (..., ends, 4), w, x, y, z, of the ends at which forces act.

    There is one end, or one a jaw: the joints of :attr:`CoupledInstrument.bearing`. Arguments and errors as
    :func:`frames`.
    """
    inst = load(inst)
    bodies = frames(inst, angles).bodies
    ends = [bodies[f"{inst.tip_joints[end].name}_tip"] for end in inst.bearing]
    return Frame(np.stack([end.position for end in ends], -2), np.stack([end.quaternion for end in ends], -2))


def jacobian(inst: CoupledLike, angles: ArrayLike) -> Array:
    """Return the rates of the ends by the angles, (..., ends, 6, joints): m/rad over rad/rad, in the stem's axes.

    Its transpose gives the moments of a wrench at the ends about the joints. Arguments and errors as :func:`frames`.
    """
    inst = load(inst)
    joints, tip = inst.tip_joints, angle_rows("angles", angles, inst.tip_joints)
    shape = tip.shape[:-1]
    stem = _frame(np.zeros((*shape, 3)), np.broadcast_to([1.0, 0, 0, 0], (*shape, 4)))
    bent = list(_chain(joints, inst.parents, tip, stem, 1.0).values())
    out = np.zeros((*shape, len(inst.bearing), 6, len(joints)))
    for row, end in enumerate(inst.bearing):
        at = _beyond(bent[end].far, joints[end].end_effector_length or 0.0).position
        i = end
        while i >= 0:
            near, middle, far, axis = bent[i]
            stretch = _chord_rate(joints[i], tip[..., i, np.newaxis]) * rotated(middle.quaternion, _Z)
            arms = at - (near.position + far.position) / 2
            out[..., row, :3, i] = np.cross(axis, arms) + stretch
            out[..., row, 3:, i] = axis
            i = inst.parents[i]
    return out


def end_length(inst: CoupledInstrument, joint: Joint) -> float | None:
    """Return how far beyond a joint forces act or, if none do, a jaw holds an object, m."""
    held = inst.grip.length if inst.grip is not None and joint.name in inst.grip.jaws else None
    return held if joint.end_effector_length is None else joint.end_effector_length


def bend_side(axis_vector: tuple[float, float, float]) -> Array:
    """Return the unit vector (3,) to which a positive angle about an axis bends: that of the agonist."""
    axis = np.array(axis_vector)
    along = _Z if abs(axis[2]) < 0.999 else np.array([1.0, 0.0, 0.0])
    side = np.cross(axis, along)
    return np.asarray(side / np.linalg.norm(side))


def crossing_offset(joint: Joint, crossing: Crossing) -> Array:
    """Return where a tendon passes a joint, from its middle, (3,), m, in the link before."""
    radius = joint.radius if crossing.radius is None else crossing.radius
    return SIGNS[crossing.side] * radius * bend_side(joint.axis_vector)


def crossed(inst: CoupledInstrument, tendon: Tendon) -> list[tuple[Joint, Crossing]]:
    """Return the joints that a tendon crosses, in the order from the handle's end to the tip."""
    crossings = {crossing.joint: crossing for crossing in tendon.route}
    ordered = (*reversed(inst.handle_joints), *inst.tip_joints)
    return [(joint, crossings[joint.name]) for joint in ordered if joint.name in crossings]


def rotated(quaternion: Array, vector: Array) -> Array:
    """Return vectors (..., 3) turned by unit quaternions (..., 4)."""
    w, u = quaternion[..., :1], quaternion[..., 1:]
    twice = 2 * np.cross(u, vector)
    return np.asarray(vector + w * twice + np.cross(u, twice))


def chord(joint: Joint, angle: Array) -> Array:
    """Return the length of a joint's chord at angles (...), m: a backbone's shortens."""
    return joint.chord * (np.sinc(angle / (2 * pi)) if joint.mechanism == "continuum" else np.ones_like(angle))


def _chord_rate(joint: Joint, angle: Array) -> Array:
    """Return the rate of a joint's chord by its angle, m/rad."""
    if joint.mechanism != "continuum":
        return np.zeros_like(angle)
    half = angle / 2
    small = np.abs(half) < 1e-3
    safe = np.where(small, 1.0, half)
    exact = (np.cos(safe) - np.sin(safe) / safe) / safe
    return np.asarray(joint.chord / 2 * np.where(small, -half / 3 * (1 - half**2 / 10), exact))


def _chain(
    joints: Sequence[Joint], parents: Sequence[int], angles: Array, start: Frame, side: float
) -> dict[str, _Bent]:
    """Return the joints at their angles (..., joints), by name; side is -1 where they point to the handle."""
    found: list[_Bent] = []
    for i, (joint, parent) in enumerate(zip(joints, parents, strict=True)):
        near = _beyond(start if parent < 0 else found[parent].far, side * joint.offset)
        angle, axis = angles[..., i, np.newaxis], np.array(joint.axis_vector)
        half = np.concatenate([np.cos(angle / 4), np.sin(angle / 4) * axis], -1)
        middle = _frame(near.position, _product(near.quaternion, half))
        far = _beyond(middle, side * chord(joint, angle))
        far = _frame(far.position, _product(middle.quaternion, half))
        found.append(_Bent(near, middle, far, rotated(near.quaternion, axis)))
    return {joint.name: bent for joint, bent in zip(joints, found, strict=True)}


def _path(
    inst: CoupledInstrument, tendon: Tendon, bent: Mapping[str, _Bent], angles: Mapping[str, Array], bottom: Frame
) -> Array:
    """Return the points (..., points, 3) that a tendon runs through, from the handle's end to the tip."""
    points: list[Array] = []
    passed = crossed(inst, tendon)
    if passed[0][0].place == "tip":
        points.append(bottom.position + crossing_offset(*passed[0]))
    for joint, crossing in passed:
        over = list(_over(joint, crossing_offset(joint, crossing), bent[joint.name], angles[joint.name][..., None]))
        points += over if joint.place == "tip" else over[::-1]
    return np.stack(points, -2)


def _over(joint: Joint, offset: Array, bent: _Bent, angle: Array) -> Iterator[Array]:
    """Yield a tendon's points over a joint, outward."""
    if joint.mechanism == "continuum":
        yield from arc(joint, bent.middle, angle, offset)
        return
    near, middle, far, _ = bent
    for frame in (near, far) if joint.mechanism == "tendon-gear" else (near, middle, far):
        yield frame.position + rotated(frame.quaternion, offset)


def arc(joint: Joint, carrier: Frame, angle: Array, offset: ArrayLike = 0.0) -> Iterator[Array]:
    """Yield points along a bent backbone, outward, or at an offset from it (3,), m; angle (..., 1), rad."""
    axis, side = np.array(joint.axis_vector), 1.0 if joint.place == "tip" else -1.0

    def turned(angle: Array) -> Array:
        return np.concatenate([np.cos(angle / 2), np.sin(angle / 2) * axis], -1)

    for station in _STATIONS:
        toward = _product(carrier.quaternion, turned((station - 1) * angle / 2))
        along = side * station * chord(joint, station * angle)
        there = _product(toward, turned(station * angle / 2))
        yield carrier.position + along * rotated(toward, _Z) + rotated(there, np.broadcast_to(offset, 3))


def angle_rows(key: str, value: ArrayLike, joints: Sequence[Joint]) -> Array:
    """Return angles with the joints in the last axis; a single 0 stands for all zeros."""
    if np.ndim(value) == 0 and not np.any(value):
        return np.zeros(len(joints))
    rows = finite(key, value, len(joints))
    if rows.size and not np.abs(rows).max() < pi:
        worst = float(rows.flat[int(np.abs(rows).argmax())])
        raise ArgumentError(key=key, value=worst, allowed="less than half a turn")
    return rows


def _frame(position: Array, quaternion: Array) -> Frame:
    return Frame(position, np.where(quaternion[..., :1] < 0, -quaternion, quaternion))


def _beyond(frame: Frame, length: float | Array) -> Frame:
    """Return a frame moved along its z, m."""
    return Frame(frame.position + length * rotated(frame.quaternion, _Z), frame.quaternion)


def _product(first: Array, then: Array) -> Array:
    """Return the product of quaternions."""
    w, u, x, v = first[..., :1], first[..., 1:], then[..., :1], then[..., 1:]
    scalar = w * x - (u * v).sum(-1, keepdims=True)
    return np.concatenate([scalar, w * v + x * u + np.cross(u, v)], -1)
