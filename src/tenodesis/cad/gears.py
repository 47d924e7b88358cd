"""Parts of a joint of gears at either end of the stem: flanks, toothed bodies with tunnels for the tendons, links."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from tenodesis.cad import kernel as k
from tenodesis.cad.kernel import Solid
from tenodesis.cad.parts import (
    PROCESSES,
    Dimension,
    End,
    Part,
    Sizes,
    far_dimensions,
    ferrule,
    ferrule_collar,
    ferrule_pockets,
    pin,
    refuse,
    sheath_seats,
    socket,
    spigot,
    transition,
    tube_dimensions,
)
from tenodesis.run import Array

PRESSURE_ANGLE = math.radians(20)
"""ISO 53."""
_ROOT = 1.25  # of a module below the pitch circle, ISO 53 profile A
_POINTS = 9
_FLATTEST_TIP = 0.2  # of a module; a thinner tip breaks


class Gear(NamedTuple):
    """A spur gear without profile shift; lengths in any one unit."""

    module: float
    teeth: int
    backlash: float = 0.0
    """Play of two such gears along their pitch circles; either gear's teeth are thinner by half of it."""

    @property
    def pitch_radius(self) -> float:
        """Radius at which two gears roll on each other."""
        return self.module * self.teeth / 2

    @property
    def root_radius(self) -> float:
        """Radius at the bottom of the spaces."""
        return self.pitch_radius - _ROOT * self.module

    @property
    def tip_radius(self) -> float:
        """Radius at the tips of the teeth: a module above the pitch circle, less where teeth would become pointed."""
        radii = np.linspace(self.pitch_radius, self.pitch_radius + self.module, 50)
        widths = 2 * radii * (math.pi / self.teeth - self.space(radii))
        wide = widths >= _FLATTEST_TIP * self.module
        return float(radii[wide][-1]) if wide.any() else self.pitch_radius

    def space(self, radii: Array) -> Array:
        """Return half the angle of a space at radii from root to tip, rad.

        It is the envelope of a rack (ISO 53, with sharp corners) that rolls on the pitch circle: the involute of its
        flank, and below it the trochoid of its corner, which undercuts gears of fewer than 22 teeth.
        """
        pitch, depth = self.pitch_radius, _ROOT * self.module
        base = pitch * math.cos(PRESSURE_ANGLE)
        extra = self.backlash / (4 * pitch)
        ratio = np.minimum(base / np.maximum(radii, base), 1.0)
        involute = math.pi / (2 * self.teeth) + extra - _involute(math.cos(PRESSURE_ANGLE)) + _involute(ratio)
        involute = np.where(radii < base, -np.inf, involute)
        corner = math.pi * self.module / 4 + self.backlash / 4 - depth * math.tan(PRESSURE_ANGLE)
        along = np.sqrt(np.maximum(radii**2 - (pitch - depth) ** 2, 0.0))
        trochoids = [np.arctan2(sign * along, pitch - depth) - (sign * along - corner) / pitch for sign in (1, -1)]
        found: Array = np.maximum(involute, np.maximum(*trochoids))
        return found

    def flank(self) -> list[Array]:
        """Return the flank of a space about the x axis from root to tip: fillet and involute, each points (n, 2)."""
        fine = np.linspace(self.root_radius, self.tip_radius, 400)
        angles = self.space(fine)
        bends = np.abs(np.diff(angles, 2))
        kink = int(bends[20:-20].argmax()) + 21 if bends.size else 0
        cuts = [0, kink, len(fine) - 1]
        pieces = []
        for begin, end in pairwise(cuts):
            # Closer points at the root, where the fillet is round.
            chosen = fine[begin] + (fine[end] - fine[begin]) * np.linspace(0, 1, _POINTS) ** 1.5
            half = self.space(chosen)
            pieces.append(np.stack([chosen * np.cos(half), chosen * np.sin(half)], 1))
        return pieces


def _involute(cosine: "float | Array") -> "Array":
    """Return inv(angle) = tan(angle) - angle by the angle's cosine."""
    angle = np.arccos(cosine)
    found: Array = np.tan(angle) - angle
    return found


_PINS = (0.8, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)  # mm, ISO 2338
_FURTHEST = math.radians(89)


