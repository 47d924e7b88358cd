"""A wrist of pulleys: a pulley on the stem, whose body is the fork of one jaw or of several on one pin."""

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise, permutations
from typing import NamedTuple

import numpy as np

from tenodesis.cad import kernel as k
from tenodesis.cad.bench_parts import TIP_PIN
from tenodesis.cad.kernel import FLIP
from tenodesis.cad.parts import Dimension, End, Part, Sizes, groove_dimensions, pin, refuse, spigot, tube_dimensions
from tenodesis.cad.pulley_parts import PINS, PulleyJoint, tendon_end

_RIM = 0.25
"""Of the rope's diameter, by which flanges stand out over its centre: two wheels turn rim to rim between ropes."""
MORE_WRAP = math.radians(10)
"""Of a passing tendon over what the joint takes back within its range."""
_SAME_PIN = 1e-6  # mm
_STEEPEST = math.radians(35)
FACTORS = tuple(number / 4 for number in range(5, 81))
"""Factors of a scale model that are tried where a wrist does not fit."""


class Passing(NamedTuple):
    """A tendon that passes the first pulley on a wheel of its own, to a joint beyond; mm and rad."""

    tendon: str
    side: int
    """Of the first joint: 1 of its agonists."""
    radius: float
    wrap: float
    """On its wheel, of the straight joint."""
    target: tuple[float, float]
    """Where it is at the joint beyond, in the frame of the first."""


class Lane(NamedTuple):
    """Where a passing tendon and its wheels are, mm and rad, in the frame of the first joint."""

    way: Passing
    y: float
    guide: tuple[float, float]
    """Centre of its guide wheel, x and z."""

    def stem(self, guide_radius: float) -> tuple[float, float]:
        """Return where it is in the stem."""
        return self.guide[0] - self.way.side * guide_radius, self.y


class Jaw(NamedTuple):
    """Sizes of a jaw with its pulley, mm."""

    pulley: PulleyJoint
    level: float
    """Of its middle along its axis."""
    offset: float
    opens: float
    """Sign of the angle to which it opens; 0 of one that closes on nothing."""
    length: float
    """From its axis to where forces act."""
    thick: float
    width: float
    """Half of the finger's, along the axis."""
    begin: float
    """Distance from the axis at which the finger is as wide as all pulleys."""

    @property
    def eye(self) -> float:
        """Diameter of the eye where forces act."""
        return min(TIP_PIN, self.width)


class Wrist(NamedTuple):
    """Sizes of a pulley that tendons of others pass, and of the fork on it, mm."""

    pulley: PulleyJoint
    lanes: tuple[Lane, ...]
    guide: float
    """Radius of the guide wheels to the rope's centre."""
    guide_pin: float
    block: tuple[float, float]
    """Where the fork's block begins and ends, from the axis."""
    jaws: tuple[Jaw, ...]
    jaw_turn: float
    """Of the jaws' frame against its own, deg."""

    @property
    def ribs(self) -> tuple[float, float]:
        """Where the fork's ribs between its own pulley and the wheels begin and end, from the middle."""
        begin = self.pulley.outside + self.pulley.play
        return begin, begin + self.pulley.cheek

    @property
    def guide_pins(self) -> list[tuple[float, int, float]]:
        """Where guide pins are: x, side of the middle, and z."""
        return sorted({(lane.guide[0], 1 if lane.y > 0 else -1, lane.guide[1]) for lane in self.lanes})

    @property
    def inner(self) -> float:
        """Half the width between the arms of its fork."""
        p, most = self.pulley, max((abs(lane.y) for lane in self.lanes), default=0.0)
        return max(most + p.groove + p.wall, p.outside) + p.play

    @property
    def outer(self) -> float:
        """Half the width over the arms."""
        return self.inner + self.pulley.fork

    @property
    def depth(self) -> float:
        """From the axis to the collar of its fork."""
        lowest = max((-lane.guide[1] for lane in self.lanes), default=0.0)
        guide = lowest + self.guide + _RIM * self.pulley.rope + self.pulley.play + self.pulley.wall
        return max(self.pulley.depth, guide)

    @property
    def collar(self) -> float:
        """Height of the collar."""
        return self.pulley.collar

    @property
    def jaw_inner(self) -> float:
        """Half the width between the arms of the jaws' fork."""
        return self.jaws[0].width + self.pulley.play

    @property
    def jaw_outer(self) -> float:
        """Half the width over the arms of the jaws' fork."""
        return self.jaw_inner + self.jaws[0].pulley.fork

    def around(self, sizes: Sizes) -> float:
        """Return the radius about all that stands on the stem."""
        p, jaw, tube = self.pulley, self.jaws[0].pulley, sizes.tunnel / 2
        stems = [(side * p.radius, side * p.shift) for side in p.sides] + [lane.stem(self.guide) for lane in self.lanes]
        return max(
            math.hypot(p.fork_arm, self.outer),
            math.hypot(jaw.fork_arm, self.jaw_outer),
            *(math.hypot(*place) + tube + max(sizes.wall, 0.15) for place in stems),
            *(math.hypot(*place) + tube + sizes.wall for place in _places(self.lanes)),
        )

    def stem_place(self, tendon: str, side: int) -> tuple[float, float]:
        """Return where a tendon is in the stem."""
        lane = next((lane for lane in self.lanes if lane.way.tendon == tendon), None)
        return (side * self.pulley.radius, side * self.pulley.shift) if lane is None else lane.stem(self.guide)


