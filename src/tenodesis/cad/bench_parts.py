"""Parts beyond the joints: stem, end-effector, grip, spools and mounts, and the load rig of Fig. 13."""

import math
from itertools import pairwise
from typing import NamedTuple

from tenodesis.cad import kernel as k
from tenodesis.cad.kernel import FLIP, Solid
from tenodesis.cad.parts import STEEPEST, Dimension, End, Part, Sizes, bought, groove_dimensions, pin, spigot

TIP_PIN = 3.0
"""Diameter of the pin at the tip that the load rig pushes, mm."""
_MOUNT = 4.0  # mm, thickness of brackets
_SCREW = 3.4  # mm, clearance for M3, ISO 273 medium


class Hardware(NamedTuple):
    """What is bought and only bolted on, m; the defaults are ours: replace them by those of what you order."""

    motor_bolts: float = 31e-3
    """Side of the square of the motor's four M3 bolts (NEMA ICS 16, size 17)."""
    motor_boss: float = 22e-3
    """Diameter of the motor's centring boss."""
    motor_shaft: float = 5e-3
    motor_length: float = 40e-3
    load_cell: float = 20e-3
    """Outer diameter of a ring-shaped load cell that a sheath presses on."""
    sheath: float = 2.2e-3
    """Outer diameter of the sheaths that lead the tendons to the motors."""
    bearing_bore: float = 3e-3
    bearing: float = 10e-3
    """Outer diameter of the load rig's bearings (623)."""
    bearing_width: float = 4e-3


def stem_part(end: End, behind: float) -> Part:
    """Return the stem's tube; what is fixed to its other end takes a length of it."""
    low, high = -end.stem_length + behind, -end.near_length
    outer, bore = end.stem_radius, end.stem_bore
    tube = k.rod((0, 0, low), (0, 0, high), outer) - k.rod((0, 0, low), (0, 0, high), bore)
    return bought(
        "stem",
        f"Stem: tube {2 * outer:.4g} x {outer - bore:.3g}",
        tube,
        "stem",
        (k.at(),),
        dimensions=(
            Dimension("outer diameter", (-outer, 0, high), (outer, 0, high), "top", 1, "Ø", "stem_diameter"),
            Dimension("bore", (-bore, 0, high), (bore, 0, high), "top", 1, "Ø"),
            Dimension("length", (0, -outer, low), (0, -outer, high), "side", -1, key="overall_length", along="y"),
        ),
    )


def base_length(end: End) -> float:
    """Return how much of the stem the base of an instrument without a handle takes."""
    return end.stem_radius


def base_part(end: End, sizes: Sizes) -> Part:
    """Return the base that holds the stem of an instrument without a handle, and the ends of its tendons' sheaths.

    Behind the stem's spigot the tendons spread at 20° to a circle on which their sheaths have room.
    """
    ways = sorted((low for _, low in end.stem_ways), key=lambda place: math.atan2(place[1], place[0]))
    apart = 2 * (end.seat + sizes.wall)
    radius = max(apart * len(ways) / (2 * math.pi) * 1.2, 1.5 * end.stem_radius)
    # The circle begins where its places are nearest to those in the stem.
    step = 2 * math.pi / len(ways)
    begin = math.atan2(
        sum(math.sin(math.atan2(y, x) - step * number) for number, (x, y) in enumerate(ways)),
        sum(math.cos(math.atan2(y, x) - step * number) for number, (x, y) in enumerate(ways)),
    )
    outer = [(radius * math.cos(begin + step * n), radius * math.sin(begin + step * n)) for n in range(len(ways))]
    slant = max(math.dist(one, other) for one, other in zip(ways, outer, strict=True)) / math.tan(STEEPEST)
    high = -end.stem_length + base_length(end)
    knee = high - end.stem_radius
    low = knee - slant
    deep = 2 * end.seat
    wide = radius + end.seat + sizes.wall
    body = k.rod((0, 0, low - 2 * deep), (0, 0, high), wide)
    for (x, y), (x_out, y_out) in zip(ways, outer, strict=True):
        points = [(x, y, high), (x, y, knee), (x_out, y_out, low), (x_out, y_out, low - 2 * deep)]
        for number, (one, other) in enumerate(pairwise(points)):
            body -= k.rod(one, other, sizes.tunnel / 2)
            if number:
                body -= k.kernel().Pos(*one) * k.kernel().Sphere(sizes.tunnel / 2)
        body -= k.rod((x_out, y_out, low - 2 * deep), (x_out, y_out, low - deep), end.seat)
    body += k.at(z=high, turn=FLIP) * spigot(end, sizes, 0.0)
    place = end.place()
    return Part(
        "stem_base",
        "Base of the stem",
        body,
        "stem",
        (place,),
        dimensions=(
            Dimension("diameter", (-wide, 0, low), (wide, 0, low), "top", 1, "Ø"),
            Dimension.height("length", low - 2 * deep, high, 1),
            Dimension("sheaths' circle", (-radius, 0, low), (radius, 0, low), "top", -1, "Ø"),
        ),
        notes=(f"Tunnels Ø{sizes.tunnel:.3g} for a rope of {sizes.rope:.3g} mm, in order about the axis.",),
        away=(0, 0, -40),
    )


