"""The tables of a workshop plan that say what to take, make, set and hang, and what that tells."""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tenodesis import statics
from tenodesis.report.content import fixed
from tenodesis.scaling.plan_text import factor, in_unit_of, masses, more, off, plain, signed, told
from tenodesis.similarity import Comparison

if TYPE_CHECKING:
    from tenodesis.scaling.design import Design, TestLoad

_FACTORS = (
    ("length", "distal radius"),
    ("force", "force at the tip"),
    ("tension", "tendon tension"),
    ("torque", "moment at the distal joint"),
    ("handle_torque", "moment at the handle"),
    ("motor_stroke", "tendon stroke of the motors"),
    ("spool_angle", "spool angle"),
    ("spool_velocity", "spool speed"),
    ("time", "time (swing of the tip)"),
)
_MOST_KINDS = 12
"""Different weights that the parts list names."""


class Limits(NamedTuple):
    """How many lines a page has room for; what is left out is said."""

    loads: int = 100
    pieces: int = 100
    """Different weights named per cable."""
    groups: int = 100
    warnings: int = 100
    drawings: int = 3


@dataclass(frozen=True)
class Table:
    """Rows of text under their headings; the first `texts` columns are words, the others numbers."""

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    texts: int = 1
    note: str = ""
    left_out: str = ""


def parts(design: "Design") -> Table:
    """Return what to take, and how many of it."""
    return Table("Parts", ("no.", "part", "take", "which is"), tuple(_part_rows(design)), texts=4)


def _part_rows(design: "Design") -> Iterator[tuple[str, ...]]:
    choice, inst = design.choice, design.scaled_up
    axes = len(inst.axes)
    yield from _wheel_rows(design)
    rope = choice.rope
    yield (
        str(2 * axes),
        "rope for tendons",
        rope.name,
        f"⌀ {told(rope.diameter, 'mm', 3, 'm')}, E = {told(rope.modulus, 'GPa', 3, 'Pa')}; breaks at "
        f"{told(rope.breaking_load, 'N', 4)}, largest tension {told(design.largest_tension, 'N', 3)}",
    )
    if choice.rod is not None:
        yield (
            str(axes),
            "rod for a backbone",
            f"{choice.rod.name}, ⌀ {told(choice.rod.diameter, 'mm', 3, 'm')}",
            f"EI = {told(choice.rod.rigidity, 'N*mm^2', 4, 'N*m^2')}",
        )
    cell = choice.load_cell
    yield (
        str(2 * axes),
        "load cells",
        cell.name,
        f"range {told(cell.range, 'N', 4)}, resolution {told(cell.resolution, 'N', 2)}",
    )
    encoder = choice.encoder
    if encoder is None:
        distal = told(choice.distal.radius, "mm", 4, "m")
        yield "–", "encoder at the tip", "none of the catalogue", f"fits a distal radius of {distal}"
    else:
        yield (
            str(axes),
            "encoder at the tip",
            encoder.name,
            f"{encoder.bits} bit over {plain(math.degrees(encoder.range))}°, noise "
            f"{plain(math.degrees(encoder.noise), 2)}°; fits from a distal radius of "
            f"{told(encoder.least_distal_radius, 'mm', 4, 'm')}",
        )
    if choice.spool is not None:
        torque = told(design.largest_tension * choice.spool.radius, "N*m", 3)
        radius = told(choice.spool.radius, "mm", 4, "m")
        yield str(2 * axes), "spools", f"radius {radius}", f"one motor each, {torque} at the largest tension"
    if design.tests:
        needed = Counter[float]()
        for test in design.tests:
            needed |= Counter((*test.hanging.loading, *test.hanging.counter))
        yield (
            str(needed.total()),
            "weights",
            masses(needed.elements(), _MOST_KINDS),
            "enough for each test load in turn",
        )


def _wheel_rows(design: "Design") -> Iterator[tuple[str, ...]]:
    choice, inst = design.choice, design.scaled_up
    for end, wheel in (("distal", choice.distal), ("proximal", choice.proximal)):
        radius = told(wheel.radius, "mm", 5, "m")
        if wheel.module is not None:
            take = f"module {told(wheel.module, 'mm', 4, 'm')}, {wheel.teeth} teeth"
            # Two gears roll on each other in every joint.
            yield str(2 * len(inst.axes)), f"{end} gears", take, f"pitch radius {radius}"
        elif inst.joint_type == "continuum" and end == "distal":
            yield "", "discs on the backbone", "to size", f"tendons {radius} from the backbone"
        else:
            yield str(len(inst.axes)), f"{end} pulley", f"radius {radius}", "where the tendon runs"


