"""A pulley with a lever that stands on a gear pair: the jaw of the end-effector, or the trigger of the handle."""

import math
from typing import NamedTuple

from tenodesis.cad import kernel as k
from tenodesis.cad.bench_parts import TIP_PIN
from tenodesis.cad.between_parts import outer_place
from tenodesis.cad.gears import GearJoint, far_half, gear_notes, half_dimensions
from tenodesis.cad.kernel import Solid
from tenodesis.cad.parts import Dimension, End, Part, Sizes, bought, ferrule, groove_dimensions, pin, refuse
from tenodesis.cad.pulley_parts import PulleyJoint, tendon_end

_FINGER = 30.0
"""Least length of a trigger's lever, mm; ours."""
_SPRING_MODULUS = 206e3  # N/mm^2, of spring steel wire, EN 10270-1
_WIRES = (0.1, 0.12, 0.14, 0.16, 0.18, 0.2, 0.22, 0.25, 0.28, 0.3, 0.35, 0.4, 0.45, 0.5, 0.55, 0.6, 0.7, 0.8, 0.9, 1.0)
"""Diameters, mm; a usual series, to be compared with what is offered."""
_FEWEST_COILS, _MOST_COILS = 1.5, 6.0
_STEEPEST = math.radians(30)


class Spring(NamedTuple):
    """A torsion spring about a pin, mm: one of two beside the pulley, each with half of the joint's stiffness."""

    wire: float
    diameter: float
    """To the middle of the wire."""
    coils: float

    @property
    def width(self) -> float:
        """Along the pin, with play."""
        return (self.coils + 1.5) * 1.05 * self.wire


def spring(sizes: Sizes, key: str, pin_diameter: float, stiffness: float, room: float) -> Spring:
    """Return the spring of a stiffness, N mm/rad, about a pin, within a radius.

    Raises InstrumentError if none of the usual wires fits.
    """
    found = []
    for wire in _WIRES:
        diameter = pin_diameter + wire + 2 * max(sizes.play, 0.1)
        # Moment by angle of a coiled wire that bends: E d^4 / (64 D n), EN 13906-3.
        coils = _SPRING_MODULUS * wire**4 / (64 * diameter * stiffness)
        if _FEWEST_COILS <= coils <= _MOST_COILS and (diameter + wire) / 2 <= room:
            found.append(Spring(wire, diameter, coils))
    if not found:
        ends = [
            _SPRING_MODULUS * wire**4 / (64 * (pin_diameter + wire + 2 * max(sizes.play, 0.1)) * coils)
            for wire, coils in ((_WIRES[0], _MOST_COILS), (_WIRES[-1], _FEWEST_COILS))
        ]
        refuse(
            key,
            2e-3 * stiffness,
            f"no wire of {_WIRES[0]:g} to {_WIRES[-1]:g} mm makes two springs of it in {_FEWEST_COILS:g} to "
            f"{_MOST_COILS:g} coils within {room:.3g} mm of the pin's axis",
            f"from {2e-3 * ends[0]:.2g} to {2e-3 * ends[1]:.2g} N m/rad, and the joint's radius larger for stiff ones",
            unit=" N m/rad",
        )
    return min(found, key=lambda one: one.width)


class Lever(NamedTuple):
    """Sizes of a pulley with a lever, mm and rad."""

    pulley: PulleyJoint
    bent: float
    """Largest angle of its range to either side."""
    offset: float
    """From the far axis of the gear pair to its own."""
    spring: Spring | None
    length: float
    """Of the lever from its axis; a jaw is shorter where the eye of the fixed one is in its way."""
    closed: float
    """Angle at which a jaw is closed."""
    reach: float
    """Of the fixed jaw, from the lever's axis to the eye where forces act; 0 at the handle."""
    thick: float
    """Of lever and fixed jaw."""

    @property
    def inner(self) -> float:
        """Half the width between the arms of its fork."""
        beside = self.spring.width if self.spring is not None else 0.0
        return self.pulley.outside + self.pulley.play + beside

    @property
    def outer(self) -> float:
        """Half the width over the arms."""
        return self.inner + self.pulley.fork

    @property
    def side(self) -> float:
        """Side of a jaw's lever: 1 toward x; the fixed jaw is on the other."""
        return -1.0 if self.closed > 0 else 1.0

    @property
    def arm(self) -> float:
        """Half the width of an arm of the fork."""
        return self.pulley.fork_arm

    def jaw(self, sizes: Sizes) -> float:
        """Return the length of the jaw that moves: as far as the eye of the fixed one."""
        return min(self.length, self.reach - _eye(sizes) - 1.0)

    def clear(self, sizes: Sizes) -> float:
        """Return how far from its axis the fork's block begins, and the bridge on the other side."""
        own = self.pulley.rim + 2 * self.pulley.play + sizes.wall
        return max(own, self.block(sizes) * math.tan(self.bent) + self.thick) if not self.reach else own

    def block(self, sizes: Sizes) -> float:
        """Return half the width of the fork's block in the plane that the lever turns in."""
        return max(self.pulley.radius + sizes.tunnel / 2 + sizes.wall, self.arm)

    def bridge(self, sizes: Sizes, seat: float) -> float:
        """Return how far from its axis the bridge begins that holds the grip: beyond the seat of the sheath."""
        return max(self.clear(sizes), math.hypot(self.pulley.radius, _seat_end(self.pulley, sizes, seat)) + 2 * seat)

    def foot(self, sizes: Sizes, seat: float) -> float:
        """Return where the socket of the grip begins, from the gear's far axis."""
        return self.offset + self.bridge(sizes, seat) + sizes.wall