def jaw_row(sizes: Sizes, pulleys: Sequence[PulleyJoint]) -> tuple[list[float], float]:
    """Return the middles of jaws side by side on one pin, and half of their width."""
    widths = [2 * one.outside for one in pulleys]
    half = (sum(widths) + (len(widths) - 1) * sizes.play) / 2
    starts = [sum(widths[:number]) + number * sizes.play - half for number in range(len(widths))]
    return [start + width / 2 for start, width in zip(starts, widths, strict=True)], half


def on_wrist(pulley: PulleyJoint, sizes: Sizes) -> PulleyJoint:
    """Return a pulley as a wrist has it: with low flanges, and cheeks as thin as the process allows."""
    return pulley._replace(rim=pulley.radius + _RIM * sizes.rope, cheek=2 * sizes.wall)


def begin_of_finger(radius: float, sizes: Sizes) -> float:
    """Return how far from a jaw's axis its finger may be as wide as all pulleys."""
    return radius + sizes.rope / 2 + 2 * sizes.play


def wrist(
    sizes: Sizes,
    keys: Mapping[str, str],
    pulley: PulleyJoint,
    passing: Sequence[Passing],
    jaws: Sequence[Jaw],
    *,
    ranges: tuple[float, float],
    jaw_turn: float,
    stem: float,
) -> Wrist:
    """Return the sizes of a wrist within a stem of a radius, whose joints bend to angles, rad.

    `keys` are those of the file by "radius", "offset" and "stem". Raises InstrumentError if it does not fit.
    """
    least = min([pulley.radius, *(way.radius for way in passing)]) - (sizes.rope + sizes.bore) / 2 - sizes.wall
    own = pulley._replace(pin=max((one for one in PINS if one <= min(pulley.pin, 2 * least)), default=PINS[0]))
    if 2 * least < own.pin:
        refuse(keys["radius"], own.radius, "the wheels of tendons that pass it leave no wall about a pin", "larger")
    found: list[tuple[Passing, float]] = []
    for up in (1, -1):
        ways = [way for way in passing if (way.target[1] > 0) == (up > 0)]
        rib = own.outside + own.cheek + 2 * sizes.play
        levels = [up * (rib + (n + 0.5) * _lane(sizes) + n * sizes.play) for n in range(len(ways))]
        orders = [list(zip(order, levels, strict=True)) for order in permutations(ways)]
        found += max(orders, key=lambda one: (min(_apart(one), sizes.tunnel + sizes.wall), -_aside(one)))
    guide, guide_pin, places = _guides(sizes, found, stem)
    lanes = tuple(Lane(way, y, place) for (way, y), place in zip(found, places, strict=True))
    block = _block(sizes, own, lanes, jaws, guide, ranges)
    made = Wrist(own, lanes, guide, guide_pin, block, tuple(jaws), jaw_turn)
    needed = made.around(sizes)
    if needed > stem:
        refuse(
            keys["stem"],
            2 * stem,
            f"the wheels of {len(lanes)} tendons side by side with their forks are {2 * needed:.3g} mm wide",
            f"at least {2 * needed:.3g} mm for process {sizes.process.name}",
        )
    if not _clear(sizes, found, places, guide, sleeve_radius(guide_pin, sizes)):
        refuse(keys["radius"], own.radius, "no guide wheels before it leave each other room", "larger")
    offset, lateral = jaws[0].offset, _aside(found)
    free = block[1] - block[0] - 2 * sizes.tunnel / 3
    if free < lateral / math.tan(_STEEPEST):
        refuse(
            keys["offset"],
            offset,
            f"its tendons have {max(free, 0.0):.3g} mm between the wheels and the jaws to get {lateral:.3g} mm aside",
            f"at least {offset - free + lateral / math.tan(_STEEPEST):.3g} mm for process {sizes.process.name}",
        )
    if _apart(found) < sizes.tunnel + sizes.wall:
        refuse(
            keys["radius"],
            own.radius,
            f"tunnels of its tendons come within {_apart(found):.3g} mm of each other and need "
            f"{sizes.tunnel + sizes.wall:.3g} mm",
            "larger, with all about it",
        )
    return made


