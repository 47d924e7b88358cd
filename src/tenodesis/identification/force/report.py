"""How well a model gives a tool's far end, and what bounds that; the fit as files."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from tenodesis.identification.force.model import WIDTH, FarEndEstimate, ForceModel, Series, checked, series_of, to_json
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.identification.report import write_files
from tenodesis.magnitude import rms
from tenodesis.report import page, style
from tenodesis.run import Array

_LEAST_PERIOD = 1.0
"""s."""
_LONGEST = 0.75
"""Of the recording, that a cycle may take."""
_SAME = 0.02
"""Median square difference below which a motion is the same, of its variance."""
_NOISE_WINDOW = 0.1
"""Time within which a signal is a line, s."""


@dataclass(frozen=True)
class RunResult:
    """Errors of the far end in one run, over the samples after the bench has settled."""

    name: str
    torque_rmse: float
    """N m."""
    angle_rmse: float
    """rad; beyond the recording's own mean where it has a pitch."""
    torque_covered: float
    """Share of samples within the 95 % interval."""
    angle_covered: float
    torque_std: float
    """Mean standard deviation that the model gives, N m."""
    angle_std: float
    """rad."""
    torque_rmse_steady: float
    """Without samples within half a second of a runaway drive, N m."""
    angle_rmse_steady: float
    """rad."""
    runaway: float
    """Time that these samples take, s."""


class Traces(NamedTuple):
    """A run with its estimate."""

    series: Series
    estimate: FarEndEstimate


def traces(model: ForceModel, run: MeasuredRun) -> Traces:
    """Return a run by the model's signs, and its estimated far end; raises as `ForceModel.estimate`."""
    series = series_of(checked(run, model.signal), model.bench)
    return Traces(series, model.estimate_series(series))


def assess(found: Traces) -> RunResult:
    """Return the errors of a run's estimate."""
    series, estimate = found
    counted, steady = series.counted, series.fitted
    torque = series.far_torque - estimate.torque
    angle = series.far_angle - estimate.angle
    if series.pitch is not None:
        angle = angle - angle[steady].mean()
    return RunResult(
        series.name,
        rms(torque[counted]),
        rms(angle[counted]),
        float(np.mean(np.abs(torque[counted]) <= WIDTH * estimate.torque_std[counted])),
        float(np.mean(np.abs(angle[counted]) <= WIDTH * estimate.angle_std[counted])),
        float(estimate.torque_std[counted].mean()),
        float(estimate.angle_std[counted].mean()),
        rms(torque[steady]),
        rms(angle[steady]),
        float((counted & ~steady).sum() * series.step),
    )


def pooled(results: list[RunResult]) -> RunResult:
    """Return the errors of all runs together."""
    rows = [asdict(one) for one in results]

    def mean(key: str) -> float:
        values = np.array([float(row[key]) for row in rows])
        return rms(values) if "rmse" in key else float(values.mean())

    return RunResult("all", **{key: mean(key) for key in rows[0] if key != "name"})


@dataclass(frozen=True)
class Bounds:
    """What bounds any estimate of a run's far end, SI."""

    near_torque_noise: float
    """Standard deviation of the near end's torque sensor about a line over a tenth of a second, N m."""
    far_torque_noise: float
    near_torque_cycles: float
    """Difference between successive cycles over the square root of two, RMS, N m; NaN for a single cycle."""
    far_torque_cycles: float
    far_angle_cycles: float
    """rad."""
    period: float
    """s."""


def bounds_of(series: Series) -> Bounds:
    """Return what bounds the estimates of a run."""
    used, step = series.fitted, series.step
    period = _period(series.angle[series.counted], step)

    def cycles(values: Array) -> float:
        if math.isnan(period):
            return math.nan
        lag = round(period / step)
        both = used[lag:] & used[:-lag]
        return rms((values[lag:] - values[:-lag])[both]) / math.sqrt(2)

    torque, far = series.torque, series.far_torque
    noise = _noise(torque[used], step), _noise(far[used], step)
    return Bounds(*noise, cycles(torque), cycles(far), cycles(series.far_angle), period)


def _period(angle: Array, step: float) -> float:
    """Return the first time after which the motion repeats, s; NaN if it does not within the recording."""
    lags = np.arange(round(_LEAST_PERIOD / step), round(_LONGEST * angle.size), max(1, round(0.01 / step)))
    apart = np.array([float(np.median((angle[lag:] - angle[:-lag]) ** 2)) for lag in lags.tolist()])
    good = np.flatnonzero(apart < _SAME * np.var(angle))
    if not good.size:
        return math.nan
    # the first stretch of several: one cycle, not two
    first = good[: 1 + int(np.argmax(np.diff(np.append(good, good[-1] + 2)) > 1))]
    return float(lags[first[np.argmin(apart[first])]] * step)


def _noise(values: Array, step: float) -> float:
    """Return the standard deviation about lines through short stretches; the median, which steps do not move."""
    size = max(8, round(_NOISE_WINDOW / step))
    rows = values[: values.size // size * size].reshape(-1, size)
    place = np.arange(size) - (size - 1) / 2
    slopes = rows @ place / (place @ place)
    left = rows - rows.mean(axis=1, keepdims=True) - slopes[:, None] * place
    return float(np.median(np.sqrt(np.sum(left**2, axis=1) / (size - 2))))


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
    write_files(out, {FIGURE: drawn, MODEL: page.json_text(numbers)}, last=MODEL)
