"""Unknowns of any instrument by name, from where its tip rests: rigidities, springs, tendons and their places.

Friction is left out: it must be small, or readings be taken after the tip was tapped or approached from both sides.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from tenodesis.errors import IdentificationError
from tenodesis.instrument import FullForm, InstrumentLike, expanded
from tenodesis.instrument.joints import SIGNS
from tenodesis.instrument.numbers import values_by_key
from tenodesis.kinematics import Port, tip_pose
from tenodesis.kinematics.chain import rotated
from tenodesis.run import Array
from tenodesis.statics import Axes, chain
from tenodesis.statics.tension_drive import angles_at_tensions

_LEAST = {"angle": -math.inf, "tie_ratio": -math.inf, "offset": 0.0, "centre_of_mass": 0.0}
"""Least values of the keys that may be zero."""
_LEAST_SHARE = 1e-3
"""Of where the search starts, the least that the others may be."""
_OF_CROSSING = 2
"""Dots in the key of where a tendon crosses a joint."""
_AT_CROSSING = ("radius", "far_radius", "angle")
_WEIGHTINGS = 3
_STEP = 1e-6
"""Difference by which slopes are taken, over an unknown's scale."""
_SINGULAR = 1e-6
"""Singular value, over the largest, below which unknowns cannot be told apart."""


class AtRest(NamedTuple):
    """What acts on an instrument and where it rests, a row each; SI. Position, direction or angles must be given."""

    strokes: Array | None = None
    """Wound on all tendons, (n, tendons), m"""
    tensions: Array | None = None
    """Held by all motors instead, (n, tendons), N"""
    wrench: Array | None = None
    """On the tip, (n, 6), N and N m"""
    handle_angles: Array | None = None
    """(n, handle joints), rad"""
    position: Array | None = None
    """Of the tip from the stem's end, in the stem's axes, (n, 3), m"""
    direction: Array | None = None
    """Of the tip's axis, unit vectors in the stem's axes, (n, 3)"""
    angles: Array | None = None
    """Of the tip's joints; of a backbone the sum over its arcs in each plane, (n, bends), rad"""

    @property
    def measured(self) -> dict[str, Array]:
        """What is measured, by name."""
        names = ("position", "direction", "angles")
        return {name: np.asarray(of, float) for name in names if (of := getattr(self, name)) is not None}


class Estimate(NamedTuple):
    """An unknown with its 95 % interval; SI."""

    value: float
    standard_error: float
    low: float
    high: float


class RestFit(NamedTuple):
    """Unknowns by name, the instrument with their values, and what remains."""

    unknowns: dict[str, Estimate]
    inst: FullForm
    noise: dict[str, float]
    """Standard deviation of a component of each measured quantity, m or rad"""
    correlation: Array
    """Of the unknowns, (unknowns, unknowns)"""


def fit_at_rest(inst: InstrumentLike, data: AtRest, unknowns: Sequence[str], *, axes: Axes = "tip") -> RestFit:
    """Return unknowns of an instrument that make it rest where it was measured to.

    Standard deviations of the noise are estimated with the unknowns, one for each measured quantity, and taken to be
    independent between readings.

    Parameters
    ----------
    inst
        The instrument, whose values are where the search starts.
    data
        Readings.
    unknowns
        ``JOINT.KEY`` such as ``bend.backbone_rigidity``, ``TENDON.KEY`` such as ``a.pretension``, or
        ``TENDON.JOINT.KEY`` for where a tendon crosses a joint, such as ``a.bend.radius`` or ``a.bend.angle``; keys are
        those of the instrument's file.
    axes
        In which wrenches are given.

    Raises
    ------
    IdentificationError
        A name is not known, nothing is measured, there are too few readings, the instrument has no equilibrium at one,
        or the readings cannot tell the unknowns apart.
    """
    whole = expanded(inst)
    start = np.array([value_of(whole, name) for name in unknowns])
    low = np.array([_LEAST.get(name.rpartition(".")[2], _LEAST_SHARE) for name in unknowns])
    may_be_zero = low != _LEAST_SHARE
    if not (may_be_zero | (start > 0)).all():
        name = unknowns[int(np.argmin(may_be_zero | (start > 0)))]
        raise IdentificationError(key=name, value=0.0, allowed="above 0, for the search starts there")
    scale = np.where(may_be_zero, 1.0, np.abs(start))
    measured = data.measured
    count = sum(of.size for of in measured.values())
    if count <= len(start) or not len(start):
        raise IdentificationError(
            f"{len(start)} unknowns are asked of {count} measured numbers; there must be one unknown at least, and "
            "more numbers than unknowns.",
            key="unknowns",
            value=len(start),
        )

    def off(x: Array) -> dict[str, Array]:
        own = at_rest(with_values(whole, unknowns, x * scale), data, axes)
        return {name: own[name] - of for name, of in measured.items()}

    if not all(np.isfinite(of).all() for of in off(start / scale).values()):
        raise IdentificationError(
            f"{whole.name} has no equilibrium at a reading; the values that the search starts from must be closer, or "
            "loads and units right.",
            key="data",
            value=whole.name,
        )
    found, noise = _searched(off, start / scale, low, whole)
    sizes, directions = np.linalg.svd(found.jac, full_matrices=False)[1:]
    if sizes[-1] < _SINGULAR * sizes[0]:
        part = [name for name, share in zip(unknowns, np.abs(directions[-1]), strict=True) if share > 0.1]
        raise IdentificationError(
            f"the readings cannot tell {' and '.join(part)} apart; fewer of them must be unknown, or readings under "
            "other loads be added.",
            key="unknowns",
            value=", ".join(part),
        )
    return _result(whole, dict(zip(unknowns, scale, strict=True)), found, noise, count)


