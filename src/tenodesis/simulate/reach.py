"""Handle angles that an instrument can be asked for."""

from math import degrees

import numpy as np

from tenodesis import statics
from tenodesis.errors import NoSolutionError, ProtocolError
from tenodesis.instrument import Instrument
from tenodesis.run import Array

_ROUNDING = 1 + 1e-9


def refuse_beyond(inst: Instrument, told: list[str], angles: Array) -> None:
    """Refuse the first handle angle (rad) beyond the handle's range, or that bends the unloaded tip to its stop.

    Parameters
    ----------
    inst
        The instrument, of one axis.
    told
        What to call each angle in the error.
    angles
        Handle angles, rad.

    Raises
    ------
    ProtocolError
        One is beyond.
    """
    for name, angle in zip(told, angles, strict=True):
        if abs(angle) > inst.handle_range:
            raise ProtocolError(
                f"{name} is {degrees(angle):.6g} deg; allowed is the handle's range of "
                f"±{degrees(inst.handle_range):.6g} deg"
            )
    bent = np.asarray(statics.output_angle(inst, angles))
    beyond = np.flatnonzero(~(np.abs(bent) <= inst.output_stop * _ROUNDING))
    if beyond.size:
        first = int(beyond[0])
        raise ProtocolError(
            f"{told[first]} is {degrees(angles[first]):.6g} deg, which bends the unloaded tip to "
            f"{degrees(bent[first]):.6g} deg; the joint stops at ±{degrees(inst.output_stop):.6g} deg"
        )


def checked(inst: Instrument, key: str, angle: float) -> float:
    """Return a handle angle (rad) that was given by a key, unless it is beyond what is allowed.

    Raises
    ------
    ProtocolError
        It is beyond the handle's range, or bends the unloaded tip to its stop.
    """
    refuse_beyond(inst, [key], np.array([angle]))
    return angle


def of_output(inst: Instrument, key: str, angle: float) -> float:
    """Return the handle angle (rad) that gives an output angle (rad) without load.

    Raises
    ------
    ProtocolError
        The output angle is beyond the output's range, or the handle cannot give it.
    """
    if abs(angle) > inst.output_range * _ROUNDING:
        raise ProtocolError(
            f"{key} is {degrees(angle):.6g} deg; allowed is the output range of ±{degrees(inst.output_range):.6g} deg"
        )
    try:
        return float(statics.handle_angle(inst, angle))
    except NoSolutionError as problem:
        raise ProtocolError(f"{key} is {degrees(angle):.6g} deg: {str(problem).rstrip('.')}") from None


def largest(inst: Instrument) -> float:
    """Return the largest handle angle (rad) that keeps to the handle's range and, without load, the output's."""
    try:
        return min(inst.handle_range, float(statics.handle_angle(inst, inst.output_range)))
    except NoSolutionError:
        return inst.handle_range
