"""An instrument at rest whose motors hold tensions: the strokes that their tendons come to."""

import math

import numpy as np
from numpy.typing import ArrayLike

from tenodesis.errors import ArgumentError
from tenodesis.instrument import FullForm, InstrumentLike, expanded
from tenodesis.statics import chain
from tenodesis.statics.chain import Array, Axes
from tenodesis.statics.query import common_shape

_PARTS = 5
"""In which tensions are raised from those at rest."""
_SETTLED = 1e-8
"""Difference of a tension at which it is met, N over 1 N and the tension."""


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
    total = math.prod(shape)
    flat = [np.broadcast_to(rows, (*shape, rows.shape[-1])).reshape(total, rows.shape[-1]) for rows in given.values()]
    found = [
        _strokes(whole, one, {"handle": held, "wrench": load, "grip": grip}, axes)
        for one, held, load, grip in zip(*flat, strict=True)
    ]
    return np.reshape(found, (*shape, len(whole.tendons)))


def _strokes(inst: FullForm, wanted: Array, given: dict[str, Array], axes: Axes) -> Array:
    """Return the strokes of one row, NaN if there are none."""
    from scipy.optimize import root  # noqa: PLC0415 - takes long to load

    held, wrench, grip = given["handle"], given["wrench"], given["grip"]
    stiffness, arms = np.array(inst.stiffnesses), inst.tendon_arms("tip")
    at_rest = np.array(inst.pretensions)
    turned = inst.tendon_arms("handle") @ chain.coordinates(inst.handle_joints, held)[0]

    # The unknowns are lengths times stiffness; a slack tendon counts as what it is short of being taut.
    def missing(force: Array, goal: Array) -> tuple[Array, Array]:
        # Two rows alike, for a single one raises where there is no equilibrium.
        load: chain.ChainLoad = {"strokes": np.tile(force / stiffness, (2, 1)), "grip_force": grip[0], "axes": axes}
        angles = chain.output_angles(inst, held, wrench, **load)[0]
        by_stroke = chain.rates(inst, held, wrench, **load).by_stroke[0]
        bent, by_angle = chain.coordinates(inst.tip_joints, angles)
        tension = at_rest + force + stiffness * (turned - arms @ bent)
        slope = np.eye(len(goal)) - stiffness[:, np.newaxis] * (arms * by_angle) @ by_stroke / stiffness
        return tension - goal, slope

    force = np.zeros(len(wanted))
    for share in np.linspace(0.0, 1.0, _PARTS + 1):
        # As tensions that the stiffness at rest would give.
        goal = at_rest + stiffness * inst.stretches(at_rest + share * (wanted - at_rest))
        try:
            found = root(missing, force, (goal,), jac=True, tol=1e-12)
        except ValueError:
            return np.full(len(wanted), np.nan)
        force = found.x
        if not np.abs(found.fun).max() <= _SETTLED * (1 + goal.max()):
            return np.full(len(wanted), np.nan)
    return force / stiffness
