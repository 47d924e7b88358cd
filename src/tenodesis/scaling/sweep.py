"""Judge every scale model that parts and lengths allow, and find the Pareto front."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tenodesis.errors import DesignError
from tenodesis.instrument import ShortForm
from tenodesis.run import Array
from tenodesis.scaling.candidates import COMBINATIONS, Candidates, candidates, finer
from tenodesis.scaling.catalogue import Catalogue
from tenodesis.scaling.costs import Forces, Judge, Limit, Tally, WorkingGrid, forces_of, limits, working_range
from tenodesis.similarity.parameters import RADII

_CHUNK = 65_536
_REFINED_AT_ONCE = 4096
RANGES = ("factor", "overall_length", "end_effector_length", "handle_length")
"""Constraints that are a range."""

ERROR_STEP = 0.01
"""Resolution of similarity errors on a bench, deg."""

RELATIVE_STEP = 0.01
"""Relative difference of resolutions, lengths and margins below which they count as equal."""

_WIDER = 4.0
_TRIED = 50_000

Progress = Callable[[str, int, int], object]
"""Called with the name of the step, the amount done and the total."""


class Stage(NamedTuple):
    """Scale models judged at few points: the numbers of those that may meet every limit, and lower bounds of costs."""

    candidates: Candidates
    feasible: NDArray[np.int64]
    lower: Array


@dataclass(frozen=True)
class Sweep:
    """The Pareto front of an instrument's scale models, and the stages of the search.

    `costs` (shape (n, 4)) are similarity error (deg), force resolution (N, real-size), overall length (m) and one over
    the tension margin, of the n designs on the front over the full working range, sorted by the error; `numbers` (n,)
    are their numbers among the candidates of the last stage. The first stage takes every part and few lengths, the
    last one the parts of the first front and more lengths.
    """

    real_size: ShortForm
    catalogue: Catalogue
    forces: Forces
    range: WorkingGrid
    stages: tuple[Stage, ...]
    numbers: NDArray[np.int64]
    costs: Array

    @property
    def candidates(self) -> Candidates:
        """The scale models to which the front's numbers refer."""
        return self.stages[-1].candidates

    @property
    def examined(self) -> int:
        """Number of scale models judged."""
        return sum(len(stage.candidates) for stage in self.stages)

    @property
    def feasible(self) -> int:
        """Number of those that meet every limit at the few points."""
        return sum(stage.feasible.size for stage in self.stages)

    def at(self, stage: Stage) -> "Sweep":
        """Return this sweep with numbers that refer to the scale models of a stage; it has no front."""
        return replace(self, stages=(stage,), numbers=np.empty(0, np.int64), costs=np.empty((0, 4)))

    def judge(self, stage: Stage) -> "Judge":
        """Return the judge of the scale models of a stage."""
        return Judge(stage.candidates, self.catalogue, self.range)


def sweep(
    real_size: ShortForm,
    catalogue: Catalogue,
    pins: Mapping[str, Any],
    *,
    combinations: int = COMBINATIONS,
    progress: Progress = lambda *_: None,
) -> Sweep:
    """Judge the scale models of a one-axis instrument by the full frictionless model, and find the Pareto front.

    The catalogue is narrowed to the pins (SI units); about `combinations` scale models are judged. Raises DesignError
    if no scale model meets the constraints.
    """
    forces = forces_of(real_size, catalogue)
    span = working_range(real_size, forces.largest)
    found = candidates(real_size, catalogue, pins, combinations)
    searching = _Search(catalogue, span, forces, progress)
    first, tally = searching.stage(found, "judging parts")
    if not first.feasible.size:
        raise contradiction(real_size, catalogue, pins, tally, span)
    numbers, costs = searching.front(first)
    if not numbers.size:
        raise DesignError(
            f"none of {len(found)} scale models meets every limit over the full working range, though "
            f"{first.feasible.size} do at the few points at which all are judged; use wider limits.",
            key="limits",
        )
    closer = finer(found, catalogue, numbers, combinations)
    if len(closer) <= numbers.size:
        return Sweep(real_size, catalogue, forces, span, (first,), numbers, costs)
    last, _ = searching.stage(closer, "judging lengths")
    return Sweep(real_size, catalogue, forces, span, (first, last), *searching.front(last))


