"""The search for an optimum: the training runs as a function of the free parameters, from many starts."""

import math
from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from scipy import special

from tenodesis.errors import IdentificationError
from tenodesis.identification import uncertainty
from tenodesis.identification.problem import Problem, differenced, scales
from tenodesis.identification.uncertainty import Linearised, LossName
from tenodesis.run import Array

DerivativesName: TypeAlias = Literal["exact", "differences"]

LEAST_PER_PARAMETER = 10
"""Samples of the training runs per fitted parameter."""
MOST_STEPS = 100
"""Iterations of a search."""

SHARES_NEAR = (1.0, 0.5, 0.25, 0.125)
"""Of a Gauss-Newton step near an optimum, of which the best is taken (three halvings: Kelley 2011, `imfil`)."""
ONE_DEVIATION = 0.5
"""By how much one deviation of one parameter raises the cost from an optimum: half of a unit of chi-square."""
DRAWS_NEAR = 40
"""Points around an optimum from which steps are averaged: their mean is known to a sixth of their scatter."""
MOST_OVER_NOISE = 5.0
"""Deviations by which the mean square of residuals may be above the sensors' noise."""
HALVINGS = 3
"""Of the changes over which slopes are taken near an optimum, down to a few deviations."""
_REFIT_STEPS = 20
"""Iterations of a search from the optimum, for a replicate of the bootstrap."""
_TOLERANCE = 1e-9
_DECADES = 100.0
"""Ratio of bounds above which starts are drawn by the logarithm."""
_NEAR_BOUND = 1e-2
"""Share of its range within which a parameter is tried on its bound."""


class SearchEnd(NamedTuple):
    """Where a search ended."""

    at: Array
    cost: float
    converged: bool
    scatter: Array | None = None
    """Covariance of where steps to the optimum lead, (free parameters, free parameters), where the cost is rough."""


