"""Statics of instruments whose joints share tendons: all angles and tensions under a wrench and a grip force."""

import math
from collections.abc import Sequence
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tenodesis._core import Status
from tenodesis.coupled.description import CoupledInstrument, Joint
from tenodesis.coupled.reading import CoupledLike, load
from tenodesis.errors import ArgumentError, NoSolutionError
from tenodesis.statics.query import common_shape, numbers, place
from tenodesis.threads import threads

Array: TypeAlias = NDArray[np.float64]
Axes: TypeAlias = Literal["tip", "stem"]

_REASONS = {
    Status.NO_EQUILIBRIUM: "there is no equilibrium on the branch that starts without a load, it ends in a fold where "
    "the joints snap through; the load must be smaller, or the pretension larger where a tendon is slack",
    Status.UNREACHABLE: "a joint would have to bend farther than its mechanism can",
    Status.BOTH_SLACK: "tendons are slack, so that nothing holds a joint; at least one of either side must be taut",
    Status.NO_AUTHORITY: "the tendons with motors cannot carry the load at these angles",
}


class Equilibrium(NamedTuple):
    """Where an instrument comes to rest; NaN where there is no equilibrium."""

    angles: Array
    """Of the tip's joints, (..., joints), rad."""
    tensions: Array
    """Of the tendons, (..., tendons), N."""
    status: NDArray[np.uint8]
    """How each solve ended, (...), a `tenodesis._core.Status`."""


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


def equilibrium(
    inst: CoupledLike,
    handle_angles: ArrayLike,
    wrench: ArrayLike = 0.0,
    *,
    grip_force: ArrayLike = 0.0,
    strokes: ArrayLike = 0.0,
    axes: Axes = "tip",
) -> Equilibrium:
    """Return angles and tensions of an instrument under a load, on the branch that starts without one.

    Parameters
    ----------
    inst
        A coupled instrument, or a planar one, or its name or path.
    handle_angles
        Of the handle's joints, (..., handle joints), rad; 0 for all.
    wrench
        Force (N) and moment (N m) on the tip, (..., 6): x, y, z of either. Each end bears an equal share, jaws half.
    grip_force
        Force with which an object presses the jaws apart, (...), N.
    strokes
        Length wound by the motors on every tendon, (..., tendons), m.
    axes
        "tip": the wrench turns with the end-effector, z along it; "stem": it keeps its direction.

    Raises
    ------
    ArgumentError
        An argument is not a finite number or does not fit the instrument.
    NoSolutionError
        There is no equilibrium at a single given point.
    """
    inst, point = _prepare(inst, handle_angles, wrench, grip_force, strokes, axes)
    angles = np.empty((point.total, len(inst.tip_joints)))
    tensions = np.empty((point.total, len(inst.tendons)))
    status = np.empty(point.total, np.uint8)
    inst.core.solve(point.held, point.strokes, point.load, axes == "stem", angles, tensions, status, threads())
    _check(inst, "equilibrium", point, status)
    return Equilibrium(point.shaped(angles), point.shaped(tensions), status.reshape(point.shape))


def output_angles(
    inst: CoupledLike,
    handle_angles: ArrayLike,
    wrench: ArrayLike = 0.0,
    *,
    grip_force: ArrayLike = 0.0,
    strokes: ArrayLike = 0.0,
    axes: Axes = "tip",
) -> Array:
    """Return the angles of the tip's joints, (..., joints), rad; arguments and errors as :func:`equilibrium`."""
    return equilibrium(inst, handle_angles, wrench, grip_force=grip_force, strokes=strokes, axes=axes).angles


def tensions(
    inst: CoupledLike,
    handle_angles: ArrayLike,
    wrench: ArrayLike = 0.0,
    *,
    grip_force: ArrayLike = 0.0,
    strokes: ArrayLike = 0.0,
    axes: Axes = "tip",
) -> Array:
    """Return the tensions of the tendons, (..., tendons), N; arguments and errors as :func:`equilibrium`."""
    return equilibrium(inst, handle_angles, wrench, grip_force=grip_force, strokes=strokes, axes=axes).tensions


