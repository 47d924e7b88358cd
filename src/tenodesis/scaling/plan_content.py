"""What a workshop plan says of a design: every text and number, formatted once for whatever shows it."""

from dataclasses import dataclass
from textwrap import shorten
from typing import TYPE_CHECKING

from tenodesis.report.content import fixed
from tenodesis.scaling import plan_figures, plan_similarity, plan_tables
from tenodesis.scaling.plan_tables import Limits, Table
from tenodesis.scaling.plan_text import degrees, more, told
from tenodesis.scaling.plan_warnings import warnings
from tenodesis.similarity import SimilarityError

if TYPE_CHECKING:
    from tenodesis.scaling.design import Design

_LONG = 120  # characters; a name made of many names is cut


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
    from tenodesis.version import __version__  # noqa: PLC0415

    error = design.comparison.error(pretension=design.scaled_up.pretension)
    said = list(warnings(design, error))
    curves, tensions, errors = plan_figures.drawn(design, error)
    return Plan(
        title=f"{design.scaled_up.name}: scale model of {design.real_size.name}",
        lead=_lead(design),
        cards=_cards(design, error),
        parts=plan_tables.parts(design),
        lengths=plan_tables.lengths(design),
        loads=plan_tables.loads(design, limits),
        pretension=plan_tables.pretension(design),
        factors=plan_tables.factors(design.comparison),
        resolution=plan_tables.resolution(design),
        similarity=plan_similarity.similarity(design, error, limits.drawings),
        groups=plan_similarity.groups(design.comparison, limits.groups),
        drawings=(
            Drawing(_curves_caption(design), curves),
            Drawing("Expected tensions, scaled-up, and their bounds", tensions),
            Drawing("Scaled-up minus real-size output angle", errors),
        )[: limits.drawings],
        warnings=(*said[: limits.warnings], *more(len(said) - limits.warnings, "further warning")),
        footer=f"tenodesis {__version__} · curves and loads without friction · research software, not a medical device",
    )


def _lead(design: "Design") -> str:
    axis = f"axis {design.scaled_up.axes[0]}" if len(design.scaled_up.axes) == 1 else "both axes alike"
    joints = dict.fromkeys((design.scaled_up.joint_type, design.real_size.joint_type))
    catalogue = shorten(design.catalogue.name, _LONG, placeholder=" …")
    return f"{' for '.join(joints)} joint · {axis} · from catalogue {catalogue}"


def _cards(design: "Design", error: SimilarityError) -> tuple[Card, ...]:
    scaled_up, real_size = design.scaled_up.pretension, design.real_size.pretension
    counted = f", {plan_similarity.STOPPED}" if error.held_by_one else ""
    return (
        Card(told(scaled_up, "N", 3), f"pretension to set on either tendon ({told(real_size, 'N', 3)} real-size)"),
        Card(f"× {fixed(float(design.comparison.force_factor()), 3)}", "force at the tip, scaled-up over real-size"),
        Card(degrees(design.objectives.similarity_error), f"largest similarity error over the working range{counted}"),
        Card(told(design.objectives.force_resolution, "N", 2), "smallest real-size tip force that can be told"),
        Card(f"{fixed(design.objectives.tension_margin, 1)} ×", "rope's breaking load over its largest tension"),
    )


def _curves_caption(design: "Design") -> str:
    tests = plan_figures.shown(design.tests)
    which = f" at {len(tests)} of {len(design.tests)} test loads" if len(tests) < len(design.tests) else ""
    return f"Expected output{which}: real-size pale, scaled-up thin"
