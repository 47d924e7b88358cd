"""A plan as files: the protocol to record, a self-contained HTML page, a figure and all values."""

import math
from pathlib import Path
from typing import Any

from markupsafe import Markup

from tenodesis.identification.experiment import figures
from tenodesis.identification.experiment.plan import HALF, OPTIMISTIC, Plan, Prediction, to_text
from tenodesis.identification.figures import readable
from tenodesis.identification.report import write_files
from tenodesis.identification.results import LIBRARIES
from tenodesis.report import page, style
from tenodesis.report.page import json_number, json_text, svg_text

PROTOCOL, PAGE, FIGURE, NUMBERS = "protocol.toml", "plan.html", "plan.svg", "plan.json"
"""What a plan is written as."""
SCHEMA = 1
"""Version of the layout of plan.json."""

_TEMPLATE = "plan.html.j2"


def write(plan: Plan, out: Path) -> list[Path]:
    """Write protocol.toml, plan.html, plan.svg and plan.json into a folder, atomically, and return their paths.

    Raises IdentificationError if the folder cannot be written.
    """
    with style.applied():
        drawn = {
            "course": (figures.course(plan), "What the twin does in the proposed protocol, block by block."),
            "intervals": (
                figures.intervals(plan),
                "Predicted 95 % intervals of the wanted parameters, all others open as well, in the same time.",
            ),
            "growth": (figures.growth(plan), "Uncertainty of the wanted parameters, block by block."),
        }
        svgs = {name: (svg_text(figure), caption) for name, (figure, caption) in drawn.items()}
    texts = {
        PROTOCOL: to_text(plan.protocol, comment=_comment(plan)),
        FIGURE: svgs["course"][0],
        NUMBERS: json_text(to_json(plan)),
        PAGE: _page(plan, svgs),
    }
    return write_files(out, texts, last=PAGE)


def to_json(plan: Plan) -> dict[str, Any]:
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
                "std": json_number(plan.proposed.std[one.name]),
                "interval_95": list(plan.interval_95[one.name]),
                "identifiable": plan.identifiable(one.name),
            }
            for one in plan.parameters
            if one.name in plan.open
        },
        "baselines": {one.name: _prediction(one) for one in plan.baselines},
        "not_identifiable_by_any": dict(plan.unidentifiable),
        "left_out": dict(plan.left_out),
        "warnings": [*plan.warnings, OPTIMISTIC],
    }


def shown(plan: Plan, name: str) -> tuple[str, str]:
    """Return the value and the half width of the predicted interval of a parameter, in readable units."""
    one = next(one for one in plan.parameters if one.name == name)
    factor, unit = readable(one.unit)
    width = HALF * plan.proposed.std[name] * factor
    value = f"{one.start * factor:.5g}{f' {unit}' if unit else ''}"
    return value, f"± {width:.2g}" if math.isfinite(width) else "open"


def ratio(plan: Plan, baseline: Prediction, name: str) -> str:
    """Return how many times as wide a parameter's interval would be by a baseline."""
    own, other = plan.proposed.std[name], baseline.std[name]
    if not math.isfinite(other):
        return "not identifiable"
    return f"{other / own:.3g}" if math.isfinite(own) and own else ""


def _prediction(one: Prediction) -> dict[str, Any]:
    return {
        "seconds": one.seconds,
        "std": {name: json_number(value) for name, value in one.std.items()},
    }


def _comment(plan: Plan) -> str:
    lines = [f"Proposed for {plan.inst.name} to identify {', '.join(plan.wanted)}.", "Blocks, each from rest to rest:"]
    return "\n".join([*lines, *(f"  {one.begins:7.2f} s  {one.candidate.name}" for one in plan.blocks)])


def _page(plan: Plan, svgs: dict[str, tuple[str, str]]) -> str:
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
        optimistic=OPTIMISTIC,
        about=page.about(*LIBRARIES),
    )
