"""What a workshop plan says of a design: every text and number, formatted once for whatever shows it."""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from textwrap import shorten
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tenodesis import statics
from tenodesis.bench.content import fixed, number
from tenodesis.instrument import Instrument
from tenodesis.quantity import in_unit
from tenodesis.scaling import plan_figures
from tenodesis.similarity import GRID, Comparison, Group, SimilarityError

if TYPE_CHECKING:
    from tenodesis.scaling.design import Design, TestLoad

_SPACE = "\u00a0"
_POWERS = str.maketrans("0123456789−", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
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
_IN_MOTION = ("motor", "inertia")
"""Kinds of groups that a held instrument does not feel."""
_SYMBOLS = {"Theta": "Θ", "theta": "θ", "kappa": "κ", "zeta": "ζ", "phi": "φ", "mu": "μ", "^2": "²"}
_ALIKE = 1e-4
"""Relative difference of two groups that a workshop calls none."""
_NO_ERROR = 1e-3  # deg
_WORTH_A_WORD = 0.02
_ROUNDING = 1e-9
_LONG = 120  # characters; a name made of many names is cut
_SLACK_OFF = 0.005
"""Share that the pretension may differ from the similar one without a word."""


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


@dataclass(frozen=True)
class Card:
    """A number that stands first, and what it is."""

    value: str
    label: str


@dataclass(frozen=True)
class Drawing:
    """A figure as SVG, and its caption."""

    caption: str
    svg: str


@dataclass(frozen=True)
class Plan:
    """All that stands on the page, in plain text; an underscore stands before the index of a symbol such as l_d."""

    title: str
    lead: str
    cards: tuple[Card, ...]
    parts: Table
    lengths: Table
    loads: Table
    pretension: Table
    factors: Table
    resolution: Table
    similarity: Table
    groups: Table
    drawings: tuple[Drawing, ...]
    warnings: tuple[str, ...]
    footer: str


def content(design: "Design", limits: Limits = Limits()) -> Plan:  # noqa: B008
    """Return what the plan of a design says.

    Parameters
    ----------
    design
        The design.
    limits
        How many lines there is room for.
    """
    from tenodesis import __version__  # noqa: PLC0415

    error = design.comparison.error(pretension=design.prototype.pretension)
    said = list(_warnings(design, error))
    curves, tensions, errors = plan_figures.drawn(design, error)
    return Plan(
        title=f"{design.prototype.name}: scale model of {design.model.name}",
        lead=_lead(design),
        cards=_cards(design),
        parts=_parts(design),
        lengths=_lengths(design),
        loads=_loads(design, limits),
        pretension=_pretension(design),
        factors=_factors(design.comparison),
        resolution=_resolution(design),
        similarity=_similarity(design, error, limits.drawings),
        groups=_groups(design.comparison, limits.groups),
        drawings=(
            Drawing(_curves_caption(design), curves),
            Drawing("Expected tensions, scaled-up, and their bounds", tensions),
            Drawing("Scaled-up minus real-size output angle", errors),
        )[: limits.drawings],
        warnings=(*said[: limits.warnings], *_more(len(said) - limits.warnings, "further warning")),
        footer=f"tenodesis {__version__} · curves and loads without friction · research software, not a medical device",
    )


def _lead(design: "Design") -> str:
    axis = f"axis {design.prototype.axes[0]}" if len(design.prototype.axes) == 1 else "both axes alike"
    joints = dict.fromkeys((design.prototype.joint_type, design.model.joint_type))
    return f"{' for '.join(joints)} joint · {axis} · from catalogue {shorten(design.catalogue.name, _LONG, placeholder=' …')}"


def _cards(design: "Design") -> tuple[Card, ...]:
    prototype, model = design.prototype.pretension, design.model.pretension
    return (
        Card(_told(prototype, "N", 3), f"pretension to set on either tendon ({_told(model, 'N', 3)} real-size)"),
        Card(f"× {fixed(float(design.comparison.force_factor()), 3)}", "force at the tip, scaled-up over real-size"),
        Card(_degrees(design.objectives.similarity_error), "largest similarity error over the working range"),
        Card(_told(design.objectives.force_resolution, "N", 2), "smallest real-size tip force that can be told"),
        Card(f"{fixed(design.objectives.tension_margin, 1)} ×", "rope's breaking load over its largest tension"),
    )


def _parts(design: "Design") -> Table:
    return Table("Parts", ("no.", "part", "take", "which is"), tuple(_part_rows(design)), texts=4)


def _part_rows(design: "Design") -> Iterator[tuple[str, ...]]:
    choice, inst = design.choice, design.prototype
    axes = len(inst.axes)
    yield from _wheel_rows(design)
    rope = choice.rope
    yield (
        str(2 * axes),
        "rope for tendons",
        rope.name,
        f"⌀ {_told(rope.diameter, 'mm', 3, 'm')}, E = {_told(rope.modulus, 'GPa', 3, 'Pa')}; breaks at "
        f"{_told(rope.breaking_load, 'N', 4)}, largest tension {_told(design.largest_tension, 'N', 3)}",
    )
    if choice.rod is not None:
        yield (
            str(axes),
            "rod for a backbone",
            f"{choice.rod.name}, ⌀ {_told(choice.rod.diameter, 'mm', 3, 'm')}",
            f"EI = {_told(choice.rod.rigidity, 'N*mm^2', 4, 'N*m^2')}",
        )
    cell = choice.load_cell
    yield (
        str(2 * axes),
        "load cells",
        cell.name,
        f"range {_told(cell.range, 'N', 4)}, resolution {_told(cell.resolution, 'N', 2)}",
    )
    encoder = choice.encoder
    if encoder is None:
        distal = _told(choice.distal.radius, "mm", 4, "m")
        yield "–", "encoder at the tip", "none of the catalogue", f"fits a distal radius of {distal}"
    else:
        yield (
            str(axes),
            "encoder at the tip",
            encoder.name,
            f"{encoder.bits} bit over {_number(math.degrees(encoder.range))}°, noise "
            f"{_number(math.degrees(encoder.noise), 2)}°; fits from a distal radius of "
            f"{_told(encoder.least_distal_radius, 'mm', 4, 'm')}",
        )
    if choice.spool is not None:
        yield str(2 * axes), "spools", f"radius {_told(choice.spool.radius, 'mm', 4, 'm')}", "one motor each"
    if design.tests:
        needed = Counter[float]()
        for test in design.tests:
            needed |= Counter((*test.hanging.loading, *test.hanging.counter))
        yield (
            str(needed.total()),
            "weights",
            _masses(needed.elements(), _MOST_KINDS),
            "enough for each test load in turn",
        )


def _wheel_rows(design: "Design") -> Iterator[tuple[str, ...]]:
    choice, inst = design.choice, design.prototype
    for end, wheel in (("distal", choice.distal), ("proximal", choice.proximal)):
        radius = _told(wheel.radius, "mm", 5, "m")
        if wheel.module is not None:
            take = f"module {_told(wheel.module, 'mm', 4, 'm')}, {wheel.teeth} teeth"
            # Two gears roll on each other in every joint.
            yield str(2 * len(inst.axes)), f"{end} gears", take, f"pitch radius {radius}"
        elif inst.joint_type == "continuum" and end == "distal":
            yield "", "discs on the backbone", "to size", f"tendons {radius} from the backbone"
        else:
            yield str(len(inst.axes)), f"{end} pulley", f"radius {radius}", "where the tendon runs"


def _lengths(design: "Design") -> Table:
    inst = design.prototype
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
        "Lengths to make", ("", "mm"), tuple((name, _in("mm", value, 5)) for name, value in rows if value is not None)
    )