class Search:
    """The training runs of a problem as a function of the free parameters, to be searched for an optimum."""

    def __init__(
        self, problem: Problem, free: Sequence[int], train: Sequence[int], loss: LossName, derivatives: DerivativesName
    ) -> None:
        self.problem, self.free, self.train, self.loss = problem, list(free), train, loss
        self.exact = derivatives == "exact"
        self.changes: Array | None = None
        """Changes of the free parameters over which slopes are taken, if not by the problem's own derivatives.

        (free, free), one in each column; over one parameter after the other, if None.
        """
        self.evaluations = self.jacobians = self.begun = 0
        self.watch: Callable[[int], None] | None = None
        """Called with the evaluations of a search so far."""
        self.start = np.array([one.start for one in problem.parameters], dtype=np.float64)
        self.lower = np.array([problem.parameters[index].lower for index in free])
        self.upper = np.array([problem.parameters[index].upper for index in free])
        self.linear = problem.linear[self.free]
        """Which free parameters residuals are linear in."""
        self.begin = np.clip(problem.starting_values(train)[self.free], self.lower, self.upper)
        """Where a search of the free parameters begins; what is held stays at its own start."""
        self.samples = sum(problem.residuals(self.start, run).size for run in train)
        least = LEAST_PER_PARAMETER * len(self.free)
        if self.samples < least:
            raise IdentificationError(
                f"the training runs have {self.samples} samples, which is too few for {len(self.free)} parameters; "
                f"at least {least} are needed, {LEAST_PER_PARAMETER} for each.",
                key="samples",
                value=self.samples,
                allowed=f"at least {least}",
            )

    def full(self, at: Array) -> Array:
        """Return the values of all parameters, with those of the free parameters in place."""
        values = self.start.copy()
        values[self.free] = at
        return values

    def residuals(self, at: Array) -> Array:
        """Return the residuals of all training runs, joined, (n,)."""
        self.evaluations += 1
        if self.watch is not None:
            self.watch(self.evaluations - self.begun)
        values = self.full(at)
        return np.concatenate([self.problem.residuals(values, run) for run in self.train])

    def jacobian(self, at: Array) -> Array:
        """Return their derivatives by the free parameters, (n, free parameters)."""
        values = self.full(at)
        given = [one for run in self.train if (one := self._own(values, run)) is not None]
        if len(given) == len(self.train):
            self.jacobians += 1
            return np.concatenate(given)
        return self._differenced(self.residuals, at)

    def _differenced(self, function: Callable[[Array], Array], at: Array) -> Array:
        if self.changes is None:
            return differenced(function, at, self.lower, self.upper, self._scale(at))
        ends = [[np.clip(at + sign * one, self.lower, self.upper) for sign in (1, -1)] for one in self.changes.T]
        self._ahead([point for both in ends for point in both])
        middle, moved, found = function(at), [], []
        for points in ends:
            sides = [function(one) - middle for one in points]
            sizes = [float(np.linalg.norm(one)) for one in sides]
            # a side that differs more than this leads over a cliff, as where a pair of tendons slips at once
            if np.linalg.norm(sides[0] + sides[1]) > min(sizes) > 0:
                beyond = int(np.argmax(sizes))
                points[beyond], sides[beyond] = at, np.zeros_like(middle)
            moved.append(points[0] - points[1])
            found.append(sides[0] - sides[1])
        return np.stack(found, axis=1) @ np.linalg.inv(np.stack(moved, axis=1))

    def _ahead(self, points: Sequence[Array]) -> None:
        """Tell the problem at which points of the free parameters residuals are asked for next."""
        for run in self.train:
            self.problem.ahead([self.full(one) for one in points], run)

    def _own(self, values: Array, run: int) -> Array | None:
        """Return the problem's own derivatives by the free parameters, (n, free), or None to use differences."""
        return self.problem.derivatives(values, run, self.free) if self.exact and self.changes is None else None

    def solve(
        self, start: Array, *, aim: Array | None = None, held: Sequence[int] = (), steps: int = MOST_STEPS
    ) -> SearchEnd | None:
        """Return the optimum found from a start of the free parameters, or None where the model has no answer there.

        `aim` is subtracted from the residuals, for the bootstrap; `held` are the free parameters that stay as they are.
        """
        self.begun = self.evaluations
        loose = [index for index in range(start.size) if index not in set(held)]

        def moved(part: Array) -> Array:
            at = start.copy()
            at[loose] = part
            return at

        def residuals(part: Array) -> Array:
            found = self.residuals(moved(part))
            return found if aim is None else found - aim

        def jacobian(part: Array) -> Array:
            return self._finite(self.jacobian(moved(part)))[:, loose]

        if not np.isfinite(residuals(start[loose])).all():
            return None
        if not loose:
            return SearchEnd(start, self._cost(residuals(start[loose])), converged=True)
        from scipy.optimize import least_squares  # noqa: PLC0415 - slow to load

        found = least_squares(
            residuals,
            start[loose],
            jac=jacobian,
            bounds=(self.lower[loose], self.upper[loose]),
            x_scale=self._scale(start)[loose],
            loss=self.loss,
            ftol=_TOLERANCE,
            xtol=_TOLERANCE,
            gtol=_TOLERANCE,
            max_nfev=steps,
        )
        return SearchEnd(moved(np.asarray(found.x)), float(found.cost), converged=found.status != 0)

    def stepped(self, start: Array) -> Array:
        """Return where Gauss-Newton steps lead from near an optimum, each as long as lowers the cost most.

        Slopes over changes beyond the steps of stick and slip lead past the small optima between these; where a step
        lowers the cost by less than one deviation of a parameter raises it, changes are halved (implicit filtering,
        Gilmore and Kelley 1995).
        """
        self.begun = self.evaluations
        at, residuals, halvings = start, self.residuals(start), 0
        for _ in range(MOST_STEPS):
            step = self._stepped(at, residuals, self._finite(self.jacobian(at))) - at
            points = [at + share * step for share in SHARES_NEAR]
            self._ahead(points)
            found = [self.residuals(one) for one in points]
            costs = [self._cost(one) for one in found]
            best, before = int(np.argmin(costs)), self._cost(residuals)
            if costs[best] < before:
                at, residuals = points[best], found[best]
            if not costs[best] < before - ONE_DEVIATION:
                if self.changes is None or halvings == HALVINGS:
                    break
                halvings += 1
                self.changes = self.changes / 2
        return at

    def scatter(self, near: Array, covariance: Array, seed: int) -> Array:
        """Return the covariance of where single Gauss-Newton steps lead to from points around an optimum, about it.

        Points are drawn from what is left open of the parameters, with their covariance, (free, free), over their
        scales. Where the cost is smooth, all steps lead to its optimum.
        """
        self.begun = self.evaluations
        draw = np.random.default_rng([seed, 2])
        slopes = self._finite(self.jacobian(near))
        sizes, directions = np.linalg.eigh(covariance)
        root = self._scale(near)[:, None] * directions * np.sqrt(np.maximum(sizes, 0))
        draws = draw.standard_normal((DRAWS_NEAR, near.size))
        points = [near, *(np.clip(near + root @ one, self.lower, self.upper) for one in draws)]
        self._ahead(points)
        found = [(one, self.residuals(one)) for one in points]
        moves = [self._stepped(one, rows, slopes) - near for one, rows in found if self.explains(rows)]
        return np.asarray(np.mean([np.outer(one, one) for one in moves], axis=0), dtype=np.float64)

    def explains(self, residuals: Array) -> bool:
        """Return whether residuals are the sensors' noise: their mean square is that of so many normal deviates."""
        return bool(np.mean(residuals**2) <= 1 + MOST_OVER_NOISE * math.sqrt(2 / residuals.size))

    def _stepped(self, at: Array, residuals: Array, slopes: Array) -> Array:
        """Return where a Gauss-Newton step leads, within the bounds."""
        first, second = uncertainty.influence(residuals, self.loss)
        root, scale = np.sqrt(second), self._scale(at)
        step = np.linalg.lstsq(root[:, None] * slopes * scale, first / root, rcond=uncertainty.UNSEEN)[0]
        there = at - scale * step
        if (there >= self.lower).all() and (there <= self.upper).all():
            return there
        from scipy.optimize import lsq_linear  # noqa: PLC0415 - slow to load

        # others make up for what a bound holds
        within = (self.lower - at) / scale, (self.upper - at) / scale
        turned, square = np.linalg.qr(root[:, None] * slopes * scale)
        shares = lsq_linear(square, -turned.T @ (first / root), within, method="bvls").x
        return np.clip(at + scale * shares, self.lower, self.upper)

    def on_bounds(self, found: SearchEnd) -> tuple[Array, float]:
        """Return the optimum and its cost, with parameters moved onto the bounds that the search stops short of.

        A parameter is moved onto a bound where the cost is no higher there, unless the cost is rough. One without any
        effect stays where it started.
        """
        at, cost = found.at, found.cost
        inert = ~self._finite(self.jacobian(at)).any(axis=0)
        if inert.any():
            kept = np.where(inert, self.start[self.free], at)
            same = self.cost(kept)
            at, cost = (kept, same) if same <= cost else (at, cost)
        reach = _NEAR_BOUND * (self.upper - self.lower)
        for bound in (self.lower, self.upper) if found.scatter is None else ():
            for index in np.flatnonzero((np.abs(at - bound) < reach) & (at != bound) & ~inert):
                there = at.copy()
                there[index] = bound[index]
                if self.cost(there) <= cost * (1 + 1e-9):
                    again = self.solve(
                        there, held=[int(index), *np.flatnonzero((at == self.lower) | (at == self.upper))]
                    )
                    if again is not None and again.cost <= cost * (1 + 1e-9):
                        at, cost = again.at, again.cost
        return at, cost

    def linearised(self, at: Array, run: int, scale: Array) -> Linearised:
        """Return a run at the optimum."""
        values = self.full(at)
        own = self._own(values, run)
        jacobian = self._differenced(lambda x: self.problem.residuals(self.full(x), run), at) if own is None else own
        return Linearised(
            self.problem.residuals(values, run),
            self._finite(jacobian) * scale,
            self.problem.channels(run),
            self.problem.systematic_errors(values, run),
        )

    def unanswered(self) -> IdentificationError:
        """Return the error for a model that has no answer at any start."""
        for run in self.train:
            if not np.isfinite(self.problem.residuals(self.start, run)).all():
                return IdentificationError(
                    f"the model has no answer for {self.problem.runs[run]} at any of the starts: residuals are not "
                    "finite; starts and bounds must be such that it has one.",
                    key="residuals",
                    allowed="finite",
                )
        return IdentificationError(
            "the model has no answer at any of the starts: residuals are not finite.", key="residuals", allowed="finite"
        )

    def _scale(self, at: Array) -> Array:
        return scales(self.problem.parameters, self.full(at))[self.free]

    def cost(self, at: Array) -> float:
        """Return the cost of values of the free parameters."""
        return self._cost(self.residuals(at))

    def _cost(self, residuals: Array) -> float:
        squares = residuals**2
        return float(0.5 * np.sum(squares if self.loss == "linear" else 2 * (np.sqrt(1 + squares) - 1)))

    def _finite(self, jacobian: Array) -> Array:
        if not np.isfinite(jacobian).all():
            names = [self.problem.parameters[index].name for index in self.free]
            bad = [name for name, column in zip(names, jacobian.T, strict=True) if not np.isfinite(column).all()]
            raise IdentificationError(
                f"the derivatives of the model with respect to {bad[0]} are not finite.",
                key="derivatives",
                value=bad[0],
                allowed="finite",
            )
        return jacobian


