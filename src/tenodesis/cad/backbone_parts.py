"""Parts of a tip of an elastic backbone: a socket on the stem, discs that guide the tendons, a plate at the far end.

A tip bends in one arc or in several, of one segment or of several one on the other, through which one rod goes. On the
disc at a segment's end its own tendons end; those of segments beyond pass through it.
"""

import math
from collections.abc import Sequence
from itertools import groupby, pairwise
from typing import NamedTuple

from tenodesis.cad import kernel as k
from tenodesis.cad.kernel import Location, Solid
from tenodesis.cad.parts import (
    Dimension,
    End,
    Part,
    Sizes,
    far_dimensions,
    ferrule,
    ferrule_collar,
    refuse,
    socket,
    spigot,
    tube_dimensions,
)

_DEVIATION = 1e-3
"""Length, mm, by which straight tendons between the discs of a segment may differ from the model's arcs."""
_THICKNESS = 1 / 3
"""Of a disc over the pitch, at which a tendon is as long as its arc (see :func:`backbone`)."""
_MODULUS = 60e9  # Pa, superelastic NiTi; ours
_STRAIGHT = 1e-6  # rad
_WIDER = 3.0
"""Width of a strip over its thickness, ours: to the side it is nine times as stiff."""


class BackboneSection(NamedTuple):
    """Section of a rod, mm: round, or a strip that is wider across the plane that it bends in."""

    thick: float
    """In that plane; the diameter of a round one."""
    wide: float
    """Across it; 0 of a round one."""

    def solid(self, low: float, high: float, more: float = 0.0) -> Solid:
        """Return a straight rod between two heights, or its bore, wider by so much."""
        thick, wide = (self.thick + more) / 2, (self.wide + more) / 2
        if self.wide:
            return k.box((-thick, thick), (-wide, wide), (low, high))
        return k.rod((0, 0, low), (0, 0, high), thick)

    @property
    def reach(self) -> float:
        """From its middle outward."""
        return math.hypot(self.thick, self.wide) / 2

    @property
    def name(self) -> str:
        """What to order."""
        return f"strip {self.thick:.3g} x {self.wide:.3g} mm" if self.wide else f"rod, diameter {self.thick:.3g} mm"


def section(rigidity: float, *, strip: bool) -> BackboneSection:
    """Return the section of a rod of a flexural rigidity, N m²: a strip where its tendons pass side by side."""
    if not strip:
        return BackboneSection(k.MM * (64 * rigidity / (math.pi * _MODULUS)) ** 0.25, 0.0)
    thick = k.MM * (12 * rigidity / (_WIDER * _MODULUS)) ** 0.25
    return BackboneSection(thick, _WIDER * thick)


class Backbone(NamedTuple):
    """Sizes of an arc of a backbone, mm and rad."""

    ways: tuple[tuple[float, float], ...]
    """Where tendons pass it, in its own frame."""
    ended: tuple[tuple[float, float], ...]
    """Those of them that end at its far end."""
    length: float
    rod: BackboneSection
    outer: float
    """Radius of a disc."""
    disc: float
    """Thickness of a disc."""
    spans: int
    """Between socket, discs and plate, as far as they belong to this arc."""
    largest: float
    """Angle that it was sized for."""
    collar: float

    def gap(self, reach: float) -> float:
        """Return what two discs leave between them at a distance inside the bend."""
        return _room(self.length, self.spans, reach, self.largest) - self.disc

    def end_radius(self, sizes: Sizes) -> float:
        """Return the radius of the disc at its far end, with walls about the ferrules of tendons that end there."""
        return max([self.outer, *(math.hypot(*way) + ferrule(sizes)[0] + sizes.wall for way in self.ended)])

    @property
    def pitch(self) -> float:
        """Distance of the discs along the backbone."""
        return self.length / self.spans

    @property
    def radius(self) -> float:
        """Of its outermost tendon."""
        return max(math.hypot(*way) for way in self.ways)


