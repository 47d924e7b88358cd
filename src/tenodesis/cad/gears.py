"""Parts of a joint of gears at either end of the stem: flanks, toothed bodies with tunnels for the tendons, links."""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from tenodesis.cad import kernel as k
from tenodesis.cad.kernel import FLIP, Solid
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

    @property
    def outside(self) -> float:
        """Half the thickness over the toothed plates."""
        return self.middle + self.plate

    @property
    def pin_length(self) -> float:
        """Over both links, with a groove's width for a ring on either side."""
        return 2 * (self.outside + self.play + self.link_thickness + 0.4 * self.pin)


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
        link=link,
        link_thickness=max(2 * wall, 0.5 * pin),
        play=sizes.play,
        depth=link + 2 * sizes.play,
        collar=max(3 * wall, 0.5 * radius),
        stop=stop,
    )


def toothed_half(joint: GearJoint, *, tooth_ahead: bool) -> Solid:
    """Return toothed plates and block of one half, its axis along y at the origin, its mate toward z.

    Either a tooth or a space is on the line of centres; the tunnels are parallel to z and end at the axis' height.
    """
    outline = _outline(joint, tooth_ahead=tooth_ahead)
    body = k.box((-joint.width, joint.width), (-joint.middle, joint.middle), (-joint.depth - joint.collar, 0.0))
    for low in (-joint.outside, joint.middle):
        body += _plate(joint, outline, low, low + joint.plate)
    return body


def bored(joint: GearJoint, body: Solid, sizes: Sizes, length: float) -> Solid:
    """Return a half with its tunnels, through a length, and the bore of its pin."""
    radius = joint.gear.pitch_radius
    for x in (-radius, radius):
        body -= k.rod((x, 0, -length), (x, 0, 0), joint.tunnel / 2)
    reach = joint.outside + 1
    return body - k.rod((0, -reach, 0), (0, reach, 0), (joint.pin + sizes.bore) / 2)


def link(joint: GearJoint, sizes: Sizes) -> Solid:
    """Return a link, its near bore at the origin, its far bore toward z; its thickness along y from 0."""
    apart = 2 * joint.gear.pitch_radius
    body = k.stadium(apart, joint.link, 0.0, joint.link_thickness)
    for z in (0.0, apart):
        body -= k.rod((0, -1, z), (0, joint.link_thickness + 1, z), (joint.pin + sizes.bore) / 2)
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
    """Return the parts of a gear pair at the tip or at the handle."""
    tip = end.tip
    names = tuple(f"{'tip' if tip else 'handle'}_{kind}" for kind in ("gear_near", "gear_far", "link", "pin"))
    titles = (
        ("Gear on the stem", "Gear of the end-effector", "Link of the tip")
        if tip
        else ("Gear at the stem's handle end", "Gear of the grip", "Link of the handle")
    )
    side = joint.outside + joint.play
    places = tuple(k.at(0, y) if tip else k.at(0, -y, turn=FLIP) for y in (side, -side - joint.link_thickness))
    radius = joint.gear.pitch_radius
    pins = tuple(k.at(z=z if tip else -z) for z in (0.0, 2 * radius))
    dowel = k.rod((0, -joint.pin_length / 2, 0), (0, joint.pin_length / 2, 0), joint.pin / 2)
    out = 2.5 * radius
    return [
        Part(
            names[0],
            titles[0],
            _near(joint, end, sizes),
            "stem",
            (k.at() if tip else k.at(z=-end.stem_length, turn=FLIP),),
            dimensions=_half_dimensions(joint, end, sizes, near=True),
            notes=_notes(joint),
        ),
        Part(
            names[1],
            titles[1],
            _far(joint, end, sizes),
            end.far,
            (k.at(turn=FLIP) if tip else k.at(),),
            dimensions=_half_dimensions(joint, end, sizes, near=False),
            notes=_notes(joint),
            away=(0, 0, out if tip else -out),
        ),
        Part(
            names[2],
            titles[2],
            link(joint, sizes),
            end.carrier,
            places,
            dimensions=_link_dimensions(joint, sizes, end.key),
            away=(0, out, out / 2 if tip else -out / 2),
        ),
        pin(
            names[3], joint.pin, joint.pin_length, dowel, end.carrier, pins, (0, 2 * out, out / 2 if tip else -out / 2)
        ),
    ]


