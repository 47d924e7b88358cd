"""Rows behind the equations: all joints of an instrument at rest, last axes by joint, tendon or wrench component."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple, TypeAlias, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tenodesis import _core
from tenodesis._core import Status
from tenodesis.errors import ArgumentError, NoSolutionError
from tenodesis.instrument import FullForm, InstrumentLike, Joint, expanded
from tenodesis.instrument.joints import MECHANISMS
from tenodesis.statics.query import Equilibrium, common_shape, numbers, place
from tenodesis.threads import threads

Array: TypeAlias = NDArray[np.float64]
Axes: TypeAlias = Literal["tip", "stem"]
_ROUNDING = 1e-9  # rad; that of a handle angle converted from degrees
_NO_ARM = 1e-12  # as a share of the largest
_MOST_CORRECTIONS = 40
_LONGEST_CORRECTION = 1e-3
"""Of a stroke at a time, m: where a tendon gets slack, Newton's step goes too far."""
_SETTLED = 1e-9
"""Angle below which a joint has arrived, rad."""

_REASONS = {
    Status.NO_EQUILIBRIUM: "there is no equilibrium on the branch that starts without a load, it ends in a fold where "
    "the joints snap through; the load must be smaller, or the pretension larger where a tendon is slack",
    Status.UNREACHABLE: "a joint would have to bend farther than its mechanism can",
    Status.BOTH_SLACK: "tendons are slack, so that nothing holds a joint; at least one of either side must be taut",
    Status.NO_AUTHORITY: "the tendons with motors cannot carry the load at these angles",
}


class Rates(NamedTuple):
    """How an instrument at rest answers to small changes; NaN where there is no equilibrium."""

    stiffness: Array
    """Moment by angle, (..., joints, joints), N m/rad; eq. 16 in one plane."""
    by_wrench: Array
    """Angles by force and moment at the tip, (..., joints, 6), rad/N and rad/(N m)."""
    by_grip: Array
    """Angles by grip force, (..., joints), rad/N."""
    by_stroke: Array
    """Angles by the tendons that motors wind, (..., joints, tendons), rad/m."""
    by_handle: Array
    """Angles by the handle's angles, (..., joints, handle joints)."""

    @property
    def transmissibility(self) -> Array:
        """Moments about the tip's joints by those about the handle's that hold them, (..., joints, handle joints).

        By reciprocity the inverse of the angles' ratios, transposed: eqs. 10-12 in one plane.
        """
        return np.asarray(np.linalg.pinv(self.by_handle).swapaxes(-1, -2), float)


class ChainLoad(TypedDict, total=False):
    """What acts on an instrument beside the wrench at its tip."""

    grip_force: ArrayLike
    """Force with which an object presses the jaws apart, (...), N"""
    strokes: ArrayLike
    """Length wound by the motors on every tendon, (..., tendons), m"""
    axes: Axes
    """"tip": the wrench turns with the end-effector, z along it; "stem": it keeps its direction"""


def equilibrium(
    inst: InstrumentLike, handle_angles: ArrayLike, wrench: ArrayLike = 0.0, **load: Unpack[ChainLoad]
) -> Equilibrium:
    """Return angles and tensions of an instrument under a load, on the branch that starts without one.

    Parameters
    ----------
    handle_angles
        Of the handle's joints, (..., handle joints), rad; 0 for all.
    wrench
        Force (N) and moment (N m) on the tip, (..., 6): x, y, z of either. Each end bears an equal share, jaws half.
    **load
        What else acts, as of :class:`ChainLoad`.

    Raises
    ------
    ArgumentError
        An argument is not a finite number or does not fit the instrument.
    NoSolutionError
        There is no equilibrium at a single given point.
    """
    point = _prepare(expanded(inst), handle_angles, wrench, **load)
    angles, tensions = point.empty(len(point.inst.tip_joints)), point.empty(len(point.inst.tendons))
    status = point.solve("equilibrium", point.inst.core.solve, angles, tensions)
    reason = Status(int(status[0])) if point.shape == () else status.reshape(point.shape)
    return Equilibrium(point.shaped(angles), point.shaped(tensions), reason)


