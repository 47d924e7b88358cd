"""Maximum likelihood by least squares, from many starts, with the uncertainty of every parameter."""

import math
import time
from collections.abc import Callable, Sequence
from typing import get_args

import numpy as np
from scipy import special

from tenodesis.errors import IdentificationError
from tenodesis.identification import identifiability, uncertainty
from tenodesis.identification.problem import Problem, scales
from tenodesis.identification.results import (
    Fit,
    Interval,
    information_criteria,
    pooled,
    run_errors,
    unexplained,
    warnings,
)
from tenodesis.identification.search import (
    HALVINGS,
    MOST_STEPS,
    ONE_DEVIATION,
    DerivativesName,
    Search,
    SearchEnd,
    replicates,
    starting_points,
)
from tenodesis.identification.uncertainty import Linearised, LossName, Whiteness
from tenodesis.run import Array

STARTS = 4
REFINEMENTS = 3
"""Searches from the optimum on, where a problem is prepared for it."""
SETTLED = 1e-3
"""Share of its range by which a parameter may move in the last of these."""
SLOPES_OVER = 8.0 * 2**HALVINGS
"""Change over which a slope is taken at first, in deviations of each principal direction of what is open.

Over a smaller one, a few contacts that stick or slip make up the difference; over a larger one, the change of many.
Along parameters instead, these would be many deviations of what is known best, and hide what is known least.
"""
LARGEST_WIDTH = 0.02
"""Of these changes, over a parameter's scale."""
LEAST_REPLICATES = 40


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
    refine: bool = True,
    progress: Callable[[float, int], None] | None = None,
) -> Fit:
    """Return the parameters of a model fitted to recordings, with their uncertainty.

    Parameters
    ----------
    free
        Names of the parameters to fit, all by default; the others keep their start.
    train, test
        Indices of the runs to fit, and of those held out: they take no part in the fit.
    starts
        The first is the problem's own (`Problem.starting_values`), the others are drawn within the bounds (Latin
        hypercube), and not tried where the search with systematic errors of sensors in the weights reaches their noise
        from the first.
    seed
        Of the starts and of the bootstrap.
    loss
        linear, or soft_l1 against outliers: beyond a standard deviation of the sensor a residual counts by its size.
    derivatives
        exact uses the problem's own where it has them, differences never does.
    bootstrap
        Replicates of a block bootstrap, each fitted again; none if zero.
    refine
        Whether the problem is prepared for further searches near the optimum (`Problem.refine`).
    progress
        Called with how many of how many searches are done, within one the share of the longest: from starts, near the
        optimum, and of replicates.

    Raises
    ------
    IdentificationError
        The request is not valid, there are too few samples, the model has no answer, or no parameter
        to be fitted is identifiable.
    """
    begun = time.monotonic()
    _check(problem, train, test, starts=starts, bootstrap=bootstrap, loss=loss, derivatives=derivatives)
    indices = _free(problem, free)
    search = Search(problem, indices, tuple(train), loss, derivatives)
    # those of an earlier fit
    problem.weigh_sensors(search.start, ())
    searches = starts + (problem.searches_near if refine else 0)
    total, done = searches + bootstrap, 0
    report = progress or (lambda _done, _total: None)

    def advance() -> None:
        nonlocal done
        done += 1
        report(done, total)

    search.watch = lambda evaluations: report(min(done + min(evaluations / MOST_STEPS, 1.0), searches), total)
    refined, best, costs = _searched(search, starts, seed, refine=refine, advance=advance)
    search.watch = None
    report(searches, total)
    at, cost = search.on_bounds(refined)
    # costs of a refined problem do not compare with those of the starts
    reference = cost if refined is best else best.cost

    values = search.full(at)
    scale = scales(problem.parameters, values)[indices]
    linearised = [search.linearised(at, run, scale) for run in search.train]
    _check_excitation(problem, indices, linearised, [problem.runs[run] for run in search.train], loss)
    scatter = None if refined.scatter is None else refined.scatter / np.outer(scale, scale)
    found = uncertainty.estimate(linearised, loss, scatter=scatter)
    base = np.concatenate([one.residuals for one in linearised])

    def change(other: Array) -> float:
        search.evaluations += 1
        return float(np.sum((np.concatenate([problem.residuals(other, run) for run in search.train]) - base) ** 2))

    identifiable = identifiability.examine(problem, indices, values, scale=scale, found=found, change=change)
    noises = [noise for run, one in zip(search.train, linearised, strict=True) for noise in _noises(problem, run, one)]
    effective = sum(noise.effective_samples for noise in noises)
    dof = max(1.0, effective - len(indices))
    # costs that differ by no more than chance are the same optimum
    same = sum(one <= reference * (1 + 1 / effective) + 1e-12 for one in costs)
    names = tuple(problem.parameters[index].name for index in indices)
    bootstrapped = None
    if bootstrap:
        fits = replicates(
            search,
            at,
            linearised,
            bootstrap,
            seed=seed,
            dof=dof,
            done=lambda n: report(searches + n, total),
        )
        low, high = np.quantile(fits, [0.025, 0.975], axis=0)
        bootstrapped = {name: (float(low[n]), float(high[n])) for n, name in enumerate(names)}

    files = (
        *(
            run_errors(
                problem, values, run, "train", problem.sensor_errors(values, run, one.jacobian, found.covariance)
            )
            for run, one in zip(search.train, linearised, strict=True)
        ),
        *(run_errors(problem, values, run, "test") for run in test),
    )
    aic, bic = information_criteria(base, len(indices))
    return Fit(
        parameters=problem.parameters,
        free=names,
        values={one.name: float(value) for one, value in zip(problem.parameters, values, strict=True)},
        std=dict(zip(names, (found.std * scale).tolist(), strict=True)),
        std_white=dict(zip(names, (found.white_std * scale).tolist(), strict=True)),
        interval_95=_intervals(problem, indices, at, found.std * scale, dof),
        bootstrap_interval_95=bootstrapped,
        correlation=found.correlation,
        cost=cost,
        aic=aic,
        bic=bic,
        files=files,
        train_rmse=pooled([one for one in files if one.split == "train"]),
        test_rmse=pooled([one for one in files if one.split == "test"]),
        identifiability=identifiable,
        whiteness=tuple(noises),
        starts=len(costs),
        same_optimum=same,
        costs=tuple(costs),
        loss=loss,
        seed=seed,
        bootstrap=bootstrap,
        samples=base.size,
        evaluations=search.evaluations,
        jacobians=search.jacobians,
        warnings=(
            *warnings(found, noises, refined, same=same, starts=len(costs), parameters=len(indices)),
            *unexplained(problem, values, [one for one in files if one.split == "train"]),
        ),
        seconds=time.monotonic() - begun,
    )


