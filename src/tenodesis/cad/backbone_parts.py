"""Parts of a tip of an elastic backbone: a socket on the stem, discs that guide the tendons, a plate at the far end."""

import math
from typing import NamedTuple

from tenodesis.cad import kernel as k
from tenodesis.cad.kernel import FLIP, Solid
from tenodesis.cad.parts import (
    Dimension,
    End,
    Part,
    Sizes,
    far_dimensions,
    ferrule_collar,
    ferrule_pockets,
    refuse,
    socket,
    spigot,
    tube_dimensions,
)

_DEVIATION = 1e-3
"""Length, mm, by which straight tendons between the discs may differ from the model's arcs."""
_THICKNESS = 1 / 3
"""Of a disc over the pitch, at which a tendon is as long as its arc (see :func:`backbone`)."""


class Backbone(NamedTuple):
    """Sizes of a tip of a backbone, mm and rad."""

    radius: float
    """Of a tendon from the backbone."""
    length: float
    rod: float
    """Diameter of the backbone."""
    outer: float
    """Radius of a disc."""
    disc: float
    """Thickness of a disc."""
    spans: int
    """Between socket, discs and plate."""
    collar: float

    @property
    def pitch(self) -> float:
        """Distance of the discs along the backbone."""
        return self.length / self.spans


def backbone(sizes: Sizes, radius: float, length: float, rod: float, largest: float) -> Backbone:
    """Return the sizes of a tip whose backbone bends to an angle, rad, with discs close enough for its tendons.

    Raises InstrumentError if there is no room for the backbone, or the discs touch.
    """
    wall = sizes.wall
    least = (rod + sizes.bore + sizes.tunnel) / 2 + wall
    if radius < least:
        refuse(
            "distal_tendon_offset",
            radius,
            f"between a backbone of {rod:.3g} mm and a tunnel of {sizes.tunnel:.3g} mm stays less than the "
            f"{wall:.3g} mm that process {sizes.process.name} allows",
            f"at least {least:.3g} mm",
        )
    # A span of angle a and pitch p, with a disc of thickness d, leaves a tendon a^2 / 24 (3 d - p) longer than its arc;
    # with d = p / 3 only the difference of the inside and the outside of the bend is left.
    count = math.ceil(math.sqrt(radius * largest**3 / (24 * _DEVIATION)))
    outer = radius + sizes.tunnel / 2 + wall
    # On the inside of the bend the discs' rims come closer.
    room = length / count - 2 * outer * math.tan(largest / count / 2)
    if room - sizes.play < wall:
        count = int((length - outer * largest) / (wall + sizes.play + 1e-9))
        room = length / max(count, 1) - 2 * outer * math.tan(largest / max(count, 1) / 2)
    if count < 2:
        least = 2 * (wall + sizes.play) + outer * largest
        refuse(
            "backbone_length",
            length,
            f"two discs of {wall:.3g} mm touch when it bends to {math.degrees(largest):.0f} deg",
            f"at least {least:.3g} mm",
        )
    disc = min(room - sizes.play, max(wall, _THICKNESS * length / count))
    return Backbone(radius, length, rod, outer, disc, count, max(3 * wall, 0.8 * radius))