def end_effector_part(end: End, sizes: Sizes, length: float, start: float, turn: float) -> Part:
    """Return the end-effector of the bench: a rod with an eye where the force acts; `start` is its socket's bottom.

    The eye's axis is across the plane that the load rig moves in, whose turn about the stem is given, deg.
    """
    eye = TIP_PIN / 2 + max(2 * sizes.wall, 1.5)
    thick = max(end.rod / 2, eye / 2)
    body = k.rod((0, 0, start), (0, 0, length - eye / 2), end.rod / 2)
    body += k.rod((0, -thick, length), (0, thick, length), eye)
    body -= k.rod((0, -thick - 1, length), (0, thick + 1, length), TIP_PIN / 2)
    return Part(
        "end_effector",
        "End-effector of the bench",
        body,
        end.far,
        (k.at(turn=(0, 0, turn)),),
        dimensions=(
            Dimension.height("joint's far axis to the force", 0, length, -1, key="end_effector_length"),
            Dimension.height("axis to foot", 0, start, 1),
            Dimension("rod", (-end.rod / 2, 0, start), (end.rod / 2, 0, start), "front", -1, "Ø"),
            Dimension("eye", (-TIP_PIN / 2, 0, length), (TIP_PIN / 2, 0, length), "front", 1, "Ø"),
        ),
        notes=("Glued into its socket, then the length to the force is checked.",),
        away=(0, 0, 4 * start + 20),
    )


def tip_pin_part(end: End, length: float, low: float, turn: float) -> Part:
    """Return the pin at the tip, that reaches down into the load rig's bar."""
    rod = k.rod((0, low, length), (0, 3.0, length), TIP_PIN / 2)
    return pin("tip_force_pin", TIP_PIN, 3.0 - low, rod, end.far, (k.at(turn=(0, 0, turn)),), (0, 20, 60))


def grip_part(end: End, sizes: Sizes, length: float, start: float) -> Part:
    """Return the grip: a shaft in the far body's socket, thicker about where the hand acts."""
    radius = max(min(14.0, 0.14 * length), end.rod / 2 + 2)
    top, bottom = min(start + 0.35 * (length - start), length - radius), 1.25 * length
    body = k.rod((0, 0, -top), (0, 0, -start), end.rod / 2)
    body += k.rod((0, 0, -bottom), (0, 0, -top), radius)
    b = k.kernel()
    edges = [edge for edge in body.edges().filter_by(b.GeomType.CIRCLE) if abs(edge.radius - radius) < 1e-6]
    body = b.fillet(edges, 0.3 * radius)
    return Part(
        "grip",
        "Grip",
        body,
        end.far,
        (k.at(),),
        dimensions=(
            Dimension.height("joint's far axis to the hand", 0, -length, -1, key="handle_length"),
            Dimension("grip", (-radius, 0, -bottom), (radius, 0, -bottom), "front", -1, "Ø"),
            Dimension("shaft", (-end.rod / 2, 0, -start), (end.rod / 2, 0, -start), "front", 1, "Ø"),
            Dimension.height("length", -start, -bottom, 1),
        ),
        away=(0, 0, -4 * start - 40),
    )


