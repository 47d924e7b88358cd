"""All that a workshop needs besides the plan: its supplement, and the files that go with it."""

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from textwrap import fill
from typing import Any

import matplotlib as mpl
import numpy as np
import tomli_w
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tenodesis.control.controller import fault_names
from tenodesis.control.export import header, joints_header
from tenodesis.report import style
from tenodesis.report.content import fixed
from tenodesis.report.page import inline_svg
from tenodesis.scaling import AnyDesign
from tenodesis.scaling.plan import Card, PlanFigure, PlanTable, Supplement, angle, plain, quantity
from tenodesis.scaling.practical import OBJECTIVES, PracticalFront
from tenodesis.workshop.budget import BACKLASHES, PULLEY, TARGET, Budget, Spread, named, nominal, tolerance, tolerate
from tenodesis.workshop.first_run import CONTROLLED, FIRST_RUN, FirstRun, law_of, protocol_text, rehearse
from tenodesis.workshop.order import HEADER, Item, Step, checklist, order_list

_SMALL: Any = {"font.size": 6.5, "legend.fontsize": 6, "axes.linewidth": 0.6, "axes.titlesize": 7}
_LINE = 60  # letters of a label
_LINE_HEIGHT = 0.65  # of a line of a label, over a bar's row
_LEAST = 0.01  # the smallest number beside a bar
_SHOWN = 0.005  # of the error or of the cost: smaller shares have no bar


def budget_svg(budget: Budget) -> str:
    """Return the figure of an error budget as SVG: share of the error and cost of every dimension."""
    with style.applied(), mpl.rc_context(_SMALL):
        return inline_svg("budget", _budget(budget))


def practical_svg(found: PracticalFront, chosen: int | None) -> str:
    """Return the figure of the designs by cost, length, waiting and robustness as SVG; `chosen` is marked."""
    with style.applied(), mpl.rc_context(_SMALL):
        return inline_svg("practical", _practical(found, chosen))


def _budget(budget: Budget) -> Figure:
    total = budget.cost or 1.0
    rows = [one for one in budget.dimensions.values() if max(one.share, one.cost / total) >= _SHOWN][::-1]
    labels = [fill(f"{named(one.key).replace('_', '')}, {one.grade.name}", _LINE) for one in rows]
    heights = np.array([max(1.0, _LINE_HEIGHT * (1 + label.count("\n"))) for label in labels])
    at = np.cumsum(heights) - heights / 2
    fig = Figure(figsize=(7.3, 0.4 + 0.2 * heights.sum()), layout="constrained")
    left, right = fig.subplots(1, 2, sharey=True)
    for axis, values, color, label in (
        (left, [100 * one.share for one in rows], style.ACCENT, "share of the error [%]"),
        (right, [one.cost for one in rows], style.ANTAGONIST, "cost of its tolerance"),
    ):  # fmt: skip
        axis.barh(at, values, color=color, height=0.65)
        axis.set(xlabel=label, xlim=(0, 1.18 * max(values, default=1.0) or 1.0))
        axis.grid(visible=False, axis="y")
        for y, value in zip(at, values, strict=True):
            text = f"<{_LEAST:g}" if 0 < value < _LEAST else f"{value:.3g}"
            axis.annotate(text, (value, y), (3, 0), textcoords="offset points", va="center", fontsize=6)
    left.set_yticks(at, labels)
    left.tick_params(axis="y", length=0, labelcolor=style.INK)
    right.tick_params(axis="y", length=0)
    return fig


def _practical(found: PracticalFront, chosen: int | None) -> Figure:
    columns = found.columns
    fig = Figure(figsize=(7.3, 2.3), layout="constrained")
    left, right = fig.subplots(1, 2)
    weeks = np.floor(columns[:, 2] + 1e-9).astype(int)
    panels = ((left, 1e3 * columns[:, 1], "overall length [mm]"), (right, columns[:, 3], "error as built, 95 % [°]"))
    for axis, x, name in panels:
        for count, marker in zip(sorted(set(weeks.tolist())), "osD^v", strict=False):
            of = weeks == count
            label = "wheels and rope in days" if not count else f"{count} kind{'s' * (count > 1)} in weeks"
            axis.scatter(
                x[of], columns[of, 0], marker=marker, s=14, color=style.LOADS[min(count, 3)], label=label, linewidths=0
            )
        axis.set(xlabel=name, ylabel="cost of parts")
        axis.margins(0.12)
        _mark(axis, found, x, chosen)
    handles, labels = left.get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside upper left", ncols=4)
    return fig


