"""The tables of a workshop plan: parts, lengths, weights, pretension, scale factors and similarity."""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tenodesis import statics
from tenodesis.report.content import fixed
from tenodesis.scaling.plan_text import (
    NO_ERROR,
    SPACE,
    angle,
    converted,
    masses,
    plain,
    quantity,
    signed,
    symbols,
    with_tolerance,
)
from tenodesis.similarity import GRID, Comparison, Group, SimilarityError

if TYPE_CHECKING:
    from tenodesis.scaling.scale_model import Design, TestLoad

SNAPPED = "a snapped tip at its stop"
"""How a tip that snaps through counts in a design's objectives."""

_FACTORS = {
    "length": "distal radius",
    "force": "force at the tip",
    "tension": "tendon tension",
    "torque": "moment at the distal joint",
    "handle_torque": "moment at the handle",
    "motor_stroke": "tendon stroke of the motors",
    "spool_angle": "spool angle",
    "spool_velocity": "spool speed",
    "time": "time (period of the tip)",
}
_IN_MOTION = ("motor", "inertia")
"""Kinds of groups without effect on an instrument at rest."""
_ALIKE = 1e-4
"""Relative difference below which two groups match for a workshop."""
_LEAST_CAUSE = 0.02
"""Share of the error below which a cause is not listed."""


@dataclass(frozen=True)
class PlanTable:
    """A table of text cells: the first `texts` columns are words, the others numbers."""

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    texts: int = 1
    wide: tuple[int, ...] = (0,)
    """Columns that share the remaining width."""
    names: bool = False
    """Whether cells hold names of parts, in which an underscore is no index."""
    note: str = ""


def parts(design: "Design") -> PlanTable:
    """Return the parts, and how many of each."""
    rows = tuple(_part_rows(design))
    return PlanTable("Parts", ("no.", "part", "take", "which is"), rows, texts=4, wide=(2, 3), names=True)


def _part_rows(design: "Design") -> Iterator[tuple[str, ...]]:
    choice, inst = design.choice, design.scaled_up
    axes = len(inst.axes)
    yield from _wheel_rows(design)
    rope = choice.rope
    yield (
        str(2 * axes),
        "rope for tendons",
        rope.name,
        f"⌀ {quantity(rope.diameter, 'mm', 3, 'm')}, E = {quantity(rope.modulus, 'GPa', 3, 'Pa')}; breaks at "
        f"{quantity(rope.breaking_load, 'N', 4)}, largest tension {quantity(design.largest_tension, 'N', 3)}",
    )
    if choice.rod is not None:
        yield (
            str(axes),
            "rod for a backbone",
            f"{choice.rod.name}, ⌀ {quantity(choice.rod.diameter, 'mm', 3, 'm')}",
            f"EI = {quantity(choice.rod.rigidity, 'N*mm^2', 4, 'N*m^2')}",
        )
    cell = choice.load_cell
    yield (
        str(2 * axes),
        "load cells",
        cell.name,
        f"range {quantity(cell.range, 'N', 4)}, resolution {quantity(cell.resolution, 'N', 2)}",
    )
    encoder = choice.encoder
    if encoder is None:
        distal = quantity(choice.distal.radius, "mm", 4, "m")
        yield "–", "encoder at the tip", "none of the catalogue", f"fits a distal radius of {distal}"
    else:
        yield (
            str(axes),
            "encoder at the tip",
            encoder.name,
            f"{encoder.bits} bit over {plain(math.degrees(encoder.range))}°, noise "
            f"{plain(math.degrees(encoder.noise), 2)}°; fits from a distal radius of "
            f"{quantity(encoder.least_distal_radius, 'mm', 4, 'm')}",
        )
    torque = quantity(design.largest_tension * choice.spool.radius, "N*m", 3)
    radius = quantity(choice.spool.radius, "mm", 4, "m")
    yield str(2 * axes), "spools", f"radius {radius}", f"one motor each, {torque} at the largest tension"
    if design.tests:
        needed = Counter[float]()
        for test in design.tests:
            needed |= Counter((*test.weights.loading, *test.weights.counter))
        yield str(needed.total()), "weights", masses(needed.elements()), "enough for each test load in turn"


