"""The load at which a tendon goes slack: handle and motors held, the load raised until the first tension is zero."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tenodesis.instrument import InstrumentLike, as_instrument
from tenodesis.statics import chain
from tenodesis.statics.chain import Axes
from tenodesis.statics.equations import Wound
from tenodesis.statics.loads import rows
from tenodesis.statics.query import FloatOrArray, prepare, shaped, solve

Array = NDArray[np.float64]

_LARGEST = 1e4
_FIRST = 0.25
_HALVINGS = 50
_TAUT = 1e-9  # as a share of the largest pretension


class Slack(NamedTuple):
    """Where the first tendon goes slack, by point."""

    factor: Array
    """Multiple of the load; 0: slack without a load, NaN: none goes slack"""
    tendon: NDArray[np.intp]
    """Its place; -1 if none goes slack"""


def slack_load(
    inst: InstrumentLike,
    handle_angle: ArrayLike,
    force: ArrayLike = 1.0,
    *,
    radial_force: ArrayLike = 0.0,
    wound: Wound = 0.0,
    grip_force: ArrayLike = 0.0,
    axes: Axes = "tip",
) -> FloatOrArray:
    """Return the multiple of a load under which the first tendon goes slack, handle and motors held.

    With the default, a force of 1 N against flexion, it is the force in N. It is 0 where a tendon is slack without a
    load, and NaN where none goes slack before the joints snap through. Parameters are those of :func:`output_angle`.
    """
    inst = as_instrument(inst)
    tangential = not (np.any(radial_force) or np.any(grip_force)) and axes == "tip"
    if inst.closed_form is not None and tangential and np.all(np.asarray(force) > 0):
        query = prepare("slack_load", inst, {"handle_angle": handle_angle, "wound": wound})
        outputs, _ = solve(query)
        return shaped(outputs[0, 0], query.shape) / np.asarray(force)[()]
    joints = inst.as_chain
    held, wrench, strokes = rows(joints, ("handle_angle", handle_angle), force, radial_force, wound)
    grip = np.asarray(grip_force, float)
    shape = np.broadcast_shapes(held.shape[:-1], wrench.shape[:-1], strokes.shape[:-1], grip.shape)

    def tensions(factors: Array) -> Array:
        scaled = factors[..., np.newaxis] * wrench
        found = chain.equilibrium(
            joints, held[np.newaxis], scaled[np.newaxis], strokes=strokes, grip_force=factors * grip, axes=axes
        )
        return np.asarray(found.tensions[0])

    factor = first_slack(tensions, shape, float(joints.pretensions.max())).factor
    return float(factor) if shape == () else factor


def first_slack(tensions: Callable[[Array], Array], shape: tuple[int, ...], scale: float) -> Slack:
    """Return where the first tendon goes slack, by its tensions (..., tendons), N, at multiples (...) of a load.

    The multiple is doubled until a tendon is slack, and then halved in on; scale is that of the tensions, N.
    """
    rest = tensions(np.zeros(shape))
    low, high = np.zeros(shape), np.full(shape, _FIRST)
    found = tensions(high)
    while (going := _all_taut(found) & (high < _LARGEST)).any():
        low, high = np.where(going, high, low), np.where(going, 2 * high, high)
        found = tensions(high)
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        taut = _all_taut(tensions(middle))
        low, high = np.where(taut, middle, low), np.where(taut, high, middle)
    found = tensions(high)
    slack = (found == 0).any(axis=-1)
    factor, tendon = np.where(slack, high, np.nan), np.where(slack, np.argmin(found, axis=-1), -1)
    already = (rest <= _TAUT * scale).any(axis=-1)
    return Slack(np.where(already, 0.0, factor), np.where(already, np.argmin(rest, axis=-1), tendon))


def _all_taut(tensions: Array) -> NDArray[np.bool_]:
    return np.asarray((tensions > 0).all(axis=-1))
