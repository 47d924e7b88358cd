"""A tool's parameters from recordings of both its ends: the most likely ones, given a prior over tools."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tenodesis.errors import IdentificationError
from tenodesis.identification.force.model import (
    FITTED_INTERVAL,
    RECALIBRATED,
    WIDTH,
    Band,
    Bands,
    ForceBench,
    ForceModel,
    Series,
    Signal,
    Unknown,
    bench_of,
    checked,
    predicted,
    recalibrated,
    series_of,
    unknowns,
)
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.identification.uncertainty import autocorrelation, correlation_samples
from tenodesis.magnitude import rms
from tenodesis.run import Array

OFFSET_SHARE = 0.03
"""Share of a recording's mean angle error that counts where recordings begin at a stop of the jaw, with a pitch."""
FOLDS = 5
"""Parts of the recordings that are left out in turn for the intervals."""
HALF_CYCLE = 2.0
"""Time over which errors of a model that is carried over are at least correlated, s."""
ROUNDS = 3
"""Fits, each by the noise that the one before has left."""
_EVERY = 4
"""Of so many residuals, correlated as they are, one is fitted."""
_FOLD_STEPS = 8
_INSIDE = 0.05
"""Least distance from its bounds at which a search begins, in prior deviations."""
_STEP = 1e-3
"""Of the differences that derivatives are, in prior deviations."""
_FIRST_NOISE = {"angle": math.radians(0.5), "torque": 5e-3, "shaft": 1e-2}
"""Of the first round: rad, N m, N m."""


class _Data(NamedTuple):
    """What is fitted."""

    series: Sequence[Series]
    bench: ForceBench
    signal: Signal


class _Noise(NamedTuple):
    """Of each channel: standard deviation, SI, and samples over which residuals are correlated."""

    std: Mapping[str, float]
    correlated: Mapping[str, float]


def fit_force(
    train: Sequence[MeasuredRun],
    signal: Signal,
    *,
    prior: ForceModel | None = None,
    groups: Sequence[str] = RECALIBRATED,
) -> ForceModel:
    """Return the model of a tool by recordings of both its ends.

    Without a prior all parameters are fitted, from what is believed of tools in general. With that of another tool, or
    another session, those of `groups` are fitted and the others carried over.

    Raises IdentificationError if a recording cannot be used, or the prior has no torque constant for a current.
    """
    if prior is not None and signal != prior.signal:
        what = "no torque constant: it was fitted from torque" if signal == "current" else "a motor: from current"
        raise IdentificationError(
            f"The prior has {what}, and the estimate is from {signal}; fit a prior from {signal} first.",
            key="prior",
            value=prior.signal,
        )
    runs = [checked(one, signal) for one in train]
    bench = bench_of(runs)
    series = [series_of(one, bench, interval=FITTED_INTERVAL) for one in runs]
    return fit_series(series, bench, signal, prior=prior, groups=groups)


def fit_series(
    series: Sequence[Series],
    bench: ForceBench,
    signal: Signal,
    *,
    prior: ForceModel | None = None,
    groups: Sequence[str] = RECALIBRATED,
) -> ForceModel:
    """Return the model of a tool by series of a bench, at the samples of each that are to be fitted."""
    wrist = prior.wrist if prior is not None else len({one.pitch for one in series}) > 1
    if prior is None:
        known = {one.name: one for one in unknowns(signal, wrist=wrist)}
    else:
        known = {
            one.name: recalibrated(one, prior.values[one.name]) if one.group in groups else one
            for one in prior.unknowns
        }
    start = {name: one.start for name, one in known.items()} if prior is None else dict(prior.values)
    if wrist and prior is None:
        start["coupling"] = _coupling(series, bench, start)
    start["angle_offset"] = _offset(series, bench, start)
    known["angle_offset"] = known["angle_offset"]._replace(start=start["angle_offset"])
    free = [known[name] for name in start if prior is None or known[name].group in groups]
    least = (
        None
        if prior is None
        else _Noise(
            {**_FIRST_NOISE, "angle": prior.known.angle.floor, "torque": prior.known.torque.floor},
            dict.fromkeys(_FIRST_NOISE, HALF_CYCLE / FITTED_INTERVAL),
        )
    )
    values, noise, inverse = _search(_Data(series, bench, signal), start, free, least)
    names = list(values)
    covariance = np.zeros((len(names), len(names)))
    if prior is not None:
        covariance += prior.covariance
    at = [names.index(one.name) for one in free]
    covariance[at, :] = 0.0
    covariance[:, at] = 0.0
    covariance[np.ix_(at, at)] = inverse
    model = ForceModel(
        signal=signal,
        bench=bench,
        values=values,
        free=tuple(one.name for one in free),
        covariance=covariance,
        prior_spread={one.name: one.spread for one in free},
        known=prior.known if prior else _unknown_bands(noise),
        new=prior.new if prior else _unknown_bands(noise),
        pitches=tuple(sorted({one.pitch for one in series if one.pitch is not None})),
        wrist=wrist,
        samples=round(sum(one.fitted.sum() for one in series) / noise.correlated["torque"]),
    )
    if prior is not None:
        return model
    return _with_bands(model, series, free, noise)