def check_lever(  # noqa: PLR0917
    gear: GearJoint, gear_end: End, lever: Lever, end: End, sizes: Sizes, way: tuple[float, float]
) -> None:
    """Refuse an axis so near to the gear pair, or to the force, that tendon or jaw have no room.

    `way` is where the tendon passes the gear's middle plane.
    """
    key = end.key_of("offset")
    taken = gear.depth + gear_end.far_collar + lever.clear(sizes)
    least = taken + math.hypot(lever.pulley.radius, *way) / math.tan(_STEEPEST)
    if lever.offset < least:
        refuse(
            key,
            lever.offset,
            f"the gear pair and the fork of {end.prefix} take {taken:.4g} mm, and its tendon needs the rest to get to "
            "the side of its pulley",
            f"at least {least:.4g} mm for process {sizes.process.name}",
        )
    short = lever.clear(sizes) + 2 * lever.thick - lever.jaw(sizes)
    if end.tip and short > 0:
        refuse(
            key,
            lever.offset,
            f"the eye of the fixed jaw leaves {max(lever.jaw(sizes), 0.0):.3g} mm for the jaw that moves",
            f"at most {lever.offset - short:.4g} mm",
        )


def lever_parts(  # noqa: PLR0917
    gear: GearJoint, gear_end: End, lever: Lever, end: End, sizes: Sizes, place: tuple[float, float], across: float
) -> list[Part]:
    """Return the parts of a lever on the last gear pair, whose far half has its fork.

    `place` is where its tendon passes the gear's middle plane; the eye's axis is turned by `across`, deg, from its own.
    """
    of = end.prefix.replace("_", " ")
    p, bore = lever.pulley, (lever.pulley.pin + sizes.bore) / 2
    half = lever.outer + 0.4 * p.pin
    dowel = k.rod((0, -half, 0), (0, half, 0), p.pin / 2)
    shift = 2.5 * gear.gear.pitch_radius * (2 * gear_end.order + 1)
    out = end.outward * (shift + 5 * p.radius + lever.length)
    found = [
        _carrier(gear, gear_end, lever, end, sizes, place, across),
        Part(
            f"{end.prefix}_lever",
            f"Lever and pulley of {of}",
            _lever(lever, end, sizes),
            end.far,
            (end.place(far=True),),
            dimensions=(
                *groove_dimensions("rope", p.radius, p.bottom_radius, -p.outside, end.key),
                Dimension("rim", (-p.rim, -p.outside, 0), (p.rim, -p.outside, 0), "front", 1, "Ø"),
                Dimension("width", (0, -p.outside, 0), (0, p.outside, 0), "side", 1),
                Dimension("pin's bore", (-bore, -p.outside, 0), (bore, -p.outside, 0), "front", -1, "Ø"),
            ),
            notes=(
                f"For a rope of {sizes.rope:.3g} mm; groove's bottom rounded with {p.groove:.3g} mm.",
                f"Lever {lever.jaw(sizes) if end.tip else lever.length:.4g} mm from the pin's axis, "
                f"{lever.thick:.3g} mm thick; as it stands at the angle zero.",
            ),
            away=(0, 0, out),
        ),
        pin(
            f"{end.prefix}_pin",
            p.pin,
            2 * half,
            dowel,
            gear_end.far,
            (end.place(end.start),),
            (0, 4 * half, end.outward * shift),
        ),
    ]
    if lever.spring is not None:
        wire, diameter, coils = lever.spring
        start = p.outside + p.play / 2 + wire
        coil = k.coil(wire, diameter, coils, 1.05 * wire, (0.0, start, 0.0))
        found.append(
            bought(
                f"{end.prefix}_spring",
                f"Torsion spring: wire {wire:g}, mean diameter {diameter:.3g}, {coils:.3g} coils",
                coil,
                gear_end.far,
                tuple(end.place(end.start) * k.at(turn=(0, 0, turn)) for turn in (0.0, 180.0)),
                (0, 3 * half, end.outward * shift),
            )
        )
    return found


