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
from typing import Any, NamedTuple, TypeAlias

import matplotlib as mpl
import numpy as np
from markupsafe import Markup, escape

from tenodesis import statics
from tenodesis.control.parameters import tension_limit
from tenodesis.errors import DesignError
from tenodesis.extras import require
from tenodesis.instrument import Instrument, Joint, expanded
from tenodesis.report import style
from tenodesis.report.content import Chart, fixed, number, unit_text
from tenodesis.report.page import about, inline_svg, render, written
from tenodesis.run import Array
from tenodesis.scaling import figures
from tenodesis.scaling.joints import JointDesign
from tenodesis.scaling.scale_model import Design, TestLoad
from tenodesis.similarity import GRID, Comparison, JointComparison, JointError, SimilarityError
from tenodesis.statics import chain
from tenodesis.statics.bends import Bends
from tenodesis.units import in_unit

AnyDesign: TypeAlias = Design | JointDesign

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


def parts(design: AnyDesign) -> PlanTable:
    """Return the parts, and how many of each."""
    rows = tuple(part_rows(design))
    return PlanTable("Parts", ("no.", "part", "take", "which is"), rows, texts=4, wide=(1, 2, 3), names=True)


def part_rows(design: AnyDesign) -> Iterator[tuple[str, str, str, str]]:
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
        yield "–", "encoders at the tip", "none of the catalogue", f"fits a distal radius of {_least_radius(design)}"
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


def _least_radius(design: AnyDesign) -> str:
    return quantity(min(joint.radius for joint in expanded(design.scaled_up).tip_joints), "mm", 4, "m")


def spools_of(design: AnyDesign) -> int:
    """Return how many tendons a spool winds."""
    return sum(tendon.start == "spool" for tendon in expanded(design.scaled_up).tendons)


def weights_needed(design: AnyDesign) -> Counter[float]:
    """Return the weights (kg), and how many of each, that are enough for each test load in turn."""
    needed = Counter[float]()
    for test in design.tests:
        needed |= Counter((*test.weights.loading, *test.weights.counter))
    return needed


def lengths(design: AnyDesign) -> PlanTable:
    """Return the lengths to make, and the positions of the load rig of one axis."""
    inst, plane = expanded(design.scaled_up), design.scaled_up.short_form
    rows = [("tendons, from spool to tip", inst.tendon_length), ("stem", inst.stem_length)]
    if plane is not None:
        rows = [("overall length L", plane.overall_length), *rows, ("stem diameter", plane.stem_diameter)]
    for joint in inst.as_given("joints"):
        rows += [(f"{joint.name}: {text}", value) for text, value in _of_joint(joint)]
    if inst.grip is not None and inst.grip.length:
        rows.append(("jaws' axis to what they hold", inst.grip.length))
    if plane is not None:
        rows.append(("load rig: pulley of the cables", design.catalogue.constraints.cable_pulley_radius))
        rows.append(("load rig: pivot to straight tip", plane.rig_arm))
    table = tuple((name, converted(value, "mm", 5)) for name, value in rows if value)
    return PlanTable("Lengths to make", ("", "mm"), table, names=True)


def _of_joint(joint: Joint) -> Iterator[tuple[str, float | None]]:
    yield "before it", joint.offset
    yield "backbone", joint.backbone_length
    yield "to the hand" if joint.place == "handle" else "to where forces act", joint.end_effector_length


def loads(design: AnyDesign) -> PlanTable:
    """Return the weights for every test load."""
    return PlanTable(
        "Test loads, and the weights to hang for them on two cables that pull against each other",
        (
            *("loading cable", "counter cable", "load", "real-size [N]", "tip [N]", "cables [N]", "off [%]"),
            *("off [N]", "lost [°]"),
        ),
        tuple(_load(design, test) for test in design.tests),
        texts=3,
        wide=(0, 1),
        note="off: force by the weights minus the test force, in N on the real-size tip, ± the tolerances of the "
        "weights; lost: the most that a joint loses under the load with all of them straight, real-size | scaled-up",
    )