def output_angles(
    inst: InstrumentLike, handle_angles: ArrayLike, wrench: ArrayLike = 0.0, **load: Unpack[ChainLoad]
) -> Array:
    """Return the angles of the tip's joints, (..., joints), rad; arguments and errors as :func:`equilibrium`."""
    return np.asarray(equilibrium(inst, handle_angles, wrench, **load).output_angle)


def tensions(
    inst: InstrumentLike, handle_angles: ArrayLike, wrench: ArrayLike = 0.0, **load: Unpack[ChainLoad]
) -> Array:
    """Return the tensions of the tendons, (..., tendons), N; arguments and errors as :func:`equilibrium`."""
    return np.asarray(equilibrium(inst, handle_angles, wrench, **load).tensions)


def rates(inst: InstrumentLike, handle_angles: ArrayLike, wrench: ArrayLike = 0.0, **load: Unpack[ChainLoad]) -> Rates:
    """Return stiffness and compliance matrices at rest, exact; arguments and errors as :func:`equilibrium`.

    Loss of dexterity to first order is `by_wrench @ wrench`, eq. 17 in one plane; `by_handle` are the transmission
    ratios of the angles.
    """
    point = _prepare(expanded(inst), handle_angles, wrench, **load)
    joints, tendons, handles = (len(of) for of in (point.inst.tip_joints, point.inst.tendons, point.inst.handle_joints))
    ends = np.cumsum([joints, 6, 1, tendons])
    out = point.empty(joints, int(ends[-1]) + handles)
    point.solve("rates", point.inst.core.answer, out)
    parts = [point.shaped(part) for part in np.split(out, ends, axis=2)]
    return Rates(parts[0], parts[1], parts[2][..., 0], parts[3], parts[4])


def handle_angles(
    inst: InstrumentLike, output_angles: ArrayLike, wrench: ArrayLike = 0.0, **load: Unpack[ChainLoad]
) -> Array:
    """Return the handle angles that hold given output angles under a load, (..., handle joints), rad.

    The inverse of :func:`output_angles`, slack included (eq. 20 in one plane); the handle must have as many joints as
    the tip. Arguments and errors as :func:`equilibrium`.
    """
    whole = expanded(inst)
    joints = len(whole.tip_joints)
    if len(whole.handle_joints) != joints:
        raise ArgumentError(
            f"{whole.name} has {len(whole.handle_joints)} joints at the handle and {joints} at the tip; their numbers "
            "must be equal.",
            key="inst",
            value=whole.name,
            allowed="an instrument with as many joints at the handle as at the tip",
        )
    point = _prepare(whole, output_angles, wrench, key="output_angles", **load)
    out = point.empty(joints)
    point.solve("handle_angles", point.inst.core.handle_angles, out)
    return point.shaped(out)


def compensation_strokes(
    inst: InstrumentLike, handle_angles: ArrayLike, wrench: ArrayLike = 0.0, **load: Unpack[ChainLoad]
) -> Array:
    """Return the lengths to wind so that all joints keep their unloaded angles under a load, (..., tendons), m.

    The tensions change by as little as carries the load, in the sum of their squares, none below zero; every motor
    winds what its own tendon is stretched by more, beyond the strokes given. A backbone in arcs keeps the direction of
    its end, by the smallest strokes: what bends it into an S no tendon takes away. Arguments and errors as
    :func:`equilibrium`; NoSolutionError also if the tendons with motors cannot carry the load.
    """
    point = _prepare(expanded(inst), handle_angles, wrench, **load)
    out = point.empty(len(point.inst.tendons))
    if any(tie.to >= 0 for tie in point.inst.ties):
        found = _straightening(point)
        lost = np.where(np.isfinite(found).all(axis=-1), Status.OK, Status.NO_AUTHORITY).astype(np.uint8)
        _check(point, "compensation_strokes", lost)
        return point.shaped(found)
    point.solve("compensation_strokes", point.inst.core.compensation_strokes, out)
    return point.shaped(out)


