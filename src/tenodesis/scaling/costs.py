"""The costs of a scale model: similarity error, force resolution, length and tension margin over the working range."""

from collections.abc import Mapping
from functools import cached_property
from math import log, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tenodesis import _core, statics
from tenodesis.instrument import ShortForm
from tenodesis.run import Array
from tenodesis.scaling.candidates import Candidates, Wheel
from tenodesis.scaling.catalogue import Catalogue
from tenodesis.scaling.limits import finest_difference
from tenodesis.scaling.parts import LoadCell, Spool
from tenodesis.similarity import GRID
from tenodesis.similarity.parameters import value_of
from tenodesis.threads import threads
from tenodesis.units import STANDARD_GRAVITY

FINDINGS = tuple(_core.findings())
"""Results of the core for a scale model, in its order."""

COARSE = (8, 8)
"""Number of handle angles and of forces at which every combination is judged."""


class Points(NamedTuple):
    """Handle angles (rad) and forces (N) on the real-size instrument, each of shape (n,)."""

    handle_angle: Array
    force: Array

    def target(self, real_size: ShortForm) -> _core.SimilarityTarget:
        """Return the reference by which the core judges scale models: equal loss of dexterity at mid-range."""
        at_angle = real_size.output_range / 2
        return _core.SimilarityTarget(
            real_size.spec, self.handle_angle.tolist(), self.force.tolist(), at_angle, real_size.output_stop
        )


class WorkingRange(NamedTuple):
    """All points of the grid at which the instrument has an equilibrium, and a few of them with the same extent."""

    fine: Points
    coarse: Points


def working_range(real_size: ShortForm, largest_force: float) -> WorkingRange:
    """Return the points at which scale models are judged, up to a force (N) and over the range of output angles.

    The few points are among the many: up to the largest force held at each of their handle angles, and the point of
    the largest tension. Errors and tensions over them are lower bounds of those over all.
    """
    reach = statics.reach(real_size)
    handle = np.linspace(-reach, reach, GRID[0])
    force = np.linspace(0.0, largest_force, GRID[1])
    held = np.isfinite(statics.output_angle(real_size, handle[:, None], force))
    rows, columns = np.nonzero(held)
    chosen = [
        (row, column)
        for row in _evenly(np.unique(rows), COARSE[0])
        for column in _evenly(columns[rows == row], COARSE[1])
    ]
    # Replaces one of the many points without a force.
    chosen[COARSE[1] * (COARSE[0] // 2)] = _most_strained(real_size, handle, force)
    few = tuple(np.array(chosen).T)
    return WorkingRange(Points(handle[rows], force[columns]), Points(handle[few[0]], force[few[1]]))


def _evenly(numbers: Array, count: int) -> list[int]:
    return [int(numbers[round(at)]) for at in np.linspace(0, numbers.size - 1, count)]


def _most_strained(real_size: ShortForm, handle: Array, force: Array) -> tuple[int, int]:
    tensions = statics.tensions(real_size, handle[:, None], force)
    largest = np.fmax(tensions.agonist, tensions.antagonist)
    row, column = np.unravel_index(int(np.nanargmax(largest)), largest.shape)
    return int(row), int(column)


class Judge:
    """Computes parameters, results and costs of scale models by number; see :class:`Sweep` for the costs."""

    def __init__(self, found: Candidates, catalogue: Catalogue, span: WorkingRange) -> None:
        self._candidates = found
        self._span = span
        self._catalogue = catalogue
        self._cells = sorted(catalogue.load_cells, key=lambda cell: (cell.range, cell.resolution))
        self._largest_wheel = np.array([max(wheel.tip_radius for wheel in pair) for pair in found.pairs])
        self._breaking_load = np.array([rope.breaking_load for rope in found.ropes])
        self._spools = [_nearest_spool(found.real_size, catalogue, pair[0]) for pair in found.pairs]
        resolutions = [cell.resolution for cell in self._cells]
        # The finest of the cells with a sufficient range, so that more tension never selects a finer one.
        self._finest = [min(range(n, len(self._cells)), key=resolutions.__getitem__) for n in range(len(self._cells))]

    @cached_property
    def _coarse(self) -> _core.SimilarityTarget:
        return self._span.coarse.target(self._candidates.real_size)

    @cached_property
    def _fine(self) -> _core.SimilarityTarget:
        return self._span.fine.target(self._candidates.real_size)

    def columns(self, numbers: NDArray[np.int64], *, fine: bool = False) -> dict[str, Array]:
        """Return parameters and results of scale models by name, at few or all points of the working range."""
        columns = self._candidates.columns(numbers)
        rows = self._candidates.rows(columns)
        found = np.empty((numbers.size, len(FINDINGS)))
        pretension = np.full(numbers.size, self._candidates.pretension)
        (self._fine if fine else self._coarse).judge(rows, pretension, found, threads())
        pair, rope, *_ = np.unravel_index(numbers, self._candidates.shape)
        extra = {
            "largest_wheel": self._largest_wheel[pair],
            "spool_radius": np.array([spool.radius for spool in self._spools])[pair],
            "breaking_load": self._breaking_load[rope],
        }
        return columns | dict(zip(FINDINGS, found.T, strict=True)) | extra

    def spool(self, number: int) -> Spool:
        """Return the spool of a scale model whose angles are closest to those of the real-size spool."""
        return self._spools[int(np.unravel_index(number, self._candidates.shape)[0])]

    def load_cell(self, largest_tension: float) -> LoadCell:
        """Return the finest load cell with a sufficient range for a tension (N)."""
        return self._cells[int(self._cell(np.array([largest_tension]))[0])]

    def _cell(self, largest_tension: Array) -> NDArray[np.int64]:
        ranges = np.array([cell.range for cell in self._cells])
        needed = self._catalogue.constraints.load_cell_margin * largest_tension
        least = np.minimum(np.searchsorted(ranges, needed * (1 - 1e-12)), len(self._cells) - 1)
        return np.array(self._finest)[least]

    def costs(self, columns: Mapping[str, Array]) -> Array:
        """Return the costs of scale models, shape (n, 4)."""
        resolution = np.array([cell.resolution for cell in self._cells])[self._cell(columns["largest_tension"])]
        return np.column_stack(
            [
                np.degrees(columns["largest_error"]),
                np.maximum(self._weight_step(columns), tip_force(resolution, columns)),
                columns["tendon_length"],
                columns["largest_tension"] / columns["breaking_load"],
            ]
        )

    def _weight_step(self, columns: Mapping[str, Array]) -> Array:
        rho = self._catalogue.constraints.cable_pulley_radius
        finest = finest_difference(self._catalogue)
        step: Array = finest * STANDARD_GRAVITY * rho / columns["rig_arm"] / columns["force_factor"]
        return step


def tip_force(tension_resolution: Any, columns: Mapping[str, Any]) -> Any:
    """Return the smallest force at the real-size tip (N) that two load cells of a resolution (N) detect.

    `columns` holds the tension difference per tip force and the force factor, by name.
    """
    return sqrt(2) * tension_resolution / columns["tension_per_force"] / columns["force_factor"]


def _nearest_spool(real_size: ShortForm, catalogue: Catalogue, distal: Wheel) -> Spool:
    wanted = real_size.drives.spool_radius * distal.radius / value_of(real_size, "distal_radius")
    return min(catalogue.spools, key=lambda one: abs(log(one.radius / wanted)))