def backbone(  # noqa: PLR0917
    sizes: Sizes,
    keys: tuple[str, str],
    ways: Sequence[tuple[float, float]],
    ended: Sequence[tuple[float, float]],
    length: float,
    arcs: int,
    rod: BackboneSection,
    largest: float,
) -> Backbone:
    """Return the sizes of one of so many arcs of a length that bend to an angle, rad, discs close enough for tendons.

    `keys` are those of the file for radius and length. Raises InstrumentError if there is no room for the backbone, or
    the discs touch.
    """
    wall = sizes.wall
    radius = min(abs(x) if rod.wide else math.hypot(x, y) for x, y in ways)
    least = (rod.thick + sizes.bore + sizes.tunnel) / 2 + wall
    if radius < least:
        refuse(
            keys[0],
            radius,
            f"between a backbone of {rod.thick:.3g} mm and a tunnel of {sizes.tunnel:.3g} mm stays less than the "
            f"{wall:.3g} mm that process {sizes.process.name} allows",
            f"at least {least:.3g} mm",
        )
    # A span of angle a and pitch p, with a disc of thickness d, leaves a tendon a^2 / 24 (3 d - p) longer than its arc;
    # with d = p / 3 only the difference of the inside and the outside of the bend is left.
    count = math.ceil(math.sqrt(radius * arcs * largest**3 / (24 * _DEVIATION)))
    outermost = max(math.hypot(*way) for way in ways)
    outer = max(outermost + sizes.tunnel / 2, rod.reach) + wall
    # Of several arcs the last disc of one is the first of the next: an arc has a whole number of spans.
    fewest = 2 if arcs == 1 else 1

    if _room(length, count, outer, largest) - sizes.play < wall:
        count = int((length - outer * largest) / (wall + sizes.play + 1e-9))
    if count < fewest:
        refuse(
            keys[1],
            arcs * length,
            f"two discs of {wall:.3g} mm touch when it bends to {math.degrees(arcs * largest):.0f} deg",
            f"at least {arcs * (fewest * (wall + sizes.play) + outer * largest):.3g} mm",
        )

    disc = min(_room(length, count, outer, largest) - sizes.play, max(wall, _THICKNESS * length / count))
    return Backbone(tuple(ways), tuple(ended), length, rod, outer, disc, count, largest, max(3 * wall, 0.8 * radius))


def _room(length: float, spans: int, reach: float, largest: float) -> float:
    """Return the pitch of spans of an arc at a distance inside its bend, where discs come closer."""
    return length / spans - 2 * reach * math.tan(largest / spans / 2)


def backbone_parts(arcs: Sequence[tuple[Backbone, End]], sizes: Sizes) -> list[Part]:
    """Return the parts of a tip of a backbone; discs and rod have their places along it, bodies "arc" and "rod"."""
    (first, begin), (last, end) = arcs[0], arcs[-1]
    length = sum(one.length for one, _ in arcs)
    turn = (0.0, 0.0, begin.turn)
    parts = [
        Part(
            "tip_socket",
            "Socket of the backbone on the stem",
            _socket(first, begin, sizes),
            "stem",
            (begin.place(),),
            dimensions=(*_offsets(first, begin), *tube_dimensions(begin, sizes), *_bore(first, sizes)),
        )
    ]
    # A segment's arcs have names that begin alike, and discs with the same holes.
    at, segments = 0.0, [list(own) for _, own in groupby(arcs, key=lambda one: one[1].prefix)]
    for number, own in enumerate(segments):
        prefix, size = own[0][1].prefix, own[0][0]
        spots = [at + n * size.pitch for n in range(1, len(own) * size.spans)]
        at += len(own) * size.length
        note = f"{len(spots)} pieces, glued at a pitch of {size.pitch:.4g} mm."
        pieces = [(f"{prefix}_disc", "Disc of the backbone", _disc(size, sizes), spots, size.outer, note)]
        if number + 1 < len(segments):
            end_disc, title = own[-1][0], f"Disc at the end of {prefix}"
            note = f"Glued {at:.4g} mm from the socket; ferrules Ø{2.5 * sizes.rope:.3g} of tendons in its pockets."
            pieces.append((f"{prefix}_end", title, _end_disc(end_disc, sizes), [at], end_disc.end_radius(sizes), note))
        parts += [
            Part(
                name,
                title,
                solid,
                "arc",
                tuple(k.at(z=z, turn=(0.0, 0.0, own[0][1].turn)) for z in where),
                dimensions=(
                    *_offsets(size, own[0][1]),
                    Dimension("outer diameter", (-outer, 0, 0), (outer, 0, 0), "top", 1, "Ø"),
                    Dimension.height("thickness", -size.disc / 2, size.disc / 2, -1),
                    *_bore(size, sizes),
                ),
                notes=(note,),
                away=(0, 0, length * (number + 0.5) / len(segments)),
            )
            for name, title, solid, where, outer, note in pieces
            if where
        ]
    return [
        *parts,
        Part(
            "tip_plate",
            "Plate at the backbone's far end",
            _plate(last, end, sizes),
            end.far,
            (end.place(far=True),),
            dimensions=(*_offsets(last, end), *far_dimensions(end, sizes, -end.far_collar - last.collar)),
            away=(0, 0, length),
        ),
        Part(
            "backbone",
            f"Backbone: superelastic {first.rod.name}",
            first.rod.solid(-first.collar, length + last.collar),
            "rod",
            (k.at(turn=turn),),
            made=False,
            density=6450.0,
        ),
    ]


def _offsets(size: Backbone, end: End) -> tuple[Dimension, ...]:
    """Return the dimensions of where tendons are in a part, of one of those that are alike in it."""
    x, y = max(size.ways, key=lambda way: way[0])
    found = (Dimension("tendon's centre to backbone", (0, y, 0), (x, y, 0), "top", 1, "R" if not y else "", end.key),)
    return (*found, Dimension("tendons apart", (x, -y, 0), (x, y, 0), "top", -1, along="y")) if y else found


