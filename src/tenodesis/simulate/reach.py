"""Handle angles that an instrument can reach."""

from collections.abc import Sequence
from math import degrees

import numpy as np

from tenodesis.errors import ProtocolError
from tenodesis.run import Array
from tenodesis.simulate.places import Place

_ROUNDING = 1 + 1e-9


def check_handle_angles(place: Place, names: Sequence[str], angles: Array) -> None:
    """Check that angles are within the range of what they move and do not bend the unloaded tip to its stop.

    The angles (rad, shape (n,)) are of one joint of the handle, or of the tip without one. They are named in the error,
    a ProtocolError about the first that is not.
    """
    low, high = place.range
    for name, angle in zip(names, angles, strict=True):
        if not low <= angle <= high:
            whose = "the handle's" if place.joint is not None else f"{place.name}'s"
            raise _beyond(name, float(angle), f"within {whose} range of {_between(low, high)}")
    if place.bends and place.joint is not None:
        check_output_angles(place, names, angles, place.output_angles(np.asarray(angles, float)))


def check_output_angles(
    place: Place, names: Sequence[str], angles: Sequence[float] | Array, bent: Array | None = None
) -> None:
    """Check that angles, rad, or those to which they bend the unloaded tip, are within its stops; errors as above."""
    low, high = place.limits("stops")
    reached = np.asarray(angles) if bent is None else bent
    beyond = np.flatnonzero(~((low * _ROUNDING <= reached) & (reached <= high * _ROUNDING)))
    if beyond.size:
        first = int(beyond[0])
        stop = f"within the joint's stops at {_between(low, high)}"
        bends = "; it" if bent is None else f", which bends the unloaded tip to {degrees(bent[first]):.6g} deg; that"
        raise ProtocolError(
            f"{names[first]} is {degrees(angles[first]):.6g} deg{bends} must be {stop}",
            key=names[first],
            value=float(angles[first]),
            allowed=stop,
        )


def check_handle_angle(place: Place, key: str, angle: float) -> float:
    """Return a handle angle (rad), given by a key, that :func:`check_handle_angles` accepts; errors as there."""
    check_handle_angles(place, [key], np.array([angle]))
    return angle


def unloaded_handle_angle(place: Place, key: str, angle: float) -> float:
    """Return the handle angle (rad) of an output angle (rad), given by a key, without load.

    Raises ProtocolError if the output angle is beyond the output's range, or the handle cannot give it.
    """
    low, high = place.limits("limits")
    if not low * _ROUNDING <= angle <= high * _ROUNDING:
        raise _beyond(key, angle, f"within the output range of {_between(low, high)}")
    found = place.handle_angle(angle)
    if not np.isfinite(found):
        raise _beyond(key, angle, f"what the handle's range of {_between(*place.range)} turns {place.inst.name} to")
    return found


def _between(low: float, high: float) -> str:
    return f"±{degrees(high):.6g} deg" if low == -high else f"{degrees(low):.6g} to {degrees(high):.6g} deg"


def _beyond(name: str, angle: float, allowed: str) -> ProtocolError:
    return ProtocolError(
        f"{name} is {degrees(angle):.6g} deg; it must be {allowed}", key=name, value=angle, allowed=allowed
    )