def drive_parts(sizes: Sizes, hardware: Hardware, spool: float, start: float, count: int) -> list[Part]:
    """Return spools, motor mounts and load-cell mounts of so many tendons; they stand from z = start downward.

    Each rope comes out of its sheath, which presses on a ring of a load cell, and goes on its spool.
    """
    rope, groove = sizes.rope, sizes.groove
    bottom = spool - rope / 2
    rim, half = spool + 2 * rope + sizes.wall, 2 * groove + 2 * sizes.wall
    boss = 1e3 * hardware.motor_boss
    bolts, plate = 1e3 * hardware.motor_bolts, 1e3 * hardware.motor_bolts + 12
    height = 1e3 * hardware.motor_length + 10
    # On a spool too small for the motor's shaft, a thinner one.
    shaft = (min(1e3 * hardware.motor_shaft, math.floor(2 * (bottom - sizes.wall) - sizes.bore)) + sizes.bore) / 2
    body = k.rod((0, -half, 0), (0, half, 0), rim)
    body = k.grooved(body, bottom, 0.0, groove, rim + 1)
    body -= k.rod((0, -half - 1, 0), (0, half + 1, 0), shaft)
    anchor = bottom + sizes.tunnel / 2
    body -= k.rod((anchor, 0, 0), (anchor, half + 1, 0), sizes.tunnel / 2)
    apart, level = plate + 30, half + _MOUNT + 1
    columns = [apart * ((count - 1) / 2 - number) for number in range(count)]
    lead = start - plate / 2 - 60
    mount = _motor_mount(plate, height, boss + 2 * sizes.bore, bolts)
    cell_seat, cell_height = (1e3 * hardware.load_cell + sizes.bore) / 2, level + height
    passage = rope + 1.0
    cell_mount = _cell_mount(2 * cell_seat, cell_height, passage)
    return [
        Part(
            "spool",
            "Spool",
            body,
            "bench",
            tuple(k.at(x, 0, lead) for x in columns),
            dimensions=(
                *groove_dimensions("rope", spool, bottom, -half, "drives.spool_radius"),
                Dimension("rim", (-rim, -half, 0), (rim, -half, 0), "front", -1, "Ø"),
                Dimension("shaft's bore", (-shaft, -half, 0), (shaft, -half, 0), "front", -1, "Ø"),
                Dimension("width", (0, -half, 0), (0, half, 0), "side", 1),
            ),
            notes=(
                f"For a rope of {rope:.3g} mm; groove's bottom rounded with {groove:.3g} mm; the rope's end goes "
                "through the hole and is knotted.",
            ),
            away=(0, 25, 0),
        ),
        Part(
            "motor_mount",
            "Mount of a motor",
            mount,
            "bench",
            tuple(k.at(x, -level, lead) for x in columns),
            dimensions=(
                Dimension("bolts", (-bolts / 2, 0, 0), (bolts / 2, 0, 0), "front", 1),
                Dimension("boss", (-boss / 2, 0, 0), (boss / 2, 0, 0), "front", 1, "Ø"),
                Dimension("side", (-plate / 2, 0, 0), (plate / 2, 0, 0), "front", -1),
                Dimension("height", (0, 0, 0), (0, -height, 0), "side", -1),
            ),
            notes=(f"Bores Ø{_SCREW:g} for M3.",),
        ),
        Part(
            "load_cell_mount",
            "Mount of a load cell",
            cell_mount,
            "bench",
            tuple(k.at(x + spool, 0, lead + plate / 2 + 30) for x in columns),
            dimensions=(
                Dimension("seat of the cell", (-cell_seat, 0, 0), (cell_seat, 0, 0), "top", 1, "Ø"),
                Dimension("rope above the base", (0, -cell_height, 0), (0, 0, 0), "side", 1),
                Dimension("rope's passage", (-passage / 2, 0, 0), (passage / 2, 0, 0), "top", 1, "Ø"),
            ),
            notes=("The rope passes without touching; the sheath ends on the cell.",),
        ),
    ]