def starting_points(search: Search, count: int, seed: int) -> list[Array]:
    """Return the starts of a search: the problem's own, and others drawn within the bounds (Latin hypercube)."""
    own = search.begin
    if count == 1:
        return [own]
    from scipy.stats import qmc  # noqa: PLC0415 - slow to load

    shares = qmc.LatinHypercube(len(search.free), rng=np.random.default_rng([seed, 0])).random(count - 1)
    wide = (search.lower > 0) & (search.upper > _DECADES * np.abs(search.lower))
    low = np.where(wide, np.log(np.where(wide, search.lower, 1)), search.lower)
    high = np.where(wide, np.log(np.where(wide, search.upper, 1)), search.upper)
    drawn = low + shares * (high - low)
    drawn[:, wide] = np.exp(drawn[:, wide])
    return [own, *np.clip(drawn, search.lower, search.upper)]


def replicates(
    search: Search,
    at: Array,
    runs: Sequence[Linearised],
    count: int,
    *,
    seed: int,
    dof: float,
    done: Callable[[int], None],
) -> Array:
    """Return the optimum of each replicate, shape (count, free parameters).

    Drawn residuals are swollen by what the parameters took up, and so that percentiles are as far out as Student's t
    with the effective samples left over (Hesterberg 2015).
    """
    draw = np.random.default_rng([seed, 1])
    lengths = [
        max(uncertainty.block_length(series) for series in one.residuals.reshape(one.channels, -1)) for one in runs
    ]
    centred = np.concatenate([one.residuals for one in runs])
    swell = math.sqrt(1 + at.size / dof) * float(special.stdtrit(dof, 0.975) / special.ndtri(0.975))
    out = np.empty((count, at.size))
    for replicate in range(count):
        fresh = np.concatenate(
            [
                uncertainty.resampled(one.residuals, one.channels, length, draw)
                for one, length in zip(runs, lengths, strict=True)
            ]
        )
        again = search.solve(at, aim=centred - swell * fresh, steps=_REFIT_STEPS)
        out[replicate] = at if again is None else again.at
        done(replicate + 1)
    return out
