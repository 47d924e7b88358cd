"""Maximum likelihood by least squares, from many starts, with everything that belongs to an honest number."""

import math
import time
from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple, TypeAlias, get_args

import numpy as np
from scipy import special

from tenodesis.errors import IdentificationError
from tenodesis.identification import bootstrap as resampling
from tenodesis.identification import identifiability, uncertainty, whiteness
from tenodesis.identification.differences import differenced, scales
from tenodesis.identification.problem import Problem, WithChannels, WithDerivatives, WithLasting, WithTraces
from tenodesis.identification.results import Fit, Interval, RunErrors
from tenodesis.identification.uncertainty import Linearised, LossName, Spread
from tenodesis.identification.whiteness import Whiteness
from tenodesis.run import Array

DerivativesName: TypeAlias = Literal["exact", "differences"]

STARTS = 4
LEAST_PER_PARAMETER = 10
"""Samples of the training runs per fitted parameter."""
LEAST_REPLICATES = 40

_TOLERANCE = 1e-9
_MOST_STEPS = 100
_REFIT_STEPS = 20
_DECADES = 100.0
"""Ratio of bounds above which starts are drawn by the logarithm."""
_MOST_UNEXPLAINED = 0.5
"""Share of a measured signal's spread that a model may leave of it."""
_LEAST_MOVED = 0.1
"""Share of the widest spread of all runs below which a signal was held, and there is nothing to explain."""
_MOST_WORSE = 4.0
"""How many times the fitted runs' error that of the held-out ones may be."""
_NEAR_BOUND = 1e-2
"""Share of its range within which a parameter is tried on its bound."""