def _lane(sizes: Sizes) -> float:
    """Return the width of a wheel with one groove, mm."""
    return 2 * (sizes.groove + sizes.wall)


def _block(  # noqa: PLR0917
    sizes: Sizes,
    own: PulleyJoint,
    lanes: Sequence[Lane],
    jaws: Sequence[Jaw],
    guide: float,
    ranges: tuple[float, float],
) -> tuple[float, float]:
    """Return where the block of the jaws' fork begins and ends, so that neither guides nor fingers touch it."""
    tube = sizes.tunnel / 2 + sizes.wall
    low = max([own.rim, *(lane.way.radius + _RIM * sizes.rope for lane in lanes)]) + 2 * sizes.play
    wide, deep = (max(abs(place[i]) for place in _places(lanes)) + tube for i in (0, 1))
    for lane in lanes:
        distance = math.hypot(*lane.guide)
        seen = math.asin(min((guide + _RIM * sizes.rope + sizes.play) / distance, 1.0))
        free = math.acos(lane.guide[1] / distance) - seen - ranges[0]
        low = max(low, wide / math.tan(max(free, 1e-6)))
    # A finger's back leaves the block's edge beside it as it swings back.
    sin, cos = math.sin(ranges[1]), max(-math.cos(ranges[1]), 0.0)
    thick = jaws[0].thick
    back = thick * sin + cos / sin * (deep + sizes.play + thick * cos) if cos > 0 else 0.0
    return low, jaws[0].offset - max(jaws[0].begin, back)


def _places(lanes: Sequence[Lane]) -> list[tuple[float, float]]:
    """Return where tendons enter and leave the block of the jaws' fork."""
    return [place for lane in lanes for place in ((lane.way.side * lane.way.radius, lane.y), lane.way.target)]


def _aside(found: Iterable[tuple[Passing, float]]) -> float:
    """Return how far tendons get aside at most from their wheels to the jaws."""
    return max(math.dist((way.side * way.radius, y), way.target) for way, y in found)


def _apart(found: Iterable[tuple[Passing, float]]) -> float:
    """Return the least distance of the slanted ways from wheels to jaws, at equal heights."""
    shares = np.linspace(0.0, 1.0, 41)[:, np.newaxis]
    ways = [np.array([way.side * way.radius, y]) * (1 - shares) + np.array(way.target) * shares for way, y in found]
    return min(
        (float(np.linalg.norm(one - other, axis=1).min()) for i, one in enumerate(ways) for other in ways[i + 1 :]),
        default=math.inf,
    )