class GearJoint(NamedTuple):
    """Sizes of one rolling gear pair, mm and rad."""

    gear: Gear
    rope: float
    tunnel: float
    """Diameter of a tunnel."""
    middle: float
    """Half the thickness of the block with the tunnels, whose toothed plates are on either side."""
    plate: float
    """Width of a toothed plate."""
    width: float
    """Half the width of the block, square to the plates' axes."""
    pin: float
    """Diameter."""
    pin_bore: float
    link: float
    """Half the width of a link, and the radius of its ends."""
    link_thickness: float
    play: float
    depth: float
    """From the gear's axis to the collar."""
    collar: float
    """Thickness of the collar."""
    stop: float
    """Output angle that the joint has to reach."""
    ring: float
    """Length of a pin beyond a link, where a ring holds it."""
    gap: float = 0.0
    """Half of what is free between two short pins on one axis, where a tendon passes; 0 of one pin."""

    @property
    def links(self) -> float:
        """Half the thickness over both links."""
        return self.outside + self.play + self.link_thickness

    @property
    def outside(self) -> float:
        """Half the thickness over the toothed plates."""
        return self.middle + self.plate

    @property
    def pin_length(self) -> float:
        """Over both links and rings."""
        return 2 * (self.links + self.ring)

    def passed(self, places: Sequence[tuple[float, float]], sizes: Sizes) -> "GearJoint":
        """Return the joint with pins that leave room for tendons in its middle plane: beyond the links, or on its axis.

        There is then no room for rings: such pins are glued into the links.
        """
        gap = sizes.tunnel / 2 + sizes.wall if any(not any(place) for place in places) else 0.0
        return self._replace(ring=0.0, gap=gap) if places else self

    def nearest_passage(self, sizes: Sizes) -> float:
        """Return the least distance from the middle at which a tendon passes beyond the links."""
        return self.links + self.play + sizes.tunnel / 2 + sizes.wall


def gear_joint(sizes: Sizes, key: str, radius: float, gear: Gear, stop: float) -> GearJoint:
    """Return the sizes of a gear pair whose bodies turn against each other up to an angle, rad; lengths in mm.

    Raises InstrumentError if its parts would touch before that angle, or leave no room for the tendons.
    """
    wall, tunnel = sizes.wall, sizes.tunnel
    sine = math.sin(stop / 2)
    room = (radius - sizes.play) / sine - radius - tunnel / 2
    if room < wall:
        least = (sizes.play + (tunnel / 2 + wall) * sine) / (1 - sine)
        reached = 2 * math.asin(min((radius - sizes.play) / (radius + tunnel / 2 + wall), 1.0))
        refuse(
            key,
            radius,
            f"with tunnels of {tunnel:.3g} mm and walls of {wall:.3g} mm beside them the joint's halves touch at "
            f"{math.degrees(reached):.0f} deg, before its stop at {math.degrees(stop):.0f} deg",
            f"at least {least:.3g} mm for process {sizes.process.name}",
        )
    tooth = math.pi * gear.module / 2 - gear.backlash / 2
    if tooth < wall:
        refuse(
            "module",
            gear.module,
            f"teeth of gears of {key} are {tooth:.3g} mm thick at the pitch circle, less than the {wall:.3g} mm that "
            f"process {sizes.process.name} allows",
            f"at least {(wall + gear.backlash / 2) * 2 / math.pi:.3g} mm{_finer(tooth)}",
        )
    free = radius * math.cos(stop / 2) - sizes.rope / 2 - sizes.play
    pins = [pin for pin in _PINS if pin <= 0.42 * radius and pin / 2 <= free]
    if not pins:
        refuse(
            key,
            radius,
            f"no pin of {_PINS[0]:g} mm fits between its tendons at {math.degrees(stop):.0f} deg",
            f"at least {max(_PINS[0] / 0.42, ((_PINS[0] + sizes.rope) / 2 + sizes.play) / math.cos(stop / 2)):.3g} mm",
        )
    pin = pins[-1]
    if gear.root_radius - (pin + sizes.bore) / 2 < wall:
        refuse(
            key,
            radius,
            f"{gear.teeth} teeth of module {gear.module:.4g} mm leave "
            f"{gear.root_radius - (pin + sizes.bore) / 2:.3g} mm between root and a pin of {pin:g} mm, less than the "
            f"{wall:.3g} mm that process {sizes.process.name} allows",
            f"one with at least {math.ceil((pin + sizes.bore + 2 * wall) / gear.module + 2.5)} teeth",
        )
    link = max(pin / 2 + 2 * wall, 0.9 * pin)
    return GearJoint(
        gear,
        sizes.rope,
        tunnel,
        middle=tunnel / 2 + max(wall, 0.06 * radius),
        plate=max(2 * gear.module, 2 * wall),
        width=radius + tunnel / 2 + min(room, 2 * wall),
        pin=pin,
        pin_bore=pin + sizes.bore,
        link=link,
        link_thickness=max(2 * wall, 0.5 * pin),
        play=sizes.play,
        depth=link + 2 * sizes.play,
        collar=max(3 * wall, 0.5 * radius),
        stop=stop,
        ring=0.4 * pin,
    )