def fit(
    problem: Problem,
    free: Sequence[str] | None = None,
    *,
    train: Sequence[int],
    test: Sequence[int] = (),
    starts: int = STARTS,
    seed: int = 0,
    loss: LossName = "linear",
    derivatives: DerivativesName = "exact",
    bootstrap: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Fit:
    """Fit a model to recordings, and say how well that is known.

    Parameters
    ----------
    problem
        The model with its recordings.
    free
        Names of the parameters to fit, all unless told; the others keep their start.
    train, test
        Indices of the runs to fit, and of those held out: they take no part in the fit.
    starts
        The first is the parameters' own start, the others are drawn within the bounds (Latin hypercube).
    seed
        Of the starts and of the bootstrap.
    loss
        linear, or soft_l1 against outliers: beyond a standard deviation of the sensor a residual counts by its size.
    derivatives
        exact uses the problem's own where it has them, differences never does.
    bootstrap
        Replicates of a block bootstrap, each fitted again; none if zero.
    progress
        Told how much is done of how much.

    Raises
    ------
    IdentificationError
        The request is not valid, there are too few samples, the model has no answer, or the recordings tell nothing
        of what is to be fitted.
    """
    begun = time.monotonic()
    _check(problem, train, test, starts=starts, bootstrap=bootstrap, loss=loss, derivatives=derivatives)
    indices = _free(problem, free)
    task = _Task(problem, indices, tuple(train), loss, derivatives)
    whole = starts + bootstrap
    report = progress or (lambda _done, _whole: None)

    ends: list[_End | None] = []
    for start in _starts(task, starts, seed):
        ends.append(task.solve(start))
        report(len(ends), whole)
    costs = [math.inf if end is None else end.cost for end in ends]
    best = ends[int(np.argmin(costs))]
    if best is None:
        raise task.unanswered()
    at, cost = task.on_bounds(best)

    values = task.full(at)
    scale = scales(problem.parameters, values)[indices]
    linearised = [task.linearised(at, run, scale) for run in task.train]
    _check_excitation(problem, indices, linearised, [problem.runs[run] for run in task.train], loss)
    found = uncertainty.spread(linearised, loss)
    base = np.concatenate([one.residuals for one in linearised])

    def change(other: Array) -> float:
        task.evaluations += 1
        return float(np.sum((np.concatenate([problem.residuals(other, run) for run in task.train]) - base) ** 2))

    told = identifiability.examine(problem, indices, values, scale=scale, found=found, change=change)
    noises = [noise for run, one in zip(task.train, linearised, strict=True) for noise in _noises(problem, run, one)]
    worth = sum(noise.effective_samples for noise in noises)
    freedom = max(1.0, worth - len(indices))
    # by so much costs differ by chance
    same = sum(one <= cost * (1 + 1 / worth) + 1e-12 for one in costs)
    names = tuple(problem.parameters[index].name for index in indices)
    drawn = None
    if bootstrap:
        replicates = _replicates(
            task,
            at,
            linearised,
            bootstrap,
            seed=seed,
            freedom=freedom,
            done=lambda done: report(starts + done, whole),
        )
        low, high = np.quantile(replicates, [0.025, 0.975], axis=0)
        drawn = {name: (float(low[n]), float(high[n])) for n, name in enumerate(names)}

    files = tuple(
        _errors(problem, values, run, split) for split, runs in (("train", train), ("test", test)) for run in runs
    )
    aic, bic = _criteria(base, len(indices))
    return Fit(
        parameters=problem.parameters,
        free=names,
        values={one.name: float(value) for one, value in zip(problem.parameters, values, strict=True)},
        std=dict(zip(names, (found.std * scale).tolist(), strict=True)),
        std_white=dict(zip(names, (found.white_std * scale).tolist(), strict=True)),
        interval_95=_intervals(problem, indices, at, found.std * scale, freedom),
        bootstrap_interval_95=drawn,
        correlation=found.correlation,
        cost=cost,
        aic=aic,
        bic=bic,
        files=files,
        train_rmse=_pooled([one for one in files if one.split == "train"]),
        test_rmse=_pooled([one for one in files if one.split == "test"]),
        identifiability=told,
        whiteness=tuple(noises),
        starts=starts,
        same_optimum=same,
        costs=tuple(costs),
        loss=loss,
        seed=seed,
        bootstrap=bootstrap,
        samples=task.samples,
        evaluations=task.evaluations,
        jacobians=task.jacobians,
        warnings=(
            *_warnings(found, noises, best, same=same, starts=starts, parameters=len(indices)),
            *unexplained(problem, values, [one for one in files if one.split == "train"]),
        ),
        seconds=time.monotonic() - begun,
    )


class _End(NamedTuple):
    """Where a search ended."""

    at: Array
    cost: float
    converged: bool


class _Task:
    """The training runs of a problem as one function of the free parameters."""

    def __init__(
        self, problem: Problem, free: Sequence[int], train: Sequence[int], loss: LossName, derivatives: DerivativesName
    ) -> None:
        self.problem, self.free, self.train, self.loss = problem, list(free), train, loss
        self.exact = derivatives == "exact"
        self.evaluations = self.jacobians = 0
        self.start = np.array([one.start for one in problem.parameters], dtype=np.float64)
        self.lower = np.array([problem.parameters[index].lower for index in free])
        self.upper = np.array([problem.parameters[index].upper for index in free])
        self.samples = sum(problem.residuals(self.start, run).size for run in train)
        least = LEAST_PER_PARAMETER * len(self.free)
        if self.samples < least:
            raise IdentificationError(
                f"the training runs have {self.samples} samples, which is too few for {len(self.free)} parameters; "
                f"at least {least} are needed, {LEAST_PER_PARAMETER} for each."
            )

    def full(self, at: Array) -> Array:
        """Return the values of all parameters, with those of the free ones in place."""
        values = self.start.copy()
        values[self.free] = at
        return values

    def residuals(self, at: Array) -> Array:
        self.evaluations += 1
        values = self.full(at)
        return np.concatenate([self.problem.residuals(values, run) for run in self.train])

    def jacobian(self, at: Array) -> Array:
        values = self.full(at)
        own = [self._own(values, run) for run in self.train]
        given = [one for one in own if one is not None]
        if len(given) == len(own):
            self.jacobians += 1
            return np.concatenate(given)
        return differenced(self.residuals, at, self.lower, self.upper, self._scale(at))

    def _own(self, values: Array, run: int) -> Array | None:
        """Return the problem's own derivatives by what is free, (n, free), or None to have them differenced."""
        if not self.exact:
            return None
        if isinstance(self.problem, WithDerivatives):
            return self.problem.derivatives(values, run, self.free)
        whole = self.problem.jacobian(values, run)
        return None if whole is None else whole[:, self.free]

    def solve(
        self, start: Array, *, aim: Array | None = None, held: Sequence[int] = (), steps: int = _MOST_STEPS
    ) -> _End | None:
        """Return the optimum found from a start, or None where the model has no answer there.

        Parameters
        ----------
        start
            Of the free parameters.
        aim
            Subtracted from the residuals, for the bootstrap.
        held
            Which of the free parameters stay as they are.
        steps
            Most iterations.
        """
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
            return _End(start, self._cost(residuals(start[loose])), converged=True)
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
        return _End(moved(np.asarray(found.x)), float(found.cost), converged=found.status != 0)

    def on_bounds(self, found: _End) -> tuple[Array, float]:
        """Return the optimum and its cost, with parameters on a bound they lean on, of which the search stops short.

        A parameter leans on a bound where the cost is no higher on it. One that changes nothing leans on none, and is
        where it started.
        """
        at, cost = found.at, found.cost
        idle = ~self._finite(self.jacobian(at)).any(axis=0)
        if idle.any():
            kept = np.where(idle, self.start[self.free], at)
            same = self._cost(self.residuals(kept))
            at, cost = (kept, same) if same <= cost else (at, cost)
        reach = _NEAR_BOUND * (self.upper - self.lower)
        for bound in (self.lower, self.upper):
            for index in np.flatnonzero((np.abs(at - bound) < reach) & (at != bound) & ~idle):
                there = at.copy()
                there[index] = bound[index]
                if self._cost(self.residuals(there)) <= cost * (1 + 1e-9):
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
        jacobian = (
            differenced(lambda x: self.problem.residuals(self.full(x), run), at, self.lower, self.upper, scale)
            if own is None
            else own
        )
        return Linearised(
            self.problem.residuals(values, run),
            self._finite(jacobian) * scale,
            channels(self.problem, run),
            self.problem.lasting(values, run) if isinstance(self.problem, WithLasting) else None,
        )

    def unanswered(self) -> IdentificationError:
        """Return the error for a model that has no answer at any start."""
        for run in self.train:
            if not np.isfinite(self.problem.residuals(self.start, run)).all():
                return IdentificationError(
                    f"the model has no answer for {self.problem.runs[run]} at any of the starts: residuals are not "
                    "finite; allowed are starts and bounds within which it has."
                )
        return IdentificationError("the model has no answer at any of the starts: residuals are not finite.")

    def _scale(self, at: Array) -> Array:
        return scales(self.problem.parameters, self.full(at))[self.free]

    def _cost(self, residuals: Array) -> float:
        squares = residuals**2
        return float(0.5 * np.sum(squares if self.loss == "linear" else 2 * (np.sqrt(1 + squares) - 1)))

    def _finite(self, jacobian: Array) -> Array:
        if not np.isfinite(jacobian).all():
            names = [self.problem.parameters[index].name for index in self.free]
            bad = [name for name, column in zip(names, jacobian.T, strict=True) if not np.isfinite(column).all()]
            raise IdentificationError(f"the derivatives of the model with respect to {bad[0]} are not finite.")
        return jacobian


def channels(problem: Problem, run: int) -> int:
    """Return how many sensors the residuals of a run hold, one after the other."""
    return problem.channels(run) if isinstance(problem, WithChannels) else 1


def _check(
    problem: Problem,
    train: Sequence[int],
    test: Sequence[int],
    *,
    starts: int,
    bootstrap: int,
    loss: str,
    derivatives: str,
) -> None:
    for name, value, allowed in (("loss", loss, LossName), ("derivatives", derivatives, DerivativesName)):
        if value not in get_args(allowed):
            raise IdentificationError(f"{name} is {value!r}; allowed are {', '.join(get_args(allowed))}.")
    if starts < 1:
        raise IdentificationError(f"starts is {starts}; allowed is a whole number of at least 1.")
    if bootstrap and bootstrap < LEAST_REPLICATES:
        raise IdentificationError(f"bootstrap is {bootstrap}; allowed is 0 for none, or at least {LEAST_REPLICATES}.")
    if not train:
        raise IdentificationError("train is empty; allowed is at least one run to fit.")
    for name, runs in (("train", train), ("test", test)):
        for run in runs:
            if not 0 <= run < len(problem.runs):
                raise IdentificationError(f"{name} names run {run}; allowed are 0 to {len(problem.runs) - 1}.")
    used = [*train, *test]
    twice = next((run for run in used if used.count(run) > 1), None)
    if twice is not None:
        raise IdentificationError(
            f"run {twice} ({problem.runs[twice]}) is given twice among train and test; allowed is once."
        )
    for one in problem.parameters:
        if not (math.isfinite(one.lower) and math.isfinite(one.upper) and one.lower <= one.start <= one.upper):
            raise IdentificationError(
                f"{one.name} starts at {one.start:g} {one.unit} within {one.lower:g} to {one.upper:g}; allowed is a "
                "start between finite bounds."
            )


def _free(problem: Problem, free: Sequence[str] | None) -> list[int]:
    names = [one.name for one in problem.parameters]
    wanted = names if free is None else list(free)
    unknown = [name for name in wanted if name not in names]
    if unknown or not wanted:
        told = f"{unknown[0]!r} is no parameter" if unknown else "free is empty"
        raise IdentificationError(f"{told}; allowed are {', '.join(names)}.")
    indices = sorted({names.index(name) for name in wanted})
    for one in (problem.parameters[index] for index in indices):
        if one.lower == one.upper:
            raise IdentificationError(
                f"{one.name} has one allowed value, {one.lower:g} {one.unit}, and cannot be fitted."
            )
    return indices


def _starts(task: _Task, count: int, seed: int) -> list[Array]:
    own = task.start[task.free]
    if count == 1:
        return [own]
    from scipy.stats import qmc  # noqa: PLC0415 - slow to load

    shares = qmc.LatinHypercube(len(task.free), rng=np.random.default_rng([seed, 0])).random(count - 1)
    wide = (task.lower > 0) & (task.upper > _DECADES * np.abs(task.lower))
    low = np.where(wide, np.log(np.where(wide, task.lower, 1)), task.lower)
    high = np.where(wide, np.log(np.where(wide, task.upper, 1)), task.upper)
    drawn = low + shares * (high - low)
    drawn[:, wide] = np.exp(drawn[:, wide])
    return [own, *np.clip(drawn, task.lower, task.upper)]


def _check_excitation(
    problem: Problem, free: Sequence[int], runs: Sequence[Linearised], names: Sequence[str], loss: LossName
) -> None:
    """Refuse recordings that tell none of the parameters, or only by a constant."""
    listed = ", ".join(problem.parameters[index].name for index in free)
    if not uncertainty.spread(runs, loss).best < identifiability.TOLD:
        raise IdentificationError(
            f"{', '.join(names)}: no excitation, the recordings tell nothing of {listed} that their bounds do not."
        )
    varying = [Linearised(one.residuals, _centred(one), one.channels) for one in runs]
    if len(free) > 1 and not uncertainty.spread(varying, loss).best < identifiability.TOLD:
        raise IdentificationError(
            f"{', '.join(names)}: no excitation, nothing that changes over the recordings tells of {listed}; "
            "what they hold is constants."
        )


def _centred(one: Linearised) -> Array:
    split = one.jacobian.reshape(one.channels, -1, one.jacobian.shape[1])
    return np.asarray((split - split.mean(axis=1, keepdims=True)).reshape(one.jacobian.shape), dtype=np.float64)


def _noises(problem: Problem, run: int, one: Linearised) -> list[Whiteness]:
    return [
        whiteness.examine(series, run=problem.runs[run], channel=channel, sample_time=problem.sample_time(run))
        for channel, series in enumerate(one.residuals.reshape(one.channels, -1))
    ]


def _intervals(problem: Problem, free: Sequence[int], at: Array, std: Array, freedom: float) -> dict[str, Interval]:
    """Return 95 % intervals by Student's t with the effective samples left over, within the bounds."""
    half = float(special.stdtrit(freedom, 0.975)) * std
    return {
        one.name: (max(one.lower, value - width), min(one.upper, value + width))
        for one, value, width in zip(
            (problem.parameters[index] for index in free), at.tolist(), half.tolist(), strict=True
        )
    }


def _replicates(
    task: _Task,
    at: Array,
    runs: Sequence[Linearised],
    count: int,
    *,
    seed: int,
    freedom: float,
    done: Callable[[int], None],
) -> Array:
    """Return the optimum of each replicate, shape (count, free parameters).

    Drawn residuals are swollen by what the parameters took up, and so that percentiles are as far out as Student's t
    with the effective samples left over (Hesterberg 2015).
    """
    draw = np.random.default_rng([seed, 1])
    lengths = [
        max(resampling.block_length(series) for series in one.residuals.reshape(one.channels, -1)) for one in runs
    ]
    centred = np.concatenate([one.residuals for one in runs])
    swell = math.sqrt(1 + at.size / freedom) * float(special.stdtrit(freedom, 0.975) / special.ndtri(0.975))
    out = np.empty((count, at.size))
    for replicate in range(count):
        fresh = np.concatenate(
            [
                resampling.redrawn(one.residuals, one.channels, length, draw)
                for one, length in zip(runs, lengths, strict=True)
            ]
        )
        again = task.solve(at, aim=centred - swell * fresh, steps=_REFIT_STEPS)
        out[replicate] = at if again is None else again.at
        done(replicate + 1)
    return out


def _errors(problem: Problem, values: Array, run: int, split: str) -> RunErrors:
    errors = problem.errors(values, run)
    for key, one in errors.items():
        if one.size == 0:
            raise IdentificationError(f"{problem.runs[run]} has no sample of {key}.")
    return RunErrors(
        name=problem.runs[run],
        split=split,
        samples={key: one.size for key, one in errors.items()},
        rmse={key: float(np.sqrt(np.mean(one**2))) for key, one in errors.items()},
        mean={key: float(np.mean(one)) for key, one in errors.items()},
        largest={key: float(np.max(np.abs(one))) for key, one in errors.items()},
    )


def _pooled(files: Sequence[RunErrors]) -> dict[str, float]:
    """Return the root mean square over all samples of several runs, by name."""
    keys = dict.fromkeys(key for one in files for key in one.rmse)
    out = {}
    for key in keys:
        having = [one for one in files if key in one.rmse]
        squares = sum(one.rmse[key] ** 2 * one.samples[key] for one in having)
        out[key] = math.sqrt(squares / sum(one.samples[key] for one in having))
    return out


def _criteria(residuals: Array, parameters: int) -> tuple[float, float]:
    """Return the criteria of Akaike and of Schwarz, with the noise as one more parameter."""
    count = residuals.size
    squares = float(residuals @ residuals)
    likelihood = count * math.log(squares / count) if squares > 0 else -math.inf
    return likelihood + 2 * (parameters + 1), likelihood + math.log(count) * (parameters + 1)


def unexplained(problem: Problem, values: Array, files: Sequence[RunErrors]) -> list[str]:
    """Return a sentence for each signal of a run of which the model explains little.

    Parameters
    ----------
    problem
        The model with its recordings.
    values
        Of all parameters.
    files
        Errors of the runs at these values.
    """
    if not isinstance(problem, WithTraces):
        return []
    spreads = {
        one.name: {
            key: float(np.std(trace.measured))
            for key, trace in problem.traces(values, problem.runs.index(one.name)).items()
        }
        for one in files
    }
    out = []
    for one in files:
        for key, spread in spreads[one.name].items():
            widest = max(other.get(key, 0.0) for other in spreads.values())
            rmse = one.rmse.get(key, 0.0)
            if spread > _LEAST_MOVED * widest and rmse > _MOST_UNEXPLAINED * spread:
                signal, _, unit = key.rpartition("_")
                out.append(
                    f"The model explains little of {signal.replace('_', ' ')} of {one.name} (rmse {rmse:.3g} {unit}, "
                    f"spread {spread:.3g} {unit}): look for a reversed sign, swapped columns, a frozen sensor or a "
                    "wrong unit."
                )
    return out


def worse_held_out(files: Sequence[RunErrors]) -> list[str]:
    """Return a sentence for each signal whose error is far larger where it was held out."""
    fitted, held = (_pooled([one for one in files if one.split == split]) for split in ("train", "test"))
    return [
        f"The error of {key.rpartition('_')[0].replace('_', ' ')} is {rmse / fitted[key]:.3g} times as large in the "
        f"runs held out as in those fitted (rmse {rmse:.3g} and {fitted[key]:.3g} {key.rpartition('_')[2]}): the "
        "model does not carry over to them."
        for key, rmse in held.items()
        if rmse > _MOST_WORSE * fitted.get(key, math.inf) > 0
    ]


def _warnings(
    found: Spread, noises: Sequence[Whiteness], best: _End, *, same: int, starts: int, parameters: int
) -> list[str]:
    out = []
    if not best.converged:
        out.append(f"The search stopped after {_MOST_STEPS} steps without having converged.")
    if starts > 2 and same == 1:
        out.append(f"Only one of {starts} starts came to the best optimum; there may be a better one yet.")
    worth = sum(noise.effective_samples for noise in noises)
    if worth < LEAST_PER_PARAMETER * parameters:
        out.append(
            f"Residuals are so correlated that all samples are worth {worth:.3g} independent ones, for {parameters} "
            "parameters: the intervals are rough."
        )
    coloured = [noise for noise in noises if not noise.white]
    if coloured:
        with np.errstate(invalid="ignore", divide="ignore"):
            widening = found.std / found.white_std
        factor = np.nanmax(np.where(np.isfinite(widening), widening, np.nan), initial=1.0)
        worst = max(coloured, key=lambda noise: noise.correlation_time)
        out.append(
            f"Residuals are not white in {len(coloured)} of {len(noises)} series (up to {worst.correlation_time:.3g} s "
            f"correlated, {worst.run}): the model leaves something out; intervals are up to {factor:.3g} times "
            "those for white noise."
        )
    return out
