"""Two recordings beside each other."""

from math import sqrt
from typing import NamedTuple

import numpy as np

from tenodesis.errors import RecordingError
from tenodesis.run import Array


class Comparison(NamedTuple):
    """The tip angles of two recordings at common times."""

    time: Array
    """From the start of either, s, shape (n,)"""
    first: Array
    """rad, shape (n,)"""
    second: Array
    rms: float
    """Root mean square of their difference, rad"""
    largest: float
    """Largest difference, rad"""


def compare(first: tuple[Array, Array], second: tuple[Array, Array], rows: int = 4000) -> Comparison:
    """Compare two tip angles (rad) at times (s), each counted from its start, over the time that both last.

    Raises
    ------
    RecordingError
        They have no time in common.
    """
    (time, angle), (other_time, other_angle) = first, second
    if time.size < 2 or other_time.size < 2:
        raise RecordingError("a recording has less than two rows; allowed are recordings that last for a while.")
    since, other_since = time - time[0], other_time - other_time[0]
    common = np.linspace(0, min(since[-1], other_since[-1]), min(rows, max(time.size, other_time.size)))
    here, there = np.interp(common, since, angle), np.interp(common, other_since, other_angle)
    known = np.isfinite(here - there)
    if not known.any():
        raise RecordingError("a recording does not tell the tip angle; allowed are recordings that do.")
    difference = (here - there)[known]
    return Comparison(common, here, there, sqrt(float(np.mean(difference**2))), float(np.abs(difference).max()))