def _search(
    data: _Data, start: Mapping[str, float], free: Sequence[Unknown], least: _Noise | None
) -> tuple[dict[str, float], _Noise, Array]:
    """Return the most likely values, the noise that they leave, and the covariance of those that are free."""
    noise = least or _Noise(_FIRST_NOISE, dict.fromkeys(_FIRST_NOISE, 100.0))
    values = dict(start)
    for _ in range(ROUNDS):
        values, slopes = _most_likely(data, values, free, noise)
        noise = _left(data, values, noise, least)
    spread = np.array([one.spread for one in free])
    # slopes are by prior deviations, and the last rows the prior's own
    return values, noise, np.asarray(np.linalg.inv(slopes.T @ slopes) * np.outer(spread, spread), dtype=np.float64)


def _most_likely(
    data: _Data, start: Mapping[str, float], free: Sequence[Unknown], noise: _Noise, *, most: int = 40
) -> tuple[dict[str, float], Array]:
    from scipy.optimize import least_squares  # noqa: PLC0415 - slow to load

    names = [one.name for one in free]
    middle, spread = np.array([one.start for one in free]), np.array([one.spread for one in free])
    lower = (np.array([one.lower for one in free]) - middle) / spread
    upper = (np.array([one.upper for one in free]) - middle) / spread

    def residuals(scaled: Array) -> Array:
        values = {**start, **dict(zip(names, (middle + spread * scaled).tolist(), strict=True))}
        parts = [scaled]
        for one in data.series:
            for channel, left in _residuals(one, data.bench, data.signal, values).items():
                apart = max(noise.correlated[channel] / _EVERY, 1.0)
                parts.append(left[::_EVERY] / (noise.std[channel] * math.sqrt(apart)))
        return np.concatenate(parts)

    def jacobian(scaled: Array) -> Array:
        base = residuals(scaled)
        columns = []
        for at in range(scaled.size):
            moved = scaled.copy()
            moved[at] += _STEP if scaled[at] + _STEP < upper[at] else -_STEP
            columns.append((residuals(moved) - base) / (moved[at] - scaled[at]))
        return np.column_stack(columns)

    # a search that begins on a bound hardly leaves it
    first = np.clip((np.array([start[name] for name in names]) - middle) / spread, lower + _INSIDE, upper - _INSIDE)
    found = least_squares(residuals, first, jac=jacobian, bounds=(lower, upper), xtol=1e-4, ftol=1e-4, max_nfev=most)
    values = {**start, **dict(zip(names, (middle + spread * found.x).tolist(), strict=True))}
    return values, jacobian(found.x)


def _residuals(series: Series, bench: ForceBench, signal: Signal, values: Mapping[str, float]) -> dict[str, Array]:
    """Return measured minus model of each channel, at the samples that are fitted, SI."""
    far = predicted(values, series, signal, bench)
    angle = (series.far_angle - far.angle)[series.fitted]
    if series.pitch is not None:
        angle = angle - (1 - OFFSET_SHARE) * angle.mean()
    found = {"angle": angle, "torque": (series.far_torque - far.torque)[series.fitted]}
    if signal == "current":
        found["shaft"] = (series.torque - far.near_torque)[series.fitted]
    return found


def _left(data: _Data, values: Mapping[str, float], before: _Noise, least: _Noise | None) -> _Noise:
    """Return the noise of the channels by the residuals."""
    parts = [_residuals(one, data.bench, data.signal, values) for one in data.series]
    std = {channel: max(rms(np.concatenate([one[channel] for one in parts])), 1e-6) for channel in parts[0]}
    correlated = {
        channel: float(np.median([correlation_samples(autocorrelation(one[channel])) for one in parts]))
        for channel in parts[0]
    }
    if least is not None:
        # what a single recording leaves says little of how wrong the model is under other loads
        std = {channel: max(value, least.std.get(channel, value)) for channel, value in std.items()}
        correlated = {channel: max(value, least.correlated[channel]) for channel, value in correlated.items()}
    return _Noise({**before.std, **std}, {**before.correlated, **correlated})


def _zeros(series: Sequence[Series], bench: ForceBench, values: Mapping[str, float]) -> Array:
    """Return the jaw's angle in mid-travel in each recording, without friction and compliance, rad."""
    turned = [one.far_angle + bench.jaw * bench.load * values["ratio"] * one.angle for one in series]
    return np.array([float(found[one.fitted].mean()) for one, found in zip(series, turned, strict=True)])


def _coupling(series: Sequence[Series], bench: ForceBench, values: Mapping[str, float]) -> float:
    """Return the jaw's angle by pitch, by a line through the recordings."""
    return float(np.polyfit([one.pitch or 0.0 for one in series], _zeros(series, bench, values), 1)[0])