def straight_arms(inst: InstrumentLike, place: Literal["tip", "handle"] = "tip") -> Array:
    """Return the moment arms of the tendons about the straight joints at one end, (tendons, joints), m."""
    inst = expanded(inst)
    return inst.tendon_arms(place) * _turns(inst.tip_joints if place == "tip" else inst.handle_joints)


def coupling(inst: InstrumentLike) -> Array:
    """Return the angles of the straight joints by the lengths that tendons are drawn, (joints, tendons), rad/m.

    What the unloaded instrument does with all tendons taut and stiff against its springs: the pseudo-inverse of the
    arms, and where the tendons leave a motion free, the one in which the springs take the least energy. Times the
    lengths that a motor's turn draws, it is the matrix from actuators to joints that robots are delivered with.
    """
    inst = expanded(inst)
    arms = straight_arms(inst)
    drawn = np.linalg.pinv(inst.tendon_arms("tip")) / _turns(inst.tip_joints)[:, np.newaxis]
    _, sizes, directions = np.linalg.svd(arms)
    free = directions[np.count_nonzero(sizes > sizes[0] * _NO_ARM) :].T
    springs = inst.springs
    return np.asarray(drawn - free @ np.linalg.pinv(free.T @ springs @ free) @ free.T @ springs @ drawn)


def _turns(joints: Sequence[Joint]) -> Array:
    """Return the rates of the straight joints' coordinates by their angles."""
    return np.asarray(coordinates(joints, np.zeros(len(joints)))[1])


def coordinates(joints: Sequence[Joint], angles: Array) -> Array:
    """Return the coordinates of joints at angles (joints,), in which excursion is linear, and their rates by them."""
    return _core.joint_coordinate([MECHANISMS[joint.mechanism] for joint in joints], np.ascontiguousarray(angles))


class _Point(NamedTuple):
    """Arguments, broadcast and flat: rows of the common length, or a single row."""

    inst: FullForm
    inputs: tuple[Array, Array, Array, Array]
    """Angles held, strokes, wrench and grip force."""
    shape: tuple[int, ...]
    total: int
    key: str
    axes: Axes

    def empty(self, *widths: int) -> Array:
        return np.empty((self.total, *widths))

    def shaped(self, values: Array) -> Array:
        return values.reshape(*self.shape, *values.shape[1:])

    def solve(self, name: str, function: Callable[..., None], *out: Array) -> NDArray[np.uint8]:
        """Fill arrays by a function of the core and return how each point ended; raises its errors."""
        status = np.empty(self.total, np.uint8)
        function(*self.inputs, self.axes == "stem", *out, status, threads())
        _check(self, name, status)
        return status


def _straightening(point: _Point) -> Array:
    """Return the strokes that bring the ends of all bends back, (points, tendons), m; NaN where none do."""
    inst = point.inst
    handle, given, wrench, grip = point.inputs
    ends = np.zeros((len(inst.bends), len(inst.tip_joints)))
    for row, arcs in zip(ends, inst.bends.values(), strict=True):
        row[arcs] = 1.0
    motors = np.array([tendon.start == "spool" for tendon in inst.tendons])
    held = np.broadcast_to(handle, (point.total, handle.shape[1]))
    wanted = output_angles(inst, held, 0.0, strokes=given, axes=point.axes) @ ends.T
    strokes = np.zeros((point.total, len(motors)))
    for _ in range(_MOST_CORRECTIONS):
        load: ChainLoad = {"grip_force": grip[:, 0], "strokes": given + strokes, "axes": point.axes}
        missing = wanted - output_angles(inst, held, wrench, **load) @ ends.T
        if not (np.abs(missing) > _SETTLED).any():
            break
        by = ends @ rates(inst, held, wrench, **load).by_stroke[:, :, motors]
        lost = ~np.isfinite(by).all(axis=(1, 2))
        by[lost] = 0.0
        step = (np.linalg.pinv(by) @ missing[..., np.newaxis])[..., 0]
        strokes[:, motors] += np.clip(step, -_LONGEST_CORRECTION, _LONGEST_CORRECTION)
        strokes[lost] = np.nan
    return np.where((np.abs(missing) <= _SETTLED).all(axis=1, keepdims=True), strokes, np.nan)


