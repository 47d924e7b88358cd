"""Parts of a joint of one pulley on a fixed axis, at either end of the stem."""

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
    ferrule,
    groove_dimensions,
    pin,
    refuse,
    socket,
    spigot,
    transition,
    tube_dimensions,
)

PINS = (0.8, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)  # mm, ISO 2338
_MORE_WRAP = math.radians(10)
_LEAST_WRAP = math.radians(75)
"""Of a tendon that leaves the pulley again."""


class PulleyJoint(NamedTuple):
    """Sizes of one pulley with a groove for each tendon, mm and rad."""

    radius: float
    """To the rope's centre."""
    rope: float
    groove: float
    """Radius of the groove's round bottom."""
    shift: float
    """Of the agonist's groove from the middle, toward y; the antagonist's is on the other side."""
    half: float
    """Half the width of the pulley."""
    rim: float
    """Radius of the flanges."""
    cheek: float
    """Thickness of either cheek of the far body."""
    fork: float
    """Thickness of either arm of the fork."""
    pin: float
    play: float
    wall: float
    depth: float
    """From the axis to the fork's collar."""
    collar: float
    wrap: float
    """Angle from where the tendon meets the straight joint's pulley to where it is anchored or leaves it."""
    sides: tuple[int, ...] = (1, -1)
    """Of its tendons: 1 of the agonist, -1 of the antagonist."""

    @property
    def bottom_radius(self) -> float:
        """To the groove's bottom."""
        return self.radius - self.rope / 2

    @property
    def outside(self) -> float:
        """Half the thickness over the far body's cheeks."""
        return self.half + self.cheek

    @property
    def fork_arm(self) -> float:
        """Half the width of either arm of the fork."""
        return self.pin / 2 + max(2 * self.wall, 0.3 * self.radius)

    @property
    def pin_length(self) -> float:
        """Over the fork, with a groove's width for a ring on either side."""
        return 2 * (self.outside + self.play + self.fork + 0.4 * self.pin)


def pulley_joint(  # noqa: PLR0917
    sizes: Sizes, key: str, radius: float, stop: float, seat: float | None, sides: tuple[int, ...] = (1, -1)
) -> PulleyJoint:
    """Return the sizes of a pulley that turns up to an angle, rad; with the radius of a sheath's seat if it has one.

    Raises InstrumentError if no pin fits in it.
    """
    wall, groove = sizes.wall, sizes.groove
    pins = [pin for pin in PINS if pin <= 0.6 * radius and radius - sizes.rope / 2 - (pin + sizes.bore) / 2 >= wall]
    if not pins:
        least = max(PINS[0] / 0.6, sizes.rope / 2 + (PINS[0] + sizes.bore) / 2 + wall)
        refuse(
            key,
            radius,
            f"between the groove's bottom and a pin of {PINS[0]:g} mm stays less than the {wall:.3g} mm that process "
            f"{sizes.process.name} allows",
            f"at least {least:.3g} mm",
        )
    shift = groove + wall / 2 if len(sides) > 1 else 0.0
    half = shift + groove + wall
    rim = radius + sizes.rope
    boss = 0.0 if seat is None else shift + seat + wall - half
    held = ferrule(sizes)[0] if seat is None else 0.0
    wrap, depth = stop + _MORE_WRAP, rim + 2 * sizes.play + wall
    if seat is not None:
        # The tendons cross below the pulley, and their sheaths leave above the collar.
        wrap = max(wrap, _LEAST_WRAP)
        across = radius * math.cos(wrap) + max(0.45 * radius, 0.3 * radius + 2 * wall)
        depth = max(depth, radius * math.sin(wrap) + across / math.tan(wrap) + seat + wall)
    return PulleyJoint(
        radius,
        sizes.rope,
        groove,
        shift,
        half,
        rim,
        cheek=max(2 * wall, boss, held),
        fork=max(2 * wall, 0.12 * radius),
        pin=pins[-1],
        play=sizes.play,
        wall=wall,
        depth=depth,
        collar=max(3 * wall, 0.5 * radius),
        wrap=wrap,
        sides=sides,
    )