def toothed_half(joint: GearJoint, sizes: Sizes, passing: Sequence[tuple[float, float]], *, tooth_ahead: bool) -> Solid:
    """Return toothed plates and block of one half, its axis along y at the origin, its mate toward z.

    Either a tooth or a space is on the line of centres; the tunnels are parallel to z and end at the axis' height, as
    do the posts about tendons that pass beyond the links.
    """
    outline = _outline(joint, tooth_ahead=tooth_ahead)
    body = k.box((-joint.width, joint.width), (-joint.middle, joint.middle), (-joint.depth - joint.collar, 0.0))
    for low in (-joint.outside, joint.middle):
        body += _plate(joint, outline, low, low + joint.plate)
    for x, y in passing:
        if y:
            body += k.rod((x, y, -joint.depth - joint.collar), (x, y, 0), joint.tunnel / 2 + sizes.wall)
    return body


def bored(joint: GearJoint, body: Solid, length: float, passing: Sequence[tuple[float, float]] = ()) -> Solid:
    """Return a half with its tunnels, through a length, and the bore of its pin or pins."""
    for bore in bores(joint, length, passing):
        body -= bore
    return body


def bores(joint: GearJoint, length: float, passing: Sequence[tuple[float, float]]) -> list[Solid]:
    """Return the tunnels of a half, through a length, and the bore of its pin or pins."""
    radius, reach = joint.gear.pitch_radius, joint.outside + 1
    ways = ((-radius, 0.0), (radius, 0.0), *passing)
    sides = ((-reach, -joint.gap), (joint.gap, reach)) if joint.gap else ((-reach, reach),)
    tunnels = [k.rod((x, y, -length), (x, y, 0), joint.tunnel / 2) for x, y in ways]
    return [*tunnels, *(k.rod((0, low, 0), (0, high, 0), joint.pin_bore / 2) for low, high in sides)]


def link(joint: GearJoint, sizes: Sizes) -> Solid:
    """Return a link, its near bore at the origin, its far bore toward z; its thickness along y from 0."""
    apart = 2 * joint.gear.pitch_radius
    body = k.stadium(apart, joint.link, 0.0, joint.link_thickness)
    for z in (0.0, apart):
        body -= k.rod((0, -1, z), (0, joint.link_thickness + 1, z), joint.pin_bore / 2)
    return body


def _plate(joint: GearJoint, outline: list[Array], low: float, high: float) -> Solid:
    b = k.kernel()
    edges = []
    for piece in outline:
        points = [(float(x), high, float(z)) for x, z in piece]
        edges.append(b.Edge.make_line(*points) if len(points) == 2 else b.Edge.make_spline(points))
    return k.prism(edges, high - low)


def _finer(tooth: float) -> str:
    """Return the processes that make teeth of a thickness, mm, as the end of a sentence."""
    names = [name for name, one in PROCESSES.items() if k.MM * one.wall <= tooth]
    return f", or the process {' or '.join(names)}" if names else ""


def _outline(joint: GearJoint, *, tooth_ahead: bool) -> list[Array]:
    """Return the outline of a toothed plate in x and z as open pieces, anticlockwise from its foot at positive x."""
    gear = joint.gear
    pitch = 2 * math.pi / gear.teeth
    bottom = float(gear.space(np.array([gear.root_radius]))[0])
    first = pitch / 2 if tooth_ahead else 0.0
    # The last space has only the flank on the side of the line of centres.
    places = [first]
    while places[-1] < joint.stop / 2 + 0.75 * pitch and places[-1] + pitch - bottom < _FURTHEST:
        places.append(places[-1] + pitch)
    if places[-1] < joint.stop / 2:
        refuse(
            "teeth",
            gear.teeth,
            f"its teeth reach {math.degrees(places[-1]):.0f} deg to either side, less than half the stop at "
            f"{math.degrees(joint.stop):.0f} deg",
            "more",
            unit="",
        )
    flank = gear.flank()
    centres = sorted({-place for place in places} | set(places))
    pieces: list[Array] = []
    foot = -joint.depth - joint.collar / 2
    root = gear.root_radius
    pieces.append(np.array([(root, foot), (root, 0.0)]))
    for centre in centres:
        # Angles are from the line of centres, positive toward negative x; flanks are about the x axis.
        turn = centre + math.pi / 2
        cos, sin = math.cos(turn), math.sin(turn)
        matrix = np.array([[cos, sin], [-sin, cos]])
        left = [piece @ matrix for piece in flank]
        right = [(piece * (1, -1)) @ matrix for piece in flank]
        enter = [] if centre == centres[0] else [piece[::-1] for piece in reversed(right)]
        leave = [] if centre == centres[-1] else left
        if pieces and enter:
            pieces.append(_arc(pieces[-1][-1], enter[0][0], gear.tip_radius))
        elif not enter:
            pieces.append(_arc(pieces[-1][-1], left[0][0], root))
        pieces += enter
        if enter and leave:
            pieces.append(_arc(enter[-1][-1], leave[0][0], root))
        pieces += leave
    pieces.append(_arc(pieces[-1][-1], np.array((-root, 0.0)), root))
    pieces.append(np.array([(-root, 0.0), (-root, foot)]))
    pieces.append(np.array([(-root, foot), (root, foot)]))
    return [piece for piece in pieces if np.linalg.norm(piece[-1] - piece[0]) > 1e-9]


