"""The working range that a scale model is judged over: where the real-size instrument has an equilibrium."""

from typing import NamedTuple

import numpy as np

from tenodesis import _core, statics
from tenodesis.instrument import Instrument
from tenodesis.run import Array
from tenodesis.similarity import GRID

COARSE = (8, 8)
"""Handle angles and forces that every combination is judged at."""


class Points(NamedTuple):
    """Handle angles (rad) and forces (N) of the real-size instrument, flat."""

    handle_angle: Array
    force: Array

    def target(self, real_size: Instrument) -> _core.SimilarityTarget:
        """Return what the core judges scale models by: equal loss of dexterity at mid-range."""
        at_angle = real_size.output_range / 2
        return _core.SimilarityTarget(
            real_size.spec, self.handle_angle.tolist(), self.force.tolist(), at_angle, real_size.output_stop
        )


class WorkingRange(NamedTuple):
    """All points of the grid that the instrument holds, and a few of them that reach as far."""

    fine: Points
    coarse: Points


def working_range(real_size: Instrument, largest_force: float) -> WorkingRange:
    """Return where an instrument is judged, up to a force (N) and over its range of output angles.

    The few points are some of the many, up to the largest force held at each of their handle angles, and that of the
    largest tension, so that no error or tension over them is larger than over all.
    """
    reach = statics.reach(real_size)
    handle = np.linspace(-reach, reach, GRID[0])
    force = np.linspace(0.0, largest_force, GRID[1])
    held = np.isfinite(statics.output_angle(real_size, handle[:, None], force))
    rows, columns = np.nonzero(held)
    chosen = [
        (row, column)
        for row in _spread(np.unique(rows), COARSE[0])
        for column in _spread(columns[rows == row], COARSE[1])
    ]
    # In place of one of the points without a force, of which there are plenty.
    chosen[COARSE[1] * (COARSE[0] // 2)] = _most_strained(real_size, handle, force)
    few = tuple(np.array(chosen).T)
    return WorkingRange(Points(handle[rows], force[columns]), Points(handle[few[0]], force[few[1]]))


def _spread(numbers: Array, count: int) -> list[int]:
    return [int(numbers[round(at)]) for at in np.linspace(0, numbers.size - 1, count)]


def _most_strained(real_size: Instrument, handle: Array, force: Array) -> tuple[int, int]:
    tensions = statics.tensions(real_size, handle[:, None], force)
    largest = np.fmax(tensions.agonist, tensions.antagonist)
    row, column = np.unravel_index(int(np.nanargmax(largest)), largest.shape)
    return int(row), int(column)