def _motor_mount(plate: float, height: float, boss: float, bolts: float) -> Solid:
    """Return a table under whose top, at y = 0 and below, a motor hangs; its shaft is y."""
    half = plate / 2
    body = k.box((-half, half), (-_MOUNT, 0), (-half, half))
    for x in (-half, half - _MOUNT):
        body += k.box((x, x + _MOUNT), (-height, 0), (-half, half))
        out = (x - 12, x + _MOUNT) if x < 0 else (x, x + _MOUNT + 12)
        body += k.box(out, (-height, -height + _MOUNT), (-half, half))
        middle = x - 6 if x < 0 else x + _MOUNT + 6
        for z in (-half / 2, half / 2):
            body -= k.rod((middle, -height - 1, z), (middle, -height + _MOUNT + 1, z), _SCREW / 2)
    body -= k.rod((0, -_MOUNT - 1, 0), (0, 1, 0), boss / 2)
    for x in (-bolts / 2, bolts / 2):
        for z in (-bolts / 2, bolts / 2):
            body -= k.rod((x, -_MOUNT - 1, z), (x, 1, z), _SCREW / 2)
    return body


def _cell_mount(cell: float, height: float, passage: float) -> Solid:
    """Return an angle whose upright plate holds a ring-shaped cell about the rope, which is z."""
    half = cell / 2 + 4
    body = k.box((-half, half), (-height, cell / 2 + 4), (-_MOUNT - 2, 0))
    body += k.box((-half, half), (-height, -height + _MOUNT), (-30, 0))
    for x in (-half + 2, half - 2 - _MOUNT / 2):
        body += k.bar([(x, -20), (x, 0), (x + 2, 0), (x + 2, -20)], -height, -height + 16)
    body -= k.rod((0, 0, -2), (0, 0, 1), cell / 2)
    body -= k.rod((0, 0, -_MOUNT - 3), (0, 0, 1), passage / 2)
    for x in (-half / 2, half / 2):
        body -= k.rod((x, -height - 1, -24), (x, -height + _MOUNT + 1, -24), _SCREW / 2)
    return body


CABLE = 1.0
"""Diameter of a weight's cable, mm."""
_BAR = 4.0  # mm
_BASE = 6.0  # mm
_GUIDE = 10.0  # mm, radius of the guide pulleys to the cable's centre


class Rig(NamedTuple):
    """Where the load rig stands, mm, in the frame of the stem."""

    pivot: float
    """Height of its axis along the stem."""
    cable_radius: float
    """Radius of its pulley to the cable's centre."""
    nearest: float
    """Least distance of the tip from the axis over the working range."""
    furthest: float
    level: float
    """Of the top of the slotted bar, below the plane of the joint."""
    turn: float = 0.0
    """Of its plane about the stem, deg."""
    others: tuple[float, ...] = ()
    """Heights along the stem of the axes about which the other joints of the tip are loaded."""

    @property
    def pulley_half(self) -> float:
        """Half the width of the pulley."""
        return 4.0 + 2 * 0.525 * CABLE

    @property
    def pulley_level(self) -> float:
        """Of the pulley's middle."""
        return -self.level - _BAR - self.pulley_half

    @property
    def base_level(self) -> float:
        """Of the top of the base."""
        return self.pulley_level - self.pulley_half - 3.0