def rates(
    inst: CoupledLike,
    handle_angles: ArrayLike,
    wrench: ArrayLike = 0.0,
    *,
    grip_force: ArrayLike = 0.0,
    strokes: ArrayLike = 0.0,
    axes: Axes = "tip",
) -> Rates:
    """Return stiffness and compliance matrices at rest, exact; arguments and errors as :func:`equilibrium`.

    Loss of dexterity to first order is `by_wrench @ wrench`, eq. 17 in one plane; `by_handle` are the transmission
    ratios of the angles.
    """
    inst, point = _prepare(inst, handle_angles, wrench, grip_force, strokes, axes)
    joints, tendons = len(inst.tip_joints), len(inst.tendons)
    ends = np.cumsum([joints, 6, 1, tendons])
    out = np.empty((point.total, joints, int(ends[-1]) + len(inst.handle_joints)))
    status = np.empty(point.total, np.uint8)
    inst.core.answer(point.held, point.strokes, point.load, axes == "stem", out, status, threads())
    _check(inst, "rates", point, status)
    parts = [point.shaped(part) for part in np.split(out, ends, axis=2)]
    return Rates(parts[0], parts[1], parts[2][..., 0], parts[3], parts[4])


def handle_angles(
    inst: CoupledLike,
    output_angles: ArrayLike,
    wrench: ArrayLike = 0.0,
    *,
    grip_force: ArrayLike = 0.0,
    strokes: ArrayLike = 0.0,
    axes: Axes = "tip",
) -> Array:
    """Return the handle angles that hold given output angles under a load, (..., handle joints), rad.

    The inverse of :func:`output_angles`, slack included (eq. 20 in one plane); the handle must have as many joints as
    the tip. Arguments and errors as :func:`equilibrium`.
    """
    inst = load(inst)
    joints = len(inst.tip_joints)
    if len(inst.handle_joints) != joints:
        raise ArgumentError(
            f"{inst.name} has {len(inst.handle_joints)} joints at the handle and {joints} at the tip; their numbers "
            "must be equal.",
            key="inst",
            value=inst.name,
            allowed="an instrument with as many joints at the handle as at the tip",
        )
    inst, point = _prepare(inst, output_angles, wrench, grip_force, strokes, axes, "output_angles", joints)
    out, status = np.empty((point.total, joints)), np.empty(point.total, np.uint8)
    inst.core.handle_angles(point.held, point.strokes, point.load, axes == "stem", out, status, threads())
    _check(inst, "handle_angles", point, status)
    return point.shaped(out)


def compensation_strokes(
    inst: CoupledLike,
    handle_angles: ArrayLike,
    wrench: ArrayLike = 0.0,
    *,
    grip_force: ArrayLike = 0.0,
    strokes: ArrayLike = 0.0,
    axes: Axes = "tip",
) -> Array:
    """Return the lengths to wind so that all joints keep their unloaded angles under a load, (..., tendons), m.

    The tensions change by as little as carries the load, in the sum of their squares, none below zero; every motor
    winds what its own tendon is stretched by more, beyond the strokes given. Arguments and errors as
    :func:`equilibrium`; NoSolutionError also if the tendons with motors cannot carry the load.
    """
    inst, point = _prepare(inst, handle_angles, wrench, grip_force, strokes, axes)
    out, status = np.empty((point.total, len(inst.tendons))), np.empty(point.total, np.uint8)
    inst.core.compensation_strokes(point.held, point.strokes, point.load, axes == "stem", out, status, threads())
    _check(inst, "compensation_strokes", point, status)
    return point.shaped(out)


def straight_arms(inst: CoupledLike, place: Literal["tip", "handle"] = "tip") -> Array:
    """Return the moment arms of the tendons about the straight joints at one end, (tendons, joints), m."""
    inst = load(inst)
    return inst.tendon_arms(place) * _turns(inst.tip_joints if place == "tip" else inst.handle_joints)


def coupling(inst: CoupledLike) -> Array:
    """Return the angles of the straight joints by the lengths that tendons are drawn, (joints, tendons), rad/m.

    For tendons that do not stretch: the pseudo-inverse of the arms. Times the lengths that a motor's turn draws, it is
    the matrix from actuators to joints that robots are delivered with.
    """
    inst = load(inst)
    return np.asarray(np.linalg.pinv(inst.tendon_arms("tip")) / _turns(inst.tip_joints)[:, np.newaxis])