def _mark(axis: Axes, found: PracticalFront, x: Any, chosen: int | None) -> None:
    """Mark the best designs by every objective; a design that is best by several has all their names."""
    best: dict[int, list[str]] = {}
    for objective in OBJECTIVES:
        best.setdefault(found.best(objective), []).append(objective)
    for place, (n, names) in enumerate(best.items()):
        where: Any = {"textcoords": "offset points", "fontsize": 6, "zorder": 6}
        right = x[n] < (x.min() + x.max()) / 2
        axis.annotate(
            ", ".join(names), (x[n], found.columns[n, 0]), (5 if right else -5, -9 if place % 2 else 4),
            ha="left" if right else "right", **where,
        )  # fmt: skip
        ring: Any = {"s": 45, "facecolors": "none", "edgecolors": style.INK, "linewidths": 0.8}
        axis.scatter(x[n], found.columns[n, 0], **ring)
    if chosen is not None:
        axis.scatter(x[chosen], found.columns[chosen, 0], marker="*", s=60, color=style.ACCENT, zorder=7)


ORDER, TOLERANCES, STUDY, CHECKLIST = "order.csv", "tolerances.csv", "tolerances.toml", "checklist.csv"
FILES = (ORDER, TOLERANCES, STUDY, CHECKLIST, FIRST_RUN, CONTROLLED, HEADER)
"""Names of the files of a pack."""
_NAMED = 3  # causes in a sentence
_LEAST_CAUSE = 0.05


@dataclass(frozen=True)
class Pack:
    """The tolerances, order list, checklist and first run of a design; :func:`prepare` makes it."""

    design: AnyDesign
    budget: Budget
    first_run: FirstRun
    items: tuple[Item, ...]
    steps: tuple[Step, ...]
    practical: PracticalFront | None = None

    def supplement(self, chosen: int | None = None) -> Supplement:
        """Return what the plan shows of it; `chosen` is the design's index on the practical front."""
        budget = self.budget
        rows: list[tuple[PlanTable | PlanFigure, ...]] = [
            (_as_built(budget),),
            (_tolerances(budget),),
            (PlanFigure("Where the error comes from, and what each tolerance costs", budget_svg(budget)),),
            (_order(self.items),),
            (_checklist(self.steps),),
            (_readings(self.first_run),),
        ]
        if self.practical is not None:
            caption = (
                "Designs that none beats in cost, length, time to get and robustness; ringed: best by an objective"
            )
            rows += [(_objectives(self.practical),), (PlanFigure(caption, practical_svg(self.practical, chosen)),)]
        return Supplement(_card(budget), tuple(rows), tuple(_warnings(budget, self.first_run.faults)))

    def write(self, folder: Path) -> None:
        """Write the files of the pack to a folder; see :data:`FILES`. Raises OSError if it cannot be written."""
        about = (
            f"Similarity error as designed {self.budget.designed:.2g} deg; as built to the plan's tolerances "
            f"{100 * self.budget.share:g} % keep {self.budget.built.kept:.2g} deg."
        )
        texts = {
            ORDER: to_csv(Item._fields, self.items),
            CHECKLIST: to_csv(("step", "do", "see"), [(str(n), *step) for n, step in enumerate(self.steps, 1)]),
            FIRST_RUN: protocol_text(self.design, about),
            CONTROLLED: protocol_text(self.design, about, controlled=True),
            HEADER: controller_header(self.design),
        }
        texts[TOLERANCES] = to_csv(_TOLERANCE_COLUMNS, _tolerance_rows(self.budget))
        texts[STUDY] = study_file(self.budget)
        for name, text in texts.items():
            (folder / name).write_text(text, "utf-8")


def controller_header(design: AnyDesign) -> str:
    """Return the C header of the controller that the first run tries."""
    inst = design.scaled_up
    return joints_header(inst) if law_of(design.bench) == "joints" else header(inst, homed=False)


def prepare(
    design: AnyDesign,
    practical: PracticalFront | None = None,
    *,
    target: float = TARGET,
    backlash: float | None = None,
    progress: Callable[[str, int, int], object] = lambda *_: None,
) -> Pack:
    """Return tolerances, order list, checklist and first run of a design.

    Parameters
    ----------
    design
        The design.
    practical
        The designs by what a workshop asks, to be shown with it.
    target
        Similarity error, deg, that 95 % of the instruments built must keep.
    backlash
        Play of gears that are printed or milled, m along the pitch circle; by default gears are cut and bought.
    progress
        Called with the name of the step, the amount done and the total.

    Raises
    ------
    StudyError, ProtocolError
        The design does not hold its test forces, or the twin cannot run its first run.
    ValueError
        The target or the backlash is out of its range.
    """
    progress("choosing tolerances", 0, 2)
    budget = tolerate(design.real_size, design.scaled_up, target=target, backlash=backlash)
    progress("running the twin", 1, 2)
    first = rehearse(design)
    progress("running the twin", 2, 2)
    return Pack(design, budget, first, order_list(design, first.demand), checklist(design, budget, first), practical)