def _searched(
    search: Search, starts: int, seed: int, *, refine: bool, advance: Callable[[], None]
) -> tuple[SearchEnd, SearchEnd, list[float]]:
    """Return the optimum, the best that was found before the problem was prepared for it, and the cost of each."""
    problem = search.problem
    # what reaches the sensors' noise from the first start needs no other
    direct = _weighed(problem, search, search.begin, seed, advance) if refine else None
    if direct is not None:
        return direct, direct, [direct.cost]
    ends = []
    for start in starting_points(search, starts, seed):
        ends.append(search.solve(start))
        advance()
    costs = [math.inf if end is None else end.cost for end in ends]
    best = ends[int(np.argmin(costs))]
    if best is None:
        raise search.unanswered()
    if not refine:
        return best, best, costs
    refined = _refined(problem, search, best, advance)
    return _weighed(problem, search, refined.at, seed, advance) or refined, best, costs


def _refined(problem: Problem, search: Search, best: SearchEnd, advance: Callable[[], None]) -> SearchEnd:
    """Return the optimum of the problem as it is prepared for a search near it."""
    found = best
    for _ in range(REFINEMENTS):
        if not problem.refine(search.full(found.at), search.train):
            break
        again = search.solve(found.at)
        advance()
        if again is None:
            break
        moved = np.abs(again.at - found.at) / (search.upper - search.lower)
        found = again
        if moved.max() < SETTLED:
            break
    return found


