"""The workshop plan of a design, as self-contained HTML and as PDF: parts, lengths, weights and expected curves."""

import json
import math
import re
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from errno import EISDIR
from functools import cache
from importlib import resources
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
from markupsafe import Markup, escape

from tenodesis.control.parameters import tension_limit
from tenodesis.errors import DesignError
from tenodesis.extras import require
from tenodesis.report import style
from tenodesis.report.content import fixed
from tenodesis.report.page import about, render, written
from tenodesis.scaling import figures, plan_tables
from tenodesis.scaling.plan_tables import SNAPPED, PlanTable
from tenodesis.scaling.plan_text import angle, falling_short, plain, quantity, signed
from tenodesis.similarity import SimilarityError

if TYPE_CHECKING:
    from tenodesis.scaling.scale_model import Design

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
class Drawing:
    """A figure as SVG, its caption, and the address of a file beside the plan that the page links to."""

    caption: str
    svg: str
    file: str = ""


@dataclass(frozen=True)
class Supplement:
    """What other packages add to a plan: a card beside that of the similarity error if any, and rows at its end."""

    card: Card | None
    rows: tuple[tuple["PlanTable | Drawing", ...], ...]
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Plan:
    """All content of the plan, in plain text; an underscore precedes the index of a symbol such as l_d."""

    title: str
    lead: str
    cards: tuple[Card, ...]
    warnings: tuple[str, ...]
    parts: PlanTable
    lengths: PlanTable
    loads: PlanTable
    pretension: PlanTable
    factors: PlanTable
    resolution: PlanTable
    similarity: PlanTable
    groups: PlanTable
    drawings: tuple[Drawing, ...]
    footer: str
    supplement: Supplement | None = None

    @property
    def rows(self) -> list[list[PlanTable | Drawing]]:
        """Tables and figures in their order on the page, those of a row side by side."""
        output, tensions, errors = self.drawings
        return [
            [self.parts],
            [self.loads],
            [self.lengths, self.factors],
            [self.pretension, self.resolution],
            [output, tensions],
            [self.groups, errors],
            [self.similarity],
            *([] if self.supplement is None else map(list, self.supplement.rows)),
        ]


def content(design: "Design", supplement: Supplement | None = None) -> Plan:
    """Return the content of the plan of a design, with what another package adds to it."""
    error = design.comparison.error(pretension=design.scaled_up.pretension)
    output, tensions, errors = figures.plan_figures(design, error)
    return Plan(
        title=f"{design.scaled_up.name}: scale model of {design.real_size.name}",
        lead=_lead(design),
        cards=_cards(design, error, supplement),
        warnings=(*_warnings(design, error), *(supplement.warnings if supplement else ())),
        parts=plan_tables.parts(design),
        lengths=plan_tables.lengths(design),
        loads=plan_tables.loads(design),
        pretension=plan_tables.pretension(design),
        factors=plan_tables.factors(design.comparison),
        resolution=plan_tables.resolution(design),
        similarity=plan_tables.similarity(design, error),
        groups=plan_tables.groups(design.comparison),
        drawings=(
            Drawing(_output_caption(design), output),
            Drawing("Expected tensions, scaled-up, and their bounds", tensions),
            Drawing("Scaled-up minus real-size output angle", errors),
        ),
        footer=f"tenodesis {about()['tenodesis']} · curves and loads without friction · "
        "research software, not a medical device",
        supplement=supplement,
    )


def write(design: "Design", folder: Path, supplement: Supplement | None = None) -> tuple[Path, Path]:
    """Write the plan of a design as plan.html and plan.pdf (A4) to a folder, both or neither, and return their paths.

    Raises DesignError if the folder cannot be written.
    """
    plan = content(design, supplement)
    files = {"plan.html": html(plan).encode(), "plan.pdf": pdf(plan)}
    with written(folder, DesignError) as new:
        for name, data in files.items():
            if (folder / name).is_dir():
                raise IsADirectoryError(EISDIR, f"{name} is a folder")
            (new / name).write_bytes(data)
    return folder / "plan.html", folder / "plan.pdf"


def html(plan: Plan) -> str:
    """Return the plan as an HTML page."""
    return render("tenodesis.scaling", "plan.html.j2", plan=plan, colors=_colors(), marked=_marked)


def pdf(plan: Plan) -> bytes:
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