def _wheel_rows(design: "Design") -> Iterator[tuple[str, ...]]:
    choice, inst = design.choice, design.scaled_up
    for end, wheel in (("distal", choice.distal), ("proximal", choice.proximal)):
        radius = quantity(wheel.radius, "mm", 5, "m")
        if wheel.module is not None:
            take = f"module {quantity(wheel.module, 'mm', 4, 'm')}, {wheel.teeth} teeth"
            # Every joint has two gears, which roll on each other.
            yield str(2 * len(inst.axes)), f"{end} gears", take, f"pitch radius {radius}"
        elif inst.joint_type == "continuum" and end == "distal":
            yield "", "discs on the backbone", "to size", f"tendons {radius} from the backbone"
        else:
            yield str(len(inst.axes)), f"{end} pulley", f"radius {radius}", "where the tendon runs"


def lengths(design: "Design") -> PlanTable:
    """Return the lengths to make, and the positions of the load rig."""
    inst = design.scaled_up
    values = {
        "overall length L": inst.overall_length,
        "tendon length": inst.tendon_length,
        "stem diameter": inst.stem_diameter,
        "backbone length": getattr(inst, "backbone_length", None),
        "distal joint to tip l_d": inst.end_effector_length,
        "proximal joint to hand l_p": inst.handle_length,
        "load rig: pulley of the cables": design.catalogue.constraints.cable_pulley_radius,
        "load rig: pivot to straight tip": inst.rig_arm,
    }
    rows = tuple((name, converted(value, "mm", 5)) for name, value in values.items() if value is not None)
    return PlanTable("Lengths to make", ("", "mm"), rows)


def loads(design: "Design") -> PlanTable:
    """Return the weights for every test load."""
    return PlanTable(
        "Test loads, and the weights to hang for them on the two cables of the load rig",
        ("loading cable", "counter cable", "real-size [N]", "tip [N]", "cables [N]", "off [%]", "off [N]", "loss [°]"),
        tuple(_load(design, test) for test in design.tests),
        texts=2,
        wide=(0, 1),
        note="off: force by the weights minus the test force, in N on the real-size tip, ± the tolerances of the "
        "weights; loss: output angle lost under the load with the handle straight, real-size | scaled-up",
    )


def _load(design: "Design", test: "TestLoad") -> tuple[str, ...]:
    losses = (
        -np.degrees(statics.output_angle(inst, np.zeros(1), force)[0])
        for inst, force in ((design.real_size, test.real_force), (design.scaled_up, test.force))
    )
    lever = (
        design.catalogue.constraints.cable_pulley_radius / design.scaled_up.rig_arm / design.comparison.force_factor()
    )
    return (
        masses(test.weights.loading),
        masses(test.weights.counter),
        plain(test.real_force, 3),
        fixed(test.force, 3),
        fixed(test.weights.wanted, 2),
        signed(100 * test.error / test.real_force, 2),
        with_tolerance(test.error, test.weights.tolerance * lever),
        " | ".join(fixed(loss, 2) for loss in losses),
    )


def pretension(design: "Design") -> PlanTable:
    """Return the pretension to set and the force under which a tendon goes slack, of both instruments."""
    pair = (design.real_size, design.scaled_up)
    values = {"pretension of either tendon [N]": [inst.pretension for inst in pair]}
    for name, bent in (("tip straight", 0.0), ("tip fully bent", 1.0)):
        values[f"slack from, handle held, {name} [N]"] = [
            float(statics.slack_load(inst, bent * statics.reach(inst))) for inst in pair
        ]
    return PlanTable(
        "Pretension to set",
        ("", "real-size", "scaled-up", "factor"),
        tuple(
            (name, plain(real, 3), plain(scaled, 3), fixed(scaled / real, 3) if real else "–")
            for name, (real, scaled) in values.items()
        ),
    )


def factors(comparison: Comparison) -> PlanTable:
    """Return the scale factors."""
    values = comparison.factors
    rows = [(name, plain(values[key])) for key, name in _FACTORS.items() if key in values]
    return PlanTable("Factors, scaled-up over real-size", ("", "factor"), (*rows, ("angles", "1")))


