"""The solids of an instrument: which body each belongs to, and its colour."""

from typing import NamedTuple

from tenodesis.console.solids import Solid, disc, gear, jaw, joined, moved, plate, rod, turned
from tenodesis.instrument import Instrument
from tenodesis.kinematics import Dimensions

METAL = (176, 184, 194)
STEEL = (120, 130, 144)
GRIP = (58, 70, 86)
GEAR = (196, 160, 90)


class Part(NamedTuple):
    """A solid at rest on a body of :class:`tenodesis.kinematics.Frames`, in that body's frame."""

    name: str
    body: str
    solid: Solid
    colour: tuple[int, int, int]
    opacity: float | None = None


class _End(NamedTuple):
    """The joints at one end of the stem."""

    prefix: str
    side: int
    """1 toward the tip, -1 toward the hand"""
    kind: str
    start: float
    spacing: float
    radii: tuple[float, ...]


def parts(inst: Instrument, lengths: Dimensions) -> list[Part]:
    """Return all solids of an instrument, lengths in m."""
    stem, radius = lengths.stem_length, lengths.stem_diameter / 2
    # A continuum is worked by a pulley.
    at_hand = "tendon-pulley" if inst.joint_type == "continuum" else inst.joint_type
    tip = _End("", 1, inst.joint_type, 0.0, lengths.joint_spacing, lengths.distal_radii)
    hand = _End("handle_", -1, at_hand, -stem, lengths.handle_joint_spacing, lengths.proximal_radii)
    found = [Part("tube", "stem", rod(radius, -stem, 0), METAL, 0.35)]
    for end in (tip, hand):
        on, at = "stem", end.start
        for number, axis in enumerate(lengths.axes):
            if number:
                found.append(
                    Part(f"{end.prefix}{axis}_strut", on, rod(0.5 * radius, min(0.0, at), max(0.0, at)), STEEL)
                )
            found += _joint(end, axis, end.radii[number], on, at)
            on, at = f"{end.prefix}{axis}_far", end.side * end.spacing
    return found + effector(lengths) + _grip(lengths)


def effector(lengths: Dimensions) -> list[Part]:
    """Return the solids beyond the last distal joint."""
    radius, length = lengths.stem_diameter / 2, lengths.end_effector_length
    root = length - lengths.jaw_length
    jaws = joined(*(jaw(1.4 * radius, lengths.jaw_length, root, side) for side in (1, -1)))
    return [
        Part("wrist", "end_effector", rod(0.7 * radius, 0, root), METAL),
        Part("jaws", "end_effector", jaws, STEEL),
    ]


def _grip(lengths: Dimensions) -> list[Part]:
    radius, length = lengths.stem_diameter / 2, lengths.handle_length
    body = f"handle_{lengths.axes[-1]}_far"
    held = joined(rod(1.5 * radius, -length, -0.35 * length), rod(1.8 * radius, -length, -0.93 * length))
    return [Part("shaft", body, rod(0.7 * radius, -0.35 * length, 0), METAL), Part("grip", body, held, GRIP)]


def _joint(end: _End, axis: str, radius: float, on: str, at: float) -> list[Part]:
    """Return the solids of a joint that begins on a body, at a place along it."""
    if end.kind == "continuum":
        return []

    def placed(name: str, body: str, solid: Solid, colour: tuple[int, int, int], along: float = 0.0) -> Part:
        facing = turned(solid) if axis == "pitch" else solid
        return Part(f"{end.prefix}{axis}_{name}", body, moved(facing, (0, 0, along)), colour)

    if end.kind == "tendon-pulley":
        return [placed("pulley", on, disc(radius, 0.6 * radius), GEAR, at)]
    thickness, apart = 0.35 * radius, 0.75 * radius
    links = _pair(
        plate(0.6 * radius, 0.12 * radius, end.side * radius - radius, end.side * radius + radius), 1.05 * radius
    )
    return [
        placed("near_gear", on, _pair(gear(radius, thickness), apart), GEAR, at),
        placed("far_gear", f"{end.prefix}{axis}_far", _pair(gear(radius, thickness, shifted=True), apart), GEAR),
        placed("link", f"{end.prefix}{axis}_carrier", links, STEEL),
    ]


def _pair(solid: Solid, apart: float) -> Solid:
    """Return a solid on either side of the plane that a joint bends in, so that the tendons are seen between."""
    return joined(moved(solid, (0, apart, 0)), moved(solid, (0, -apart, 0)))
