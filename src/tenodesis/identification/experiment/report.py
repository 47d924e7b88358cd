"""A plan as files: the protocol to record, a self-contained HTML page with its figures, and all values."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from tenodesis.identification.experiment.joints import commands
from tenodesis.identification.experiment.planning import HALF, Prediction, ProposedProtocol
from tenodesis.identification.experiment.simulated import to_text
from tenodesis.identification.report import readable, write_files
from tenodesis.identification.results import LIBRARIES
from tenodesis.report import page, style
from tenodesis.report.page import json_text, svg_text

_KEPT = 4000
"""Samples drawn."""
_FLOOR = 1e-12


def course(plan: ProposedProtocol) -> Figure:
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


def intervals(plan: ProposedProtocol) -> Figure:
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


def growth(plan: ProposedProtocol) -> Figure:
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


def _half_width(plan: ProposedProtocol, name: str, std: float) -> float:
    unit = next(one.unit for one in plan.parameters if one.name == name)
    return HALF * std * readable(unit)[0]


PROTOCOL, PAGE, FIGURE, NUMBERS, COMMANDS = "protocol.toml", "plan.html", "plan.svg", "plan.json", "commands.csv"
"""What a plan is written as."""
SCHEMA = 1
"""Version of the layout of plan.json."""

_TEMPLATE = "plan.html.j2"


def write(plan: ProposedProtocol, out: Path) -> list[Path]:
    """Write protocol.toml, plan.html, plan.svg and plan.json into a folder, atomically, and return their paths.

    Of motions that no protocol holds, commands.csv and plan.json. Raises IdentificationError if the folder cannot be
    written.
    """
    numbers = {NUMBERS: json_text(to_json(plan))}
    if plan.protocol is None:
        return write_files(out, {COMMANDS: commands(plan.run)} | numbers, last=NUMBERS)
    with style.applied():
        drawn = {
            "course": (course(plan), "What the twin does in the proposed protocol, block by block."),
            "intervals": (
                intervals(plan),
                "Predicted 95 % intervals of the wanted parameters, all others open as well, in the same time.",
            ),
            "growth": (growth(plan), "Uncertainty of the wanted parameters, block by block."),
        }
        svgs = {name: (svg_text(figure), caption) for name, (figure, caption) in drawn.items()}
    texts = {
        PROTOCOL: to_text(plan.protocol, comment=_comment(plan)),
        FIGURE: svgs["course"][0],
        **numbers,
        PAGE: _page(plan, svgs),
    }
    return write_files(out, texts, last=PAGE)


def to_json(plan: ProposedProtocol) -> dict[str, Any]:
    """Return a plan as plain values for JSON, SI; None for values that are not finite."""
    return {
        "schema": SCHEMA,
        "about": page.about(*LIBRARIES),
        "instrument": plan.inst.name,
        "law": plan.law,
        "distal_encoder": plan.distal_encoder,
        "duration": plan.duration,
        "criterion": plan.criterion,
        "forces": list(plan.forces),
        "wanted": list(plan.wanted),
        "open": list(plan.open),
        "held": list(plan.held),
        "seconds": plan.proposed.seconds,
        "blocks": [
            {"name": one.candidate.name, "kind": one.candidate.kind, "begins": one.begins, "seconds": one.seconds}
            for one in plan.blocks
        ],
        "parameters": {
            one.name: {
                "value": one.start,
                "unit": one.unit,
                "meaning": one.meaning,
                "wanted": one.name in plan.wanted,
                "std": plan.proposed.std[one.name],
                "interval_95": list(plan.interval_95[one.name]),
                "identifiable": plan.identifiable(one.name),
            }
            for one in plan.parameters
            if one.name in plan.open
        },
        "baselines": {one.name: _prediction(one) for one in plan.baselines},
        "not_identifiable_by_any": dict(plan.unidentifiable),
        "left_out": dict(plan.left_out),
        "warnings": [*plan.warnings, plan.caveat],
    }


def shown(plan: ProposedProtocol, name: str) -> tuple[str, str]:
    """Return the value and the half width of the predicted interval of a parameter, in readable units."""
    one = next(one for one in plan.parameters if one.name == name)
    factor, unit = readable(one.unit)
    width = HALF * plan.proposed.std[name] * factor
    value = f"{one.start * factor:.5g}{f' {unit}' if unit else ''}"
    if name in plan.assumed:
        value = f"none, {value} assumed"
    return value, f"± {width:.2g}" if math.isfinite(width) else "open"


def ratio(plan: ProposedProtocol, baseline: Prediction, name: str) -> str:
    """Return how many times as wide a parameter's interval would be by a baseline."""
    own, other = plan.proposed.std[name], baseline.std[name]
    if not math.isfinite(other):
        return "not identifiable"
    return f"{other / own:.3g}" if math.isfinite(own) and own else ""


def _prediction(one: Prediction) -> dict[str, Any]:
    return {
        "seconds": one.seconds,
        "std": dict(one.std),
    }


def _comment(plan: ProposedProtocol) -> str:
    lines = [f"Proposed for {plan.inst.name} to identify {', '.join(plan.wanted)}.", "Blocks, each from rest to rest:"]
    return "\n".join([*lines, *(f"  {one.begins:7.2f} s  {one.candidate.name}" for one in plan.blocks)])


def _page(plan: ProposedProtocol, svgs: dict[str, tuple[str, str]]) -> str:
    rows = [
        {
            "name": name.replace("_", " "),
            "cells": shown(plan, name),
            "ratios": [ratio(plan, one, name) for one in plan.baselines],
            "identifiable": plan.identifiable(name),
            "wanted": name in plan.wanted,
        }
        for name in sorted(plan.open, key=lambda name: name not in plan.wanted)
    ]
    return page.render(
        "tenodesis.identification.experiment",
        _TEMPLATE,
        plan=plan,
        rows=rows,
        drawn=[(name, Markup(style.inlined(name, svg)), caption) for name, (svg, caption) in svgs.items()],
        reasons=list(dict.fromkeys(plan.unidentifiable.values())),
        about=page.about(*LIBRARIES),
    )