def pulley_parts(joint: PulleyJoint, end: End, sizes: Sizes) -> list[Part]:
    """Return the parts of a pulley at the tip or at the handle."""
    tip = end.tip
    near, far = ("tip_fork", "tip_pulley") if tip else ("handle_fork", "handle_pulley")
    dowel = k.rod((0, -joint.pin_length / 2, 0), (0, joint.pin_length / 2, 0), joint.pin / 2)
    out = 3 * joint.radius
    notes = (
        f"Grooves: radius to the rope's centre {joint.radius:.4g} mm, to the groove's bottom "
        f"{joint.bottom_radius:.4g} mm, for a rope of {sizes.rope:.3g} mm; bottom rounded with {joint.groove:.3g} mm.",
    )
    return [
        Part(
            near,
            "Fork on the stem" if tip else "Fork at the stem's handle end",
            _near(joint, end, sizes),
            "stem",
            (k.at() if tip else k.at(z=-end.stem_length, turn=FLIP),),
            dimensions=_fork_dimensions(joint, end, sizes),
            notes=(f"Tunnels Ø{sizes.tunnel:.3g} for a rope of {sizes.rope:.3g} mm.",),
        ),
        Part(
            far,
            "Pulley of the end-effector" if tip else "Pulley of the grip",
            _far(joint, end, sizes),
            end.far,
            (k.at(turn=FLIP) if tip else k.at(),),
            dimensions=_pulley_dimensions(joint, end, sizes),
            notes=notes,
            away=(0, 0, out if tip else -out),
        ),
        pin(
            f"{'tip' if tip else 'handle'}_pin",
            joint.pin,
            joint.pin_length,
            dowel,
            "stem",
            (k.at() if tip else k.at(z=-end.stem_length),),
            (0, out, 0),
        ),
    ]


def _near(joint: PulleyJoint, end: End, sizes: Sizes) -> Solid:
    inner = joint.outside + joint.play
    arm, top = joint.fork_arm, -joint.depth
    width = max(joint.radius + sizes.tunnel / 2 + sizes.wall, arm)
    body = k.box((-width, width), (-inner - joint.fork, inner + joint.fork), (top - joint.collar, top))
    for low in (-inner - joint.fork, inner):
        body += k.box((-arm, arm), (low, low + joint.fork), (top, 0.0))
        body += k.rod((0, low, 0), (0, low + joint.fork, 0), arm)
    places = [(joint.radius, joint.shift), (-joint.radius, -joint.shift)]
    if end.tip:
        body += k.rod((0, 0, top - joint.collar), (0, 0, top), end.stem_radius)
        cuts = [k.rod((x, y, top - joint.collar), (x, y, top), sizes.tunnel / 2) for x, y in places]
    else:
        low = top - joint.collar
        joined, cuts = transition(end, sizes, width, inner + joint.fork, low)
        body += joined
        cuts += [k.rod((x, y, low), (x, y, top), sizes.tunnel / 2) for x, y in places]
    for cut in cuts:
        body -= cut
    reach = inner + joint.fork + 1
    body -= k.rod((0, -reach, 0), (0, reach, 0), (joint.pin + sizes.bore) / 2)
    return body + spigot(end, sizes, -end.near_length)


