"""Values between samples."""

import numpy as np

from tenodesis.run import Array


def monotone_cubic(knots: Array, values: Array, at: Array) -> Array:
    """Return values between samples by a piecewise cubic that has a continuous slope and does not overshoot.

    Slopes are weighted harmonic means of the neighbours' (Fritsch and Butland 1984), and nought at either end, where
    a hand is at rest.

    Parameters
    ----------
    knots
        Where the samples are, strictly increasing, two at least.
    values
        The samples.
    at
        Where values are wanted, within the knots.
    """
    step = np.diff(knots)
    rise = np.diff(values) / step
    slopes = np.zeros_like(values)
    left, right = 2 * step[1:] + step[:-1], step[1:] + 2 * step[:-1]
    same = rise[:-1] * rise[1:] > 0
    steepness = left[same] / rise[:-1][same] + right[same] / rise[1:][same]
    slopes[1:-1][same] = (left + right)[same] / steepness
    piece = np.clip(np.searchsorted(knots, at, "right") - 1, 0, step.size - 1)
    width = step[piece]
    along = (at - knots[piece]) / width
    back = 1 - along
    return (
        values[piece] * (1 + 2 * along) * back**2
        + values[piece + 1] * (1 + 2 * back) * along**2
        + width * along * back * (slopes[piece] * back - slopes[piece + 1] * along)
    )
