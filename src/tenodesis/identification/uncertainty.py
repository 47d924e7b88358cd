"""Statistics of residuals that are not independent: whiteness, the covariance of a fit, a block bootstrap."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from scipy import linalg, special

from tenodesis.magnitude import rms
from tenodesis.run import Array

_WINDOW = 5.0
"""Correlation times after which the sum of correlations is cut (Sokal 1997)."""
_TESTED_LAGS = 20
_SIGNIFICANCE = 0.01


@dataclass(frozen=True)
class Whiteness:
    """Autocorrelation of the residuals of one sensor of one run, with the test for white noise."""

    run: str
    channel: int
    sensor: str
    samples: int
    sample_time: float
    """s."""
    correlation_time: float
    """Integrated autocorrelation time, s; the sample time for white noise."""
    effective_samples: float
    """Independent samples whose mean would be known as well."""
    statistic: float
    """Of Ljung and Box (1978), over `lags` lags."""
    lags: int
    p_value: float
    """How likely white noise would be at least as correlated."""
    autocorrelation: Array
    """By lag from 0."""

    @property
    def white(self) -> bool:
        """Whether white noise is not ruled out at the 1 % level."""
        return self.p_value >= _SIGNIFICANCE


def autocorrelation(series: Array, lags: int | None = None) -> Array:
    """Return the autocorrelation of a series, shape (lags + 1,), from lag 0; all lags by default."""
    centred = series - series.mean()
    most = series.size - 1 if lags is None else min(lags, series.size - 1)
    from scipy import signal  # noqa: PLC0415 - slow to load

    sums = signal.correlate(centred, centred, method="fft")[series.size - 1 : series.size + most]
    if not sums[0] > 0:
        return np.asarray(np.arange(most + 1) == 0, dtype=np.float64)
    return np.asarray(sums / sums[0], dtype=np.float64)


def correlation_samples(correlations: Array) -> float:
    """Return the integrated autocorrelation time in samples, at least 1, cut by Sokal's window."""
    times = 2 * np.cumsum(correlations) - 1
    inside = np.arange(times.size) < _WINDOW * times
    end = times.size - 1 if inside.all() else int(np.argmin(inside))
    return max(1.0, float(times[end]))