def _carrier(  # noqa: PLR0917
    gear: GearJoint, gear_end: End, lever: Lever, end: End, sizes: Sizes, way: tuple[float, float], across: float
) -> Part:
    """Return the far half of the gear pair with the fork of the lever, and the fixed jaw or the grip's socket."""
    body, bottom = far_half(gear, gear_end, sizes, gear_end.far_collar)
    place = outer_place(gear_end, end)
    own, cuts = _fork(lever, sizes, -lever.offset - bottom)
    if gear_end.tip:
        jaw, eye = _fixed_jaw(lever, sizes, across)
        own += jaw
        cuts.append(eye)
    else:
        bridge, hole = _bridge(lever, gear_end, sizes)
        own += bridge
        cuts.append(hole)
    body += place * own
    for cut in cuts:
        body -= place * cut
    wide, long = ferrule(sizes)
    if gear_end.tip:
        for x in (-gear.gear.pitch_radius, gear.gear.pitch_radius):
            body -= k.rod((x, 0, bottom - 2 * long), (x, 0, bottom), wide)
    # The tendon of the lever goes from the gear's middle plane to the side of the pulley.
    turned = place.inverse()
    begin = turned * k.at(way[0], -way[1] if gear_end.tip else way[1], bottom)
    start = begin.position
    front = -lever.clear(sizes)
    for side in lever.pulley.sides:
        target = (side * lever.pulley.radius, side * lever.pulley.shift)
        tunnel = k.rod((start.X, start.Y, start.Z), (*target, front), sizes.tunnel / 2)
        # Its ends are across it, not across the tunnels before and after.
        tunnel += k.rod((*target, front), (*target, front + sizes.tunnel), sizes.tunnel / 2)
        for x, y, z in ((start.X, start.Y, start.Z), (*target, front)):
            tunnel += k.kernel().Pos(x, y, z) * k.kernel().Sphere(sizes.tunnel / 2)
        body -= place * tunnel
    of = f"{gear_end.prefix} and the fork of {end.prefix}".replace("_", " ")
    eye_or_socket = (
        Dimension.height(
            "axis to the force", 0, -lever.offset - lever.reach, -1, key=gear_end.key_of("end_effector_length")
        )
        if gear_end.tip
        else Dimension.height("axis to the socket's bottom", 0, -lever.foot(sizes, gear_end.seat), -1)
    )
    return Part(
        f"{gear_end.prefix}_{end.prefix}",
        f"Gear of {of}",
        body,
        gear_end.far,
        (gear_end.place(far=True),),
        dimensions=(
            *half_dimensions(gear, gear_end),
            Dimension.height("axis to the fork's axis", 0, -lever.offset, 1, key=end.key_of("offset")),
            eye_or_socket,
        ),
        notes=(
            *gear_notes(gear),
            f"Fork for a pin of {lever.pulley.pin:g} mm, {2 * lever.inner:.4g} mm between its arms.",
        ),
        away=(0, 0, gear_end.outward * 2.5 * gear.gear.pitch_radius * (2 * gear_end.order + 1)),
    )


def _fork(lever: Lever, sizes: Sizes, begin: float) -> tuple[Solid, list[Solid]]:
    """Return block and arms of the fork in the lever's near frame, z outward, from a height, and the pin's bore."""
    p, front = lever.pulley, -lever.clear(sizes)
    wide = lever.block(sizes)
    body = k.box((-wide, wide), (-lever.outer, lever.outer), (begin, front))
    for low in (-lever.outer, lever.inner):
        body += k.box((-lever.arm, lever.arm), (low, low + p.fork), (front, 0.0))
        body += k.rod((0, low, 0), (0, low + p.fork, 0), lever.arm)
    reach = lever.outer + 1
    return body, [k.rod((0, -reach, 0), (0, reach, 0), (p.pin + sizes.bore) / 2)]