def _load(design: AnyDesign, test: TestLoad) -> tuple[str, ...]:
    of_jaws = test.direction == "grip_force"
    factor = design.comparison.factors["grip_force" if of_jaws else "force"]
    lever = test.force / test.weights.weight if test.weights.weight else 1.0
    lost = (_lost(design.real_size, test._replace(force=test.real_force)), _lost(design.bench, test))
    return (
        masses(test.weights.loading),
        masses(test.weights.counter),
        "grip" if of_jaws else test.direction.replace("f", "").replace("-", "−"),
        plain(test.real_force, 3),
        fixed(test.force, 3),
        fixed(test.weights.wanted, 2),
        signed(100 * test.error / test.real_force, 2),
        with_tolerance(test.error, test.weights.tolerance * lever / factor),
        " | ".join(fixed(one, 2) for one in lost),
    )


def _lost(inst: Instrument, test: TestLoad) -> float:
    """Return the most that a straight joint loses under a load, deg."""
    whole, (wrench, grip) = expanded(inst), test.load
    free, loaded = chain.output_angles(whole, 0.0, np.outer((0.0, 1.0), wrench), grip_force=np.array([0.0, grip]))
    return float(np.degrees(np.abs(Bends.of(whole).summed(free - loaded)).max()))


def pretension(design: Design) -> PlanTable:
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


def resolution(design: AnyDesign, *more: tuple[str, str]) -> PlanTable:
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


def similarity(design: Design, error: SimilarityError) -> PlanTable:
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


def _cause(design: Design, error: SimilarityError) -> str:
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
_POINTS = 21
_LEAST = 1e-6  # m


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


class _OfKind(NamedTuple):
    """What a plan has of one plane, or of all joints at once."""

    cards: tuple[Card, ...]
    """That of the similarity error last"""
    rows: tuple[tuple[PlanTable | PlanFigure, ...], ...]
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class AsBuilt:
    """Largest errors that a share of the instruments keep that are built to tolerances."""

    share: float
    joints: tuple[float, ...]
    """By joint, deg"""
    tip: float
    """At the real-size tip, m"""


def content(design: AnyDesign, supplement: Supplement | None = None, built: AsBuilt | None = None) -> ScalePlan:
    """Return the content of the plan of a design, with what another package adds to it."""
    own = _of_joints(design, built) if isinstance(design, JointDesign) else _of_plane(design)
    pair, whole = design.comparison, expanded(design.scaled_up)
    catalogue = shorten(design.catalogue.name, _LONG, placeholder=" …")
    joints = ", ".join(f"{one.name} ({one.mechanism})" for one in whole.as_given("joints") if one.place == "tip")
    added = Supplement(None, ()) if supplement is None else supplement
    return ScalePlan(
        title=f"{design.scaled_up.name}: scale model of {design.real_size.name}",
        lead=f"{joints} · {len(whole.tendons)} tendons · from catalogue {catalogue}",
        cards=(
            Card(f"× {plain(pair.factors['length'])}", "length, scaled-up over real-size"),
            Card(f"× {fixed(float(pair.factors['force']), 3)}", "force at the tip, scaled-up over real-size"),
            Card(quantity(design.objectives.force_resolution, "N", 2), "resolution of the real-size tip force"),
            Card(f"{fixed(design.objectives.tension_margin, 1)} ×", "rope's breaking load over its largest tension"),
            *own.cards,
            *(() if added.card is None else (added.card,)),
        ),
        warnings=(*own.warnings, *_warnings(design), *added.warnings),
        rows=((parts(design),), (loads(design),), (lengths(design), factors(pair)), *own.rows, *added.rows),
        footer=f"tenodesis {about()['tenodesis']} · curves and loads without friction · "
        "research software, not a medical device",
    )