class _Search:
    """Judges candidates and finds their front, reporting progress."""

    def __init__(self, catalogue: Catalogue, span: WorkingGrid, forces: Forces, progress: Progress) -> None:
        self._catalogue, self._span, self._progress = catalogue, span, progress
        self._limits = limits(catalogue, forces)

    def stage(self, found: Candidates, doing: str) -> tuple[Stage, Tally]:
        """Judge all candidates at few points."""
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
        """Return numbers and costs of the front over the full working range, sorted by the error."""
        judge = Judge(stage.candidates, self._catalogue, self._span)
        exact = stage.lower.copy()
        refined = 0

        def refine(rows: NDArray[np.int64]) -> tuple[Array, NDArray[np.bool_]]:
            nonlocal refined
            allowed = np.empty(rows.size, bool)
            for part in np.array_split(np.arange(rows.size), -(-rows.size // _REFINED_AT_ONCE)):
                some = rows[part]
                exact[some], allowed[part] = exact_costs(judge, self._limits, stage.feasible[some])
                refined += some.size
                self._progress("refining the front", refined, refined + rows.size)
            return levels(exact[rows]), allowed

        best = search(levels(stage.lower), refine)
        by_level = np.column_stack([levels(exact[best])[:, 0], exact[best, 1:]])
        best = best[np.lexsort(by_level.T[::-1])]
        return stage.feasible[best], exact[best]


def exact_costs(judge: Judge, bounds: tuple[Limit, ...], numbers: NDArray[np.int64]) -> tuple[Array, NDArray[np.bool_]]:
    """Return costs of scale models over the full working range, (n, 4), and whether they meet every limit there."""
    columns = judge.columns(numbers, fine=True)
    return judge.costs(columns), np.all([limit.met(columns) for limit in bounds], axis=0)


def contradiction(
    real_size: ShortForm, catalogue: Catalogue, pins: Mapping[str, Any], tally: Tally, span: WorkingGrid
) -> DesignError:
    """Return the error that names the two constraints that contradict each other, if there are two.

    A limit that nothing meets contradicts a range if it can be met with that range wider.
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
                f"{limit.key} and {key} contradict each other: {limit.requires}, and {asked}; {tally.nearest(limit)}, "
                f"but another {key} can meet it.",
                key=limit.key,
                allowed=limit.requires,
            )
    return tally.contradiction()


def _widened(
    real_size: ShortForm, catalogue: Catalogue, pins: Mapping[str, Any]
) -> Iterator[tuple[str, str, Catalogue, Mapping[str, Any]]]:
    """Yield, one range or pin at a time, its key, its text, and catalogue and pins without it."""
    for key in pins:
        if key in (*RADII, "pretension"):
            free = {name: value for name, value in pins.items() if name != key}
            yield key, f"{key} is pinned", catalogue, free
    ranges = {key: getattr(catalogue.constraints, key) for key in RANGES}
    # A pinned value is the more likely cause.
    for key, asked in sorted(ranges.items(), key=lambda item: item[1] is None or item[1][0] != item[1][1]):
        if asked is not None:
            unit, scale = ("", 1.0) if key == "factor" else (" mm", 1e3)
            low, high = (f"{scale * bound:g}" for bound in asked)
            text = f"{key} is {low}{unit}" if low == high else f"{key} is {low} to {high}{unit}"
            for wider in (None, (asked[0] / _WIDER, asked[1] * _WIDER)):
                constraints = catalogue.constraints.model_copy(update={key: wider})
                yield key, text, catalogue.model_copy(update={"constraints": constraints}), pins


def levels(costs: Array) -> Array:
    """Return costs, shape (n, 4) as in :class:`Sweep`, as integer numbers of steps that a bench can resolve."""
    relative = np.round(np.log(costs[:, 1:]) / np.log1p(RELATIVE_STEP))
    return np.column_stack([np.round(costs[:, 0] / ERROR_STEP), relative])


def search(lower: Array, refine: Callable[[NDArray[np.int64]], tuple[Array, NDArray[np.bool_]]]) -> NDArray[np.int64]:
    """Return the numbers of the designs on the Pareto front; of equal designs, the first.

    `lower` are lower bounds of the costs, as levels, shape (n, 4); `refine` returns the exact levels of some designs by
    number, shape (m, 4), and which of them meet every limit. The front is exact although few designs are refined: a
    design whose lower bounds are dominated is dominated itself.
    """
    costs = lower.copy()
    refined = np.zeros(len(costs), bool)
    pool = np.arange(len(costs))
    while pool.size:
        front = pool[nondominated(costs[pool])]
        new = front[~refined[front]]
        if not new.size:
            return front
        costs[new], allowed = refine(new)
        refined[new] = True
        pool = pool[~np.isin(pool, new[~allowed])]
        exact, rest = pool[refined[pool]], pool[~refined[pool]]
        # Costs do not fall below their bounds: what an exact design beats or equals is out. Exact ones stand first,
        # since of equal rows the first is kept.
        pool = np.concatenate([exact, rest[~_beaten(costs[rest], costs[new[allowed]])]])
    return pool


def nondominated(costs: Array) -> NDArray[np.int64]:
    """Return the numbers of the rows that no other row dominates, ascending; of equal rows, the first."""
    # A row stands behind every row that dominates it, and behind its equals that come first.
    order, distinct = _distinct(costs)
    left, front = order[distinct], []
    columns = np.ascontiguousarray(costs[left].T)
    while left.size:
        front.append(left[0])
        better = _somewhere_better(columns, columns[:, 0])
        left, columns = left[better], columns.take(better, axis=1)
    return np.sort(np.array(front, np.int64))


def _beaten(costs: Array, by: Array) -> NDArray[np.bool_]:
    """Return which rows one of others dominates or equals."""
    order, distinct = _distinct(costs)
    columns, left = np.ascontiguousarray(costs[order[distinct]].T), np.arange(np.count_nonzero(distinct))
    for row in by[_distinct(by)[0]]:
        better = _somewhere_better(columns, row)
        left, columns = left[better], columns.take(better, axis=1)
    beaten = np.ones(len(costs), bool)
    beaten[order] = ~np.isin(np.cumsum(distinct) - 1, left)
    return beaten


def _somewhere_better(columns: Array, row: Array) -> NDArray[np.int64]:
    """Return the numbers of the designs, a column each, that a row neither dominates nor equals."""
    better = columns[0] < row[0]
    for costs, other in zip(columns[1:], row[1:], strict=True):
        better |= costs < other
    return np.flatnonzero(better)


def _distinct(costs: Array) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return an order of rows in which those that dominate many come early, and which differ from the one before."""
    spans = costs.max(axis=0, initial=-np.inf) - costs.min(axis=0, initial=np.inf)
    order = np.lexsort((*costs.T[::-1], (costs / np.where(spans > 0, spans, 1.0)).sum(axis=1)))
    ordered = costs[order]
    return order, np.append(np.ones(min(1, len(costs)), bool), (ordered[1:] != ordered[:-1]).any(axis=1))
