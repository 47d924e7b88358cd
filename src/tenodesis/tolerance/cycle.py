"""The experiment of a study: under a constant load the handle flexes, goes a little beyond, comes back and flexes."""

from typing import NamedTuple

import numpy as np

from tenodesis import statics
from tenodesis.run import Array
from tenodesis.similarity import Comparison

STEPS = 24
"""Steps from straight to the working range's end."""
BEYOND = 6
"""Steps beyond it, so that every contact slides back before the end is approached in extension."""
LOADING = 8
SPEED = float(np.radians(10))
"""Of the handle, rad/s; only viscous friction feels it."""


class Cycle(NamedTuple):
    """The handle's way (rad) and the share of the load on it, by step, with where on it the responses are read."""

    handle: Array
    load: Array
    end: float
    """Handle angle at the working range's end, rad."""
    time_step: float

    @property
    def extension(self) -> slice:
        """Steps from the end back to straight."""
        first = LOADING + BEYOND + STEPS + BEYOND - 1
        return slice(first, first + STEPS + 1)

    @property
    def flexion(self) -> slice:
        """Steps from straight to the end, the second time."""
        last = len(self.handle)
        return slice(last - STEPS - 1, last)


def cycles(comparison: Comparison) -> tuple[Cycle, Cycle]:
    """Return the cycle of either instrument, by the handle angles that stand for each other.

    It goes to the end of the real-size instrument's working range, or less far where either handle does not reach a
    quarter beyond it.
    """
    real_size = comparison.real_size
    room = min(real_size.handle_range, _range_of_scaled_up(comparison)) / (1 + BEYOND / STEPS)
    end = min(statics.reach(real_size), room)
    top = STEPS + BEYOND
    nodes = np.concatenate(
        [np.zeros(LOADING), np.arange(1, top + 1), np.arange(top - 1, -1, -1), np.arange(1, STEPS + 1)]
    )
    load = np.ones(nodes.size)
    load[:LOADING] = np.arange(1, LOADING + 1) / LOADING
    handle = nodes * (end / STEPS)
    mapped = np.asarray(comparison.scaled_up_handle_angle(handle))
    other = float(comparison.scaled_up_handle_angle(end))
    return Cycle(handle, load, end, end / STEPS / SPEED), Cycle(mapped, load, other, end / STEPS / SPEED)


def _range_of_scaled_up(comparison: Comparison) -> float:
    """Return the real-size handle angle that stands for the end of the scaled-up handle's range, rad."""
    real_size, scaled_up = comparison.real_size, comparison.scaled_up
    if comparison.same_mechanism:
        return scaled_up.handle_range
    bent = statics.output_angle(scaled_up, scaled_up.handle_range)
    if bent >= statics.output_angle(real_size, real_size.handle_range):
        return real_size.handle_range
    return float(statics.handle_angle(real_size, bent))
