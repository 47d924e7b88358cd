"""An instrument at rest whose motors hold tensions: the strokes that their tendons come to."""

import math

import numpy as np
from numpy.typing import ArrayLike

from tenodesis.errors import ArgumentError
from tenodesis.instrument import FullForm, InstrumentLike, expanded
from tenodesis.statics import chain
from tenodesis.statics.chain import Array, Axes
from tenodesis.statics.query import common_shape

_SOFT = 0.02
"""Stiffness of tendons with given tensions, over that of the joints as the tendons feel it."""
_ROUNDS = 50
_SETTLED = 1e-9
"""Difference of a tension at which it is met, N."""
_WORSE = 100.0
"""Times that difference, up to which the last round counts."""
_LEAST_ARM = 1e-9
"""Arm below which a tendon does not feel a joint, m."""


def strokes_at_tensions(
    inst: InstrumentLike,
    tensions: ArrayLike,
    handle_angles: ArrayLike = 0.0,
    wrench: ArrayLike = 0.0,
    *,
    grip_force: ArrayLike = 0.0,
    axes: Axes = "tip",
) -> Array:
    """Return the lengths that motors wind when they hold given tensions, without friction, (..., tendons), m.

    Parameters
    ----------
    tensions
        Of all tendons, (..., tendons), N, not below zero; all tendons must have motors. At zero a tendon is let out
        until it just carries nothing.
    handle_angles, wrench, grip_force, axes
        As of :func:`tenodesis.statics.equilibrium`, which the strokes are for; NaN where they are not found.

    Raises
    ------
    ArgumentError
        A tension is no finite number or below zero, a tendon has no motor, or a shape does not fit.
    """
    whole = expanded(inst)
    angles = angles_at_tensions(whole, tensions, handle_angles, wrench, grip_force=grip_force, axes=axes)
    held = chain.rows_of("handle_angles", handle_angles, len(whole.handle_joints))
    held = np.broadcast_to(held, (*angles.shape[:-1], held.shape[-1]))
    stretches = whole.stretches(np.broadcast_to(tensions, (*angles.shape[:-1], len(whole.tendons))))
    return np.asarray(stretches - _drawn(whole, held, angles))


def angles_at_tensions(
    inst: InstrumentLike,
    tensions: ArrayLike,
    handle_angles: ArrayLike = 0.0,
    wrench: ArrayLike = 0.0,
    *,
    grip_force: ArrayLike = 0.0,
    axes: Axes = "tip",
) -> Array:
    """Return the angles of the tip's joints where motors hold tensions, (..., joints), rad; NaN where there are none.

    They are found with tendons so soft that few rounds of strokes hold the tensions. Arguments and errors as
    :func:`strokes_at_tensions`.
    """
    whole = expanded(inst)
    wanted = chain.rows_of("tensions", tensions, len(whole.tendons))
    wrong = wanted[~(np.isfinite(wanted) & (wanted >= 0))]
    if wrong.size:
        raise ArgumentError(key="tensions", value=float(wrong[0]), allowed="finite and not below 0 N")
    for tendon in whole.tendons:
        if tendon.start != "spool":
            raise ArgumentError(key=f"start of {tendon.name}", value=tendon.start, allowed="spool, to hold a tension")
    given = {
        "tensions": wanted,
        "handle_angles": chain.rows_of("handle_angles", handle_angles, len(whole.handle_joints)),
        "wrench": chain.rows_of("wrench", wrench, 6),
        "grip_force": np.asarray(grip_force, float)[..., np.newaxis],
    }
    shape = common_shape({name: rows.shape[:-1] for name, rows in given.items()})
    wanted, held, load, grip = (
        np.broadcast_to(rows, (*shape, rows.shape[-1])).reshape(math.prod(shape), rows.shape[-1])
        for rows in given.values()
    )
    springs, arms = np.diag(whole.springs), whole.tendon_arms("tip")
    felt = springs / np.maximum(np.abs(arms), _LEAST_ARM) ** 2 / len(whole.tendons)
    stiffness = _SOFT * min([*felt[(arms != 0) & (springs > 0)], *whole.stiffnesses])
    alike = {"stiffness": stiffness, "stiffness_by_tension": None}
    soft = whole.replace(
        tendons=[tendon.model_copy(update=alike) for tendon in whole.as_given("tendons")],
        joints=list(whole.as_given("joints")),
    )
    slack = (wanted - np.array(whole.pretensions)) / stiffness
    strokes = slack - _drawn(whole, held, np.zeros((len(wanted), len(whole.tip_joints))))
    for _ in range(_ROUNDS):
        angles = chain.output_angles(soft, held, load, grip_force=grip[:, 0], strokes=strokes, axes=axes)
        after = slack - _drawn(whole, held, angles)
        off = np.abs(after - strokes).max(axis=-1, keepdims=True) * stiffness
        if not np.nanmax(off, initial=0.0) > _SETTLED:
            break
        strokes = np.where(np.isfinite(after), after, strokes)
    return np.reshape(np.where(off <= _WORSE * _SETTLED, angles, np.nan), (*shape, len(whole.tip_joints)))


def _drawn(inst: FullForm, handle_angles: Array, angles: Array) -> Array:
    """Return the length by which handle and tip stretch each tendon, (n, tendons), m."""
    rows = math.prod(angles.shape[:-1])
    held, bent = (
        np.reshape([chain.coordinates(joints, row)[0] for row in of.reshape(rows, len(joints))], of.shape)
        for joints, of in ((inst.handle_joints, handle_angles), (inst.tip_joints, angles))
    )
    return np.asarray(held @ inst.tendon_arms("handle").T - bent @ inst.tendon_arms("tip").T)