def study_file(budget: Budget) -> str:
    """Return the text of a tolerance file, for ``tenodesis tolerance``, without pulley of the rig and play of gears."""
    tables: list[dict[str, Any]] = []
    for one in budget.dimensions.values():
        if one.key == PULLEY or one.key in BACKLASHES:
            continue
        width = f"{1e3 * one.tolerance:.6g} mm" if one.is_drawn else f"{100 * one.tolerance / one.nominal:.6g} %"
        kind = {"distribution": "normal", "standard_deviation": width} if one.grade.is_normal else {
            "distribution": "uniform", "half_width": width}  # fmt: skip
        source = f"{one.grade.name}; {one.grade.source}"[:200]
        tables += [{"key": key, **kind, "source": source} for key in one.keys]
    about = (
        f"keeps {budget.target:g} deg for {100 * budget.share:g} % of the instruments built" if budget.is_kept else ""
    )
    return tomli_w.dumps({"name": "as drawn", "description": about, "parameters": tables})


def _card(budget: Budget) -> Card:
    built = budget.built
    return Card(
        f"{angle(built.median)}, {angle(built.kept)}",
        f"as built: its median, and what {100 * budget.share:g} % of the instruments keep with the tolerances below, "
        f"{_up_to(budget)}",
    )


def _up_to(budget: Budget) -> str:
    forces = budget.forces or tuple(budget.by_force)
    return f"up to {plain(max(forces), 3)} N real-size"


def _warnings(budget: Budget, faults: int) -> list[str]:
    keeps = f"{100 * budget.share:g} % of the instruments built"
    found = []
    if faults:
        found.append(
            f"On the twin the controller faults in the first run: {', '.join(fault_names(faults))}. Change the "
            "instrument before it is built."
        )
    if not budget.is_kept:
        found.append(
            f"No set of grades keeps {angle(budget.target)} for {keeps}: all that lower the error by 1 % for a cost of "
            f"1 leave {angle(budget.built.kept)}, of which {angle(budget.designed)} is designed. Take a more similar "
            "design, or give a larger --as-built."
        )
    elif len(budget.forces) < len(budget.by_force):
        worst = max(budget.by_force)
        found.append(
            f"{angle(budget.target)} is kept up to {plain(max(budget.forces), 3)} N real-size only; at "
            f"{plain(worst, 3)} N the same tolerances leave {angle(budget.by_force[worst].kept)} for {keeps}."
        )
    if budget.play_as_made:
        left = sum(budget.dimensions[key].effect for key in BACKLASHES)
        found.append(
            "The gears' play turns the links, not the tip, which the tendons hold; but encoders at the joints' axes "
            f"read the links: up to {angle(budget.play_as_made)} off with gears as bought or made, {angle(left)} with "
            "the grades below."
        )
    if budget.has_friction:
        found.append(
            f"Friction is no tolerance: with coefficients 20 % off those of the real-size instrument, {keeps} keep "
            f"{angle(budget.with_friction.kept)} only. Use the same rope on the same material, and identify it."
        )
    else:
        found.append(
            "The instrument file has no friction, so that errors, readings and the controller's guess are without it; "
            "the instrument will have some: identify it, and write it into the file."
        )
    return found


def _as_built(budget: Budget) -> PlanTable:
    share = f"{100 * budget.share:g} %"
    rows = [
        ("as designed, with friction", angle(budget.designed), ""),
        _spread("with the tolerances below", budget.built),
    ]
    for force, spread in budget.by_force.items():
        rows.append(_spread(f"of these, at {plain(force, 3)} N real-size", spread))
    if budget.has_friction:
        rows.append(_spread("the same, and friction 20 % off", budget.with_friction))
    rows.append(_spread("everything by its cheapest grade", budget.coarsest))
    coarsest = sorted(budget.coarsest_shares.items(), key=lambda item: -item[1])
    return PlanTable(
        f"Largest similarity error, as designed and as built, {_up_to(budget)}",
        ("", "median", f"{share} keep"),
        tuple(rows),
        note=f"{budget.samples} instruments drawn and run on the quasi-static twin, largest difference of the output "
        "angle over a loop of the handle; caused by "
        f"{_causes([(key, one.share) for key, one in budget.dimensions.items()])}; "
        f"with the cheapest grades by {_causes(coarsest)}",
    )


def _spread(name: str, spread: Spread) -> tuple[str, str, str]:
    kept = angle(spread.kept) if np.isfinite(spread.kept) else "tip lost"
    return name, angle(spread.median) if np.isfinite(spread.median) else "tip lost", kept


def _causes(shares: Sequence[tuple[str, float]]) -> str:
    shown = [f"{named(key)} {100 * share:.0f} %" for key, share in shares[:_NAMED] if share >= _LEAST_CAUSE]
    return ", ".join(shown)