def resolution(design: "Design") -> PlanTable:
    """Return the resolution of sensors and weights, in units of the real-size instrument."""
    encoder = "–" if design.choice.encoder is None else f"{plain(design.angle_resolution, 2)}°"
    rows = (
        ("output angle, by the encoder", encoder),
        ("tendon tension, by a load cell", quantity(design.tension_resolution, "N", 2)),
        ("force at the tip, by the load cells", quantity(design.force_resolution, "N", 2)),
        ("the same, and set by weights", quantity(design.objectives.force_resolution, "N", 2)),
    )
    return PlanTable("Resolution, real-size", ("", "smallest difference"), rows)


def similarity(design: "Design", error: SimilarityError) -> PlanTable:
    """Return the size of the similarity error, where it is largest, and which groups cause it.

    Where only the scaled-up instrument snaps through, the error is also given with its tip at the stop, by which a
    design is judged.
    """
    at_rest = design.comparison.error_at_rest(pretension=design.scaled_up.pretension)
    held = ", where both hold" if error.held_by_one else ""
    rows = [
        (f"without friction{held}", angle(error.largest), angle(error.rms)),
        ("with friction, at rest", angle(at_rest.largest), angle(at_rest.rms)),
    ]
    if error.held_by_one:
        rows.insert(1, (f"without friction, {SNAPPED}", angle(error.largest_snapped), angle(error.rms_snapped)))
    return PlanTable(
        f"Similarity error, up to {plain(design.comparison.largest_force, 3)}{SPACE}N real-size",
        ("", "largest", "root mean square"),
        tuple(rows),
        note=f"output angle, scaled-up minus real-size{'' if held else ', where both hold'}; {_cause(design, error)}",
    )


def _cause(design: "Design", error: SimilarityError) -> str:
    """Return where the error is largest and which groups cause it."""
    try:
        found = design.comparison.causes(pretension=design.scaled_up.pretension, grid=GRID)
    except ValueError:
        return f"largest at {_place(*error.worst)}"
    if abs(found.error) < NO_ERROR:
        return "too small to have a cause"
    named = [
        f"{symbols(cause.name)} {'+' if cause.at_worst > 0 else ''}{plain(cause.at_worst, 2)}°"
        for cause in found.causes
        if abs(cause.at_worst) > _LEAST_CAUSE * abs(found.error)
    ]
    return f"largest at {_place(found.place.handle_angle, found.place.force)}, caused by {', '.join(named)}"


def _place(handle_angle: float, force: float) -> str:
    return f"handle {fixed(math.degrees(handle_angle), 1)}°, {plain(force, 3)}{SPACE}N real-size"


def groups(comparison: Comparison) -> PlanTable:
    """Return the groups that do not match, and a note on those that match or are made to match."""
    imposed = [symbols(group.name) for group in comparison.groups if group.imposed]
    free = [group for group in comparison.groups if (group.real_size or group.scaled_up) and not group.imposed]
    matching = [symbols(group.name) for group in free if _matches(group)]
    others = [group for group in free if not _matches(group)]
    in_motion = [
        f"{symbols(group.name)} × {plain(group.ratio)}".replace(" ", SPACE)
        for group in others
        if group.kind in _IN_MOTION
    ]
    rows = tuple(
        (symbols(group.name), group.kind, plain(group.real_size, 3), plain(group.scaled_up, 3), plain(group.ratio))
        for group in others
        if group.kind not in _IN_MOTION
    )
    notes = [
        f"matching: {', '.join(matching) or 'none'}",
        f"made equal by the factors of force and time: {', '.join(imposed)}",
    ]
    if in_motion:
        notes.append(f"not matching, in motion only: {', '.join(in_motion)}")
    return PlanTable(
        "Groups that do not match",
        ("", "", "real-size", "scaled-up", "ratio"),
        rows,
        texts=2,
        note="; ".join(notes),
    )


def _matches(group: Group) -> bool:
    return group.matches or abs(group.ratio - 1) < _ALIKE