def _of_plane(design: Design) -> _OfKind:
    error = design.comparison.error(pretension=design.scaled_up.pretension)
    output, tensions, errors = figures.plan_figures(design, error)
    tests = figures.shown(design.tests)
    which = f" at {len(tests)} of {len(design.tests)} test loads" if len(tests) < len(design.tests) else ""
    set_to = f"pretension to set on either tendon ({quantity(design.real_size.pretension, 'N', 3)} real-size)"
    snapped = f", {SNAPPED}" if error.held_by_one else ""
    by_cells = ("force at the tip, by the load cells", quantity(design.force_resolution, "N", 2))
    return _OfKind(
        (
            Card(quantity(design.scaled_up.pretension, "N", 3), set_to),
            Card(
                angle(design.objectives.similarity_error),
                f"as designed: largest similarity error over the working range{snapped}",
            ),
        ),
        (
            (pretension(design), resolution(design, by_cells)),
            (
                PlanFigure(f"Expected output{which}: real-size pale, scaled-up thin", output),
                PlanFigure("Expected tensions, scaled-up, and their bounds", tensions),
            ),
            (groups(design.comparison), PlanFigure("Scaled-up minus real-size output angle", errors)),
            (similarity(design, error),),
        ),
        tuple(_of_error(design, error)),
    )


def _of_joints(design: JointDesign, built: AsBuilt | None) -> _OfKind:
    pair, error = design.comparison, design.error
    cards = [
        Card(distance(error.largest_at_tip), "as designed: the largest error at the real-size tip"),
        Card(angle(float(error.largest.max())), "as designed: largest similarity error of a joint, without friction"),
    ]
    if built is not None:
        share = f"{100 * built.share:g} %"
        cards.append(Card(angle(max(built.joints)), f"as built: {share} keep, with friction, by usual tolerances"))
    return _OfKind(
        tuple(cards),
        (
            (_tendons(design), resolution(design)),
            (_losses(design),),
            (_similarity_of_joints(design, built),),
            (groups(pair, named=True),),
        ),
        tuple(_of_parts(design)),
    )


def distance(metres: float) -> str:
    """Return an error at the tip as text."""
    return quantity(metres, "mm", 2, "m") if metres >= _LEAST else f"<{1e3 * _LEAST:g} mm"


def write(
    design: AnyDesign, folder: Path, supplement: Supplement | None = None, built: AsBuilt | None = None
) -> tuple[Path, Path]:
    """Write the plan of a design as plan.html and plan.pdf (A4) to a folder, both or neither, and return their paths.

    Raises DesignError if the folder cannot be written.
    """
    plan = content(design, supplement, built)
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


def _tendons(design: JointDesign) -> PlanTable:
    inst = design.scaled_up
    rows = tuple(
        (tendon.name, quantity(float(tension), "N", 4), quantity(float(stiffness), "N/mm", 4, "N/m"))
        for tendon, tension, stiffness in zip(inst.tendons, inst.pretensions, inst.stiffnesses, strict=True)
    )
    return PlanTable("Tendons", ("", "pretension", "stiffness"), rows, names=True)


def _similarity_of_joints(design: JointDesign, built: AsBuilt | None) -> PlanTable:
    pair = design.comparison
    rows = [
        _error("as designed, without friction", design.error),
        _error("with friction at rest", design.error_at_rest),
    ]
    if built is not None:
        tip = distance(built.tip)
        rows.append((f"as built, {100 * built.share:g} % keep", *(angle(one) for one in built.joints), tip))
    loads = ", ".join(
        f"{one.size:.3g} N {'of grip' if one.name == 'grip' else f'along {one.name}'}" for one in pair.loads
    )
    return PlanTable(
        f"Largest similarity error, up to {loads} real-size",
        ("", *pair.joints, "at the real-size tip"),
        tuple(rows),
        names=True,
        note="angles over the working range, scaled-up minus real-size; at the tip, how far they would move the "
        "real-size one, of two jaws the farther; as built by general tolerances: tenodesis tolerance has more",
    )


def _error(name: str, error: JointError) -> tuple[str, ...]:
    return (name, *(angle(float(one)) for one in error.largest), distance(error.largest_at_tip))