def _offset(series: Sequence[Series], bench: ForceBench, values: Mapping[str, float]) -> float:
    """Return the jaw's angle in mid-travel without pitch."""
    pitches = np.array([one.pitch or 0.0 for one in series])
    return float(np.mean(_zeros(series, bench, values) - values.get("coupling", 0.0) * pitches))


def _unknown_bands(noise: _Noise) -> Bands:
    """Return bands where no recording was left out: what is left of those that were fitted, or usual in others."""
    angle, torque = (max(noise.std[channel], _FIRST_NOISE[channel]) for channel in ("angle", "torque"))
    return Bands(Band(angle, 0.0, 1.0), Band(torque, 0.0, 1.0))


def _with_bands(model: ForceModel, series: Sequence[Series], free: Sequence[Unknown], noise: _Noise) -> ForceModel:
    """Return the model with its intervals, by recordings that were left out of fits of their own.

    For the pitches that were fitted, a fifth of the recordings at a time; for other pitches, all of a pitch.
    """
    if len(series) == 1:
        return model
    count = min(len(series), FOLDS)
    by_run = _left_out(model, series, free, noise, [at % count for at in range(len(series))])
    pitches = [*model.pitches]
    by_pitch = (
        _left_out(model, series, free, noise, [pitches.index(one.pitch or 0.0) for one in series])
        if len(pitches) > 1
        else by_run
    )
    model = replace(model, covariance=model.covariance + _jackknife(by_run))
    return replace(model, known=_bands(model, by_run), new=_bands(model, by_pitch))


class _LeftOut(NamedTuple):
    """Recordings that were left out of a fit, and that fit's values."""

    values: dict[str, float]
    series: list[Series]


def _left_out(
    model: ForceModel, series: Sequence[Series], free: Sequence[Unknown], noise: _Noise, fold: Sequence[int]
) -> list[_LeftOut]:
    """Return the fits without each fold in turn."""
    found = []
    for out in sorted(set(fold)):
        others = [one for one, at in zip(series, fold, strict=True) if at != out]
        data = _Data(others, model.bench, model.signal)
        values, _ = _most_likely(data, model.values, free, noise, most=_FOLD_STEPS)
        found.append(_LeftOut(values, [one for one, at in zip(series, fold, strict=True) if at == out]))
    return found


def _jackknife(found: Sequence[_LeftOut]) -> Array:
    """Return the covariance of all parameters by how they differ between fits, each without a part (Tukey 1958)."""
    rows = np.array([list(one.values.values()) for one in found])
    off = rows - rows.mean(axis=0)
    return np.asarray((len(found) - 1) / len(found) * off.T @ off, dtype=np.float64)


def _bands(model: ForceModel, found: Sequence[_LeftOut]) -> Bands:
    """Return the bands by the errors on what was left out."""
    errors: dict[str, list[Array]] = {"angle": [], "torque": []}
    hidden: dict[str, list[Array]] = {"angle": [], "torque": []}
    moved: dict[str, list[Array]] = {"angle": [], "torque": []}
    for values, series in found:
        fitted = replace(model, values=values)
        for one in series:
            far = predicted(values, one, model.signal, model.bench)
            left = _residuals(one, model.bench, model.signal, values)
            by = fitted.moved(one, far)
            for channel, far_hidden, by_parameters in zip(
                errors, (far.hidden_angle, far.hidden_torque), by, strict=True
            ):
                errors[channel].append(left[channel])
                hidden[channel].append(np.abs(far_hidden[one.fitted]))
                moved[channel].append(np.sqrt(np.sum(by_parameters**2, axis=0))[one.fitted])
    angle, torque = (
        band_of(np.concatenate(errors[channel]), np.concatenate(hidden[channel]), np.concatenate(moved[channel]))
        for channel in errors
    )
    return Bands(angle, torque)


def band_of(errors: Array, hidden: Array, moved: Array) -> Band:
    """Return the band that errors are most likely from, each (n,), scaled to cover 95 % of them.

    `hidden` is how far friction may hide the signal, `moved` its deviation by the parameters' uncertainty.
    """
    from scipy.optimize import minimize  # noqa: PLC0415 - slow to load

    def variance(logs: Array) -> Array:
        return np.asarray(np.exp(2 * logs[0]) + (np.exp(logs[1]) * hidden) ** 2 + moved**2, dtype=np.float64)

    def misfit(logs: Array) -> float:
        left = variance(logs)
        return float(np.mean(np.log(left) + errors**2 / left))

    typical = rms(errors) + 1e-12
    bounds = [(math.log(typical) - 4, math.log(typical) + 2), (-6.0, 1.0)]
    found = minimize(misfit, np.array([math.log(typical), -1.5]), method="Nelder-Mead", bounds=bounds).x
    wider = float(np.quantile(np.abs(errors) / np.sqrt(variance(found)), 0.95)) / WIDTH
    return Band(math.exp(found[0]) * wider, math.exp(found[1]) * wider, wider)