def _arc(start: Array, end: Array, radius: float) -> Array:
    """Return points of a short arc about the origin."""
    first, last = math.atan2(start[1], start[0]), math.atan2(end[1], end[0])
    angles = np.linspace(first, last, 5)
    points = radius * np.stack([np.cos(angles), np.sin(angles)], 1)
    points[0], points[-1] = start, end
    return points


def gear_parts(joint: GearJoint, end: End, sizes: Sizes) -> list[Part]:
    """Return the parts of a gear pair, but for its halves on bodies that it has in common with another joint."""
    tip = end.tip
    alone = end.last and not end.order
    of = end.prefix.replace("_", " ")
    titles = (
        (f"Gear of {of} on the stem", f"Gear of {of}", f"Link of {of}")
        if not alone
        else ("Gear on the stem", "Gear of the end-effector", "Link of the tip")
        if tip
        else ("Gear at the stem's handle end", "Gear of the grip", "Link of the handle")
    )
    side = joint.outside + joint.play
    step = 2.5 * joint.gear.pitch_radius
    out = end.outward * step * (2 * end.order + 1)
    beside = end.outward * step * (2 * end.order + 0.5)
    lengths = (joint.gap, joint.links + joint.ring) if joint.gap else (-joint.pin_length / 2, joint.pin_length / 2)
    dowel = k.rod((0, lengths[0], 0), (0, lengths[1], 0), joint.pin / 2)
    sides = (0.0, 180.0) if joint.gap else (0.0,)
    found = []
    if not end.order:
        found.append(
            Part(
                f"{end.prefix}_gear_near",
                titles[0],
                _near(joint, end, sizes),
                end.near,
                (end.place(end.start),),
                dimensions=(*half_dimensions(joint, end), *tube_dimensions(end, sizes)),
                notes=gear_notes(joint),
            )
        )
    if end.last:
        found.append(
            Part(
                f"{end.prefix}_gear_far",
                titles[1],
                _far(joint, end, sizes),
                end.far,
                (end.place(far=True),),
                dimensions=_far_half_dimensions(joint, end, sizes),
                notes=gear_notes(joint),
                away=(0, 0, out),
            )
        )
    return [
        *found,
        Part(
            f"{end.prefix}_link",
            titles[2],
            link(joint, sizes),
            end.carrier,
            tuple(end.place() * k.at(0, y) for y in (side, -side - joint.link_thickness)),
            dimensions=_link_dimensions(joint, sizes, end.key),
            away=(0, step, beside),
        ),
        pin(
            f"{end.prefix}_pin",
            joint.pin,
            lengths[1] - lengths[0],
            dowel,
            end.carrier,
            tuple(
                end.place() * k.at(z=z, turn=(0, 0, turn)) for z in (0.0, 2 * joint.gear.pitch_radius) for turn in sides
            ),
            (0, 2 * step, beside),
        ),
    ]


def _near(joint: GearJoint, end: End, sizes: Sizes) -> k.Solid:
    body = toothed_half(joint, sizes, end.passing_in(), tooth_ahead=True)
    top = -joint.depth
    if end.tip:
        wide = max((abs(y) + joint.tunnel / 2 + sizes.wall for _, y in end.passing_in()), default=0.0)
        body += k.rod((0, 0, top - joint.collar), (0, 0, top), max(end.stem_radius, wide))
        body += spigot(end, sizes, top - joint.collar)
        return bored(joint, body, joint.depth + joint.collar, end.passing_in())
    joined, tunnels = transition(end, sizes, joint.width, joint.middle, top)
    body = bored(joint, body + joined, joint.depth, end.passing_in())
    for tunnel in tunnels:
        body -= tunnel
    return body + spigot(end, sizes, -end.near_length)