def _prepare(  # noqa: PLR0917
    inst: FullForm,
    held: ArrayLike,
    wrench: ArrayLike,
    grip_force: ArrayLike = 0.0,
    strokes: ArrayLike = 0.0,
    axes: Axes = "tip",
    key: str = "handle_angles",
) -> _Point:
    if axes not in ("tip", "stem"):
        raise ArgumentError(key="axes", value=axes, allowed="tip or stem")
    grip = numbers("grip_force", grip_force)
    if inst.grip is None and np.any(grip):
        raise ArgumentError(
            f"grip_force is given, but {inst.name} has nothing that grips; its file must have a table [grip] with the "
            "jaws.",
            key="grip_force",
            value=grip_force,
            allowed="0 without a table [grip]",
        )
    given = {
        key: rows_of(key, held, len(inst.handle_joints if key == "handle_angles" else inst.tip_joints)),
        "strokes": rows_of("strokes", strokes, len(inst.tendons)),
        "wrench": rows_of("wrench", wrench, 6),
        "grip_force": grip[..., np.newaxis],
    }
    shape = common_shape({name: rows.shape[:-1] for name, rows in given.items()})
    if key == "handle_angles":
        _check_within_range(inst, given[key])
    total = math.prod(shape)
    held, wound, wrenches, grips = (_flat(rows, shape, total) for rows in given.values())
    return _Point(inst, (held, wound, wrenches, grips), shape, total, key, axes)


def _flat(rows: Array, shape: tuple[int, ...], total: int) -> Array:
    """Return rows of the common length, or the single one that stands for all."""
    width = rows.shape[-1]
    if rows.size == width:
        return np.ascontiguousarray(rows).reshape(1, width)
    return np.ascontiguousarray(np.broadcast_to(rows, (*shape, width))).reshape(total, width)


def _check_within_range(inst: FullForm, held: Array) -> None:
    for i, joint in enumerate(inst.handle_joints):
        angles = held[..., i]
        if angles.size and max(angles.max(), -angles.min()) > joint.range + _ROUNDING:
            raise ArgumentError(
                key=f"handle_angles of {joint.name}",
                value=float(angles.flat[np.argmax(np.abs(angles))]),
                allowed=f"within its range of ±{joint.range:.4g} rad",
            )


def rows_of(key: str, value: ArrayLike, width: int) -> Array:
    """Return an argument with its last axis of a given length; a single 0 stands for all zeros."""
    array = numbers(key, value)
    if array.ndim == 0 and not array:
        return np.zeros(width)
    if array.ndim == 0 and width == 1:
        return array.reshape(1)
    if array.ndim == 0 or array.shape[-1] != width:
        raise ArgumentError(
            f"{key} has the shape {array.shape}; its last axis must have the length {width}.",
            key=key,
            value=array.shape,
            allowed=f"of {width} numbers in its last axis",
        )
    return array


def _check(point: _Point, function: str, status: NDArray[np.uint8]) -> None:
    """Raise ArgumentError if an argument is not finite, NoSolutionError where a single point has no solution."""
    if status.size and int(status.max()) == int(Status.NOT_FINITE):
        for name, rows in zip((point.key, "strokes", "wrench", "grip_force"), point.inputs, strict=True):
            wrong = np.flatnonzero(~np.isfinite(rows))
            if wrong.size:
                is_single, width = len(rows) == 1, rows.shape[1]
                shape = (() if is_single else point.shape) + ((width,) if name != "grip_force" else ())
                at = place(int(wrong[0]), shape)
                raise ArgumentError(key=f"{name}{at}", value=float(rows.flat[wrong[0]]), allowed="a finite number")
    if point.shape != () or status[0] == Status.OK:
        return
    held, _, wrench, grip = point.inputs
    given = f"{point.key} = {_list(held[0])}, load = {_list(np.append(wrench[0], grip[0]))}"
    reason: Any = _REASONS.get(Status(int(status[0])), "an argument is not of physical size")
    raise NoSolutionError(f"{function} of {point.inst.name} at {given}: {reason}.", key=point.key, value=held[0])


def _list(values: Array) -> str:
    return f"[{', '.join(f'{value:.4g}' for value in values)}]"