def _guides(
    sizes: Sizes, found: Sequence[tuple[Passing, float]], stem: float
) -> tuple[float, float, list[tuple[float, float]]]:
    """Return radius, pin and places of the guide wheels: the largest that fit, or else those that nearly do."""
    best: tuple[tuple[bool, float], float, float, list[tuple[float, float]]] = ((True, math.inf), 0.0, 0.0, [])
    smallest = sizes.rope / 2 + (PINS[0] + sizes.bore) / 2 + sizes.wall
    for radius in np.linspace(max(way.radius for way, _ in found), smallest, 41):
        own_pin = max(
            (
                one
                for one in PINS
                if one <= 0.7 * radius and radius - sizes.rope / 2 - (one + sizes.bore) / 2 >= sizes.wall
            ),
            default=PINS[0],
        )
        places = [_guide(sizes, way, float(radius)) for way, _ in found]
        touches = not _clear(sizes, found, places, radius, sleeve_radius(own_pin, sizes))
        out = max(math.hypot(x - way.side * radius, y) for (way, y), (x, _) in zip(found, places, strict=True))
        if (touches, out) < best[0]:
            best = ((touches, out), float(radius), own_pin, places)
        if not touches and out + sizes.tunnel / 2 + max(sizes.wall, 0.15) <= stem:
            break
    return best[1:]


def _clear(
    sizes: Sizes,
    found: Sequence[tuple[Passing, float]],
    places: Sequence[tuple[float, float]],
    radius: float,
    sleeve: float,
) -> bool:
    """Return whether guides of a radius pass the sleeves on the pins of others at their side of the middle."""
    wheel = radius + _RIM * sizes.rope + sleeve + sizes.play
    levels = [y for _, y in found]
    pairs = [
        math.dist(one, other)
        for y, one in zip(levels, places, strict=True)
        for beside, other in zip(levels, places, strict=True)
        if y * beside > 0
    ]
    return all(one < _SAME_PIN or one >= wheel for one in pairs)


def sleeve_radius(own_pin: float, sizes: Sizes) -> float:
    """Return the outer radius of a sleeve on a pin."""
    return (own_pin + sizes.bore) / 2 + sizes.wall


def _guide(sizes: Sizes, way: Passing, radius: float) -> tuple[float, float]:
    """Return the centre, x and z, of the guide wheel from which a tendon meets its wheel with its wrap."""
    both = way.radius + radius
    free = math.sqrt((both + 2 * _RIM * sizes.rope + sizes.play) ** 2 - both**2)
    sin, cos = math.sin(way.wrap), math.cos(way.wrap)
    return way.side * (both * cos - free * sin), -both * sin - free * cos


def wrist_parts(joint: Wrist, end: End, jaw_ends: Sequence[End], sizes: Sizes) -> list[Part]:
    """Return the parts of a wrist at the tip: fork, wheels, pins, the body that bends, and the jaws."""
    p = joint.pulley
    of = end.prefix
    out = 3 * p.radius
    short, middle = joint.outer - joint.ribs[0], (joint.outer + joint.ribs[0]) / 2
    places = {
        f"{of}_pin": (p.pin, 2 * joint.outer, [(0.0, 0.0, 0.0)]),
        f"{of}_guide_pin": (joint.guide_pin, short, [(x, side * middle, z) for x, side, z in joint.guide_pins]),
    }
    parts = [_fork_part(joint, end, sizes), _body_part(joint, end, jaw_ends[0], sizes)]
    for name, (diameter, length, spots) in places.items():
        if spots:
            rod = k.rod((0, -length / 2, 0), (0, length / 2, 0), diameter / 2)
            where = tuple(end.place() * k.at(*spot) for spot in spots)
            parts.append(pin(name, diameter, length, rod, end.near, where, (0, 2 * out, 0)))
    radii = sorted({lane.way.radius for lane in joint.lanes})
    for number, radius in enumerate(radii):
        spots3 = [(0.0, lane.y, 0.0) for lane in joint.lanes if lane.way.radius == radius]
        name = f"{of}_wheel" if len(radii) == 1 else f"{of}_wheel_{number + 1}"
        parts.append(_wheel(name, f"Wheel of tendons that pass {of}", radius, p.pin, spots3, end, sizes))
    if joint.lanes:
        spots3 = [(lane.guide[0], lane.y, lane.guide[1]) for lane in joint.lanes]
        parts.append(
            _wheel(f"{of}_guide", f"Guide wheel before {of}", joint.guide, joint.guide_pin, spots3, end, sizes)
        )
        parts += _sleeves(joint, end, sizes)
    jaw_pin = joint.jaws[0].pulley.pin
    rod = k.rod((0, -joint.jaw_outer, 0), (0, joint.jaw_outer, 0), jaw_pin / 2)
    where = (k.at(z=joint.jaws[0].offset, turn=(0, 0, jaw_ends[0].turn)),)
    parts.append(pin("jaw_pin", jaw_pin, 2 * joint.jaw_outer, rod, end.far, where, (0, 2 * out, out)))
    for number, (jaw, jaw_end) in enumerate(zip(joint.jaws, jaw_ends, strict=True)):
        parts.append(_jaw_part(jaw, jaw_end, sizes, (number + 2) * out))
    return parts