def backbone_parts(tip: Backbone, end: End, sizes: Sizes) -> list[Part]:
    """Return the parts of a tip of a backbone; discs are fixed to places along it, body "arc"."""
    radius, bore = tip.radius, (tip.rod + sizes.bore) / 2
    discs = tuple(k.at(z=number * tip.pitch) for number in range(1, tip.spans))
    out = tip.length
    offset = Dimension("tendon's centre to backbone", (0, 0, 0), (radius, 0, 0), "top", 1, "R", end.key)
    return [
        Part(
            "tip_socket",
            "Socket of the backbone on the stem",
            _socket(tip, end, sizes),
            "stem",
            (k.at(),),
            dimensions=(
                offset,
                *tube_dimensions(end, sizes),
                Dimension("backbone's bore", (-bore, 0, 0), (bore, 0, 0), "top", -1, "Ø"),
            ),
        ),
        Part(
            "tip_disc",
            "Disc of the backbone",
            _disc(tip, sizes),
            "arc",
            discs,
            dimensions=(
                offset,
                Dimension("outer diameter", (-tip.outer, 0, 0), (tip.outer, 0, 0), "top", 1, "Ø"),
                Dimension("thickness", (0, 0, -tip.disc / 2), (0, 0, tip.disc / 2), "front", -1, along="y"),
            ),
            notes=(f"{tip.spans - 1} pieces, glued at a pitch of {tip.pitch:.4g} mm.",),
            away=(0, 0, out / 2),
        ),
        Part(
            "tip_plate",
            "Plate at the backbone's far end",
            _plate(tip, end, sizes),
            end.far,
            (k.at(turn=FLIP),),
            dimensions=(offset, *far_dimensions(end, sizes, -end.far_collar - tip.collar)),
            away=(0, 0, out),
        ),
        Part(
            "backbone",
            f"Backbone: superelastic rod, diameter {tip.rod:.3g} mm",
            k.rod((0, 0, -tip.collar), (0, 0, tip.length + tip.collar), tip.rod / 2),
            "rod",
            (k.at(),),
            made=False,
            density=6450.0,
        ),
    ]


def bent_rod(tip: Backbone, angle: float) -> Solid:
    """Return the backbone bent to an angle within the joint, straight in its socket and its plate."""
    ends = k.rod((0, 0, -tip.collar), (0, 0, 0), tip.rod / 2)
    if abs(angle) < 1e-6:
        return ends + k.rod((0, 0, 0), (0, 0, tip.length + tip.collar), tip.rod / 2)
    b = k.kernel()
    bend = tip.length / angle
    disc = b.Face(b.Wire(b.Edge.make_circle(tip.rod / 2)))
    arc = b.Solid.revolve(disc, abs(math.degrees(angle)), b.Axis((bend, 0, 0), (0, 1 if angle > 0 else -1, 0)))
    far = arc_place(tip.length, tip.length, angle)
    return ends + arc + far * k.rod((0, 0, 0), (0, 0, tip.collar), tip.rod / 2)


def arc_place(along: float, length: float, angle: float) -> k.Location:
    """Return the place at a distance along a backbone of a length that is bent to an angle, rad."""
    turned = angle * along / length
    if abs(angle) < 1e-9:
        return k.at(z=along)
    bend = length / angle
    return k.at(bend * (1 - math.cos(turned)), 0, bend * math.sin(turned)) * k.turned_about_y(turned)


def _socket(tip: Backbone, end: End, sizes: Sizes) -> Solid:
    body = k.rod((0, 0, -end.near_length), (0, 0, 0), end.stem_radius)
    for x in (-tip.radius, tip.radius):
        body -= k.rod((x, 0, -end.near_length), (x, 0, 0), sizes.tunnel / 2)
    body += spigot(end, sizes, -end.near_length)
    return body - k.rod((0, 0, -tip.collar), (0, 0, 0), (tip.rod + sizes.bore) / 2)


def _disc(tip: Backbone, sizes: Sizes) -> Solid:
    half = tip.disc / 2
    body = k.rod((0, 0, -half), (0, 0, half), tip.outer)
    for x in (-tip.radius, tip.radius):
        body -= k.rod((x, 0, -half), (x, 0, half), sizes.tunnel / 2)
    return body - k.rod((0, 0, -half), (0, 0, half), (tip.rod + sizes.bore) / 2)


def _plate(tip: Backbone, end: End, sizes: Sizes) -> Solid:
    """Return the plate, whose collar is toward -z."""
    bottom = -tip.collar - end.far_collar
    body = k.rod((0, 0, bottom), (0, 0, 0), ferrule_collar(tip.radius, end, sizes))
    for x in (-tip.radius, tip.radius):
        body -= k.rod((x, 0, bottom), (x, 0, 0), sizes.tunnel / 2)
    body -= ferrule_pockets(tip.radius, sizes, bottom, end.far_collar)
    body -= k.rod((0, 0, -tip.collar), (0, 0, 0), (tip.rod + sizes.bore) / 2)
    return body - socket(end, sizes, bottom)