def at_rest(inst: FullForm, data: AtRest, axes: Axes = "tip") -> dict[str, Array]:
    """Return position, direction and angles of an instrument under what acts, as of :class:`AtRest`; NaN where none."""
    wrench = 0.0 if data.wrench is None else data.wrench
    held = 0.0 if data.handle_angles is None else data.handle_angles
    if data.tensions is None:
        strokes = 0.0 if data.strokes is None else data.strokes
        angles = chain.output_angles(inst, held, wrench, strokes=strokes, axes=axes)
    else:
        angles = angles_at_tensions(inst, data.tensions, held, wrench, axes=axes)
    known = np.isfinite(angles)
    pose = tip_pose(inst, np.where(known, angles, 0.0), port=Port(insertion=0.0))
    lost = np.where(known.all(axis=-1, keepdims=True), 0.0, np.nan)
    summed = np.stack([angles[..., arcs].sum(axis=-1) for arcs in inst.arc_places.values()], axis=-1)
    direction = rotated(pose.quaternion[..., 0, :], np.array([0.0, 0.0, 1.0]))
    return {"position": pose.position[..., 0, :] + lost, "direction": direction + lost, "angles": summed}


def _searched(off: Any, start: Array, low: Array, inst: FullForm) -> tuple[Any, dict[str, float]]:
    """Return SciPy's result with residuals over the noise, and the noise, which is weighted anew after every search."""
    from scipy.optimize import least_squares  # noqa: PLC0415 - takes long to load

    reach = sum(joint.chord + (joint.end_effector_length or 0.0) for joint in inst.tip_joints)
    noise = {name: 1e-2 * (reach if name == "position" else 1.0) for name in off(start)}

    def weighted(x: Array) -> Array:
        values = np.concatenate([(of / noise[name]).ravel() for name, of in off(x).items()])
        return np.asarray(np.nan_to_num(values, nan=1e3))

    found: Any = None
    for _ in range(_WEIGHTINGS):
        at = start if found is None else found.x
        found = least_squares(
            weighted,
            at,
            bounds=(low, np.inf),
            diff_step=np.full(len(start), _STEP),
            x_scale="jac",
            xtol=1e-8,
            ftol=1e-8,
        )
        left = off(found.x)
        free = {name: 2 * of.size // 3 if name == "direction" else of.size for name, of in left.items()}
        share = 1 - len(start) / sum(free.values())
        noise = {name: max(math.sqrt(np.sum(of**2) / (free[name] * share)), 1e-12) for name, of in left.items()}
    return found, noise


def _result(inst: FullForm, scales: dict[str, float], found: Any, noise: dict[str, float], count: int) -> RestFit:
    from scipy.special import stdtrit  # noqa: PLC0415 - takes long to load

    # The slopes are weighted by the noise of the round before, which has settled.
    covariance = np.linalg.inv(found.jac.T @ found.jac)
    errors = np.sqrt(np.diag(covariance))
    wide = float(stdtrit(count - len(scales), 0.975))
    estimates = {
        name: Estimate(*(float(one * by) for one in (x, error, x - wide * error, x + wide * error)))
        for (name, by), x, error in zip(scales.items(), found.x, errors, strict=True)
    }
    correlation = covariance / np.outer(errors, errors)
    return RestFit(estimates, with_values(inst, list(scales), found.x * [*scales.values()]), noise, correlation)


def _path(inst: FullForm, name: str) -> str:
    """Return the key of an unknown as :meth:`FullForm.replace` takes it."""
    of_joint = name.partition(".")[0] in [joint.name for joint in inst.as_given("joints")]
    return f"{'joints' if of_joint else 'tendons'}.{name}"


def value_of(inst: FullForm, name: str) -> float:
    """Return the value of an unknown by the name that :func:`fit_at_rest` knows it by; raises as that does."""
    known, path = values_by_key(inst), _path(inst, name)
    crossing, _, key = path.rpartition(".")
    value = known.get(path, (None,))[0]
    if crossing.count(".") == _OF_CROSSING:
        if key == "angle" and value is None:
            value = math.pi if SIGNS[known[f"{crossing}.side"][0]] < 0 else 0.0
        elif key == "far_radius" and value is None:
            value = known[f"{crossing}.radius"][0]
        elif key not in _AT_CROSSING:
            value = None
    if not isinstance(value, float):
        raise IdentificationError(
            f"{name} is no unknown of {inst.name}; it must be JOINT.KEY, TENDON.KEY or TENDON.JOINT.KEY of numbers "
            "that its file has.",
            key="unknowns",
            value=name,
        )
    return value


def with_values(inst: FullForm, unknowns: Sequence[str], values: Array, **changes: float) -> FullForm:
    """Return the instrument with values of its unknowns, (n,), by these names, and changes of other keys."""
    paths = [_path(inst, name) for name in unknowns]
    # a tendon crosses a joint at an angle instead of on a side
    sides = {f"{path.removesuffix('angle')}side": None for path in paths if path.endswith(".angle")}
    return inst.replace(**dict(zip(paths, values.tolist(), strict=True)), **sides, **changes)