def _loads(design: "Design", limits: Limits) -> Table:
    rows = [_load(design, test, limits.pieces) for test in design.tests]
    return Table(
        "Test loads, and what to hang for them on the two cables of the load rig",
        ("loading cable", "counter cable", "real-size [N]", "tip [N]", "cables [N]", "off [%]", "off [N]", "lost [°]"),
        tuple(rows[: limits.loads]),
        texts=2,
        note="off: what hangs minus what is wanted, in N on the real-size tip; lost: output angle that the load takes "
        "with the handle straight, real-size | scaled-up",
        left_out="; ".join(_more(len(rows) - limits.loads, "further test load")),
    )


def _load(design: "Design", test: "TestLoad", pieces: int) -> tuple[str, ...]:
    lost = (
        -np.degrees(statics.output_angle(inst, np.zeros(1), force)[0])
        for inst, force in ((design.model, test.real_force), (design.prototype, test.force))
    )
    return (
        _masses(test.hanging.loading, pieces),
        _masses(test.hanging.counter, pieces),
        _number(test.real_force, 3),
        fixed(test.force, 3),
        fixed(test.hanging.wanted, 2),
        _signed(100 * test.error / test.real_force, 2),
        _signed(test.error, 4),
        " | ".join(fixed(angle, 2) for angle in lost),
    )


