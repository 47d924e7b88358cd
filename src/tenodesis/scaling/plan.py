"""The workshop plan of a design, as self-contained HTML and as PDF: parts, lengths, weights and expected curves."""

import json
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from errno import EISDIR
from functools import cache
from importlib import resources
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from markupsafe import Markup, escape

from tenodesis import statics
from tenodesis.control.parameters import tension_limit
from tenodesis.errors import DesignError
from tenodesis.extras import require
from tenodesis.instrument import expanded
from tenodesis.report import style
from tenodesis.report.content import fixed, number, unit_text
from tenodesis.report.page import about, render, written
from tenodesis.scaling import figures
from tenodesis.similarity import GRID, Comparison, JointComparison, SimilarityError
from tenodesis.units import in_unit

if TYPE_CHECKING:
    from tenodesis.scaling import AnyDesign
    from tenodesis.scaling.scale_model import Design, TestLoad


SPACE = "\u00a0"
"""Separator of a number and its unit, without a line break."""

NO_ERROR = 1e-3
"""Angle, deg, below which an error is shown as none."""

MOST_MASSES = 12
"""Largest number of different masses listed individually."""

_POWERS = str.maketrans("0123456789−", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
_SYMBOLS = {"Theta": "Θ", "theta": "θ", "kappa": "κ", "zeta": "ζ", "phi": "φ", "mu": "μ", "^2": "²"}


def quantity(value: float, unit: str, digits: int, si_unit: str = "") -> str:
    """Return a value with its unit, converted from the SI unit if they differ."""
    return f"{converted(value, unit, digits, si_unit)}{SPACE}{unit_text(unit)}"


def converted(value: float, unit: str, digits: int, si_unit: str = "") -> str:
    """Return a value as :func:`quantity` does, without the unit."""
    return plain(value * in_unit(unit, si_unit or {"mm": "m"}.get(unit, unit)), digits)


def plain(value: float, digits: int = 4) -> str:
    """Return a number as reports write it, in plain text."""
    mantissa, _, power = number(value, digits).partition("<sup>")
    return mantissa + power.removesuffix("</sup>").translate(_POWERS)


def angle(error: float) -> str:
    """Return an error (deg), "below 0.001°" for smaller errors."""
    return f"{plain(error, 2)}°" if not abs(error) < NO_ERROR else f"below {NO_ERROR:g}°"


def signed(value: float, decimals: int) -> str:
    """Return a number with fixed decimals and its sign; zero has none."""
    text = fixed(value, decimals)
    is_zero = not text.strip("−0.")
    return text.lstrip("−") if is_zero else text if text.startswith("−") else f"+{text}"


def with_tolerance(error: float, tolerance: float) -> str:
    """Return an error with its tolerance, both to the tolerance's first digit, four decimals at least."""
    if not tolerance:
        return signed(error, 4)
    decimals = max(4, -math.floor(math.log10(tolerance)))
    return f"{signed(error, decimals)}{SPACE}±{SPACE}{fixed(tolerance, decimals)}"


def falling_short(value: float, required: float) -> str:
    """Return a value that falls short of a requirement, with enough decimals (at least two) to show it."""
    decimals = next((n for n in range(2, 10) if round(value, n) < required), 10)
    return fixed(value, decimals)


def masses(kilograms: Iterable[float]) -> str:
    """Return masses (kg) as a list of weights, heaviest first; beyond a number of kinds the lightest are summed."""
    kinds = sorted(Counter(kilograms).items(), reverse=True)
    listed = [
        f"{count}{SPACE}×{SPACE}{_mass(mass)}" if count > 1 else _mass(mass) for mass, count in kinds[:MOST_MASSES]
    ]
    rest = kinds[MOST_MASSES:]
    if rest:
        pieces, total = sum(count for _, count in rest), sum(mass * count for mass, count in rest)
        listed.append(f"{pieces} smaller, not listed, of {_mass(total)} in all")
    return " + ".join(listed) or "nothing"


def _mass(mass: float) -> str:
    unit = "kg" if mass >= 1 else "g" if mass >= 1e-3 else "mg"
    return quantity(mass, unit, 6, "kg")


def symbols(name: str) -> str:
    """Return the name of a group with Greek letters."""
    for word, symbol in _SYMBOLS.items():
        name = name.replace(word, symbol)
    return name


SNAPPED = "a snapped tip at its stop"
"""How a tip that snaps through counts in a design's objectives."""

FACTORS = {
    "length": "tendons' arms about joints, and length",
    "tendon_stiffness": "stiffness of tendons",
    "tension": "tendon tension",
    "force": "force at the tip",
    "moment": "moment at the tip",
    "grip_force": "grip force",
    "torque": "moment about a joint at the tip",
    "handle_torque": "moment at the handle",
    "motor_stroke": "tendon stroke of the motors",
    "spool_angle": "spool angle",
    "spool_velocity": "spool speed",
    "time": "time (period of the tip)",
}
"""Scale factors by key, in words."""
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
    """Whether cells and note hold names of parts, in which an underscore is no index."""
    note: str = ""


def parts(design: "AnyDesign") -> PlanTable:
    """Return the parts, and how many of each."""
    rows = tuple(part_rows(design))
    return PlanTable("Parts", ("no.", "part", "take", "which is"), rows, texts=4, wide=(1, 2, 3), names=True)


def part_rows(design: "AnyDesign") -> Iterator[tuple[str, str, str, str]]:
    """Yield number, part, what to take and what it is, of all parts."""
    choice, inst = design.choice, expanded(design.scaled_up)
    for one in design.wheels:
        wheel, radius = one.wheel, quantity(one.wheel.radius, "mm", 5, "m")
        if wheel.module is not None:
            take = f"module {quantity(wheel.module, 'mm', 4, 'm')}, {wheel.teeth} teeth"
            yield str(one.pieces), one.part, take, f"pitch radius {radius}"
        elif one.kind == "discs":
            yield str(one.pieces), one.part, "to size", f"tendons {radius} from the backbone"
        else:
            yield str(one.pieces), one.part, f"radius {radius}", "where the tendon runs"
    rope = choice.rope
    yield (
        str(len(inst.tendons)),
        "rope for tendons",
        rope.name,
        f"⌀ {quantity(rope.diameter, 'mm', 3, 'm')}, E = {quantity(rope.modulus, 'GPa', 3, 'Pa')}; breaks at "
        f"{quantity(rope.breaking_load, 'N', 4)}, largest tension {quantity(design.largest_tension, 'N', 3)}",
    )
    for name, rod in design.rods:
        take = f"{rod.name}, ⌀ {quantity(rod.diameter, 'mm', 3, 'm')}"
        yield "1", "rod for a backbone", take, f"{name}; EI = {quantity(rod.rigidity, 'N*mm^2', 4, 'N*m^2')}"
    for name, spring in choice.springs:
        yield "1", "spring", quantity(spring, "N*mm", 4, "N*m") + " per rad", f"{name}; made to this value"
    cell, spools = choice.load_cell, str(spools_of(design))
    yield (
        spools,
        "load cells",
        cell.name,
        f"range {quantity(cell.range, 'N', 4)}, resolution {quantity(cell.resolution, 'N', 2)}",
    )
    encoder = choice.encoder
    if encoder is None:
        least = quantity(min(joint.radius for joint in inst.tip_joints), "mm", 4, "m")
        yield "–", "encoders at the tip", "none of the catalogue", f"fits a distal radius of {least}"
    else:
        yield (
            str(len(inst.arc_places)),
            "encoders at the tip",
            encoder.name,
            f"{encoder.bits} bit over {plain(math.degrees(encoder.range))}°, noise "
            f"{plain(math.degrees(encoder.noise), 2)}°; fits from a distal radius of "
            f"{quantity(encoder.least_distal_radius, 'mm', 4, 'm')}",
        )
    torque = quantity(design.largest_tension * choice.spool.radius, "N*m", 3)
    radius = quantity(choice.spool.radius, "mm", 4, "m")
    yield spools, "spools", f"radius {radius}", f"one motor each, {torque} at the largest tension"
    if needed := weights_needed(design):
        yield str(needed.total()), "weights", masses(needed.elements()), "enough for each test load in turn"


def spools_of(design: "AnyDesign") -> int:
    """Return how many tendons a spool winds."""
    return sum(tendon.start == "spool" for tendon in expanded(design.scaled_up).tendons)


def weights_needed(design: "AnyDesign") -> Counter[float]:
    """Return the weights (kg), and how many of each, that are enough for each test load in turn."""
    needed = Counter[float]()
    for test in design.tests:
        needed |= Counter((*test.weights.loading, *test.weights.counter))
    return needed


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


def factors(pair: Comparison | JointComparison) -> PlanTable:
    """Return the scale factors."""
    rows = [(name, plain(pair.factors[key])) for key, name in FACTORS.items() if key in pair.factors]
    return PlanTable("Factors, scaled-up over real-size", ("", "factor"), (*rows, ("angles", "1")))


def resolution(design: "AnyDesign", *more: tuple[str, str]) -> PlanTable:
    """Return the resolution of sensors and weights, in units of the real-size instrument."""
    choice, tension = design.choice, design.choice.load_cell.resolution / design.comparison.factors["tension"]
    least = "–" if choice.encoder is None else f"{plain(math.degrees(choice.encoder.resolution), 2)}°"
    rows = (
        ("angle of a joint, by an encoder", least),
        ("tendon tension, by a load cell", quantity(tension, "N", 2)),
        *more,
        ("force at the tip, set and measured", quantity(design.objectives.force_resolution, "N", 2)),
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


def groups(pair: Comparison | JointComparison, *, named: bool = False) -> PlanTable:
    """Return the groups that do not match, and a note on those that match or are made to match.

    Where groups are named after joints and tendons, with what they mean.
    """
    shown = {group: group.name if named else symbols(group.name) for group in pair.groups}
    free = [group for group in shown if (group.real_size or group.scaled_up) and not group.imposed]
    others = [group for group in free if not (group.matches or abs(group.ratio - 1) < _ALIKE)]
    still = [group for group in others if group.kind not in _IN_MOTION]
    rows = tuple(
        (shown[group], group.meaning if named else group.kind, plain(group.real_size, 3), plain(group.scaled_up, 3),
         plain(group.ratio))
        for group in still
    )  # fmt: skip
    lists = {
        "matching": [shown[group] for group in free if group not in others],
        "made equal by the factors of force and time": [shown[group] for group in shown if group.imposed],
        "not matching, in motion only": [
            f"{shown[group]} × {plain(group.ratio)}".replace(" ", SPACE) for group in others if group not in still
        ],
    }
    return PlanTable(
        "Groups that do not match" if rows else "All groups match",
        ("", "", "real-size", "scaled-up", "ratio"),
        rows,
        texts=2,
        wide=(0, 1) if named else (0,),
        names=named,
        note="; ".join(f"{what}: {', '.join(found)}" for what, found in lists.items() if found),
    )


_LONG = 120  # characters; a longer name of a catalogue, made of many names, is shortened
_SYMBOL = r"([^\W\d_]+)_(\w+)"
_PRETENSION_OFF = 0.005
"""Share by which the pretension may differ from the similar pretension without a warning."""
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Card:
    """A key figure at the top of the plan, with its description."""

    value: str
    label: str


@dataclass(frozen=True)
class PlanFigure:
    """A figure as SVG, its caption, and the address of a file beside the plan that the page links to."""

    caption: str
    svg: str
    file: str = ""


@dataclass(frozen=True)
class Supplement:
    """What other packages add to a plan: a card beside that of the similarity error if any, and rows at its end."""

    card: Card | None
    rows: tuple[tuple["PlanTable | PlanFigure", ...], ...]
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class ScalePlan:
    """All content of a plan, in plain text; an underscore precedes the index of a symbol such as l_d."""

    title: str
    lead: str
    cards: tuple[Card, ...]
    warnings: tuple[str, ...]
    rows: tuple[tuple[PlanTable | PlanFigure, ...], ...]
    """Tables and figures in their order on the page, those of a row side by side."""
    footer: str


def content(design: "Design", supplement: Supplement | None = None) -> ScalePlan:
    """Return the content of the plan of a design, with what another package adds to it."""
    error = design.comparison.error(pretension=design.scaled_up.pretension)
    output, tensions, errors = figures.plan_figures(design, error)
    by_cells = ("force at the tip, by the load cells", quantity(design.force_resolution, "N", 2))
    return ScalePlan(
        title=f"{design.scaled_up.name}: scale model of {design.real_size.name}",
        lead=_lead(design),
        cards=_cards(design, error, supplement),
        warnings=(*_warnings(design, error), *(supplement.warnings if supplement else ())),
        rows=(
            (parts(design),),
            (loads(design),),
            (lengths(design), factors(design.comparison)),
            (pretension(design), resolution(design, by_cells)),
            (
                PlanFigure(_output_caption(design), output),
                PlanFigure("Expected tensions, scaled-up, and their bounds", tensions),
            ),
            (groups(design.comparison), PlanFigure("Scaled-up minus real-size output angle", errors)),
            (similarity(design, error),),
            *(supplement.rows if supplement else ()),
        ),
        footer=f"tenodesis {about()['tenodesis']} · curves and loads without friction · "
        "research software, not a medical device",
    )


def write(design: "Design", folder: Path, supplement: Supplement | None = None) -> tuple[Path, Path]:
    """Write the plan of a design as plan.html and plan.pdf (A4) to a folder, both or neither, and return their paths.

    Raises DesignError if the folder cannot be written.
    """
    return write_plan(content(design, supplement), folder)


def write_plan(plan: ScalePlan, folder: Path) -> tuple[Path, Path]:
    """Write the content of a plan as :func:`write`."""
    files = {"plan.html": html(plan).encode(), "plan.pdf": pdf(plan)}
    with written(folder, DesignError) as new:
        for name, data in files.items():
            if (folder / name).is_dir():
                raise IsADirectoryError(EISDIR, f"{name} is a folder")
            (new / name).write_bytes(data)
    return folder / "plan.html", folder / "plan.pdf"


def html(plan: ScalePlan) -> str:
    """Return the plan as an HTML page."""
    return render("tenodesis.scaling", "plan.html.j2", plan=plan, colors=_colors(), marked=_marked)


def pdf(plan: ScalePlan) -> bytes:
    """Return the plan as PDF, A4."""
    data = {
        "title": plan.title,
        "lead": plan.lead,
        "cards": [asdict(card) for card in plan.cards],
        "warnings": plan.warnings,
        "rows": [[asdict(block) for block in row] for row in plan.rows],
        "footer": plan.footer,
        "colors": _colors(),
    }
    template = (resources.files("tenodesis.scaling") / "plan.typ").read_bytes()
    compiled: bytes = require("typst", "design").compile(
        template, sys_inputs={"data": json.dumps(data)}, font_paths=_fonts()
    )
    return compiled


@cache
def _fonts() -> Any:
    """Return the fonts that come with matplotlib, so that the PDF is the same on every machine."""
    return require("typst", "design").Fonts(
        include_system_fonts=False, font_paths=[Path(mpl.get_data_path()) / "fonts/ttf"]
    )


def _colors() -> dict[str, str]:
    return {"ink": style.INK, "muted": style.MUTED, "line": style.GRID, "accent": style.ACCENT}


def _marked(text: str) -> Markup:
    """Return text as HTML with the indices of its symbols as subscripts."""
    return Markup(re.sub(_SYMBOL, r"\1<sub>\2</sub>", str(escape(text))))


def _lead(design: "Design") -> str:
    axis = f"axis {design.scaled_up.axes[0]}" if len(design.scaled_up.axes) == 1 else "both axes alike"
    joints = dict.fromkeys((design.scaled_up.joint_type, design.real_size.joint_type))
    catalogue = shorten(design.catalogue.name, _LONG, placeholder=" …")
    return f"{' for '.join(joints)} joint · {axis} · from catalogue {catalogue}"


def _cards(design: "Design", error: SimilarityError, supplement: Supplement | None) -> tuple[Card, ...]:
    pretension = f"pretension to set on either tendon ({quantity(design.real_size.pretension, 'N', 3)} real-size)"
    snapped = f", {SNAPPED}" if error.held_by_one else ""
    return (
        Card(quantity(design.scaled_up.pretension, "N", 3), pretension),
        Card(f"× {fixed(float(design.comparison.force_factor()), 3)}", "force at the tip, scaled-up over real-size"),
        Card(
            angle(design.objectives.similarity_error),
            f"as designed: largest similarity error over the working range{snapped}",
        ),
        *(() if supplement is None or supplement.card is None else (supplement.card,)),
        Card(quantity(design.objectives.force_resolution, "N", 2), "resolution of the real-size tip force"),
        Card(f"{fixed(design.objectives.tension_margin, 1)} ×", "rope's breaking load over its largest tension"),
    )


def _output_caption(design: "Design") -> str:
    tests = figures.shown(design.tests)
    which = f" at {len(tests)} of {len(design.tests)} test loads" if len(tests) < len(design.tests) else ""
    return f"Expected output{which}: real-size pale, scaled-up thin"


def _warnings(design: "Design", error: SimilarityError) -> Iterator[str]:
    """Yield warnings for the workshop, a sentence each."""
    constraints, choice = design.catalogue.constraints, design.choice
    similar = design.real_size.pretension * design.comparison.tension_factor
    off = design.scaled_up.pretension / similar - 1 if similar else 0.0
    if abs(off) > _PRETENSION_OFF:
        yield (
            f"Pretension is {quantity(design.scaled_up.pretension, 'N', 3)}, {plain(abs(100 * off), 2)} % "
            f"{'below' if off < 0 else 'above'} the similar {quantity(similar, 'N', 3)}: tendons do not go slack at "
            "similar loads."
        )
    for test in design.tests:
        share = test.error / test.real_force
        if abs(share) > constraints.force_tolerance:
            yield (
                f"The weights for {quantity(test.real_force, 'N', 3)} real-size are off by {signed(100 * share, 2)} %, "
                f"more than {plain(100 * constraints.force_tolerance, 2)} %."
            )
    cell_margin = choice.load_cell.range / design.largest_tension if design.largest_tension else math.inf
    for what, margin, asked in (
        ("The rope breaks", design.objectives.tension_margin, constraints.tension_margin),
        ("The range of the load cells ends", cell_margin, constraints.load_cell_margin),
    ):
        if margin < asked * (1 - _ROUNDING):
            yield f"{what} at {falling_short(margin, asked)} × the largest tension; {plain(asked, 9)} × is required."
    limit = tension_limit(design.scaled_up)
    if limit < design.largest_tension:
        yield (
            f"The controller winds no tendon above {quantity(limit, 'N', 3)}, below the plan's largest tension of "
            f"{quantity(design.largest_tension, 'N', 3)}: take load cells or a rope for more."
        )
    if choice.encoder is None:
        yield f"No encoder of the catalogue fits a distal radius of {quantity(choice.distal.radius, 'mm', 4, 'm')}."
    if error.held_by_one:
        yield (
            f"On {plain(100 * error.held_by_one, 2)} % of the working range one of the two snaps through and the other "
            f"does not; with that tip at its stop, the error goes up to {angle(error.largest_snapped)}."
        )
    neither = error.unsolved - error.held_by_one
    if neither > _ROUNDING:
        yield f"On {plain(100 * neither, 2)} % of the working range neither holds the load."