def _weighed(
    problem: Problem, search: Search, start: Array, seed: int, advance: Callable[[], None]
) -> SearchEnd | None:
    """Return the optimum with systematic errors of sensors in the residuals' weights.

    None where a problem has none, the search does not reach it, or the model leaves an effect out.
    """
    if not problem.weigh_sensors(search.full(start), search.train):
        return None
    near, before = start, search.cost(start)
    for _ in range(problem.searches_near):
        near = search.stepped(near)
        gain = before - search.cost(near)
        # gains of load cells act on tensions, which are better known now
        problem.weigh_sensors(search.full(near), search.train)
        before, residuals = search.cost(near), search.residuals(near)
        scale = scales(problem.parameters, search.full(near))[search.free]
        found = uncertainty.estimate([search.linearised(near, run, scale) for run in search.train], search.loss)
        rough = np.flatnonzero(~search.linear)
        sizes, directions = np.linalg.eigh(found.full[np.ix_(rough, rough)])
        widths = np.minimum(SLOPES_OVER * np.sqrt(sizes), LARGEST_WIDTH / np.abs(directions).max(axis=0, initial=0.0))
        # what is known exactly of the others would be lost in directions shared with these
        search.changes = np.diag(LARGEST_WIDTH * scale)
        search.changes[np.ix_(rough, rough)] = scale[rough, None] * directions * widths
        advance()
        if gain < ONE_DEVIATION * len(search.free):
            break
    if search.explains(residuals):
        scatter = search.scatter(near, found.covariance, seed)
        return SearchEnd(near, before, converged=True, scatter=scatter)
    problem.weigh_sensors(search.full(start), ())
    search.changes = None
    return None


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
            raise IdentificationError(key=name, value=value, allowed=" or ".join(get_args(allowed)))
    if starts < 1:
        raise IdentificationError(key="starts", value=starts, allowed="an integer of at least 1")
    if bootstrap and bootstrap < LEAST_REPLICATES:
        raise IdentificationError(
            key="bootstrap", value=bootstrap, allowed=f"0 for none, or at least {LEAST_REPLICATES}"
        )
    if not train:
        raise IdentificationError("train is empty; it must name at least one run to fit.", key="train")
    for name, runs in (("train", train), ("test", test)):
        for run in runs:
            if not 0 <= run < len(problem.runs):
                raise IdentificationError(key=name, value=run, allowed=f"0 to {len(problem.runs) - 1}")
    used = [*train, *test]
    twice = next((run for run in used if used.count(run) > 1), None)
    if twice is not None:
        raise IdentificationError(key="test", value=twice, allowed="given once among train and test")
    for one in problem.parameters:
        if not (math.isfinite(one.lower) and math.isfinite(one.upper) and one.lower <= one.start <= one.upper):
            raise IdentificationError(
                f"{one.name} starts at {one.start:g} {one.unit} within {one.lower:g} to {one.upper:g}; a start must "
                "be between finite bounds.",
                key=one.name,
                value=one.start,
            )


def _free(problem: Problem, free: Sequence[str] | None) -> list[int]:
    names = [one.name for one in problem.parameters]
    wanted = names if free is None else list(free)
    unknown = [name for name in wanted if name not in names]
    if unknown or not wanted:
        wrong = f"free names {unknown[0]!r}, which is no parameter" if unknown else "free is empty"
        raise IdentificationError(f"{wrong}; it must name some of {', '.join(names)}.", key="free", value=unknown[:1])
    indices = sorted({names.index(name) for name in wanted})
    for one in (problem.parameters[index] for index in indices):
        if one.lower == one.upper:
            raise IdentificationError(
                f"{one.name} has both bounds at {one.lower:g} {one.unit}, and cannot be fitted.", key=one.name
            )
    return indices


def _check_excitation(
    problem: Problem, free: Sequence[int], runs: Sequence[Linearised], names: Sequence[str], loss: LossName
) -> None:
    """Refuse recordings from which no parameter is identifiable, or only by a constant."""
    listed = ", ".join(problem.parameters[index].name for index in free)
    if not uncertainty.estimate(runs, loss).smallest_std < identifiability.IDENTIFIABLE_SHARE:
        raise IdentificationError(
            f"{', '.join(names)}: no excitation, the recordings narrow {listed} no further than their bounds do.",
            key="fit",
            value=names,
            allowed="excited by the recordings",
        )
    varying = [Linearised(one.residuals, _centred(one), one.channels) for one in runs]
    if len(free) > 1 and not uncertainty.estimate(varying, loss).smallest_std < identifiability.IDENTIFIABLE_SHARE:
        raise IdentificationError(
            f"{', '.join(names)}: no excitation, {listed} are seen in constants only: in nothing that "
            "changes over the recordings.",
            key="fit",
            value=names,
            allowed="excited by the recordings",
        )


def _centred(one: Linearised) -> Array:
    split = one.jacobian.reshape(one.channels, -1, one.jacobian.shape[1])
    return np.asarray((split - split.mean(axis=1, keepdims=True)).reshape(one.jacobian.shape), dtype=np.float64)


def _noises(problem: Problem, run: int, one: Linearised) -> list[Whiteness]:
    return [
        uncertainty.whiteness(
            series, run=problem.runs[run], channel=channel, sensor=sensor, sample_time=problem.sample_time(run)
        )
        for channel, (series, sensor) in enumerate(
            zip(one.residuals.reshape(one.channels, -1), problem.sensors(run), strict=True)
        )
    ]


def _intervals(problem: Problem, free: Sequence[int], at: Array, std: Array, dof: float) -> dict[str, Interval]:
    """Return 95 % intervals by Student's t with the effective samples left over, within the bounds."""
    half = float(special.stdtrit(dof, 0.975)) * std
    return {
        one.name: (max(one.lower, value - width), min(one.upper, value + width))
        for one, value, width in zip(
            (problem.parameters[index] for index in free), at.tolist(), half.tolist(), strict=True
        )
    }
