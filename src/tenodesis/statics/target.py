"""The target of every law: where the tip would be without load and friction."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tenodesis.instrument import InstrumentLike, expanded
from tenodesis.statics.equations import unloaded_angle


def targets(inst: InstrumentLike, handle_angles: ArrayLike) -> NDArray[np.float64]:
    """Return the angles that laws aim at, rad, (..., joints): :func:`unloaded_angle` of all joints of the tip.

    Parameters
    ----------
    inst
        The instrument.
    handle_angles
        As they were read, rad, (..., handle joints): noise beyond the handle's range is cut off. Where one is NaN, so
        are the targets.
    """
    inst = expanded(inst)
    handle = np.asarray(handle_angles, float)
    ranges = np.array([joint.range for joint in inst.handle_joints])
    within = np.nan_to_num(np.clip(handle, -ranges, ranges))
    is_pair = inst.closed_form is not None
    aims = np.asarray(unloaded_angle(inst, within[..., 0] if is_pair else within))
    known = np.isfinite(handle).all(axis=-1, keepdims=True)
    return np.where(known, aims[..., np.newaxis] if is_pair else aims, np.nan)
