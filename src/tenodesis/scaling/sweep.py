"""Judge every scale model that parts and lengths allow, and find the front."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import log, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tenodesis import _core
from tenodesis.errors import DesignError
from tenodesis.instrument import Instrument
from tenodesis.run import Array
from tenodesis.scaling import front
from tenodesis.scaling.candidates import COMBINATIONS, Candidates, Wheel, candidates, finer
from tenodesis.scaling.catalogue import Catalogue, LoadCell, Spool
from tenodesis.scaling.limits import Forces, Limit, Tally, finest_difference, forces_of, limits
from tenodesis.scaling.range import WorkingRange, working_range
from tenodesis.similarity.parameters import RADII, value_of
from tenodesis.threads import threads
from tenodesis.units import STANDARD_GRAVITY

FINDINGS = tuple(_core.findings())
"""What the core finds of a scale model, in its order."""

_CHUNK = 65_536
_REFINED_AT_ONCE = 4096
RANGES = ("factor", "overall_length", "end_effector_length", "handle_length")
"""Constraints that are ranges."""

_WIDER = 4.0
_TRIED = 50_000

Progress = Callable[[str, int, int], object]
"""Called with what is being done, how much of it is done, and how much there is."""


class Stage(NamedTuple):
    """Scale models judged over few points: all of them, those that may meet every limit, and bounds of their costs."""

    candidates: Candidates
    held: NDArray[np.int64]
    lower: Array


@dataclass(frozen=True)
class Sweep:
    """The scale models of an instrument that no other one beats in everything.

    `costs` are similarity error (deg), force resolution (N, real-size), overall length (m) and one over the tension
    margin, of the designs on the front over the whole working range, in the order of the error; `numbers` are theirs
    among the candidates of the last stage. The first stage takes every part and few lengths, the last one the parts
    that the first front is made of and more lengths.
    """

    real_size: Instrument
    catalogue: Catalogue
    tests: Forces
    range: WorkingRange
    stages: tuple[Stage, ...]
    numbers: NDArray[np.int64]
    costs: Array

    @property
    def candidates(self) -> Candidates:
        """The scale models that the front's numbers count."""
        return self.stages[-1].candidates

    @property
    def examined(self) -> int:
        """How many scale models were judged."""
        return sum(len(stage.candidates) for stage in self.stages)

    @property
    def feasible(self) -> int:
        """How many of them meet every limit at the points they were judged at."""
        return sum(stage.held.size for stage in self.stages)

    def judge(self, stage: Stage) -> "Judge":
        """Return what finds out about the scale models of a stage."""
        return Judge(stage.candidates, self.catalogue, self.range)


class Judge:
    """Finds what there is to know of scale models by number; see :class:`Sweep` for the costs."""

    def __init__(self, found: Candidates, catalogue: Catalogue, span: WorkingRange) -> None:
        self._candidates = found
        self._span = span
        self._catalogue = catalogue
        self._cells = sorted(catalogue.load_cells, key=lambda cell: (cell.range, cell.resolution))
        self._largest_wheel = np.array([max(wheel.tip_radius for wheel in pair) for pair in found.pairs])
        self._breaking_load = np.array([rope.breaking_load for rope in found.ropes])
        self._spools = [_nearest_spool(found.real_size, catalogue, pair[0]) for pair in found.pairs]
        resolutions = [cell.resolution for cell in self._cells]
        # Of the cells whose range suffices, the finest, so that more tension never makes a finer one of it.
        self._finest = [min(range(n, len(self._cells)), key=resolutions.__getitem__) for n in range(len(self._cells))]

    @cached_property
    def _coarse(self) -> _core.SimilarityTarget:
        return self._span.coarse.target(self._candidates.real_size)

    @cached_property
    def _fine(self) -> _core.SimilarityTarget:
        return self._span.fine.target(self._candidates.real_size)

    def columns(self, numbers: NDArray[np.int64], *, fine: bool = False) -> dict[str, Array]:
        """Return parameters and findings of scale models by name, over few points of the working range or all."""
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
        """Return the spool of a scale model: that which turns most nearly as far as the real one's."""
        return self._spools[int(np.unravel_index(number, self._candidates.shape)[0])]

    def load_cell(self, largest_tension: float) -> LoadCell:
        """Return the finest load cell whose range suits a tension (N)."""
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
    """Return the force at the real-size tip (N) that two load cells can just tell.

    Parameters
    ----------
    tension_resolution
        Resolution of a load cell, N.
    columns
        Tension difference per tip force and force factor, as the core finds them.
    """
    return sqrt(2) * tension_resolution / columns["tension_per_force"] / columns["force_factor"]


def sweep(
    real_size: Instrument,
    catalogue: Catalogue,
    pins: Mapping[str, Any],
    *,
    combinations: int = COMBINATIONS,
    progress: Progress = lambda *_: None,
) -> Sweep:
    """Judge every scale model of an instrument by the full frictionless model, and find the front.

    Parameters
    ----------
    real_size
        The real-size instrument, one axis.
    catalogue
        Parts and constraints, narrowed to what is pinned.
    pins
        What is pinned, in SI units.
    combinations
        About how many scale models to judge.
    progress
        Called as the work goes on.

    Raises
    ------
    DesignError
        No scale model meets the constraints.
    """
    tests = forces_of(real_size, catalogue)
    span = working_range(real_size, tests.largest)
    found = candidates(real_size, catalogue, pins, combinations)
    judged = _Judged(catalogue, span, tests, progress)
    first, tally = judged.stage(found, "judging parts")
    if not first.held.size:
        raise contradiction(real_size, catalogue, pins, tally, span)
    numbers, costs = judged.front(first)
    if not numbers.size:
        raise DesignError(
            f"no scale model of {len(found)} meets every limit over the whole working range, though {first.held.size} "
            "do at the few points that all are judged at; allowed are wider limits."
        )
    closer = finer(found, catalogue, numbers, combinations)
    if len(closer) <= numbers.size:
        return Sweep(real_size, catalogue, tests, span, (first,), numbers, costs)
    last, _ = judged.stage(closer, "judging lengths")
    return Sweep(real_size, catalogue, tests, span, (first, last), *judged.front(last))


