"""The plan of a scale model of several joints: what to build, with which weights, and how similar it is."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tenodesis.instrument.joints import Joint
from tenodesis.report import style
from tenodesis.report.content import Chart
from tenodesis.report.page import about, inline_svg
from tenodesis.scaling.joints import JointDesign
from tenodesis.scaling.plan import (
    Card,
    PlanFigure,
    PlanTable,
    ScalePlan,
    Supplement,
    angle,
    factors,
    groups,
    masses,
    parts,
    plain,
    quantity,
    resolution,
    write_plan,
)
from tenodesis.similarity.joints import JointComparison, JointError
from tenodesis.statics import chain
from tenodesis.statics.bends import Bends

_POINTS = 21
_LEAST = 1e-6  # m


@dataclass(frozen=True)
class AsBuilt:
    """Largest errors that a share of the instruments keep that are built to tolerances."""

    share: float
    joints: tuple[float, ...]
    """By joint, deg"""
    tip: float
    """At the real-size tip, m"""


def write(
    design: JointDesign, folder: Path, built: AsBuilt | None = None, supplement: Supplement | None = None
) -> tuple[Path, Path]:
    """Write the plan as plan.html and plan.pdf, and return their paths; raises DesignError if they cannot be."""
    return write_plan(content(design, built, supplement), folder)


def distance(metres: float) -> str:
    """Return an error at the tip as text."""
    return quantity(metres, "mm", 2, "m") if metres >= _LEAST else f"<{1e3 * _LEAST:g} mm"


def content(design: JointDesign, built: AsBuilt | None = None, supplement: Supplement | None = None) -> ScalePlan:
    """Return the content of the plan of a design, with what another package adds to it."""
    pair, error = design.comparison, design.error
    cards = [
        Card(f"× {plain(pair.factors['length'])}", "length, scaled-up over real-size"),
        Card(f"× {plain(pair.factors['force'])}", "force at the tip, scaled-up over real-size"),
        Card(angle(float(error.largest.max())), "as designed: largest similarity error of a joint, without friction"),
        Card(distance(error.largest_at_tip), "the same at the real-size tip"),
    ]
    if built is not None:
        share = f"{100 * built.share:g} %"
        cards.append(Card(angle(max(built.joints)), f"as built: {share} keep, with friction, by usual tolerances"))
    if supplement is not None and supplement.card is not None:
        cards.append(supplement.card)
    return ScalePlan(
        title=f"{design.scaled_up.name}: scale model of {design.real_size.name}",
        lead=f"{', '.join(pair.joints)} · {len(design.scaled_up.tendons)} tendons · catalogue {design.catalogue.name}",
        cards=tuple(cards),
        warnings=(*_warnings(design), *(supplement.warnings if supplement else ())),
        rows=(
            (parts(design),),
            (_loads(design),),
            (_lengths(design), factors(pair)),
            (_tendons(design), resolution(design)),
            (_losses(design),),
            (_similarity(design, built),),
            (groups(pair, named=True),),
            *(supplement.rows if supplement else ()),
        ),
        footer=f"tenodesis {about()['tenodesis']} · research software, not a medical device",
    )


def _loads(design: JointDesign) -> PlanTable:
    rows = tuple(
        (
            "between the jaws" if test.direction == "grip_force" else f"along {test.direction[-1]}",
            quantity(test.real_force, "N", 3),
            quantity(test.weights.wanted, "N", 4),
            masses(test.weights.loading),
            masses(test.weights.counter),
            f"{100 * test.weights.relative_error:+.2g} %",
        )
        for test in design.tests
    )
    columns = ("force at the tip", "real-size", "scaled-up", "loading cable", "counter cable", "off by")
    return PlanTable("Test loads, on two cables that pull at the tip against each other", columns, rows, 1, (0, 3, 4))


def _lengths(design: JointDesign) -> PlanTable:
    inst = design.scaled_up
    rows = [("tendons, from spool to tip", inst.tendon_length), ("stem", inst.stem_length)]
    for joint in inst.as_given("joints"):
        rows += [(f"{joint.name}: {text}", value) for text, value in _of_joint(joint)]
    if inst.grip is not None and inst.grip.length:
        rows.append(("jaws' axis to what they hold", inst.grip.length))
    table = tuple((name, f"{1e3 * value:.5g}") for name, value in rows if value)
    return PlanTable("Lengths to make", ("", "mm"), table, names=True)


def _of_joint(joint: Joint) -> Iterator[tuple[str, float | None]]:
    yield "before it", joint.offset
    yield "backbone", joint.backbone_length
    yield "to where forces act", joint.end_effector_length


def _tendons(design: JointDesign) -> PlanTable:
    inst = design.scaled_up
    rows = tuple(
        (tendon.name, quantity(float(tension), "N", 4), quantity(float(stiffness), "N/mm", 4, "N/m"))
        for tendon, tension, stiffness in zip(inst.tendons, inst.pretensions, inst.stiffnesses, strict=True)
    )
    return PlanTable("Tendons", ("", "pretension", "stiffness"), rows, names=True)


def _similarity(design: JointDesign, built: AsBuilt | None) -> PlanTable:
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


def _angles(inst: object, handle: np.ndarray, strokes: np.ndarray, wrench: np.ndarray, grip: np.ndarray) -> np.ndarray:
    return chain.output_angles(inst, handle, wrench, grip_force=grip, strokes=strokes)  # type: ignore[arg-type]


def _warnings(design: JointDesign) -> Iterator[str]:
    if design.error.unsolved > design.comparison.error().unsolved:
        yield "Where both do not hold a load, no error is counted."
    for name, spring in design.choice.springs:
        yield f"The spring of {name}, {spring:.4g} N m/rad, is in no catalogue: it must be made, or set by trying."
    if any(tendon.stiffness_by_tension is not None for tendon in design.scaled_up.tendons):
        yield "Ropes whose stiffness grows with the tension must have the scaled table of the instrument file."