def _fixed_jaw(lever: Lever, sizes: Sizes, across: float) -> tuple[Solid, Solid]:
    """Return the fixed jaw with its eye where forces act, and the eye's bore, in the lever's near frame."""
    p, s, gap = lever.pulley, -lever.side, lever.pulley.play
    clear, eye = lever.clear(sizes), _eye(sizes)
    x = _bounds(s * gap, s * lever.thick)
    arms = _bounds(s * gap, s * max(lever.thick, lever.arm))
    body = k.box(arms, (-lever.outer, lever.outer), (clear, clear + lever.thick))
    for low in (-lever.outer, lever.inner):
        body += k.box(arms, (low, low + p.fork), (0.0, clear + lever.thick))
    body += k.box(x, (-p.outside, p.outside), (clear, lever.reach - eye / 2))
    half, end = max(p.outside, eye / 2), lever.reach
    turned = k.at(turn=(0, 0, across))
    body += turned * k.rod((0, -half, end), (0, half, end), eye)
    return body, turned * k.rod((0, -half - 9, end), (0, half + 9, end), TIP_PIN / 2)


def _bounds(one: float, other: float) -> tuple[float, float]:
    return min(one, other), max(one, other)


def _eye(sizes: Sizes) -> float:
    return TIP_PIN / 2 + max(2 * sizes.wall, 1.5)


def _bridge(lever: Lever, gear_end: End, sizes: Sizes) -> tuple[Solid, Solid]:
    """Return what joins the arms beyond the lever and holds the grip, and its socket, in the lever's near frame."""
    clear, collar = lever.bridge(sizes, gear_end.seat), gear_end.far_collar
    wide = max((gear_end.rod + sizes.bore) / 2 + sizes.wall, lever.arm)
    deep = max(lever.outer, wide)
    body = k.box((-wide, wide), (-deep, deep), (clear, clear + collar))
    for low in (-lever.outer, lever.inner):
        body += k.box((-lever.arm, lever.arm), (low, low + lever.pulley.fork), (0.0, clear))
    return body, k.rod((0, 0, clear + sizes.wall), (0, 0, clear + collar), (gear_end.rod + sizes.bore) / 2)


def _lever(lever: Lever, end: End, sizes: Sizes) -> Solid:
    """Return pulley and lever in the far frame of the joint, z toward the stem."""
    p, thick = lever.pulley, lever.thick
    body = k.rod((0, -p.outside, 0), (0, p.outside, 0), p.rim)
    if end.tip:
        length = lever.jaw(sizes)
        s = lever.side
        outline = [(s * p.play, 0.0), (s * thick, 0.0), (s * thick, -length), (s * p.play, -length)]
        # As it is when closed, turned back; in this frame, whose z is flipped, about y the other way.
        body += k.turned_about_y(lever.closed) * k.bar(outline, -p.outside, p.outside)
    else:
        side = p.sides[0]
        x = _bounds(0.0, -side * lever.length)
        body += k.box(x, (-p.outside, p.outside), (-thick / 2, thick / 2))
        body += k.rod((-side * lever.length, -p.outside, 0), (-side * lever.length, p.outside, 0), thick)
        for plate in _sheath_plates(p, end, sizes):
            body += plate
    for side in p.sides:
        body = k.grooved(body, p.bottom_radius, side * p.shift, p.groove, p.rim + 1e-3)
        body = tendon_end(p, end, sizes, body, side)
    return body - k.rod((0, -p.outside - 1, 0), (0, p.outside + 1, 0), (p.pin + sizes.bore) / 2)


def _sheath_plates(p: PulleyJoint, end: End, sizes: Sizes) -> list[Solid]:
    """Return what joins a trigger's pulley, beside its groove, with the seat of its sheath."""
    cos, sin, wide = math.cos(p.wrap), math.sin(p.wrap), end.seat + sizes.wall
    long = _seat_end(p, sizes, end.seat)
    plates = []
    for side in p.sides:
        foot = (side * p.radius * cos, -p.radius * sin)
        way, across = (-side * sin, -cos), (cos, -side * sin)
        corners = [
            (foot[0] + along * way[0] + out * across[0], foot[1] + along * way[1] + out * across[1])
            for along, out in ((0, -wide), (long, -wide), (long, wide), (0, wide))
        ]
        for low in (-p.outside, p.half):
            plates.append(k.bar(corners, low, low + p.cheek))
    return plates


def _seat_end(p: PulleyJoint, sizes: Sizes, seat: float) -> float:
    """Return how far from the pulley the seat of a sheath ends, along the tendon."""
    return math.sqrt((p.rim + sizes.wall) ** 2 - p.radius**2) + 4 * seat


def lever_length(*, tip: bool, radius: float, held: float) -> float:
    """Return the length of a lever, mm: beyond where a jaw holds an object, or for a finger."""
    return 1.25 * held if tip else max(4.5 * radius, _FINGER)