def _fork_part(joint: Wrist, end: End, sizes: Sizes) -> Part:
    """Return the fork on the stem, with the pins of the wheels and the tendons' tunnels."""
    p, arm, top = joint.pulley, joint.pulley.fork_arm, -joint.depth
    body = k.rod((0, 0, top - joint.collar), (0, 0, top), end.stem_radius)
    guides = [lane.guide for lane in joint.lanes]
    wide = max([arm, *(abs(x) + joint.guide_pin / 2 + 2 * sizes.wall for x, _ in guides)])
    low = max([top, *(z for _, z in guides)])
    outline = [(-arm, 0.0), (arm, 0.0), (wide, low), (wide, top), (-wide, top), (-wide, low)]
    arms = [(joint.inner, joint.outer), *([joint.ribs] if joint.lanes else [])]
    for start, stop in (*arms, *((-stop, -start) for start, stop in arms)):
        body += k.bar(outline, start, stop) + k.rod((0, start, 0), (0, stop, 0), arm)
    body = k.common(body, k.rod((0, 0, top - joint.collar), (0, 0, arm), end.stem_radius))
    for x, y in {place for place, _ in end.stem_ways}:
        body -= k.rod((x, y, top - joint.collar), (x, y, top), sizes.tunnel / 2)
    reach = joint.outer + 1
    body -= k.rod((0, -reach, 0), (0, reach, 0), (p.pin + sizes.bore) / 2)
    for x, side, z in joint.guide_pins:
        body -= k.rod((x, 0, z), (x, side * reach, z), (joint.guide_pin + sizes.bore) / 2)
    body += spigot(end, sizes, -end.near_length)
    bore = (p.pin + sizes.bore) / 2
    return Part(
        f"{end.prefix}_fork",
        "Fork on the stem",
        body,
        end.near,
        (end.place(),),
        dimensions=(
            Dimension("tunnels apart", (-p.radius, 0, top), (p.radius, 0, top), "front", 1, key=end.key, factor=2),
            Dimension("axis to collar", (0, -joint.inner, 0), (0, -joint.inner, top), "front", -1, along="y"),
            *tube_dimensions(end, sizes),
            Dimension("between the arms", (0, -joint.inner, 0), (0, joint.inner, 0), "side", 1),
            Dimension("over the arms", (0, -joint.outer, 0), (0, joint.outer, 0), "side", 1),
            Dimension("pin's bore", (-bore, -joint.inner, 0), (bore, -joint.inner, 0), "front", 1, "Ø"),
        ),
        notes=(
            f"Tunnels Ø{sizes.tunnel:.3g} for a rope of {sizes.rope:.3g} mm.",
            *(f"Guide pin's bore at x {x:.4g}, {-z:.4g} mm below the axis." for x, z in sorted(set(guides))),
        ),
    )


