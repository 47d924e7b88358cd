"""The figures of a plan's parts: the error budget, and the designs by what a workshop asks."""

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tenodesis.report import style
from tenodesis.report.page import inline_svg
from tenodesis.scaling.practical import OBJECTIVES, PracticalFront
from tenodesis.workshop.budget import Budget
from tenodesis.workshop.words import NAMES

_SMALL: Any = {"font.size": 6.5, "legend.fontsize": 6, "axes.linewidth": 0.6, "axes.titlesize": 7}
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
    at = np.arange(len(rows))
    fig = Figure(figsize=(7.3, 0.4 + 0.2 * len(rows)), layout="constrained")
    left, right = fig.subplots(1, 2, sharey=True)
    for axis, values, color, label in (
        (left, [100 * one.share for one in rows], style.ACCENT, "share of the error [%]"),
        (right, [one.cost for one in rows], style.ANTAGONIST, "cost of its tolerance"),
    ):  # fmt: skip
        axis.barh(at, values, color=color, height=0.65)
        axis.set(xlabel=label, xlim=(0, 1.18 * max(values, default=1.0) or 1.0))
        axis.grid(visible=False, axis="y")
        for y, value in zip(at, values, strict=True):
            axis.annotate(f"{value:.3g}", (value, y), (3, 0), textcoords="offset points", va="center", fontsize=6)
    left.set_yticks(at, [f"{NAMES[one.key].replace('_', '')}, {one.grade.name}" for one in rows])
    left.tick_params(axis="y", length=0, labelcolor=style.INK)
    right.tick_params(axis="y", length=0)
    return fig


def _practical(found: PracticalFront, chosen: int | None) -> Figure:
    columns = found.columns
    fig = Figure(figsize=(7.3, 2.3), layout="constrained")
    left, right = fig.subplots(1, 2)
    weeks = np.floor(columns[:, 2] + 1e-9).astype(int)
    panels = (
        (left, 1e3 * columns[:, 1], "overall length [mm]"),
        (right, columns[:, 3], "error as built, 95 % [°]"),
    )
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
