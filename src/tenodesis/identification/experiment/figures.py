"""The figures of a plan: the protocol, and the predicted precision of parameters with and without it."""

import math

import numpy as np
from matplotlib.figure import Figure

from tenodesis.identification.experiment.plan import HALF, Plan
from tenodesis.identification.figures import readable
from tenodesis.report import style

_KEPT = 4000
"""Samples drawn."""
_FLOOR = 1e-12


def course(plan: Plan) -> Figure:
    """Return angles, force, spools and tensions over time, block by block."""
    run = plan.run
    every = max(1, len(run) // _KEPT)
    time = run.time[::every]
    fig = Figure(figsize=(8.6, 6.6), layout="constrained")
    angles, force, spools, tensions = fig.subplots(4, 1, sharex=True, height_ratios=[2, 1, 1, 2])
    angles.plot(time, np.degrees(run["handle_angle"][::every]), color=style.INK, lw=1.2, label="handle")
    angles.plot(time, np.degrees(run["output_angle"][::every]), color=style.ACCENT, lw=1.2, label="tip")
    angles.set_ylabel("angle [°]")
    force.plot(time, run["force"][::every], color=style.LOADS[0], lw=1.2)
    force.set_ylabel("force [N]")
    wound = 1e3 * plan.inst.drives.spool_radius * run["spool_angle"][::every]
    for n, (name, colour) in enumerate((("agonist", style.AGONIST), ("antagonist", style.ANTAGONIST))):
        spools.plot(time, wound[:, n], color=colour, lw=1.2)
        tensions.plot(time, run["tension"][::every, n], color=colour, lw=1.2, label=name)
    if not np.ptp(wound):
        spools.set_ylim(-1, 1)
    spools.set_ylabel("wound [mm]")
    tensions.set_ylabel("tension [N]")
    tensions.set_xlabel("time [s]")
    for number, block in enumerate(plan.blocks, 1):
        for axis in (angles, force, spools, tensions):
            if number % 2:
                axis.axvspan(block.begins, block.begins + block.seconds, color=style.GRID, alpha=0.6, lw=0, zorder=0)
        angles.text(
            block.begins + block.seconds / 2, 0.98, str(number), transform=angles.get_xaxis_transform(),
            ha="center", va="top", fontsize=8, color=style.MUTED,
        )  # fmt: skip
    for axis in (angles, tensions):
        style.legend_above(axis, 2)
    angles.margins(x=0, y=0.12)
    fig.align_ylabels()
    return fig


def intervals(plan: Plan) -> Figure:
    """Return the half width of each wanted parameter's 95 % interval, by the proposed protocol and the others."""
    names = [name for name in plan.wanted if name in plan.open]
    predictions = [plan.proposed, *plan.baselines]
    fig, (axis,) = style.figure(1, width=8.6, height=1.4 + 0.42 * len(names))
    marks = (("o", style.ACCENT), ("s", style.REFERENCE), ("D", style.INK))
    for one, (mark, colour) in zip(predictions, marks, strict=False):
        widths = [_half_width(plan, name, one.std[name]) for name in names]
        axis.plot(widths, range(len(names)), mark, color=colour, ms=7, label=one.name, clip_on=False)
        for row, width in enumerate(widths):
            if not math.isfinite(width):
                axis.annotate(
                    "not identifiable", (1.0, row), xycoords=axis.get_yaxis_transform(), color=colour, fontsize=8
                )
    axis.set_xscale("log")
    units = [readable(one.unit)[1] for name in names for one in plan.parameters if one.name == name]
    labels = [name.replace("_", " ") + (f" [{unit}]" if unit else "") for name, unit in zip(names, units, strict=True)]
    axis.set_yticks(range(len(names)), labels)
    axis.invert_yaxis()
    axis.set_xlabel("half width of the predicted 95 % interval")
    style.legend_above(axis, 3)
    return fig


def growth(plan: Plan) -> Figure:
    """Return how the standard deviation of each wanted parameter falls from block to block, over that at the end."""
    fig, (axis,) = style.figure(1, width=8.6, height=3.4)
    ends = [block.begins + block.seconds for block in plan.blocks]
    names = [name for name in plan.wanted if math.isfinite(plan.proposed.std[name])]
    for name, colour in zip(names, style.colors(len(names) + 1)[1:], strict=True):
        last = max(plan.growth[-1][name], _FLOOR)
        axis.plot(ends, [one[name] / last for one in plan.growth], "o-", color=colour, ms=3.5, lw=1.3,
                  label=name.replace("_", " "))  # fmt: skip
    axis.set_yscale("log")
    axis.set(xlabel="time [s]", ylabel="standard deviation,\nover that at the end")
    axis.legend(loc="upper right", ncols=2)
    return fig


def _half_width(plan: Plan, name: str, std: float) -> float:
    unit = next(one.unit for one in plan.parameters if one.name == name)
    return HALF * std * readable(unit)[0]