def _body_part(joint: Wrist, end: End, jaw_end: End, sizes: Sizes) -> Part:
    """Return the body that bends: its pulley, its tendons' ends, tunnels of those that go on, and the jaws' fork."""
    p, jaw, (low, top) = joint.pulley, joint.jaws[0].pulley, joint.block
    tube = sizes.tunnel / 2 + sizes.wall
    wide = max(abs(lane.way.radius) for lane in joint.lanes) + tube if joint.lanes else p.radius
    broad, deep = (
        max([least, *(abs(place[i]) + tube for place in _places(joint.lanes))])
        for i, least in ((0, joint.jaw_outer), (1, p.outside))
    )
    knee = min(low + 2 * (broad - wide), top - sizes.wall) if broad > wide else low
    outline = [(-wide, low), (wide, low), (broad, knee), (broad, top), (-broad, top), (-broad, knee)]
    body = k.bar(outline if knee > low else [outline[0], outline[1], outline[3], outline[4]], -deep, deep)
    to_jaws = k.at(z=joint.jaws[0].offset, turn=(0, 0, joint.jaw_turn))
    arm, drop = jaw.fork_arm, top - joint.jaws[0].offset
    for start in (-joint.jaw_outer, joint.jaw_inner):
        own = k.box((-arm, arm), (start, start + jaw.fork), (drop, 0.0))
        body += to_jaws * (own + k.rod((0, start, 0), (0, start + jaw.fork, 0), arm))
    body = k.common(body, k.rod((0, 0, low), (0, 0, joint.jaws[0].offset + arm), end.stem_radius))
    body += k.rod((0, -p.half, 0), (0, p.half, 0), p.rim)
    for start in (-p.outside, p.half):
        body += k.rod((0, start, 0), (0, start + p.cheek, 0), p.rim)
        body += k.box((-wide, wide), (start, start + p.cheek), (0.0, low + sizes.wall))
    for lane in joint.lanes:
        x, y = lane.way.side * lane.way.radius, lane.y
        straight = sizes.tunnel / 3
        points = [(x, y, low), (x, y, low + straight), (*lane.way.target, top - straight), (*lane.way.target, top)]
        for number, (one, other) in enumerate(pairwise(points)):
            body -= k.rod(one, other, sizes.tunnel / 2)
            if number:
                body -= k.kernel().Pos(*one) * k.kernel().Sphere(sizes.tunnel / 2)
    reach = joint.jaw_outer + 1
    body -= to_jaws * k.rod((0, -reach, 0), (0, reach, 0), (jaw.pin + sizes.bore) / 2)
    body = k.at(turn=FLIP) * body
    for y in (p.shift, -p.shift):
        body = k.grooved(body, p.bottom_radius, y, p.groove, p.radius + sizes.rope / 2 + sizes.play)
    for side in p.sides:
        body = tendon_end(p, end, sizes, body, side)
    body -= k.rod((0, -p.outside - 1, 0), (0, p.outside + 1, 0), (p.pin + sizes.bore) / 2)
    return Part(
        f"{end.prefix}_body",
        f"Pulley of {end.prefix} and the fork of what it carries",
        body,
        end.far,
        (end.place(far=True),),
        dimensions=(
            *groove_dimensions("rope", p.radius, p.bottom_radius, -p.outside, end.key),
            Dimension.height("axis to the fork's axis", 0, -joint.jaws[0].offset, 1, key=jaw_end.key_of("offset")),
            Dimension("over the cheeks", (0, -p.outside, 0), (0, p.outside, 0), "side", 1),
            Dimension("width of the block", (-broad, 0, -top), (broad, 0, -top), "front", -1),
        ),
        notes=(
            f"Grooves for a rope of {sizes.rope:.3g} mm; bottom rounded with {p.groove:.3g} mm.",
            f"Fork for a pin of {jaw.pin:g} mm, {2 * joint.jaw_inner:.4g} mm between its arms.",
        ),
        away=(0, 0, 3 * p.radius),
    )


def _wheel(  # noqa: PLR0917
    name: str, title: str, radius: float, own_pin: float, spots: Sequence[k.Point], end: End, sizes: Sizes
) -> Part:
    """Return a wheel with one groove that turns on a pin, at its places in the frame of the joint."""
    half, rim, bore = _lane(sizes) / 2, radius + _RIM * sizes.rope, (own_pin + sizes.bore) / 2
    bottom = radius - sizes.rope / 2
    body = k.grooved(k.rod((0, -half, 0), (0, half, 0), rim), bottom, 0.0, sizes.groove, rim + 1)
    body -= k.rod((0, -half - 1, 0), (0, half + 1, 0), bore)
    return Part(
        name,
        title,
        body,
        end.near,
        tuple(end.place() * k.at(*spot) for spot in spots),
        dimensions=(
            *groove_dimensions("rope", radius, bottom, -half),
            Dimension("rim", (-rim, -half, 0), (rim, -half, 0), "front", -1, "Ø"),
            Dimension("bore", (-bore, -half, 0), (bore, -half, 0), "front", -1, "Ø"),
            Dimension("width", (0, -half, 0), (0, half, 0), "side", 1),
        ),
        away=(0, 0, 1.5 * end.stem_radius),
    )