def rig_parts(rig: Rig, sizes: Sizes, hardware: Hardware, stem: float) -> list[Part]:
    """Return the parts of the load rig; the bar turns with the pulley, body "rig_bar", toward the tip."""
    groove = 0.525 * CABLE
    bottom = rig.cable_radius - CABLE / 2
    half, rim = rig.pulley_half, rig.cable_radius + 1.5 * CABLE
    levels = (half / 2, -half / 2)
    seat = (1e3 * hardware.bearing + sizes.bore) / 2
    pulley = k.rod((0, -half, 0), (0, half, 0), rim)
    for y in levels:
        pulley = k.grooved(pulley, bottom, y, groove, rim + 1)
    pulley -= k.rod((0, -half - 1, 0), (0, half + 1, 0), seat - 1.0)
    for y in (-half, half - 1e3 * hardware.bearing_width):
        pulley -= k.rod((0, y, 0), (0, y + 1e3 * hardware.bearing_width, 0), seat)
    screws = 0.5 * (seat + bottom)
    for x in (-screws, screws):
        pulley -= k.rod((x, -half - 1, 0), (x, half + 1, 0), 1.25)
    back = min(_clamps(rig)) - 20.0
    level = rig.base_level
    return [
        Part(
            "rig_pulley",
            "Pulley of the load rig",
            pulley,
            "rig_bar",
            (k.at(0, rig.pulley_level),),
            dimensions=(
                *groove_dimensions("cable", rig.cable_radius, bottom, -half, "conditions.cable_pulley_radius"),
                Dimension("rim", (-rim, -half, 0), (rim, -half, 0), "front", -1, "Ø"),
                Dimension("bearing's seat", (-seat, -half, 0), (seat, -half, 0), "front", -1, "Ø"),
                Dimension("grooves apart", (0, levels[1], 0), (0, levels[0], 0), "side", 1),
                Dimension("width", (0, -half, 0), (0, half, 0), "side", 1),
            ),
            notes=(f"For cables of {CABLE:g} mm; each is knotted through a hole drilled at its groove.",),
            away=(0, -25, 0),
        ),
        _bar(rig, sizes, screws, seat),
        Part(
            "rig_base",
            "Base of the load rig",
            _base(rig, stem, back),
            "bench",
            (k.at(),),
            dimensions=(
                Dimension.height("length", back, rig.pivot + 25, -1),
                Dimension.height("axis to back", back, rig.pivot, 1),
                Dimension("width", (-_width(rig), 0, back), (_width(rig), 0, back), "front", -1),
            ),
            away=(0, -70, 0),
        ),
        _clamp(rig, sizes, stem),
        _guide(rig, sizes, hardware, back, level),
        _bracket(rig, hardware, back, level),
        bought(
            "rig_axle",
            "Screw ISO 4762 M3 as axle",
            k.rod((0, level - _BASE, 0), (0, rig.pulley_level + half, 0), 1.5),
            "bench",
            (k.at(0, 0, rig.pivot),),
            away=(0, -25, 0),
        ),
    ]


def _bar(rig: Rig, sizes: Sizes, screws: float, seat: float) -> Part:
    end = rig.furthest + TIP_PIN / 2 + 6
    wide, slot = 6.0, TIP_PIN / 2 + sizes.play
    body = k.box((-wide, wide), (0, _BAR), (0, end)) + k.rod((0, 0, 0), (0, _BAR, 0), max(screws + 3, 6.0))
    body += k.rod((0, 0, end), (0, _BAR, end), wide)
    low, high = rig.nearest - 2, rig.furthest + 2
    body -= k.box((-slot, slot), (-1, _BAR + 1), (low, high))
    for z in (low, high):
        body -= k.rod((0, -1, z), (0, _BAR + 1, z), slot)
    body -= k.rod((0, -1, 0), (0, _BAR + 1, 0), seat - 1.0)
    for x in (-screws, screws):
        body -= k.rod((x, -1, 0), (x, _BAR + 1, 0), _SCREW / 2)
    return Part(
        "rig_bar",
        "Slotted bar of the load rig",
        body,
        "rig_bar",
        (k.at(0, -rig.level - _BAR),),
        dimensions=(
            Dimension.height("axis to end of slot", 0, high, -1),
            Dimension.height("axis to begin of slot", 0, low, 1),
            Dimension("slot", (-slot, 0, high), (slot, 0, high), "front", 1),
            Dimension("screws", (-screws, 0, 0), (screws, 0, 0), "front", -1),
            Dimension("thickness", (0, 0, 0), (0, _BAR, 0), "side", 1),
        ),
        notes=("Slot polished: it transmits the tangential force only.",),
        away=(0, -12, 0),
    )


def _width(rig: Rig) -> float:
    return max(rig.cable_radius + 12, 30.0)


def _base(rig: Rig, stem: float, back: float) -> k.Solid:
    half, top = _width(rig), rig.base_level
    body = k.box((-half, half), (top - _BASE, top), (back, rig.pivot + 25))
    body += k.rod((0, top, rig.pivot), (0, rig.pulley_level - rig.pulley_half, rig.pivot), 3.5)
    body -= k.rod((0, top - _BASE - 1, rig.pivot), (0, 0, rig.pivot), 1.5)
    for z in _clamps(rig):
        for x in (-stem - 8, stem + 8):
            body -= k.rod((x, top - _BASE - 1, z), (x, top + 1, z), _SCREW / 2)
    return body


def _clamps(rig: Rig) -> tuple[float, float]:
    """Return the middles of the clamps along the stem, behind the rig's pulley and behind the stem's distal end."""
    near = min(rig.pivot - 70.0, -20.0)
    return (near - 90.0, near)


