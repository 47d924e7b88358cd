"""What an instrument is made of: processes, sizes that all parts share, parts, dimensions, and ends of the stem."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, NoReturn, Self

from tenodesis.cad import kernel as k
from tenodesis.cad.kernel import FLIP, Location, Point, Solid
from tenodesis.errors import ArgumentError, InstrumentError


class Process(NamedTuple):
    """A way of making parts; lengths in m, density in kg/m³. Values are ours: to be measured on the machine at hand."""

    name: str
    material: str
    density: float
    wall: float
    """Thinnest wall."""
    play: float
    """Between parts that move against each other, on each side."""
    bore: float
    """By which a bore for a rope or pin is wider than it, on the diameter."""
    backlash: float
    """Play of a gear pair along its pitch circle."""
    overhang: float
    """Steepest overhang without a support, deg from the vertical; 90 where none is needed."""


PROCESSES: Mapping[str, Process] = {
    one.name: one
    for one in (
        Process("fdm", "PLA", 1240.0, 0.8e-3, 0.25e-3, 0.2e-3, 0.15e-3, 45.0),
        Process("sla", "resin", 1180.0, 0.5e-3, 0.12e-3, 0.1e-3, 0.08e-3, 60.0),
        Process("milled", "brass", 8500.0, 0.15e-3, 0.04e-3, 0.04e-3, 0.03e-3, 90.0),
    )
}
"""Processes by name."""


def process(name: "str | Process") -> Process:
    """Return a process by its name. Raises ValueError if there is none."""
    if isinstance(name, Process):
        return name
    if name not in PROCESSES:
        raise ArgumentError(key="process", value=name, allowed=f"one of {', '.join(PROCESSES)}")
    return PROCESSES[name]


class Sizes(NamedTuple):
    """Sizes that all parts share, mm."""

    process: Process
    rope: float
    """Diameter of a tendon."""

    @property
    def wall(self) -> float:
        """Thinnest wall."""
        return 1e3 * self.process.wall

    @property
    def play(self) -> float:
        """Between parts that move, on each side."""
        return 1e3 * self.process.play

    @property
    def bore(self) -> float:
        """By which a bore is wider than what goes through it."""
        return 1e3 * self.process.bore

    @property
    def tunnel(self) -> float:
        """Diameter of a tendon's tunnel."""
        return self.rope + self.bore

    @property
    def groove(self) -> float:
        """Radius of a groove's round bottom: 5 % more than the rope's."""
        return 0.525 * self.rope


def refuse(key: str, value: Any, because: str, allowed: str, *, unit: str = " mm") -> NoReturn:
    """Raise InstrumentError: one sentence with the dimension, its value, why it cannot be, and what would do."""
    raise InstrumentError(
        f"{key} is {value:.4g}{unit}: {because}; it must be {allowed}.", key=key, value=value, allowed=allowed
    )


View = Literal["front", "side", "top"]
STEEL = 7800.0
"""Density of steel, kg/m³."""


PAGE: dict[View, tuple[Point, Point]] = {
    "front": ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "side": ((0.0, -1.0, 0.0), (0.0, 0.0, 1.0)),
    "top": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
}
"""Directions across and up the page, by view: seen from -y, from -x and from z."""


def on_page(view: View, point: Point) -> tuple[float, float]:
    """Return where a point of a part is on the page, mm."""
    across, up = (sum(one * other for one, other in zip(way, point, strict=True)) for way in PAGE[view])
    return across, up


@dataclass(frozen=True)
class Dimension:
    """A dimension of a drawing, between two points of the part, mm, seen from -y (front), -x (side) or z (top)."""

    name: str
    first: Point
    second: Point
    view: View = "front"
    side: Literal[1, -1] = 1
    """Of the view on which it stands: 1 for above or to the right."""
    sign: Literal["", "Ø", "R"] = ""
    key: str = ""
    """Key of the instrument file that sets it, under which a tolerance may be given; by default its name."""
    factor: float = 1.0
    """By which the key's value, and its tolerance, is in the dimension."""
    along: Literal["x", "y"] = "x"
    """Direction on the page that it measures."""

    @classmethod
    def height(cls, name: str, low: float, high: float, side: Literal[1, -1], *, key: str = "") -> Self:
        """Return the dimension between two heights, seen from the front."""
        return cls(name, (0, 0, low), (0, 0, high), "front", side, key=key, along="y")

    @property
    def value(self) -> float:
        """Its nominal value, mm."""
        place = 0 if self.along == "x" else 1
        return abs(on_page(self.view, self.second)[place] - on_page(self.view, self.first)[place])


