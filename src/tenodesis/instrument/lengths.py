"""Lengths of an instrument from handle to tip, including those that its file omits."""

import math
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

from tenodesis import _core
from tenodesis.errors import InstrumentError

if TYPE_CHECKING:
    from tenodesis.instrument.instrument import Instrument
    from tenodesis.instrument.short_form import ShortForm

# Defaults of what a file leaves out, as shares. The first is the paper's (Table I), the others are our choice.
STEM_PER_RADIUS = 2.5
_JAW_SHARE = 0.4
_INSERTION_SHARES = 0.2, 0.5, 0.8  # least, at rest, most


class Dimensions(NamedTuple):
    """Lengths of an instrument from handle to tip, m; radii and joint lengths by axis, from the stem outward."""

    axes: tuple[str, ...]
    stem_length: float
    """Between the joints' ends nearest to the stem."""
    stem_diameter: float
    joint_spacing: float
    handle_joint_spacing: float
    end_effector_length: float
    """From the last distal joint's far end to where the force acts."""
    handle_length: float
    """From the last proximal joint's far end to where the hand acts."""
    jaw_length: float
    distal_radii: tuple[float, ...]
    """Pitch radii of gears, radii of pulleys, or a continuum's tendon offset."""
    proximal_radii: tuple[float, ...]
    insertion: float
    """Of the stem beyond the port, at rest."""


@lru_cache(maxsize=64)
def lengths(inst: "ShortForm") -> Dimensions:
    """Return the lengths of an instrument in the short form, m; errors as :func:`tenodesis.kinematics.dimensions`."""
    axes = inst.planar
    distal, proximal = (tuple(_radius(axis, end) for axis in axes) for end in ("distal", "proximal"))
    geometry = inst.geometry
    spacing = 2 * distal[0] if geometry.joint_spacing is None else geometry.joint_spacing
    handle_spacing = 2 * proximal[0] if geometry.handle_joint_spacing is None else geometry.handle_joint_spacing
    effector, handle = axes[-1].end_effector_length, axes[-1].handle_length
    joints = sum(sum(_core.joint_lengths(axis.spec)) for axis in axes)
    taken = effector + handle + joints + (len(axes) - 1) * (spacing + handle_spacing)
    stem = inst.overall_length - taken if geometry.stem_length is None else geometry.stem_length
    if not stem > 0:
        raise InstrumentError(
            f"{inst.name}: overall_length is {inst.overall_length:g} m, of which handle, end-effector and joints take "
            f"{taken:g} m, so that no stem is left; it must be larger, or geometry.stem_length given.",
            key="overall_length",
            value=inst.overall_length,
            allowed=f"above {taken:g} m",
        )
    return Dimensions(
        axes=tuple(inst.axes),
        stem_length=stem,
        stem_diameter=STEM_PER_RADIUS * distal[0] if inst.stem_diameter is None else inst.stem_diameter,
        joint_spacing=spacing,
        handle_joint_spacing=handle_spacing,
        end_effector_length=effector,
        handle_length=handle,
        jaw_length=jaw_length(inst, effector),
        distal_radii=distal,
        proximal_radii=proximal,
        insertion=insertions(inst, stem)[1],
    )


def insertions(inst: "Instrument", stem: float) -> tuple[float, float, float]:
    """Return the least, the resting and the most insertion through the port, m, with a stem of a length (m).

    Raises InstrumentError if the resting one is not between the others.
    """
    given = inst.geometry.least_insertion, inst.geometry.insertion, inst.geometry.most_insertion
    least, rest, most = (
        share * stem if length is None else length for share, length in zip(_INSERTION_SHARES, given, strict=True)
    )
    if not least <= rest <= most:
        raise InstrumentError(
            f"{inst.name}: geometry.insertion is {rest:g} m; it must be from least_insertion, {least:g} m, to "
            f"most_insertion, {most:g} m.",
            key="geometry.insertion",
            value=rest,
            allowed=f"from {least:g} to {most:g} m",
        )
    return least, rest, most


def jaw_length(inst: "Instrument", effector: float) -> float:
    """Return the length of the jaws of an end-effector of a length, m."""
    return _JAW_SHARE * effector if inst.geometry.jaw_length is None else inst.geometry.jaw_length


def _radius(axis: "ShortForm", end: str) -> float:
    field = next(field for field, parameter in axis.parameter_fields.items() if parameter == f"{end}_radius")
    radius = getattr(axis, field)
    return math.nan if radius is None else float(radius)