def _far(joint: PulleyJoint, end: End, sizes: Sizes) -> Solid:
    """Return the pulley with its cheeks; the tendons come from z, and its collar is toward -z."""
    half, rim = joint.half, joint.rim
    body = k.rod((0, -half, 0), (0, half, 0), rim)
    top, width = -joint.depth, max(end.rod / 2 + 2 * sizes.wall, 0.45 * joint.radius)
    bottom = top - end.far_collar
    for low in (-joint.outside, half):
        body += k.box((-width, width), (low, low + joint.cheek), (bottom, 0.0))
        body += k.rod((0, low, 0), (0, low + joint.cheek, 0), rim)
    body += k.box((-width, width), (-joint.outside, joint.outside), (bottom, top))
    body += k.rod((0, 0, bottom), (0, 0, top), (end.rod + sizes.bore) / 2 + sizes.wall)
    for y in (joint.shift, -joint.shift):
        body = k.grooved(body, joint.bottom_radius, y, joint.groove, rim + 1e-3)
    for side in (1, -1):
        body = tendon_end(joint, end, sizes, body, side)
    body -= k.rod((0, -joint.outside - 1, 0), (0, joint.outside + 1, 0), (joint.pin + sizes.bore) / 2)
    return body - socket(end, sizes, bottom)


def tendon_end(joint: PulleyJoint, end: End, sizes: Sizes, body: Solid, side: int) -> Solid:
    """Return the far body with the anchor of a tendon, or at the handle its tunnel and the seat of its sheath."""
    # The far body's frame is that of the near half turned about x, so that y is the other way.
    y = -side * joint.shift
    x, z = side * joint.radius * math.cos(joint.wrap), -joint.radius * math.sin(joint.wrap)
    if end.tip:
        return body - k.rod((x, y, z), (x, math.copysign(joint.outside + 1, y), z), ferrule(sizes)[0])
    way = (-side * math.sin(joint.wrap), 0.0, -math.cos(joint.wrap))
    begin = math.sqrt((joint.rim + sizes.wall) ** 2 - joint.radius**2)
    length = 4 * end.seat

    def along(distance: float) -> k.Point:
        return (x + distance * way[0], y, z + distance * way[2])

    body += k.rod(along(begin), along(begin + length), end.seat + sizes.wall) - k.rod(
        (0, -2 * joint.outside, 0), (0, 2 * joint.outside, 0), joint.rim + sizes.wall / 2
    )
    body -= k.rod(along(0), along(begin + length), sizes.tunnel / 2)
    return body - k.rod(along(begin + 2 * sizes.wall), along(2 * joint.radius), end.seat)


def _pulley_dimensions(joint: PulleyJoint, end: End, sizes: Sizes) -> tuple[Dimension, ...]:
    y = -joint.outside
    return (
        *groove_dimensions("rope", joint.radius, joint.bottom_radius, y, end.key),
        Dimension("rim", (-joint.rim, y, 0), (joint.rim, y, 0), "front", 1, "Ø"),
        *far_dimensions(end, sizes, -joint.depth - end.far_collar),
        Dimension("width of the pulley", (0, -joint.half, 0), (0, joint.half, 0), "side", 1),
        Dimension("over the cheeks", (0, -joint.outside, 0), (0, joint.outside, 0), "side", 1),
        Dimension("grooves apart", (0, -joint.shift, 0), (0, joint.shift, 0), "side", 1),
    )


def _fork_dimensions(joint: PulleyJoint, end: End, sizes: Sizes) -> tuple[Dimension, ...]:
    inner, bore = joint.outside + joint.play, (joint.pin + sizes.bore) / 2
    low = -joint.depth if end.tip else 0.0
    return (
        Dimension(
            "tunnels apart",
            (-joint.radius, -inner, low),
            (joint.radius, -inner, low),
            "front",
            1,
            key=end.key,
            factor=2,
        ),
        Dimension("axis to collar", (0, -inner, 0), (0, -inner, -joint.depth), "front", -1, along="y"),
        *tube_dimensions(end, sizes),
        Dimension("between the arms", (0, -inner, 0), (0, inner, 0), "side", 1),
        Dimension("over the arms", (0, -inner - joint.fork, 0), (0, inner + joint.fork, 0), "side", 1),
        Dimension("pin's bore", (-bore, -inner, 0), (bore, -inner, 0), "front", 1, "Ø"),
    )