@dataclass(frozen=True)
class Part:
    """A kind of part: a solid in its own frame, mm, and its places in the frames of bodies (m elsewhere)."""

    name: str
    title: str
    solid: Solid
    body: str
    """Name of the body that it is fixed to, as in :func:`tenodesis.kinematics.frames`; or "rig_bar", "bench"."""
    places: tuple[Location, ...]
    made: bool = True
    """Whether it is to be made; otherwise bought to size, and drawn for assembly only."""
    density: float = 0.0
    """kg/m³; 0 of a part that is made, for which it is that of the process."""
    dimensions: tuple[Dimension, ...] = ()
    notes: tuple[str, ...] = ()
    away: Point = field(default=(0.0, 0.0, 0.0))
    """By how much it is moved in the exploded view, in its body's frame, mm."""


def bought(  # noqa: PLR0917
    name: str,
    title: str,
    solid: Solid,
    body: str,
    places: tuple[Location, ...],
    away: Point = (0.0, 0.0, 0.0),
    dimensions: tuple[Dimension, ...] = (),
) -> Part:
    """Return a part of steel that is bought to size."""
    return Part(name, title, solid, body, places, False, STEEL, dimensions, away=away)


def pin(  # noqa: PLR0917
    name: str, diameter: float, length: float, solid: Solid, body: str, places: tuple[Location, ...], away: Point
) -> Part:
    """Return a dowel pin of a diameter and a length, mm."""
    return bought(name, f"Dowel pin ISO 2338 {diameter:g} x {math.ceil(length):g}", solid, body, places, away)


STEEPEST = math.radians(20)
"""Slant of a tendon between the handle's joint and the stem; its bends there do not change with the joint."""


class End(NamedTuple):
    """Where a joint is along the instrument, mm: what its parts have in common."""

    tip: bool
    """Whether it is at the tip; otherwise at the handle."""
    prefix: str
    """Begin of the names of its parts."""
    key: str
    """Key of the instrument file for the radius of its joint."""
    near: str
    """Body that it stands on: the stem, or the far body of the joint before."""
    carrier: str
    far: str
    turn: float
    """Turn about the stem of its own frame, whose x is the side that it bends to, deg."""
    start: float
    """Of its near axis along the body that it stands on."""
    order: int
    """Number of joints between it and the stem."""
    last: bool
    """Whether no other joint stands on it."""
    passing: tuple[tuple[float, float], ...]
    """Where tendons of joints beyond pass its middle plane, in its own frame."""
    stem_ways: tuple[tuple[tuple[float, float], tuple[float, float]], ...]
    """Of every tendon, where it is at the joint and where within the stem, in the frame of the joint."""
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

    def key_of(self, name: str) -> str:
        """Return the key of the instrument file for another value of its joint."""
        return f"{self.key.removesuffix('radius')}{name}"

    def place(self, along: float = 0.0, *, far: bool = False) -> Location:
        """Return where a half of the joint, or a link, is in its body, so far along it; z of a half is to its mate."""
        turned = k.at(z=along, turn=(0.0, 0.0, self.turn))
        return turned * k.at(turn=FLIP) if far == self.tip else turned

    def passing_in(self, *, far: bool = False) -> tuple[tuple[float, float], ...]:
        """Return where tendons pass, in the frame of a half."""
        return tuple((x, -y) for x, y in self.passing) if far == self.tip else self.passing

    @property
    def outward(self) -> float:
        """Direction from the stem along it: 1 at the tip, -1 at the handle."""
        return 1.0 if self.tip else -1.0


def _spigot_length(end: End) -> float:
    return 1.2 * end.stem_radius


def spigot(end: End, sizes: Sizes, top: float) -> Solid:
    """Return what goes into the stem's tube from a height downward; flat on two sides, where the tendons pass."""
    radius, length = end.stem_bore - sizes.play / 2, _spigot_length(end)
    flat = end.tendon_radius - sizes.tunnel / 2
    body = k.rod((0, 0, top - length), (0, 0, top), radius)
    lows = [low for _, low in end.stem_ways]
    for turn in (0.0, 90.0):
        if any(_across(low) == turn for low in lows):
            for low, high in ((flat, radius + 1), (-radius - 1, -flat)):
                body -= k.at(turn=(0, 0, turn)) * k.box((low, high), (-radius, radius), (top - length, top))
    if any(not any(low) for low in lows):
        body -= k.rod((0, 0, top - length), (0, 0, top), sizes.tunnel / 2)
    return body


