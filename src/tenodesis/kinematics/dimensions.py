"""Lengths and limits of an instrument from handle to tip, including those that its file omits."""

from functools import lru_cache
from typing import NamedTuple

from tenodesis import _core
from tenodesis.instrument import InstrumentLike, ShortForm, as_short_form
from tenodesis.instrument.lengths import Dimensions, insertions, lengths


class Limits(NamedTuple):
    """Smallest and largest value of every coordinate of the tip, rad and m; (0, 0) for an axis it does not have."""

    pan: tuple[float, float]
    tilt: tuple[float, float]
    spin: tuple[float, float]
    insertion: tuple[float, float]
    yaw: tuple[float, float]
    pitch: tuple[float, float]
    roll: tuple[float, float]


def dimensions(inst: InstrumentLike) -> Dimensions:
    """Return the lengths of an instrument from handle to tip, m (Fig. 1, Table I).

    What the file leaves out follows from the rest: the stem's length is overall_length less handle, end-effector and
    joints; two joints at one end are as far apart as each is long; the stem's diameter is 2.5 distal radii.

    Raises
    ------
    TypeError
        `inst` is no instrument.
    InstrumentError
        Nothing is left for the stem, or the insertion at rest does not fit it.
    """
    return lengths(as_short_form(inst))


def limits(inst: InstrumentLike) -> Limits:
    """Return the limits of the tip's coordinates, rad and m: bending to output_range, the rest by table geometry.

    Raises InstrumentError as :func:`dimensions`.
    """
    inst = as_short_form(inst)
    stem = dimensions(inst).stem_length
    least, _, most = insertions(inst, stem)
    geometry = inst.geometry
    bends = {axis: planar.output_range for axis, planar in zip(inst.axes, inst.planar, strict=True)}
    pivot, yaw, pitch = geometry.pivot_range, bends.get("yaw", 0.0), bends.get("pitch", 0.0)
    return Limits(
        pan=(-pivot, pivot),
        tilt=(-pivot, pivot),
        spin=(-geometry.spin_range, geometry.spin_range),
        insertion=(least, most),
        yaw=(-yaw, yaw),
        pitch=(-pitch, pitch),
        roll=(-geometry.roll_range, geometry.roll_range),
    )


@lru_cache(maxsize=64)
def chain(inst: ShortForm) -> _core.Chain:
    """Return the chain from port to tip in the core's form."""
    along = dimensions(inst)
    return _core.Chain(
        [axis.spec for axis in inst.planar],
        [axis == "pitch" for axis in inst.axes],
        along.stem_length,
        along.joint_spacing,
        along.handle_joint_spacing,
    )
