"""A comparison with poses of another solver as a figure, and as a self-contained HTML page."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from tenodesis.errors import ReportError
from tenodesis.files import atomic_file, write_errors
from tenodesis.poses.comparison import PoseComparison
from tenodesis.report import style
from tenodesis.report.content import Chart, Table, fixed
from tenodesis.report.page import inline_svg, render

_MOST_ROWS = 40
"""Poses of the table; of more, those with the largest errors."""


def plot(found: PoseComparison) -> Figure:
    """Return the figure: tips of both seen from two sides, and the error of each pose."""
    with style.applied():
        chart, panels = Chart.panels(3, width=10.5, height=3.9)
        theirs, ours = 1e3 * found.given.position, 1e3 * found.position
        for axis, side, name in zip(panels, (0, 1), "xy", strict=False):
            axis.plot(theirs[:, side], theirs[:, 2], "o", ms=6, mfc="none", color=style.REFERENCE, label="reference")
            axis.plot(ours[:, side], ours[:, 2], ".", ms=4, color=style.ACCENT, label="instrument")
            axis.set(xlabel=f"{name} [mm]", ylabel="z [mm]", title=f"Tip, seen in {name} and z")
            axis.set_aspect("equal", adjustable="datalim")
        panels[0].legend(loc="best")
        rows = np.arange(1, len(theirs) + 1)
        panels[2].plot(rows, 100 * found.error / found.length, ".", color=style.ACCENT)
        panels[2].set(xlabel="pose", ylabel="error [% of length]", title="Error of the tip's place")
        panels[2].set_ylim(bottom=0)
    return chart.figure


def table(found: PoseComparison, most: int = _MOST_ROWS) -> Table:
    """Return the poses, of more than `most` those with the largest errors: place by the reference, and errors."""
    order = np.argsort(-np.nan_to_num(found.error, nan=np.inf), kind="stable")
    shown = range(len(order)) if len(order) <= most else order[:most].tolist()
    columns = ["pose", "x [mm]", "y [mm]", "z [mm]", "error [mm]", "of length [%]"]
    columns += [] if found.angle_error is None else ["angle [°]"]
    rows = []
    for at in shown:
        row = [str(at + 1), *(fixed(1e3 * value) for value in found.given.position[at])]
        row += [fixed(1e3 * found.error[at], 3), fixed(100 * found.error[at] / found.length, 3)]
        rows.append(row + ([] if found.angle_error is None else [fixed(np.degrees(found.angle_error[at]), 3)]))
    of = "All poses" if len(order) <= most else f"The {most} of {len(order)} poses with the largest errors"
    return Table(f"{of}: place of the tip by the reference, and errors of {found.inst.name}", columns, rows)


def write(found: PoseComparison, path: Path) -> None:
    """Write the page; raises ReportError if it cannot be written."""
    page = render(
        "tenodesis.poses",
        "poses.html.j2",
        found=found,
        summary=[(name, f"{value:.3g}") for name, value in found.summary.items()],
        table=table(found),
        drawing=inline_svg("tips", plot(found)),
    )
    with write_errors(path, ReportError), atomic_file(path) as new:
        new.write_text(page, "utf-8")
