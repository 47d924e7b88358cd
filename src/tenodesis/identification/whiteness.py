"""Whether residuals are white noise: autocorrelation, correlation time and effective number of samples."""

from dataclasses import dataclass

import numpy as np
from scipy import special

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


def examine(series: Array, *, run: str, channel: int, sample_time: float, sensor: str = "") -> Whiteness:
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