def _pretension(design: "Design") -> Table:
    pair = (design.model, design.prototype)
    rows = [("pretension of either tendon [N]", [inst.pretension for inst in pair])]
    for name, angle in (("tip straight", 0.0), ("tip fully bent", design.model.output_range)):
        rows.append((f"slack from, {name} [N]", [float(statics.slack_force(inst, angle)) for inst in pair]))
    return Table(
        "Pretension to set",
        ("", "real-size", "scaled-up", "factor"),
        tuple(
            (name, *(_number(value, 3) for value in values), fixed(values[1] / values[0], 3) if values[0] else "–")
            for name, values in rows
        ),
    )


def _factors(comparison: Comparison) -> Table:
    factors = comparison.factors
    rows = [(name, _factor(factors[key])) for key, name in _FACTORS if key in factors]
    return Table("Factors, scaled-up over real-size", ("", "factor"), (*rows, ("angles", "1")))


def _resolution(design: "Design") -> Table:
    step = math.degrees(design.choice.encoder.range) / 2**design.choice.encoder.bits if design.choice.encoder else None
    rows = [
        ("output angle, by the encoder", "–" if step is None else f"{_number(design.angle_resolution, 2)}°"),
        ("tendon tension, by a load cell", _told(design.tension_resolution, "N", 2)),
        ("force at the tip, by the load cells", _told(design.force_resolution, "N", 2)),
        ("the same, and hung by weights", _told(design.objectives.force_resolution, "N", 2)),
    ]
    return Table("What can be told, real-size", ("", "smallest"), tuple(rows))


def _similarity(design: "Design", error: SimilarityError, drawings: int) -> Table:
    at_rest = design.comparison.error_at_rest(pretension=design.prototype.pretension)
    return Table(
        f"Similarity error, up to {_number(design.comparison.largest_force, 3)}{_SPACE}N real-size",
        ("", "largest", "root mean square"),
        (
            ("without friction", _degrees(error.largest), _degrees(error.rms)),
            ("with friction, at rest", _degrees(at_rest.largest), _degrees(at_rest.rms)),
        ),
        note=f"output angle, scaled-up minus real-size, where both hold the load; {_cause(design, error)}",
        left_out="; ".join(_more(3 - drawings, "drawing")),
    )


def _cause(design: "Design", error: SimilarityError) -> str:
    """Return where the error is largest and which groups make it."""
    try:
        found = design.comparison.causes(pretension=design.prototype.pretension, grid=GRID)
    except ValueError:
        return f"worst at {_place(*error.worst)}"
    if abs(found.error) < _NO_ERROR:
        return "none worth a cause"
    parts = [
        f"{_symbols(cause.name)} {_signed(cause.at_worst, 2)}°"
        for cause in found.causes
        if abs(cause.at_worst) > _WORTH_A_WORD * abs(found.error)
    ]
    return f"worst at {_place(found.place.handle_angle, found.place.force)}, caused by {', '.join(parts)}"


def _place(handle_angle: float, force: float) -> str:
    return f"handle {fixed(math.degrees(handle_angle), 1)}°, {_number(force, 3)}{_SPACE}N real-size"


def _groups(comparison: Comparison, most: int) -> Table:
    there = [group for group in comparison.groups if group.model or group.prototype]
    alike = [_symbols(group.name) for group in there if _matches(group)]
    others = [group for group in there if not _matches(group)]
    held = [group for group in others if group.kind not in _IN_MOTION]
    moved = [
        f"{_symbols(group.name)} × {_factor(group.ratio)}".replace(" ", _SPACE)
        for group in others
        if group.kind in _IN_MOTION
    ]
    rows = tuple(
        (_symbols(group.name), group.kind, _number(group.model, 3), _number(group.prototype, 3), _factor(group.ratio))
        for group in held[:most]
    )
    notes = [f"matching: {', '.join(alike) or 'none'}"]
    if moved:
        notes.append(f"not matching, in motion only: {', '.join(moved)}")
    return Table(
        "Groups that do not match",
        ("", "", "real-size", "scaled-up", "ratio"),
        rows,
        texts=2,
        note="; ".join(notes),
        left_out="; ".join(_more(len(held) - most, "further group")),
    )


def _matches(group: Group) -> bool:
    return group.matches or abs(group.ratio - 1) < _ALIKE


def _symbols(name: str) -> str:
    """Return the name of a group as it is printed."""
    for word, symbol in _SYMBOLS.items():
        name = name.replace(word, symbol)
    return name