def draw_losses(pair: JointComparison) -> Chart:
    """Return a chart of the angles that each load leaves in the bent state, of both instruments."""
    states = pair.states
    bent = int(np.argmax(np.abs(states.angles).sum(axis=1)))
    bends = Bends.of(pair.real_size)
    chart, axes = Chart.panels(len(pair.loads), width=3.4 * len(pair.loads), height=2.8)
    shares = np.linspace(0.0, 1.0, _POINTS)
    for axis, load in zip(axes, pair.loads, strict=True):
        wrench, grip = np.outer(shares, load.wrench), shares * load.grip_force
        own = _angles(pair.real_size, states.handle[bent], states.strokes[bent], wrench, grip)
        other = _angles(
            pair.scaled_up, states.handle[bent], states.scaled_strokes[bent], *pair.scaled_loads(wrench, grip)
        )
        along = "of grip" if load.name == "grip" else f"along {load.name}"
        force = chart.keep(f"force {along} [N]", shares * load.size)
        colors = style.colors(len(pair.joints))
        for n, (name, color) in enumerate(zip(pair.joints, colors, strict=True)):
            real, scaled = (np.degrees(bends.summed(angles))[:, n] for angles in (own, other))
            chart.curve(axis, force, f"{name}, force {along} [deg]", real, color=color, label=name)
            kept = chart.keep(f"{name}, scale model, force {along} [deg]", scaled)
            axis.plot(force[::4], kept[::4], "o", color=color, ms=3)
        axis.set_xlabel(f"force {along}, real-size [N]")
    axes[0].set_ylabel("angle [deg]")
    style.legend_above(axes[0], len(pair.joints))
    return chart


def _losses(design: JointDesign) -> PlanFigure:
    with style.applied():
        drawn = inline_svg("angles", draw_losses(design.comparison).figure)
    return PlanFigure("Angles that loads leave in a bent state: real-size (lines), scaled-up (points)", drawn)


def _angles(inst: Instrument, handle: Array, strokes: Array, wrench: Array, grip: Array) -> Array:
    return chain.output_angles(inst, handle, wrench, grip_force=grip, strokes=strokes)


def _of_parts(design: JointDesign) -> Iterator[str]:
    """Yield warnings about what a scale model of several joints is made of, a sentence each."""
    if design.error.unsolved > design.comparison.error().unsolved:
        yield "Where both do not hold a load, no error is counted."
    for name, spring in design.choice.springs:
        yield f"The spring of {name}, {spring:.4g} N m/rad, is in no catalogue: it must be made, or set by trying."
    if any(tendon.stiffness_by_tension is not None for tendon in design.scaled_up.tendons):
        yield "Ropes whose stiffness grows with the tension must have the scaled table of the instrument file."


def _of_error(design: Design, error: SimilarityError) -> Iterator[str]:
    """Yield warnings about the similarity in one plane, a sentence each."""
    similar = design.real_size.pretension * design.comparison.tension_factor
    off = design.scaled_up.pretension / similar - 1 if similar else 0.0
    if abs(off) > _PRETENSION_OFF:
        yield (
            f"Pretension is {quantity(design.scaled_up.pretension, 'N', 3)}, {plain(abs(100 * off), 2)} % "
            f"{'below' if off < 0 else 'above'} the similar {quantity(similar, 'N', 3)}: tendons do not go slack at "
            "similar loads."
        )
    if error.held_by_one:
        yield (
            f"On {plain(100 * error.held_by_one, 2)} % of the working range one of the two snaps through and the other "
            f"does not; with that tip at its stop, the error goes up to {angle(error.largest_snapped)}."
        )
    neither = error.unsolved - error.held_by_one
    if neither > _ROUNDING:
        yield f"On {plain(100 * neither, 2)} % of the working range neither holds the load."


def _warnings(design: AnyDesign) -> Iterator[str]:
    """Yield warnings for the workshop, a sentence each."""
    constraints, choice = design.catalogue.constraints, design.choice
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
        yield f"No encoder of the catalogue fits a distal radius of {_least_radius(design)}."
