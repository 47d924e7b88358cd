"""A fit of a tool's far end as files: its model, its errors, and a figure of its held-out runs."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from tenodesis.identification.force.model import WIDTH, ForceModel, to_json
from tenodesis.identification.force.results import RunResult, Traces, bounds_of
from tenodesis.identification.report import write_files
from tenodesis.report import page, style

MODEL, FIGURE = "model.json", "force.svg"
"""What a fit is written as."""
_MOST_SHOWN = 6
_SPARSE = 20
"""Every so many samples are drawn."""


def figure(shown: Sequence[Traces]) -> Figure:
    """Return torque and angle of the far end over time, measured and estimated, with the 95 % interval."""
    shown = shown[:_MOST_SHOWN]
    fig = Figure(figsize=(3.2 * len(shown) + 0.8, 5.2), layout="constrained")
    axes = fig.subplots(2, len(shown), squeeze=False, sharex="col")
    for column, (series, found) in enumerate(shown):
        # an estimate is drawn from where the bench has settled
        used = np.flatnonzero(series.counted)[::_SPARSE]
        own = series.far_angle[used] - found.angle[used]
        shift = float(own.mean()) if series.pitch is not None else 0.0
        for row, (scale, measured, value, std) in enumerate(
            (
                (1e3, series.far_torque[used], found.torque[used], found.torque_std[used]),
                (math.degrees(1), series.far_angle[used], found.angle[used] + shift, found.angle_std[used]),
            )
        ):
            axis, time = axes[row, column], series.time[used]
            low, high = scale * (value - WIDTH * std), scale * (value + WIDTH * std)
            axis.fill_between(time, low, high, color=style.ACCENT, alpha=0.2, lw=0, label="95 %")
            axis.plot(time, scale * measured, color=style.INK, lw=1.2, label="measured")
            axis.plot(time, scale * value, color=style.ACCENT, lw=1.0, label="estimated")
            # an interval that a runaway drive makes wide must not hide the rest
            reach = np.quantile(scale * np.concatenate([measured, value]), (0.01, 0.99))
            axis.set_ylim(reach[0] - 0.3 * np.ptp(reach), reach[1] + 0.3 * np.ptp(reach))
        axes[0, column].set_title(series.name)
        axes[1, column].set_xlabel("time [s]")
    axes[0, 0].set_ylabel("jaw torque [mN·m]")
    axes[1, 0].set_ylabel("jaw angle [deg]")
    style.legend_above(axes[0, 0], 3)
    return fig


def write(model: ForceModel, results: Mapping[str, Sequence[RunResult]], shown: Sequence[Traces], out: Path) -> None:
    """Write model.json and force.svg into a folder; raises IdentificationError if it cannot be written."""
    numbers = {
        "about": page.about(),
        **to_json(model),
        "undetermined": list(model.undetermined()),
        "errors": {use: [asdict(one) for one in rows] for use, rows in results.items()},
        "bounds": {found.series.name: asdict(bounds_of(found.series)) for found in shown},
    }
    with style.applied():
        drawn = page.svg_text(figure(shown))
    write_files(out, {FIGURE: drawn, MODEL: page.json_text(_finite(numbers))}, last=MODEL)


def _finite(value: Any) -> Any:
    """Return plain values with those that are no numbers as null."""
    if isinstance(value, dict):
        return {key: _finite(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    return page.json_number(value) if isinstance(value, float) else value