def lengths(design: "Design") -> Table:
    """Return the lengths to make and to mount the load rig at."""
    inst = design.scaled_up
    rows = [
        ("overall length L", inst.overall_length),
        ("tendon length", inst.tendon_length),
        ("stem diameter", inst.stem_diameter),
        ("backbone length", getattr(inst, "backbone_length", None)),
        ("distal joint to tip l_d", inst.end_effector_length),
        ("proximal joint to hand l_p", inst.handle_length),
        ("load rig: pulley of the cables", design.catalogue.constraints.cable_pulley_radius),
        ("load rig: pivot to straight tip", inst.rig_arm),
    ]
    return Table(
        "Lengths to make",
        ("", "mm"),
        tuple((name, in_unit_of("mm", value, 5)) for name, value in rows if value is not None),
    )


def loads(design: "Design", limits: Limits) -> Table:
    """Return what to hang for every test load."""
    rows = [_load(design, test, limits.pieces) for test in design.tests]
    return Table(
        "Test loads, and what to hang for them on the two cables of the load rig",
        ("loading cable", "counter cable", "real-size [N]", "tip [N]", "cables [N]", "off [%]", "off [N]", "lost [°]"),
        tuple(rows[: limits.loads]),
        texts=2,
        note="off: what hangs minus what is wanted, in N on the real-size tip, ± the tolerances of what hangs; lost: "
        "output angle that the load takes with the handle straight, real-size | scaled-up",
        left_out="; ".join(more(len(rows) - limits.loads, "further test load")),
    )


def _load(design: "Design", test: "TestLoad", pieces: int) -> tuple[str, ...]:
    lost = (
        -np.degrees(statics.output_angle(inst, np.zeros(1), force)[0])
        for inst, force in ((design.real_size, test.real_force), (design.scaled_up, test.force))
    )
    lever = (
        design.catalogue.constraints.cable_pulley_radius / design.scaled_up.rig_arm / design.comparison.force_factor()
    )
    return (
        masses(test.hanging.loading, pieces),
        masses(test.hanging.counter, pieces),
        plain(test.real_force, 3),
        fixed(test.force, 3),
        fixed(test.hanging.wanted, 2),
        signed(100 * test.error / test.real_force, 2),
        off(test.error, test.hanging.tolerance * lever),
        " | ".join(fixed(angle, 2) for angle in lost),
    )


def pretension(design: "Design") -> Table:
    """Return the pretension to set and where slack begins, of both instruments."""
    pair = (design.real_size, design.scaled_up)
    rows = [("pretension of either tendon [N]", [inst.pretension for inst in pair])]
    for name, angle in (("tip straight", 0.0), ("tip fully bent", design.real_size.output_range)):
        rows.append((f"slack from, {name} [N]", [float(statics.slack_force(inst, angle)) for inst in pair]))
    return Table(
        "Pretension to set",
        ("", "real-size", "scaled-up", "factor"),
        tuple(
            (name, *(plain(value, 3) for value in values), fixed(values[1] / values[0], 3) if values[0] else "–")
            for name, values in rows
        ),
    )


def factors(comparison: Comparison) -> Table:
    """Return the scale factors."""
    factors = comparison.factors
    rows = [(name, factor(factors[key])) for key, name in _FACTORS if key in factors]
    return Table("Factors, scaled-up over real-size", ("", "factor"), (*rows, ("angles", "1")))


def resolution(design: "Design") -> Table:
    """Return what sensors and weights can tell, in units of the real-size instrument."""
    step = math.degrees(design.choice.encoder.range) / 2**design.choice.encoder.bits if design.choice.encoder else None
    rows = [
        ("output angle, by the encoder", "–" if step is None else f"{plain(design.angle_resolution, 2)}°"),
        ("tendon tension, by a load cell", told(design.tension_resolution, "N", 2)),
        ("force at the tip, by the load cells", told(design.force_resolution, "N", 2)),
        ("the same, and hung by weights", told(design.objectives.force_resolution, "N", 2)),
    ]
    return Table("What can be told, real-size", ("", "smallest"), tuple(rows))