def _far(joint: GearJoint, end: End, sizes: Sizes) -> k.Solid:
    body, bottom = far_half(joint, end, sizes, end.far_collar)
    return body - socket(end, sizes, bottom)


def far_half(joint: GearJoint, end: End, sizes: Sizes, collar: float) -> tuple[k.Solid, float]:
    """Return the far half with a collar of a length, where its tendons end or leave for the motors, and its bottom."""
    radius, top = joint.gear.pitch_radius, -joint.depth
    body = toothed_half(
        joint._replace(collar=min(joint.collar, collar)), sizes, end.passing_in(far=True), tooth_ahead=False
    )
    bottom = top - collar
    if end.tip:
        body += k.rod((0, 0, bottom), (0, 0, top), ferrule_collar(radius, end, sizes))
        body = bored(joint, body, joint.depth + collar, end.passing_in(far=True))
        return body - ferrule_pockets(radius, sizes, bottom, collar), bottom
    reach = radius + end.seat + sizes.wall
    deep = max(end.seat, (end.rod + sizes.bore) / 2) + sizes.wall
    body += k.box((-reach, reach), (-deep, deep), (bottom, top))
    for x, y in end.passing_in(far=True):
        if y:
            wide = joint.tunnel / 2 + sizes.wall
            body += k.box((x - deep, x + deep), (min(0.0, y - wide), max(0.0, y + wide)), (bottom, top))
    body = bored(joint, body, joint.depth + collar, end.passing_in(far=True))
    return body - sheath_seats(radius, end, sizes, bottom), bottom


def gear_notes(joint: GearJoint) -> tuple[str, ...]:
    """Return the notes in the drawing of a half."""
    gear, rope = joint.gear, joint.rope
    return (
        f"Gear: module {gear.module:.4g} mm, {gear.teeth} teeth, 20 deg, no profile shift; "
        f"tooth thickness less {gear.backlash / 2:.3g} mm.",
        f"Tunnels Ø{joint.tunnel:.3g} for a rope of {rope:.3g} mm; their ends at the gear's axis have a sharp edge.",
        "Radius to the rope's centre = pitch radius = tunnel's axis.",
    )


def half_dimensions(joint: GearJoint, end: End) -> tuple[Dimension, ...]:
    """Return the dimensions of the teeth, tunnels and bore of either half."""
    gear, y = joint.gear, -joint.outside
    radius, bore = gear.pitch_radius, joint.pin_bore / 2
    return (
        Dimension("radius to the rope's centre", (0, y, 0), (radius, y, 0), "front", 1, "R", end.key),
        Dimension("tip circle", (0, y, 0), (0, y, gear.tip_radius), "front", -1, "R", along="y"),
        Dimension("tunnels apart", (-radius, 0, 0), (radius, 0, 0), "top", 1, "", end.key, 2),
        Dimension("over the toothed plates", (0, -joint.outside, 0), (0, joint.outside, 0), "side", 1),
        Dimension("between the toothed plates", (0, -joint.middle, 0), (0, joint.middle, 0), "side", 1),
        Dimension("pin's bore", (-bore, y, 0), (bore, y, 0), "front", 1, "Ø"),
    )


def _far_half_dimensions(joint: GearJoint, end: End, sizes: Sizes) -> tuple[Dimension, ...]:
    bottom = -joint.depth - end.far_collar
    return (*half_dimensions(joint, end), *far_dimensions(end, sizes, bottom), end_dimension(joint, end, sizes, bottom))


def end_dimension(joint: GearJoint, end: End, sizes: Sizes, bottom: float) -> Dimension:
    """Return the dimension of the bores in which a far half's tendons end, or their sheaths."""
    half, radius = ferrule(sizes)[0] if end.tip else end.seat, joint.gear.pitch_radius
    name = "ferrule's pocket" if end.tip else "sheath's seat"
    return Dimension(name, (radius - half, 0, bottom), (radius + half, 0, bottom), "top", 1, "Ø")


def _link_dimensions(joint: GearJoint, sizes: Sizes, key: str) -> tuple[Dimension, ...]:
    apart, bore = 2 * joint.gear.pitch_radius, joint.pin_bore / 2
    return (
        Dimension("distance of the axes", (0, 0, 0), (0, 0, apart), "front", -1, key=key, factor=2, along="y"),
        Dimension("bore", (-bore, 0, apart), (bore, 0, apart), "front", 1, "Ø"),
        Dimension("width", (-joint.link, 0, 0), (joint.link, 0, 0), "front", -1),
        Dimension("thickness", (0, 0, 0), (0, joint.link_thickness, 0), "side", 1),
    )
