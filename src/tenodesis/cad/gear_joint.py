"""Solids of a rolling gear pair: two toothed bodies with tunnels for the tendons, and the links that hold them."""

import math
from typing import NamedTuple

import numpy as np

from tenodesis.cad import kernel as k
from tenodesis.cad.involute import Gear
from tenodesis.cad.kernel import Solid
from tenodesis.cad.process import PROCESSES
from tenodesis.cad.sizes import Sizes, refuse
from tenodesis.run import Array

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