def whiteness(series: Array, *, run: str, channel: int, sample_time: float, sensor: str = "") -> Whiteness:
    """Return autocorrelation and Ljung-Box test of the residuals of one sensor, shape (n,)."""
    correlations = autocorrelation(series)
    time = correlation_samples(correlations)
    count = series.size
    lags = max(1, min(_TESTED_LAGS, count // 5))
    behind = np.arange(1, lags + 1)
    statistic = float(count * (count + 2) * np.sum(correlations[1 : lags + 1] ** 2 / (count - behind)))
    return Whiteness(
        run=run,
        channel=channel,
        sensor=sensor,
        samples=count,
        sample_time=sample_time,
        correlation_time=time * sample_time,
        effective_samples=count / time,
        statistic=statistic,
        lags=lags,
        p_value=float(special.chdtrc(lags, statistic)),
        autocorrelation=correlations[: _shown(time, count) + 1],
    )


def _shown(time: float, count: int) -> int:
    """Return how many lags to show: some correlation times, and enough to see that there are none."""
    return int(min(count // 2, max(2 * _TESTED_LAGS, 6 * time)))


LEAST_BLOCKS = 8
"""Blocks that are drawn for a run at least."""
_LONGER = 2
"""Times the length of least mean square error, which for an interval cuts off too much correlation."""
_QUIET = 2.0
"""Standard errors above which a correlation counts (Politis and White 2004)."""


def block_length(series: Array) -> int:
    """Return the length of block for an interval of the mean of a sensor's residuals, shape (n,).

    After Politis and White (2004), as corrected in 2009.
    """
    count = series.size
    longest = max(1, count // LEAST_BLOCKS)
    correlations = autocorrelation(series)
    limit = _QUIET * math.sqrt(math.log10(count) / count)
    patience = max(5, math.ceil(math.sqrt(math.log10(count))))
    quiet = np.abs(correlations[1:]) < limit
    held = np.convolve(quiet, np.ones(patience), mode="valid") == patience
    reach = 2 * (int(np.argmax(held)) if held.any() else count // 2)
    if reach == 0:
        return 1
    lags = np.arange(1, min(reach, count - 1) + 1)
    window = np.minimum(1, 2 * (1 - lags / reach))
    shape = 2 * np.sum(window * lags * correlations[lags])
    size = 1 + 2 * np.sum(window * correlations[lags])
    if size <= 0:
        return longest
    length = (1.5 * (shape / size) ** 2) ** (1 / 3) * count ** (1 / 3)
    return int(np.clip(math.ceil(_LONGER * length), 1, longest))


def resampled(residuals: Array, channels: int, length: int, draw: np.random.Generator) -> Array:
    """Return residuals made of blocks of given residuals, about zero, shape (n,).

    Residuals are one sensor after the other. Blocks of `length` samples wrap around the end, and all sensors of a run
    are drawn together.
    """
    rows = residuals.reshape(channels, -1)
    rows = rows - rows.mean(axis=1, keepdims=True)
    count = rows.shape[1]
    begins = draw.integers(count, size=math.ceil(count / length))
    places = (begins[:, None] + np.arange(length)).ravel()[:count] % count
    return np.asarray(rows[:, places].ravel(), dtype=np.float64)


LossName: TypeAlias = Literal["linear", "soft_l1"]

_BLOCKS = 300
"""Of a run's scores, summed before their correlation is estimated: the sum's variance is that of all samples."""
_LARGEST_ORDER = 6
_LARGEST_ROOT = 0.97
"""Of the autoregression that whitens the scores (Andrews and Monahan 1992)."""
UNSEEN = 1e-8
"""Singular value, as a share of the largest, below which a direction is not seen at all."""


@dataclass(frozen=True)
class Linearised:
    """A run at the optimum."""

    residuals: Array
    """(n,), whitened."""
    jacobian: Array
    """(n, free parameters), in units of the parameters' scales."""
    channels: int = 1
    """Sensors, in their order in the residuals."""
    systematic: Array | None = None
    """Effects of systematic errors on the residuals, one standard deviation each, (n, m)."""


@dataclass(frozen=True)
class Uncertainty:
    """Covariances of the free parameters in units of their scales, over the directions that are seen."""

    covariance: Array
    """Corrected for residuals that are not independent."""
    white: Array
    """As if they were."""
    unseen: Array
    """Directions without any effect on the residuals, (free parameters, directions)."""

    @property
    def std(self) -> Array:
        """Corrected standard deviations; infinite where an unseen direction contributes."""
        return _std(self.covariance, self.unseen)

    @property
    def white_std(self) -> Array:
        """Standard deviations as if residuals were independent."""
        return _std(self.white, self.unseen)

    @property
    def full(self) -> Array:
        """Corrected covariance in all directions; the standard deviation of an unseen direction is 1000 ranges."""
        return np.asarray(self.covariance + 1e6 * self.unseen @ self.unseen.T, dtype=np.float64)

    @property
    def smallest_std(self) -> float:
        """Standard deviation of the combination of parameters that is known best."""
        return math.sqrt(max(0.0, float(linalg.eigvalsh(self.full).min())))

    @property
    def correlation(self) -> Array:
        """Correlation matrix of that covariance."""
        size = np.sqrt(np.diag(self.full))
        size[size == 0] = 1
        return np.asarray(self.full / np.outer(size, size), dtype=np.float64)


def influence(residuals: Array, loss: LossName) -> tuple[Array, Array]:
    """Return the influence function of a loss, its first derivative by the residuals, and its second derivative."""
    if loss == "linear":
        return residuals, np.ones_like(residuals)
    root = np.sqrt(1 + residuals**2)
    return residuals / root, root**-3


def estimate(runs: Sequence[Linearised], loss: LossName = "linear", *, scatter: Array | None = None) -> Uncertainty:
    """Return the covariance of the parameters: the scores' long-run covariance between inverse curvatures.

    The sandwich of Huber (1967) and White (1980) with the estimator of Andrews and Monahan (1992) between, but no
    variance is below that for independent residuals; systematic errors are added, and the covariance of the optimum's
    scatter, (free parameters, free parameters).
    """
    count = sum(run.residuals.size for run in runs)
    free = runs[0].jacobian.shape[1]
    weighted, scores, squares = [], [], 0.0
    for run in runs:
        first, second = influence(run.residuals, loss)
        weighted.append(np.sqrt(second)[:, None] * run.jacobian)
        score = (first[:, None] * run.jacobian).reshape(run.channels, -1, free).sum(axis=0)
        scores.append(_summed(score))
        squares += float(first @ first)
    _, sizes, rows = linalg.svd(np.linalg.qr(np.concatenate(weighted), mode="r"))
    seen = sizes > UNSEEN * sizes.max(initial=0.0)
    directions, unseen = rows[seen].T, rows[~seen].T
    inverse = directions / sizes[seen] ** 2 @ directions.T
    correction = count / max(1, count - free)
    middle = long_run([score @ directions for score in scores])
    bread = directions / sizes[seen] ** 2
    covariance = correction * bread @ middle @ bread.T
    white = inverse * squares / max(1, count - free)
    covariance = covariance + np.diag(np.maximum(np.diag(white) - np.diag(covariance), 0))
    for run in runs:
        if run.systematic is not None:
            off = bread @ (directions.T @ (run.jacobian.T @ run.systematic))
            covariance = covariance + off @ off.T
    if scatter is not None:
        covariance = covariance + scatter
    return Uncertainty(covariance=covariance, white=white, unseen=unseen)


def long_run(scores: Sequence[Array]) -> Array:
    """Return the covariance of the sum of all scores, each (n, m), correlated within a run and not between runs.

    Whitened by a vector autoregression (den Haan and Levin 1997), what it leaves by the quadratic spectral kernel with
    its automatic bandwidth (Andrews 1991).
    """
    width = scores[0].shape[1]
    if width == 0:
        return np.zeros((0, 0))
    count = sum(len(one) for one in scores)
    middle = np.sum([one.sum(axis=0) for one in scores], axis=0) / count
    centred = [one - middle for one in scores]
    size = rms(np.concatenate(centred), axis=0)
    size[size == 0] = 1
    centred = [one / size for one in centred]
    steps, innovations = _whitened(centred)
    left, stretch, right = linalg.svd(steps)
    steps = left * np.minimum(stretch, _LARGEST_ROOT) @ right
    white = np.sum([_kernel_sum(one, _bandwidth(innovations)) for one in innovations], axis=0)
    white = white * count / sum(len(one) for one in innovations)
    colour = linalg.inv(np.eye(width) - steps) * size[:, None]
    return np.asarray(colour @ white @ colour.T, dtype=np.float64)


def _whitened(series: Sequence[Array]) -> tuple[Array, list[Array]]:
    """Return the sum of the coefficients of the autoregression that Akaike's criterion prefers, and what it leaves."""
    width = series[0].shape[1]
    count = sum(len(one) for one in series)
    most = int(np.clip(count // (10 * width), 0, _LARGEST_ORDER))
    best: tuple[float, Array, list[Array]] = (math.inf, np.zeros((width, width)), list(series))
    for order in range(most + 1):
        after = [one[most:] for one in series]
        before = [
            np.concatenate(
                [one[most - lag : len(one) - lag] for lag in range(1, order + 1)] or [one[most:, :0]], axis=1
            )
            for one in series
        ]
        coefficients = linalg.lstsq(np.concatenate(before), np.concatenate(after))[0] if order else np.zeros((0, width))
        left = [new - old @ coefficients for new, old in zip(after, before, strict=True)]
        rest = np.concatenate(left)
        size = np.linalg.slogdet(rest.T @ rest / len(rest))[1]
        criterion = size + 2 * order * width**2 / len(rest)
        if criterion < best[0]:
            best = (criterion, coefficients.reshape(order, width, width).sum(axis=0).T, left)
    return best[1], best[2]


def _summed(scores: Array) -> Array:
    """Return scores summed over blocks of equal length; the last takes the remainder."""
    block = max(1, len(scores) // _BLOCKS)
    return np.add.reduceat(scores, np.arange(0, len(scores) - block + 1, block), axis=0)


def _bandwidth(series: Sequence[Array]) -> float:
    """Return the bandwidth of Andrews (1991), eq. 6.4, with first-order autoregressions of equal weight."""
    above = below = 0.0
    for column in range(series[0].shape[1]):
        before = np.concatenate([one[:-1, column] for one in series])
        after = np.concatenate([one[1:, column] for one in series])
        power = float(before @ before)
        root = float(np.clip(before @ after / power, -_LARGEST_ROOT, _LARGEST_ROOT)) if power > 0 else 0.0
        noise = float(np.mean((after - root * before) ** 2))
        above += 4 * root**2 * noise**2 / (1 - root) ** 8
        below += noise**2 / (1 - root) ** 4
    length = max(len(one) for one in series)
    return max(1.0, 1.3221 * (above / below * length) ** 0.2) if below > 0 else 1.0


def _kernel_sum(series: Array, bandwidth: float) -> Array:
    """Return the sum of autocovariances, weighted by the quadratic spectral kernel, times the length."""
    total = series.T @ series
    # beyond fifty bandwidths the kernel is below 1e-4
    for lag in range(1, min(len(series), math.ceil(50 * bandwidth))):
        angle = 6 * math.pi * lag / bandwidth / 5
        weight = 3 / angle**2 * (math.sin(angle) / angle - math.cos(angle))
        product = series[lag:].T @ series[:-lag]
        total = total + weight * (product + product.T)
    return np.asarray(total, dtype=np.float64)


def _std(covariance: Array, unseen: Array) -> Array:
    std = np.sqrt(np.maximum(np.diag(covariance), 0))
    std[np.abs(unseen).max(axis=1, initial=0.0) > 1e-4] = np.inf
    return np.asarray(std, dtype=np.float64)