def _sleeves(joint: Wrist, end: End, sizes: Sizes) -> list[Part]:
    """Return the sleeves that fill the guide pins beside their wheels."""
    half, parts, radius = _lane(sizes) / 2, [], sleeve_radius(joint.guide_pin, sizes)
    gaps: dict[float, list[k.Point]] = {}
    for x, side, z in joint.guide_pins:
        at = sorted(side * lane.y for lane in joint.lanes if lane.guide == (x, z) and side * lane.y > 0)
        edges = [joint.ribs[1], *(y + beside * half for y in at for beside in (-1, 1)), joint.inner]
        for low, high in zip(edges[::2], edges[1::2], strict=True):
            length = round(high - low - 2 * sizes.play, 6)
            if length > sizes.wall:
                gaps.setdefault(length, []).append((x, side * (low + high) / 2, z))
    for number, (length, spots) in enumerate(gaps.items()):
        body = k.rod((0, -length / 2, 0), (0, length / 2, 0), radius)
        body -= k.rod((0, -length, 0), (0, length, 0), (joint.guide_pin + sizes.bore) / 2)
        parts.append(
            Part(
                f"{end.prefix}_sleeve" if len(gaps) == 1 else f"{end.prefix}_sleeve_{number + 1}",
                "Sleeve beside guide wheels",
                body,
                end.near,
                tuple(end.place() * k.at(*spot) for spot in spots),
                dimensions=(
                    Dimension("length", (0, -length / 2, 0), (0, length / 2, 0), "side", 1),
                    Dimension("outside", (-radius, 0, 0), (radius, 0, 0), "front", 1, "Ø"),
                ),
                away=(0, 1.5 * joint.outer, 0),
            )
        )
    return parts


def _jaw_part(jaw: Jaw, end: End, sizes: Sizes, out: float) -> Part:
    """Return a jaw with its pulley, whose groove has the two tendons of its pair side by side."""
    p, sign = jaw.pulley, jaw.opens or 1.0
    low = -sign * jaw.thick if not jaw.opens else sign * sizes.play / 2
    x = min(low, sign * jaw.thick), max(low, sign * jaw.thick)
    far = jaw.length + jaw.eye / 2 + max(2 * sizes.wall, jaw.eye / 2)
    hub = k.rod((0, -p.outside, 0), (0, p.outside, 0), p.rim) + k.box(
        x, (-p.outside, p.outside), (0.0, jaw.begin + sizes.wall)
    )
    hub = k.at(turn=FLIP) * hub
    for y in (p.shift, -p.shift):
        hub = k.grooved(hub, p.bottom_radius, y, p.groove, p.radius + sizes.rope / 2)
    for side in p.sides:
        hub = tendon_end(p, end, sizes, hub, side)
    body = k.at(y=-jaw.level) * hub
    body += k.at(turn=FLIP) * k.box(x, (-jaw.width, jaw.width), (jaw.begin, far))
    body -= k.rod((0, -2 * jaw.width, 0), (0, 2 * jaw.width, 0), (p.pin + sizes.bore) / 2)
    body -= k.rod((-2 * jaw.thick, 0, -jaw.length), (2 * jaw.thick, 0, -jaw.length), jaw.eye / 2)
    return Part(
        f"{end.prefix}_jaw",
        f"Jaw and pulley of {end.prefix}".replace("_", " "),
        body,
        end.far,
        (end.place(far=True),),
        dimensions=(
            *groove_dimensions("rope", p.radius, p.bottom_radius, -p.outside, end.key),
            Dimension.height("axis to the force", 0, -jaw.length, -1, key=end.key_of("end_effector_length")),
            Dimension("eye", (0, -jaw.eye / 2, -jaw.length), (0, jaw.eye / 2, -jaw.length), "side", 1, "Ø"),
            Dimension("width", (0, -jaw.width, -jaw.length), (0, jaw.width, -jaw.length), "side", -1),
        ),
        notes=(f"Grooves for a rope of {sizes.rope:.3g} mm; finger {jaw.thick:.3g} mm thick.",),
        away=(0, 0, out),
    )
