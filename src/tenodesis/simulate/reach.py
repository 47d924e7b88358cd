"""Handle angles that an instrument can reach."""

from collections.abc import Sequence
from math import degrees

import numpy as np

from tenodesis import statics
from tenodesis.errors import NoSolutionError, ProtocolError
from tenodesis.instrument import ShortForm
from tenodesis.run import Array
from tenodesis.simulate.places import Place

_ROUNDING = 1 + 1e-9


def check_handle_angles(place: Place, names: Sequence[str], angles: Array) -> None:
    """Check that handle angles are within the handle's range and do not bend the unloaded tip to its stop.

    The angles (rad, shape (n,)) are of one joint of the handle, whose range alone counts without an axis of its own.
    They are named in the error, a ProtocolError about the first that is not.
    """
    largest, inst = 0.0 if place.joint is None else place.joint.range, place.plane
    for name, angle in zip(names, angles, strict=True):
        if abs(angle) > largest:
            raise _beyond(name, float(angle), f"within the handle's range of ±{degrees(largest):.6g} deg")
    if inst is None:
        return
    bent = np.asarray(statics.output_angle(inst, angles))
    beyond = np.flatnonzero(~(np.abs(bent) <= inst.output_stop * _ROUNDING))
    if beyond.size:
        first = int(beyond[0])
        stop = f"within the joint's stops at ±{degrees(inst.output_stop):.6g} deg"
        raise ProtocolError(
            f"{names[first]} is {degrees(angles[first]):.6g} deg, which bends the unloaded tip to "
            f"{degrees(bent[first]):.6g} deg; that must be {stop}",
            key=names[first],
            value=float(angles[first]),
            allowed=stop,
        )


def check_handle_angle(place: Place, key: str, angle: float) -> float:
    """Return a handle angle (rad), given by a key, that :func:`check_handle_angles` accepts; errors as there."""
    check_handle_angles(place, [key], np.array([angle]))
    return angle


def unloaded_handle_angle(inst: ShortForm, key: str, angle: float) -> float:
    """Return the handle angle (rad) of an output angle (rad), given by a key, without load.

    Raises ProtocolError if the output angle is beyond the output's range, or the handle cannot give it.
    """
    if abs(angle) > inst.output_range * _ROUNDING:
        raise _beyond(key, angle, f"within the output range of ±{degrees(inst.output_range):.6g} deg")
    try:
        return float(statics.handle_angle(inst, angle))
    except NoSolutionError as problem:
        raise ProtocolError(
            f"{key} is {degrees(angle):.6g} deg: {str(problem).rstrip('.')}", key=key, value=angle
        ) from None


def _beyond(name: str, angle: float, allowed: str) -> ProtocolError:
    return ProtocolError(
        f"{name} is {degrees(angle):.6g} deg; it must be {allowed}", key=name, value=angle, allowed=allowed
    )
