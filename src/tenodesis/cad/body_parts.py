"""Parts between and beyond the joints: stem, end-effector, grip, spools, and the mounts of motors and load cells."""

from typing import NamedTuple

from tenodesis.cad import kernel as k
from tenodesis.cad.kernel import Solid
from tenodesis.cad.parts import Dimension, End, Part, Sizes, bought, groove_dimensions, pin

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


def stem_part(end: End, other: End) -> Part:
    """Return the stem's tube."""
    low, high = -end.stem_length + other.near_length, -end.near_length
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


def end_effector_part(end: End, sizes: Sizes, length: float, start: float) -> Part:
    """Return the end-effector of the bench: a rod with an eye where the force acts; `start` is its socket's bottom."""
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
        (k.at(),),
        dimensions=(
            Dimension(
                "joint's far axis to the force",
                (0, 0, 0),
                (0, 0, length),
                "front",
                -1,
                key="end_effector_length",
                along="y",
            ),
            Dimension("axis to foot", (0, 0, 0), (0, 0, start), "front", 1, along="y"),
            Dimension("rod", (-end.rod / 2, 0, start), (end.rod / 2, 0, start), "front", -1, "Ø"),
            Dimension("eye", (-TIP_PIN / 2, 0, length), (TIP_PIN / 2, 0, length), "front", 1, "Ø"),
        ),
        notes=("Glued into its socket, then the length to the force is checked.",),
        away=(0, 0, 4 * start + 20),
    )


def tip_pin_part(end: End, length: float, low: float) -> Part:
    """Return the pin at the tip, that reaches down into the load rig's bar."""
    rod = k.rod((0, low, length), (0, 3.0, length), TIP_PIN / 2)
    return pin("tip_force_pin", TIP_PIN, 3.0 - low, rod, end.far, (k.at(),), (0, 20, 60))


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
            Dimension(
                "joint's far axis to the hand", (0, 0, 0), (0, 0, -length), "front", -1, key="handle_length", along="y"
            ),
            Dimension("grip", (-radius, 0, -bottom), (radius, 0, -bottom), "front", -1, "Ø"),
            Dimension("shaft", (-end.rod / 2, 0, -start), (end.rod / 2, 0, -start), "front", 1, "Ø"),
            Dimension("length", (0, 0, -start), (0, 0, -bottom), "front", 1, along="y"),
        ),
        away=(0, 0, -4 * start - 40),
    )


def drive_parts(sizes: Sizes, hardware: Hardware, spool: float, start: float) -> list[Part]:
    """Return spools, motor mounts and load-cell mounts of both tendons; they stand from z = start downward.

    Each rope comes out of its sheath, which presses on a ring of a load cell, and goes on its spool.
    """
    rope, groove = sizes.rope, sizes.groove
    bottom = spool - rope / 2
    rim, half = spool + 2 * rope + sizes.wall, 2 * groove + 2 * sizes.wall
    boss = 1e3 * hardware.motor_boss
    bolts, plate = 1e3 * hardware.motor_bolts, 1e3 * hardware.motor_bolts + 12
    height = 1e3 * hardware.motor_length + 10
    shaft = (1e3 * hardware.motor_shaft + sizes.bore) / 2
    body = k.rod((0, -half, 0), (0, half, 0), rim)
    body = k.grooved(body, bottom, 0.0, groove, rim + 1)
    body -= k.rod((0, -half - 1, 0), (0, half + 1, 0), shaft)
    anchor = bottom + sizes.tunnel / 2
    body -= k.rod((anchor, 0, 0), (anchor, half + 1, 0), sizes.tunnel / 2)
    apart, level = plate + 30, half + _MOUNT + 1
    columns = (apart / 2, -apart / 2)
    lead = start - plate / 2 - 60
    mount = _motor_mount(plate, height, boss + 2 * sizes.bore, bolts)
    cell, cell_height = 1e3 * hardware.load_cell, level + height
    passage = rope + 1.0
    cell_mount = _cell_mount(cell + sizes.bore, cell_height, passage)
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
                Dimension(
                    "seat of the cell",
                    (-cell / 2 - sizes.bore / 2, 0, 0),
                    (cell / 2 + sizes.bore / 2, 0, 0),
                    "top",
                    1,
                    "Ø",
                ),
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