def _across(place: tuple[float, float]) -> float | None:
    """Return the turn of the plane in which a tendon is beside the axis, deg; None on the axis."""
    x, y = map(abs, place)
    return None if not x and not y else 0.0 if x >= y else 90.0


def tube_dimensions(end: End, sizes: Sizes) -> tuple[Dimension, ...]:
    """Return the dimensions of the collar and spigot of a part on the stem."""
    top, length, radius = -end.near_length, _spigot_length(end), end.stem_bore - sizes.play / 2
    flat = end.tendon_radius - sizes.tunnel / 2
    return (
        Dimension.height("axis to tube", 0, top, 1),
        Dimension.height("spigot's length", top, top - length, 1),
        Dimension("spigot", (0, -radius, top), (0, radius, top), "side", -1, "Ø"),
        Dimension("over the spigot's flats", (-flat, 0, top), (flat, 0, top), "front", -1),
        Dimension("collar", (-end.stem_radius, 0, top), (end.stem_radius, 0, top), "top", -1, "Ø", "stem_diameter"),
    )


def far_dimensions(end: End, sizes: Sizes, bottom: float) -> tuple[Dimension, ...]:
    """Return the dimensions of the collar of a far body."""
    socket_radius = (end.rod + sizes.bore) / 2
    return (
        Dimension.height("axis to back", 0, bottom, -1),
        Dimension("socket", (-socket_radius, 0, bottom), (socket_radius, 0, bottom), "front", -1, "Ø"),
        Dimension.height("socket's depth", bottom, bottom + end.far_collar - sizes.wall, 1),
    )


def groove_dimensions(what: str, radius: float, bottom: float, y: float, key: str = "") -> tuple[Dimension, Dimension]:
    """Return the dimensions of a groove at a height y, to the centre of what lies in it and to its bottom, mm."""
    return (
        Dimension(f"radius to the {what}'s centre", (0, y, 0), (radius, y, 0), "front", 1, "R", key),
        Dimension("radius to the groove's bottom", (0, y, 0), (bottom, y, 0), "front", 1, "R", key),
    )


def transition_length(radius: float, tendon_radius: float) -> float:
    """Return the length within which a tendon goes from a joint's radius to its place in the stem."""
    return abs(radius - tendon_radius) / math.tan(STEEPEST)


def transition(end: End, sizes: Sizes, width: float, middle: float, top: float) -> tuple[Solid, list[Solid]]:
    """Return the body between a joint's collar and the stem, and its tunnels, from a height at the top."""
    length = -end.near_length - top
    straight = min(0.25 * -length, end.stem_radius)
    low = -end.near_length + straight
    # The walls beside the slanted tunnels are slanted as well.
    wall = sizes.wall / math.cos(STEEPEST) + 0.01
    body = k.rod((0, 0, -end.near_length), (0, 0, low), end.stem_radius)
    narrow = end.tendon_radius + sizes.tunnel / 2 + wall
    for turn in (0.0, 90.0):
        ways = [[turned(place, -turn) for place in way] for way in end.stem_ways if _across(way[0]) == turn]
        if not ways:
            continue
        own = width if turn == 0 else 0.0
        wide = max(own, *(abs(x) + sizes.tunnel / 2 + wall for (x, _), _ in ways))
        depths = [abs(y) + sizes.tunnel / 2 + sizes.wall for way in ways for _, y in way]
        deep = max(middle, 0.4 * end.stem_radius, *depths)
        prism = k.bar([(-wide, top), (-narrow, low), (narrow, low), (wide, top)], -deep, deep)
        body += prism if turn == 0 else k.at(turn=(0, 0, turn)) * prism
    radius, tunnels = sizes.tunnel / 2, []
    for (x, y), (x_low, y_low) in end.stem_ways:
        slanted = k.rod((x, y, top), (x_low, y_low, low), radius)
        for place in ((x, y, top), (x_low, y_low, low)):
            slanted += k.kernel().Pos(*place) * k.kernel().Sphere(radius)
        tunnels += [slanted, k.rod((x_low, y_low, -end.near_length), (x_low, y_low, low), radius)]
    return body, tunnels


def turned(place: tuple[float, float], turn: float) -> tuple[float, float]:
    """Return a place in the plane across, turned by an angle, deg."""
    x, y = place
    cos, sin = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    return cos * x - sin * y, sin * x + cos * y


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