def _warnings(design: "Design", error: SimilarityError) -> Iterator[str]:
    constraints, choice = design.catalogue.constraints, design.choice
    similar = design.model.pretension * design.comparison.tension_factor
    off = design.prototype.pretension / similar - 1 if similar else 0.0
    if abs(off) > _SLACK_OFF:
        yield (
            f"Pretension is {_told(design.prototype.pretension, 'N', 3)}, {_number(abs(100 * off), 2)} % "
            f"{'below' if off < 0 else 'above'} the similar {_told(similar, 'N', 3)}: tendons do not go slack at "
            "similar loads."
        )
    for test in design.tests:
        share = test.error / test.real_force
        if abs(share) > constraints.force_tolerance:
            yield (
                f"What hangs for {_told(test.real_force, 'N', 3)} real-size is off by {_signed(100 * share, 2)} %, more "
                f"than {_number(100 * constraints.force_tolerance, 2)} %."
            )
    margin = design.objectives.tension_margin
    if margin < constraints.tension_margin:
        yield f"The rope breaks at {fixed(margin, 2)} × its largest tension; {_number(constraints.tension_margin, 3)} × is asked for."
    spare = choice.load_cell.range / design.largest_tension if design.largest_tension else math.inf
    if spare < constraints.load_cell_margin:
        yield (
            f"The load cells end at {fixed(spare, 2)} × the largest tension; {_number(constraints.load_cell_margin, 3)} × "
            "is asked for."
        )
    if choice.encoder is None:
        yield f"No encoder of the catalogue fits a distal radius of {_told(choice.distal.radius, 'mm', 4, 'm')}."
    if error.held_by_one:
        yield (
            f"On {_number(100 * error.held_by_one, 2)} % of the working range one of the two snaps through and the other "
            f"does not; with a tip at its stop there, the error goes up to {_degrees(error.largest_snapped)}."
        )
    both = error.unsolved - error.held_by_one
    if both > _ROUNDING:
        yield f"On {_number(100 * both, 2)} % of the working range neither holds the load."


def _curves_caption(design: "Design") -> str:
    tests = plan_figures.shown(design.tests)
    which = f" at {len(tests)} of {len(design.tests)} test loads" if len(tests) < len(design.tests) else ""
    return f"Expected output{which}: real-size pale, scaled-up thin"


def _masses(masses: Iterable[float], most: int) -> str:
    """Return masses (kg) as what to take from the box, heaviest first."""
    kinds = sorted(Counter(masses).items(), reverse=True)
    named = [f"{count}{_SPACE}×{_SPACE}{_mass(mass)}" if count > 1 else _mass(mass) for mass, count in kinds[:most]]
    rest = kinds[most:]
    if rest:
        pieces, total = sum(count for _, count in rest), sum(mass * count for mass, count in rest)
        named.append(f"{pieces} smaller, not listed, of {_mass(total)} in all")
    return " + ".join(named) or "nothing"


def _mass(mass: float) -> str:
    unit = "kg" if mass >= 1 else "g" if mass >= 1e-3 else "mg"
    return _told(mass, unit, 6, "kg")


def _told(value: Any, unit: str, digits: int, si_unit: str = "") -> str:
    label = unit.replace("*", "·").replace("^2", "²")
    return f"{_in(unit, value, digits, si_unit)}{_SPACE}{label}"


def _in(unit: str, value: float, digits: int, si_unit: str = "") -> str:
    return _number(value * in_unit(unit, si_unit or {"mm": "m"}.get(unit, unit)), digits)


def _number(value: float, digits: int = 4) -> str:
    """Return a number for reading, as the report has it but in plain text."""
    mantissa, _, power = number(value, digits).partition("<sup>")
    return mantissa + power.removesuffix("</sup>").translate(_POWERS)


def _degrees(value: float) -> str:
    """Return an error (deg) for reading; below a thousandth, that it is."""
    return f"{_number(value, 2)}°" if not abs(value) < _NO_ERROR else f"below {_NO_ERROR:g}°"


def _factor(value: float) -> str:
    return _number(value, 4)


def _signed(value: float, decimals: int) -> str:
    text = fixed(value, decimals)
    is_zero = not text.strip("−0.")
    return text.lstrip("−") if is_zero else text if text.startswith("−") else f"+{text}"


def _more(count: int, what: str) -> Sequence[str]:
    return [f"{count} {what}{'s' if count > 1 else ''} left out: no room on this page"] if count > 0 else []