def _bore(size: Backbone, sizes: Sizes) -> tuple[Dimension, ...]:
    thick, wide = ((value + sizes.bore) / 2 for value in (size.rod.thick, size.rod.wide))
    if not size.rod.wide:
        return (Dimension("backbone's bore", (-thick, 0, 0), (thick, 0, 0), "top", -1, "Ø"),)
    return (
        Dimension("backbone's slot", (-thick, 0, 0), (thick, 0, 0), "top", -1),
        Dimension("slot's width", (0, -wide, 0), (0, wide, 0), "top", 1, along="y"),
    )


def bent_rod(rod: BackboneSection, arcs: Sequence[tuple[float, float, Location]], collar: float) -> Solid:
    """Return the backbone of arcs of a length, bent to an angle from a place, straight in its socket and its plate."""
    b = k.kernel()
    face = (b.Rectangle(rod.thick, rod.wide) if rod.wide else b.Circle(rod.thick / 2)).face()
    (_, _, begin), (length, angle, last) = arcs[0], arcs[-1]
    pieces = [begin * rod.solid(-collar, 0.0), last * arc_place(length, length, angle) * rod.solid(0.0, collar)]
    for length, angle, place in arcs:
        if abs(angle) < _STRAIGHT:
            pieces.append(place * rod.solid(0.0, length))
            continue
        bend = b.Axis((length / angle, 0, 0), (0, 1 if angle > 0 else -1, 0))
        pieces.append(place * b.Solid.revolve(face, abs(math.degrees(angle)), bend))
    return b.Compound(children=pieces)


def arc_place(along: float, length: float, angle: float) -> k.Location:
    """Return the place at a distance along an arc of a length that is bent to an angle, rad."""
    turned = angle * along / length
    if abs(angle) < 1e-3 * _STRAIGHT:
        return k.at(z=along)
    bend = length / angle
    return k.at(bend * (1 - math.cos(turned)), 0, bend * math.sin(turned)) * k.turned_about_y(turned)


def _bored(size: Backbone, sizes: Sizes, body: Solid, low: float, high: float) -> Solid:
    """Return a body with the tunnels of its tendons between two heights."""
    for x, y in size.ways:
        body -= k.rod((x, y, low), (x, y, high), sizes.tunnel / 2)
    return body


def _socket(size: Backbone, end: End, sizes: Sizes) -> Solid:
    body = k.rod((0, 0, -end.near_length), (0, 0, 0), end.stem_radius)
    body = _bored(size, sizes, body, -end.near_length, 0.0)
    body += spigot(end, sizes, -end.near_length)
    return body - size.rod.solid(-size.collar, 0.0, sizes.bore)


def _disc(size: Backbone, sizes: Sizes) -> Solid:
    half = size.disc / 2
    body = _bored(size, sizes, k.rod((0, 0, -half), (0, 0, half), size.outer), -half, half)
    return body - size.rod.solid(-half, half, sizes.bore)


def _pocket(size: Backbone, sizes: Sizes) -> float:
    """Return the depth of a ferrule's pocket in a disc, mm."""
    return min(max(size.disc - sizes.wall, 0.0), ferrule(sizes)[1])


def _end_disc(size: Backbone, sizes: Sizes) -> Solid:
    """Return the disc on which tendons end, the pockets of their ferrules outward."""
    wide, deep = ferrule(sizes)[0], _pocket(size, sizes)
    body = _disc(size._replace(outer=size.end_radius(sizes)), sizes)
    for x, y in size.ended if deep else ():
        body -= k.rod((x, y, size.disc / 2 - deep), (x, y, size.disc / 2), wide)
    return body


def check_ends(arcs: Sequence[Backbone], sizes: Sizes, key: str) -> None:
    """Refuse a disc at the end of an inner segment whose ferrules have no room before the next disc, bent."""
    for one, beyond in pairwise(arcs):
        if not one.ended:
            continue
        standing = ferrule(sizes)[1] - _pocket(one, sizes) + sizes.play
        free = beyond.gap(max(math.hypot(*way) for way in one.ended) + ferrule(sizes)[0])
        if free < standing:
            refuse(
                key,
                sizes.rope,
                f"ends of tendons stand {standing:.3g} mm out of a disc, and the next leaves {max(free, 0.0):.3g} mm",
                "thinner, or the backbone longer",
            )


def _plate(size: Backbone, end: End, sizes: Sizes) -> Solid:
    """Return the plate, whose collar is toward -z."""
    bottom, (wide, deep) = -size.collar - end.far_collar, ferrule(sizes)
    body = k.rod((0, 0, bottom), (0, 0, 0), ferrule_collar(size.radius, end, sizes))
    size = size._replace(ways=tuple((x, -y) for x, y in size.ways))
    body = _bored(size, sizes, body, bottom, 0.0)
    deep = min(deep, end.far_collar - 2 * sizes.wall)
    for x, y in size.ways:
        body -= k.rod((x, y, bottom), (x, y, bottom + deep), wide)
    body -= size.rod.solid(-size.collar, 0.0, sizes.bore)
    return body - socket(end, sizes, bottom)