def _near(joint: GearJoint, end: End, sizes: Sizes) -> k.Solid:
    radius, stem = joint.gear.pitch_radius, end.stem_radius
    body = toothed_half(joint, tooth_ahead=True)
    top = -joint.depth
    if end.tip:
        body += k.rod((0, 0, top - joint.collar), (0, 0, top), stem)
        body += spigot(end, sizes, top - joint.collar)
        return bored(joint, body, sizes, joint.depth + joint.collar)
    ways = [((x, 0.0), (math.copysign(end.tendon_radius, x), 0.0)) for x in (-radius, radius)]
    body += transition(end, sizes, joint.width, joint.middle, top, ways)[0]
    body = bored(joint, body, sizes, joint.depth)
    for tunnel in transition(end, sizes, joint.width, joint.middle, top, ways)[1]:
        body -= tunnel
    return body + spigot(end, sizes, -end.near_length)


def _far(joint: GearJoint, end: End, sizes: Sizes) -> k.Solid:
    radius, top = joint.gear.pitch_radius, -joint.depth
    body = toothed_half(joint, tooth_ahead=False)
    bottom = top - end.far_collar
    if end.tip:
        body += k.rod((0, 0, bottom), (0, 0, top), ferrule_collar(radius, end, sizes))
        body = bored(joint, body, sizes, joint.depth + end.far_collar)
        body -= ferrule_pockets(radius, sizes, bottom, end.far_collar)
    else:
        reach = radius + end.seat + sizes.wall
        deep = max(end.seat, (end.rod + sizes.bore) / 2) + sizes.wall
        body += k.box((-reach, reach), (-deep, deep), (bottom, top))
        body = bored(joint, body, sizes, joint.depth + end.far_collar)
        body -= sheath_seats(radius, end, sizes, bottom)
    return body - socket(end, sizes, bottom)


def _notes(joint: GearJoint) -> tuple[str, ...]:
    gear, rope = joint.gear, joint.rope
    return (
        f"Gear: module {gear.module:.4g} mm, {gear.teeth} teeth, 20 deg, no profile shift; "
        f"tooth thickness less {gear.backlash / 2:.3g} mm.",
        f"Tunnels Ø{joint.tunnel:.3g} for a rope of {rope:.3g} mm; their ends at the gear's axis have a sharp edge.",
        "Radius to the rope's centre = pitch radius = tunnel's axis.",
    )


def _half_dimensions(joint: GearJoint, end: End, sizes: Sizes, *, near: bool) -> tuple[Dimension, ...]:
    gear, y = joint.gear, -joint.outside
    radius, bore = gear.pitch_radius, (joint.pin + sizes.bore) / 2
    bottom = -joint.depth - end.far_collar
    wide, _ = ferrule(sizes)
    own = (
        Dimension("radius to the rope's centre", (0, y, 0), (radius, y, 0), "front", 1, "R", end.key),
        Dimension("tip circle", (0, y, 0), (0, y, gear.tip_radius), "front", -1, "R", along="y"),
        Dimension("tunnels apart", (-radius, 0, 0), (radius, 0, 0), "top", 1, "", end.key, 2),
        Dimension("over the toothed plates", (0, -joint.outside, 0), (0, joint.outside, 0), "side", 1),
        Dimension("between the toothed plates", (0, -joint.middle, 0), (0, joint.middle, 0), "side", 1),
        Dimension("pin's bore", (-bore, y, 0), (bore, y, 0), "front", 1, "Ø"),
    )
    if near:
        return own + tube_dimensions(end, sizes)
    pocket = wide if end.tip else end.seat
    name = "ferrule's pocket" if end.tip else "sheath's seat"
    ends = Dimension(name, (radius - pocket, 0, bottom), (radius + pocket, 0, bottom), "top", 1, "Ø")
    return (*own, *far_dimensions(end, sizes, bottom), ends)


def _link_dimensions(joint: GearJoint, sizes: Sizes, key: str) -> tuple[Dimension, ...]:
    apart, bore = 2 * joint.gear.pitch_radius, (joint.pin + sizes.bore) / 2
    return (
        Dimension("distance of the axes", (0, 0, 0), (0, 0, apart), "front", -1, key=key, factor=2, along="y"),
        Dimension("bore", (-bore, 0, apart), (bore, 0, apart), "front", 1, "Ø"),
        Dimension("width", (-joint.link, 0, 0), (joint.link, 0, 0), "front", -1),
        Dimension("thickness", (0, 0, 0), (0, joint.link_thickness, 0), "side", 1),
    )