def _turns(joints: Sequence[Joint]) -> Array:
    """Return the rate of the straight joints' coordinates by their angles, of which a gear's is the sine of half."""
    return np.array([0.5 if joint.mechanism == "tendon-gear" else 1.0 for joint in joints])


class _Point(NamedTuple):
    """Arguments, broadcast and flat: rows of the common length, or a single row."""

    held: Array
    strokes: Array
    load: Array
    shape: tuple[int, ...]
    total: int
    key: str

    def shaped(self, values: Array) -> Array:
        return values.reshape(*self.shape, *values.shape[1:])


def _prepare(  # noqa: PLR0917
    inst: CoupledLike,
    held: ArrayLike,
    wrench: ArrayLike,
    grip_force: ArrayLike,
    strokes: ArrayLike,
    axes: Axes,
    key: str = "handle_angles",
    width: int | None = None,
) -> tuple[CoupledInstrument, _Point]:
    inst = load(inst)
    if axes not in ("tip", "stem"):
        raise ArgumentError(key="axes", value=axes, allowed="tip or stem")
    width = len(inst.handle_joints) if width is None else width
    given = {
        key: _rows(key, held, width),
        "wrench": _rows("wrench", wrench, 6),
        "strokes": _rows("strokes", strokes, len(inst.tendons)),
    }
    grip = numbers("grip_force", grip_force)
    if inst.grip is None and np.any(grip):
        raise ArgumentError(
            f"grip_force is given, but {inst.name} has nothing that grips; its file must have a table [grip] with the "
            "jaws.",
            key="grip_force",
            value=grip_force,
            allowed="0 without a table [grip]",
        )
    shapes = {name: rows.shape[:-1] for name, rows in given.items()} | {"grip_force": grip.shape}
    shape = common_shape(shapes)
    for name, rows in (given | {"grip_force": grip[..., np.newaxis]}).items():
        if not np.isfinite(rows).all():
            first = int(np.argmin(np.isfinite(rows).ravel()))
            at = place(first, rows.shape if name != "grip_force" else grip.shape)
            raise ArgumentError(key=f"{name}{at}", value=float(rows.ravel()[first]), allowed="a finite number")
    if key == "handle_angles":
        limits = np.array([joint.range for joint in inst.handle_joints])
        beyond = np.abs(given[key]) > limits + 1e-9
        if beyond.any():
            worst = int(np.argmax(beyond.reshape(-1, width).any(axis=0)))
            joint, angle = inst.handle_joints[worst], float(given[key][..., worst].ravel()[0])
            raise ArgumentError(
                key=f"{key} of {joint.name}", value=angle, allowed=f"within its range of ±{limits[worst]:.4g} rad"
            )
    total = math.prod(shape)
    flat = {
        name: np.ascontiguousarray(np.broadcast_to(rows, (*shape, rows.shape[-1]))).reshape(total, rows.shape[-1])
        for name, rows in (given | {"grip_force": grip[..., np.newaxis]}).items()
    }
    load_rows = np.ascontiguousarray(np.concatenate([flat["wrench"], flat["grip_force"]], axis=1))
    return inst, _Point(flat[key], flat["strokes"], load_rows, shape, total, key)


def _rows(key: str, value: ArrayLike, width: int) -> Array:
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


def _check(inst: CoupledInstrument, function: str, point: _Point, status: NDArray[np.uint8]) -> None:
    """Raise NoSolutionError where a single point has no solution."""
    if point.shape != () or status[0] == Status.OK:
        return
    given = f"{point.key} = {_list(point.held[0])}, load = {_list(point.load[0])}"
    reason: Any = _REASONS.get(Status(int(status[0])), "an argument is not of physical size")
    raise NoSolutionError(f"{function} of {inst.name} at {given}: {reason}.")


def _list(values: Array) -> str:
    return f"[{', '.join(f'{value:.4g}' for value in values)}]"
