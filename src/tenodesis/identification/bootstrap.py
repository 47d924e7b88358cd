"""Block bootstrap: residuals resampled in blocks, so that their correlation is kept."""

import math

import numpy as np

from tenodesis.identification.whiteness import autocorrelation
from tenodesis.run import Array

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