class _Judged:
    """Judges candidates and finds their front, telling how far it is."""

    def __init__(self, catalogue: Catalogue, span: WorkingRange, tests: Forces, progress: Progress) -> None:
        self._catalogue, self._span, self._progress = catalogue, span, progress
        self._limits = limits(catalogue, tests)

    def stage(self, found: Candidates, doing: str) -> tuple[Stage, Tally]:
        """Judge all candidates over few points."""
        judge = Judge(found, self._catalogue, self._span)
        tally = Tally(self._limits)
        numbers, costs = [], []
        for chunk in found.chunks(_CHUNK):
            columns = judge.columns(chunk)
            feasible = tally.feasible(columns)
            numbers.append(chunk[feasible])
            costs.append(judge.costs({name: values[feasible] for name, values in columns.items()}))
            self._progress(doing, int(chunk[-1]) + 1, len(found))
        return Stage(found, np.concatenate(numbers), np.concatenate(costs)), tally

    def front(self, stage: Stage) -> tuple[NDArray[np.int64], Array]:
        """Return numbers and costs of the front over the whole working range, in the order of the error."""
        judge = Judge(stage.candidates, self._catalogue, self._span)
        exact = stage.lower.copy()
        refined = 0

        def refine(rows: NDArray[np.int64]) -> tuple[Array, NDArray[np.bool_]]:
            nonlocal refined
            allowed = np.empty(rows.size, bool)
            for part in np.array_split(np.arange(rows.size), -(-rows.size // _REFINED_AT_ONCE)):
                some = rows[part]
                exact[some], allowed[part] = exact_costs(judge, self._limits, stage.held[some])
                refined += some.size
                self._progress("refining the front", refined, refined + rows.size)
            return front.levels(exact[rows]), allowed

        best = front.search(front.levels(stage.lower), refine)
        by_level = np.column_stack([front.levels(exact[best])[:, 0], exact[best, 1:]])
        best = best[np.lexsort(by_level.T[::-1])]
        return stage.held[best], exact[best]


def exact_costs(judge: Judge, bounds: tuple[Limit, ...], numbers: NDArray[np.int64]) -> tuple[Array, NDArray[np.bool_]]:
    """Return costs of scale models over the whole working range, (n, 4), and whether they meet every limit there."""
    columns = judge.columns(numbers, fine=True)
    return judge.costs(columns), np.all([limit.met(columns) for limit in bounds], axis=0)


def _nearest_spool(real_size: Instrument, catalogue: Catalogue, distal: Wheel) -> Spool:
    wanted = real_size.drives.spool_radius * distal.radius / value_of(real_size, "distal_radius")
    return min(catalogue.spools, key=lambda one: abs(log(one.radius / wanted)))


def contradiction(
    real_size: Instrument, catalogue: Catalogue, pins: Mapping[str, Any], tally: Tally, span: WorkingRange
) -> DesignError:
    """Return the error that says which two constraints contradict each other, if it is two.

    A limit that nothing meets stands against one of the ranges, if it can be met with that range wider.
    """
    limit = tally.unmeetable()
    if limit is None:
        return tally.contradiction()
    for key, asked, wider, free in _widened(real_size, catalogue, pins):
        try:
            found = candidates(real_size, wider, free, _TRIED)
        except DesignError:
            continue
        judge = Judge(found, wider, span)
        if any(limit.met(judge.columns(chunk)).any() for chunk in found.chunks(_CHUNK)):
            return DesignError(
                f"{limit.key} and {key} contradict each other: {limit.asks}, and {asked}; {tally.nearest(limit)}, but "
                f"another {key} would do."
            )
    return tally.contradiction()


def _widened(
    real_size: Instrument, catalogue: Catalogue, pins: Mapping[str, Any]
) -> Iterator[tuple[str, str, Catalogue, Mapping[str, Any]]]:
    """Yield, one range or pin at a time, its key, what it asks, and catalogue and pins without it."""
    for key in pins:
        if key in (*RADII, "pretension"):
            free = {name: value for name, value in pins.items() if name != key}
            yield key, f"{key} is pinned", catalogue, free
    ranges = {key: getattr(catalogue.constraints, key) for key in RANGES}
    # What is pinned is the likelier to be asked too much of.
    for key, asked in sorted(ranges.items(), key=lambda item: item[1] is None or item[1][0] != item[1][1]):
        if asked is not None:
            unit, scale = ("", 1.0) if key == "factor" else (" mm", 1e3)
            low, high = (f"{scale * bound:g}" for bound in asked)
            told = f"{key} is {low}{unit}" if low == high else f"{key} is {low} to {high}{unit}"
            for wider in (None, (asked[0] / _WIDER, asked[1] * _WIDER)):
                constraints = catalogue.constraints.model_copy(update={key: wider})
                yield key, told, catalogue.model_copy(update={"constraints": constraints}), pins
