"""What all mechanisms have at the ends of the stem: spigots, transitions, pockets, seats and sockets."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from tenodesis.cad import kernel as k
from tenodesis.cad.kernel import Solid
from tenodesis.cad.parts import Dimension
from tenodesis.cad.sizes import Sizes

_STEEPEST = math.radians(20)
"""Slant of a tendon between the handle's joint and the stem; its bends there do not change with the joint."""


class End(NamedTuple):
    """One end of the stem, mm: what its joint's parts have in common."""

    tip: bool
    key: str
    """Key of the instrument file for the radius of its joint."""
    carrier: str
    far: str
    stem_length: float
    stem_radius: float
    stem_bore: float
    """Radius within the stem's tube."""
    tendon_radius: float
    """Distance of a tendon from the stem's axis within it."""
    near_length: float
    """From the joint's axis to the stem's tube."""
    far_collar: float
    """Length of the far body's collar."""
    rod: float
    """Diameter of what is fixed to the far body."""
    seat: float
    """Radius of a sheath's seat."""
    shift: float = 0.0
    """Distance of a tendon within the stem from the plane that the joint bends in."""


def _spigot_length(end: End) -> float:
    return 1.2 * end.stem_radius


def spigot(end: End, sizes: Sizes, top: float) -> Solid:
    """Return what goes into the stem's tube from a height downward; flat on two sides, where the tendons pass."""
    radius, length = end.stem_bore - sizes.play / 2, _spigot_length(end)
    flat = end.tendon_radius - sizes.tunnel / 2
    body = k.rod((0, 0, top - length), (0, 0, top), radius)
    for low, high in ((flat, radius + 1), (-radius - 1, -flat)):
        body -= k.box((low, high), (-radius, radius), (top - length, top))
    return body


def tube_dimensions(end: End, sizes: Sizes) -> tuple[Dimension, ...]:
    """Return the dimensions of the collar and spigot of a part on the stem."""
    top, length, radius = -end.near_length, _spigot_length(end), end.stem_bore - sizes.play / 2
    flat = end.tendon_radius - sizes.tunnel / 2
    return (
        Dimension("axis to tube", (0, 0, 0), (0, 0, top), "front", 1, along="y"),
        Dimension("spigot's length", (0, 0, top), (0, 0, top - length), "front", 1, along="y"),
        Dimension("spigot", (0, -radius, top), (0, radius, top), "side", -1, "Ø"),
        Dimension("over the spigot's flats", (-flat, 0, top), (flat, 0, top), "front", -1),
        Dimension("collar", (-end.stem_radius, 0, top), (end.stem_radius, 0, top), "top", -1, "Ø", "stem_diameter"),
    )


def far_dimensions(end: End, sizes: Sizes, bottom: float) -> tuple[Dimension, ...]:
    """Return the dimensions of the collar of a far body."""
    socket_radius = (end.rod + sizes.bore) / 2
    return (
        Dimension("axis to back", (0, 0, 0), (0, 0, bottom), "front", -1, along="y"),
        Dimension("socket", (-socket_radius, 0, bottom), (socket_radius, 0, bottom), "front", -1, "Ø"),
        Dimension(
            "socket's depth", (0, 0, bottom), (0, 0, bottom + end.far_collar - sizes.wall), "front", 1, along="y"
        ),
    )


def groove_dimensions(what: str, radius: float, bottom: float, y: float, key: str = "") -> tuple[Dimension, Dimension]:
    """Return the dimensions of a groove at a height y, to the centre of what lies in it and to its bottom, mm."""
    return (
        Dimension(f"radius to the {what}'s centre", (0, y, 0), (radius, y, 0), "front", 1, "R", key),
        Dimension("radius to the groove's bottom", (0, y, 0), (bottom, y, 0), "front", 1, "R", key),
    )


def transition_length(radius: float, tendon_radius: float) -> float:
    """Return the length within which a tendon goes from a joint's radius to its place in the stem."""
    return abs(radius - tendon_radius) / math.tan(_STEEPEST)


def transition(  # noqa: PLR0917
    end: End,
    sizes: Sizes,
    width: float,
    middle: float,
    top: float,
    ways: Sequence[tuple[tuple[float, float], tuple[float, float]]],
) -> tuple[Solid, list[Solid]]:
    """Return the body between a joint's collar and the stem, and its tunnels: from (x, y) at the top to (x, y)."""
    length = -end.near_length - top
    straight = min(0.25 * -length, end.stem_radius)
    low = -end.near_length + straight
    # The walls beside the slanted tunnels are slanted as well.
    wall = sizes.wall / math.cos(_STEEPEST) + 0.01
    width = max(width, *(abs(x) + sizes.tunnel / 2 + wall for (x, _), _ in ways))
    narrow = end.tendon_radius + sizes.tunnel / 2 + wall
    deep = max(middle, 0.4 * end.stem_radius, *(abs(y) + sizes.tunnel / 2 + sizes.wall for way in ways for _, y in way))
    body = k.bar([(-width, top), (-narrow, low), (narrow, low), (width, top)], -deep, deep)
    body += k.rod((0, 0, -end.near_length), (0, 0, low), end.stem_radius)
    tunnels = []
    for (x, y), (x_low, y_low) in ways:
        radius = sizes.tunnel / 2
        slanted = k.rod((x, y, top), (x_low, y_low, low), radius)
        for place in ((x, y, top), (x_low, y_low, low)):
            slanted += k.kernel().Pos(*place) * k.kernel().Sphere(radius)
        tunnels += [slanted, k.rod((x_low, y_low, -end.near_length), (x_low, y_low, low), radius)]
    return body, tunnels


def ferrule(sizes: Sizes) -> tuple[float, float]:
    """Return radius and length of the bore that holds a crimped ferrule of 2.5 rope diameters."""
    return 1.25 * sizes.rope + sizes.bore / 2, 4 * sizes.rope


def ferrule_collar(radius: float, end: End, sizes: Sizes) -> float:
    """Return the radius of the collar that holds the ferrules: the stem's, or more where their walls need it."""
    return max(end.stem_radius, radius + ferrule(sizes)[0] + sizes.wall)


def ferrule_pockets(radius: float, sizes: Sizes, bottom: float, collar: float) -> Solid:
    """Return the pockets of the ferrules at the tendons' ends."""
    wide, deep = ferrule(sizes)
    deep = min(deep, collar - 2 * sizes.wall)
    left, right = (k.rod((x, 0, bottom), (x, 0, bottom + deep), wide) for x in (-radius, radius))
    return left + right


def sheath_seats(radius: float, end: End, sizes: Sizes, bottom: float) -> Solid:
    """Return the seats of the sheaths through which the tendons go on to the motors."""
    deep = end.far_collar - 2 * sizes.wall
    left, right = (k.rod((x, 0, bottom), (x, 0, bottom + deep), end.seat) for x in (-radius, radius))
    return left + right


def socket(end: End, sizes: Sizes, bottom: float) -> Solid:
    """Return the socket for what is fixed to the far body."""
    return k.rod((0, 0, bottom), (0, 0, bottom + end.far_collar - sizes.wall), (end.rod + sizes.bore) / 2)
