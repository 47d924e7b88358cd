"""A load and what motors have wound, as rows of the chain of joints, by the number of joints."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tenodesis.errors import ArgumentError
from tenodesis.instrument import FullForm
from tenodesis.statics.query import FloatOrArray, numbers

Array = NDArray[np.float64]

_Z = np.array([0.0, 0.0, 1.0])


class LoadRows(NamedTuple):
    """Arguments of :mod:`tenodesis.statics.chain`."""

    held: Array
    """Angles of the handle or of the tip, (..., joints), rad"""
    wrench: Array
    """(..., 6), N and N m"""
    strokes: Array
    """(..., tendons), m"""


def rows(
    inst: FullForm, held: tuple[str, ArrayLike], force: ArrayLike, radial_force: ArrayLike, wound: Any
) -> LoadRows:
    """Return the rows of an instrument's arguments.

    With one joint `held` (its name and value), `force` and `radial_force` are numbers, otherwise they have a last axis.
    """
    key, given = held
    across = numbers("force", force)
    outward = numbers("radial_force", radial_force)
    angles = numbers(key, given)
    if len(inst.tip_joints) == 1:
        side = np.cross(inst.tip_joints[0].axis_vector, _Z)
        along = outward[..., np.newaxis] * _Z - across[..., np.newaxis] * side
        wrench = np.concatenate([along, np.zeros_like(along)], axis=-1)
        return LoadRows(angles[..., np.newaxis] if angles.ndim else angles, wrench, _strokes(inst, wound))
    if outward.any():
        allowed = f"0 for the {len(inst.tip_joints)} joints of {inst.name}; a force there has x, y and z"
        raise ArgumentError(key="radial_force", value=radial_force, allowed=allowed)
    if across.ndim and across.shape[-1] == 3:
        across = np.concatenate([across, np.zeros_like(across)], axis=-1)
    if across.any() and (not across.ndim or across.shape[-1] != 6):
        raise ArgumentError(
            f"force has the shape {across.shape}; of {inst.name}, which has {len(inst.tip_joints)} joints, it must be "
            "x, y and z in its last axis, and may be followed by the moment's.",
            key="force",
            value=across.shape,
            allowed="of 3 or 6 numbers in its last axis",
        )
    return LoadRows(angles, across if across.any() else np.zeros(6), _strokes(inst, wound))


def of_joints(inst: FullForm, values: Array) -> FloatOrArray:
    """Return values with the joints in the last axis; those of one joint without it, as a float for a single point."""
    if len(inst.tip_joints) > 1:
        return values
    return float(values[0]) if values.ndim == 1 else values[..., 0]


def _strokes(inst: FullForm, wound: Any) -> Array:
    if isinstance(wound, tuple):
        return np.stack(np.broadcast_arrays(*(numbers("wound", one) for one in wound)), axis=-1)
    given = numbers("wound", wound)
    if given.any() and len(inst.tip_joints) == 1 and (not given.ndim or given.shape[-1] != len(inst.tendons)):
        # The agonist's alone.
        return np.asarray(given[..., np.newaxis] * np.eye(1, len(inst.tendons))[0])
    return given