_TOLERANCE_COLUMNS = (
    "key", "dimension", "nominal [SI]", "tolerance [SI]", "kind", "grade", "share of error", "alone [deg]", "cost",
    "on a drawing", "source",
)  # fmt: skip


def _tolerance_rows(budget: Budget) -> list[tuple[str, ...]]:
    return [
        (
            " ".join(one.keys), named(one.key), f"{one.nominal:.9g}", f"{one.tolerance:.6g}",
            "standard deviation" if one.grade.is_normal else "half width", one.grade.name, f"{one.share:.4f}",
            f"{one.effect:.4f}", f"{one.cost:.4g}", "yes" if one.is_drawn else "no", one.grade.source,
        )
        for one in budget.dimensions.values()
    ]  # fmt: skip


def _tolerances(budget: Budget) -> PlanTable:
    rows = [
        (
            named(one.key), one.grade.name, nominal(one), tolerance(one), f"{100 * one.share:.0f}",
            fixed(one.effect, 3), fixed(one.cost, 1),
        )
        for one in budget.dimensions.values()
    ]  # fmt: skip
    rows.append(("all", "", "", "", "100", "", fixed(budget.cost, 1)))
    return PlanTable(
        f"Tolerances: the cheapest set found that keeps {angle(budget.target)} for {100 * budget.share:g} % of the "
        f"instruments, {_up_to(budget)}" if budget.is_kept
        else "Tolerances: each that lowers the error by 1 % for a cost of 1",
        ("dimension or setting", "grade", "nominal", "tolerance", "of error [%]", "alone [°]", "cost"),
        tuple(rows),
        texts=2,
        wide=(0, 1),
        note="radii are to the rope's centre; IT grades and ISO 2768 hold for the diameter, so that a radius has half. "
        "s: standard deviation of a setting. alone: largest error by it alone. Costs are ours, 1 is one part turned to "
        "general tolerances",
    )  # fmt: skip


def _order(items: Sequence[Item]) -> PlanTable:
    return PlanTable(
        "Order list (order.csv has the sources)",
        ("no.", "part", "take", "which must", "in", "known"),
        tuple((one.number, one.part, one.designation, one.requirement, one.lead, one.status) for one in items),
        texts=6,
        wide=(2, 3),
        names=True,
        note="in: days from stock, weeks on order, or made in the workshop. known: second hand is quoted by "
        "others, to be "
        "checked is assumed; ask the maker before you order",
    )


def _checklist(steps: Sequence[Step]) -> PlanTable:
    return PlanTable(
        "Assembly, from rope to the controller",
        ("", "do", "see, before you go on"),
        tuple((str(n), *step) for n, step in enumerate(steps, 1)),
        texts=3,
        wide=(1, 2),
        names=True,
    )


def _readings(run: FirstRun) -> PlanTable:
    rows = []
    for one in run.readings:
        digits, unit = (1, "°") if one.unit == "deg" else (1, "\u00a0N")
        low, value, high = (fixed(number, digits) for number in (one.low, one.expected, one.high))
        rows.append((one.step, one.what, one.otherwise, f"{value}{unit}", f"{low} … {high}"))
    return PlanTable(
        "First run: what must be read",
        ("step", "read", "if it is not", "expected", "between"),
        tuple(rows),
        texts=3,
        wide=(0, 2),
        names=True,
        note="by the twin without a controller; between: for half to twice the guessed friction, and what the "
        "sensors leave "
        f"open. With the controller every joint comes back to {angle(run.left)} under each of these loads",
    )


def _objectives(found: PracticalFront) -> PlanTable:
    rows = []
    for objective in OBJECTIVES:
        index = found.best(objective)
        one, error = found.practical[index], found.exact[index].similarity_error
        weeks = int(one.waiting + 1e-9)
        rows.append(
            (
                objective, found.described(index), plain(one.cost, 3), quantity(one.overall_length, "mm", 4, "m"),
                f"{weeks}, {10 * (one.waiting - weeks):.0f}", angle(error), angle(one.as_built),
            )
        )  # fmt: skip
    return PlanTable(
        "The same instrument by other objectives (--objective)",
        ("", "", "cost", "length", "weeks, made", "as designed", "as built"),
        tuple(rows),
        texts=2,
        wide=(1,),
        note="cost of parts, 1 is one part turned to general tolerances (ours); weeks: kinds of wheels and ropes "
        "that take "
        "weeks, made: parts to make. as built: what 95 % keep with tolerances of about IT10 and ISO 2768-m, a "
        "rope known to "
        "2 % and a pretension to 1 %, without friction, by linear propagation",
    )


def to_csv(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return rows of text as CSV, with plain spaces."""
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([field.replace("\u00a0", " ") for field in row] for row in rows)
    return text.getvalue()
