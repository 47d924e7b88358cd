"""The wrench at the tip, as far as the moments about the joints determine it."""

from __future__ import annotations

from math import pi
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tenodesis.errors import ArgumentError
from tenodesis.instrument import FullForm, InstrumentLike, expanded
from tenodesis.statics import chain
from tenodesis.statics.query import numbers

Array = NDArray[np.float64]

USUAL = (5.0, 5.0, 5.0, 0.05, 0.05, 0.05)
"""Deviations of the components of a wrench that is not known: forces, N, and moments, N m."""


class TipWrench(NamedTuple):
    """A wrench in the tip's axes: force (N) and moment (N m)."""

    wrench: Array
    """Most likely, (..., 6)"""
    covariance: Array
    """(..., 6, 6)"""
    narrowed: Array
    """Share by which the moments have narrowed each component's deviation, (..., 6): 0 where they say nothing"""


def load_matrix(inst: InstrumentLike, angles: ArrayLike) -> Array:
    """Return the moments about the joints by a wrench in the tip's axes, (..., joints, 6), by virtual work.

    Raises ArgumentError for angles, (..., joints), rad, that are not finite, or half a turn or more.
    """
    inst = expanded(inst)
    at = _angles(inst, angles)
    out = np.empty((*at.shape, 6))
    joints = len(inst.tip_joints)
    inst.core.load_matrix(np.ascontiguousarray(at).reshape(-1, joints), out.reshape(-1, joints, 6))
    return out


def tip_wrench(
    inst: InstrumentLike, angles: ArrayLike, moments: ArrayLike, deviations: ArrayLike, *, usual: ArrayLike = USUAL
) -> TipWrench:
    """Return the wrench at the tip from moments about the joints; the covariance is large where they leave it open.

    Joints of a wrist are fewer than the six components, so that some follow from what wrenches usually are: a normal
    distribution about zero, which the moments narrow (Bayes).

    Parameters
    ----------
    inst
        The instrument.
    angles
        Of the tip's joints, (..., joints), rad.
    moments
        Of the load about the joints, (..., joints), N m; NaN where a joint's is not known.
    deviations
        Their standard deviations, as moments or one for all.
    usual
        Deviations of the components of usual wrenches, (6,), N and N m; 0 for a component that is known to be absent.

    Raises
    ------
    ArgumentError
        A shape does not fit, or a deviation is negative.
    """
    inst = expanded(inst)
    at = _angles(inst, angles)
    given, spread = np.broadcast_arrays(numbers("moments", moments), numbers("deviations", deviations))
    if given.ndim == 0 or given.shape[-1] != len(inst.tip_joints):
        allowed = f"of shape (..., {len(inst.tip_joints)})"
        raise ArgumentError(f"moments has shape {given.shape}; it must be {allowed}.", key="moments", value=given.shape)
    before = np.broadcast_to(numbers("usual", usual), (6,))
    for key, values in (("usual", before), ("deviations", np.where(np.isnan(given), 0.0, spread))):
        if not (values >= 0).all():
            raise ArgumentError(key=key, value=float(np.min(values)), allowed="0 or more")
    matrix = load_matrix(inst, at)
    known = np.isfinite(given)
    matrix = np.where(known[..., np.newaxis], matrix, 0.0)
    prior = np.diag(before**2)
    # A moment that is not known says nothing: its row is zero and its deviation any.
    noise = np.where(known, np.maximum(spread, 1e-12) ** 2, 1.0)
    innovation = matrix @ prior @ matrix.swapaxes(-1, -2) + noise[..., np.newaxis] * np.eye(len(inst.tip_joints))
    gain = np.linalg.solve(innovation, matrix @ prior).swapaxes(-1, -2)
    wrench = (gain @ np.where(known, given, 0.0)[..., np.newaxis])[..., 0]
    covariance = prior - gain @ matrix @ prior
    left = np.sqrt(np.maximum(np.diagonal(covariance, axis1=-2, axis2=-1), 0.0))
    narrowed = 1 - np.divide(left, before, out=np.zeros_like(left), where=before > 0)
    return TipWrench(np.asarray(wrench), np.asarray(covariance), np.where(before > 0, narrowed, 1.0))


def _angles(inst: FullForm, angles: ArrayLike) -> Array:
    at = chain.rows_of("angles", angles, len(inst.tip_joints))
    wrong = ~(np.abs(at) < pi)
    if wrong.any():
        raise ArgumentError(key="angles", value=float(at[wrong][0]), allowed="less than half a turn")
    return at