def _clamp(rig: Rig, sizes: Sizes, stem: float) -> Part:
    high, half = -rig.base_level, 6.0
    wide = stem + 4
    body = k.box((-wide, wide), (-high, stem + 4), (-half, half))
    body += k.box((-stem - 14, stem + 14), (-high, -high + 5), (-half, half))
    body -= k.rod((0, 0, -half - 1), (0, 0, half + 1), stem + sizes.bore / 2)
    body -= k.box((-0.75, 0.75), (0, stem + 5), (-half - 1, half + 1))
    for x in (-stem - 8, stem + 8):
        body -= k.rod((x, -high - 1, 0), (x, -high + 6, 0), _SCREW / 2)
    body -= k.rod((-wide - 1, stem + 2, 0), (wide + 1, stem + 2, 0), 0.8)
    return Part(
        "rig_clamp",
        "Clamp of the stem",
        body,
        "bench",
        tuple(k.at(0, 0, z) for z in _clamps(rig)),
        dimensions=(
            Dimension("bore", (-stem, 0, 0), (stem, 0, 0), "top", 1, "Ø", "stem_diameter"),
            Dimension("axis above the base", (0, -high, 0), (0, 0, 0), "top", -1, along="y"),
            Dimension("screws", (-stem - 8, -high, 0), (stem + 8, -high, 0), "top", -1),
            Dimension("thickness", (0, 0, -half), (0, 0, half), "side", 1, along="y"),
        ),
        away=(0, -45, 0),
    )


def _guide(rig: Rig, sizes: Sizes, hardware: Hardware, back: float, level: float) -> Part:
    groove, half, rim = 0.525 * CABLE, 3.0, _GUIDE + 1.5 * CABLE
    bore = (1e3 * hardware.bearing_bore + sizes.bore) / 2
    bottom = _GUIDE - CABLE / 2
    body = k.grooved(k.rod((0, -half, 0), (0, half, 0), rim), bottom, 0.0, groove, rim + 1)
    body -= k.rod((0, -half - 1, 0), (0, half + 1, 0), bore)
    return Part(
        "rig_guide",
        "Guide pulley of a weight's cable",
        body,
        "bench",
        tuple(k.at(x, y, z, (0, 0, 90)) for x, y, z in _guides(rig, back)),
        dimensions=(
            *groove_dimensions("cable", _GUIDE, bottom, -half),
            Dimension("bore", (-bore, -half, 0), (bore, -half, 0), "front", -1, "Ø"),
            Dimension("width", (0, -half, 0), (0, half, 0), "side", 1),
        ),
        away=(0, 0, -30),
    )


def _guides(rig: Rig, back: float) -> list[tuple[float, float, float]]:
    """Return the centres of the guide pulleys: their cables are as high as the pulley's grooves."""
    shift = rig.pulley_half / 2
    return [(side * rig.cable_radius, rig.pulley_level + side * shift - _GUIDE, back - _GUIDE - 6) for side in (1, -1)]


def _bracket(rig: Rig, hardware: Hardware, back: float, level: float) -> Part:
    reach, low = _GUIDE + 6.0, level - _BASE
    places = _guides(rig, back)
    body = k.box((-9, 9), (low - 12, low), (0, 30))
    for x in (-8.0, 4.0):
        body += k.box((x, x + 4), (low - 12, places[0][1] + 5), (-reach - 5, 0))
        body += k.box((x, x + 4), (low - 12, low), (-1, 12))
        for _, y, _ in places:
            body -= k.rod((x - 1, y, -reach), (x + 5, y, -reach), (1e3 * hardware.bearing_bore + 0.2) / 2)
    for z in (8.0, 22.0):
        body -= k.rod((0, low - 13, z), (0, low + 1, z), _SCREW / 2)
    return Part(
        "rig_bracket",
        "Bracket of a guide pulley",
        body,
        "bench",
        tuple(k.at(x, 0, back) for x, _, _ in places),
        dimensions=(
            Dimension("axle from the edge", (0, 0, -reach), (0, 0, 0), "side", 1, along="y"),
            Dimension("between the cheeks", (-4, 0, -reach), (4, 0, -reach), "front", -1),
        ),
        notes=("Two bores for the axle: each bracket uses that of its cable's height.",),
        away=(0, -20, -30),
    )
