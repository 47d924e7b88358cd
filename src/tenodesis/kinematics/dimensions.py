"""Lengths and limits of an instrument from handle to tip, including those that its file omits."""

from typing import NamedTuple

from tenodesis.instrument import Instrument, InstrumentLike, as_short_form
from tenodesis.instrument.lengths import Dimensions, insertions, jaw_length, lengths


class Limits(NamedTuple):
    """Smallest and largest value of every coordinate of the tip, rad and m; (0, 0) for an axis it does not have."""

    pan: tuple[float, float]
    tilt: tuple[float, float]
    spin: tuple[float, float]
    insertion: tuple[float, float]
    yaw: tuple[float, float]
    pitch: tuple[float, float]
    roll: tuple[float, float]


class PortRange(NamedTuple):
    """Smallest and largest value of the stem's coordinates and of the roll, rad and m, and lengths at rest, m."""

    pan: tuple[float, float]
    tilt: tuple[float, float]
    spin: tuple[float, float]
    insertion: tuple[float, float]
    roll: tuple[float, float]
    at_rest: float
    """Insertion."""
    jaw_length: float


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
    along = dimensions(inst)
    at_port = port_range(inst, along.stem_length, along.end_effector_length)
    bends = {axis: planar.output_range for axis, planar in zip(inst.axes, inst.planar, strict=True)}
    yaw, pitch = bends.get("yaw", 0.0), bends.get("pitch", 0.0)
    return Limits(
        pan=at_port.pan,
        tilt=at_port.tilt,
        spin=at_port.spin,
        insertion=at_port.insertion,
        yaw=(-yaw, yaw),
        pitch=(-pitch, pitch),
        roll=at_port.roll,
    )


def port_range(inst: Instrument, stem_length: float, end_effector_length: float) -> PortRange:
    """Return what the table geometry says of the port of an instrument with a stem and an end-effector of lengths, m.

    Raises InstrumentError if the insertion at rest is not between the least and the most.
    """
    geometry = inst.geometry
    pivot, spin, roll = geometry.pivot_range, geometry.spin_range, geometry.roll_range
    least, rest, most = insertions(inst, stem_length)
    return PortRange(
        pan=(-pivot, pivot),
        tilt=(-pivot, pivot),
        spin=(-spin, spin),
        insertion=(least, most),
        roll=(-roll, roll),
        at_rest=rest,
        jaw_length=jaw_length(inst, end_effector_length),
    )
