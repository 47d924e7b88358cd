"""How well a model explains runs, those fitted and those held out, and the caveats of a fit."""

import math
from collections.abc import Sequence

import numpy as np

from tenodesis.errors import IdentificationError
from tenodesis.identification.problem import Problem
from tenodesis.identification.results import RunErrors
from tenodesis.identification.search import LEAST_PER_PARAMETER, MOST_STEPS, SearchEnd
from tenodesis.identification.uncertainty import Uncertainty
from tenodesis.identification.whiteness import Whiteness
from tenodesis.run import Array

_MOST_UNEXPLAINED = 0.5
"""Share of a measured signal's spread that a model may leave of it."""
_LEAST_MOVED = 0.1
"""Share of the widest spread of all runs below which a signal was held, and there is nothing to explain."""
_MOST_WORSE = 4.0
"""Largest ratio of the error of held-out runs to that of fitted runs."""


def run_errors(problem: Problem, values: Array, run: int, split: str) -> RunErrors:
    """Return the errors of a run, which is of the split train or test."""
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


def pooled(files: Sequence[RunErrors]) -> dict[str, float]:
    """Return the root mean square over all samples of several runs, by name."""
    keys = dict.fromkeys(key for one in files for key in one.rmse)
    out = {}
    for key in keys:
        having = [one for one in files if key in one.rmse]
        squares = sum(one.rmse[key] ** 2 * one.samples[key] for one in having)
        out[key] = math.sqrt(squares / sum(one.samples[key] for one in having))
    return out


def information_criteria(residuals: Array, parameters: int) -> tuple[float, float]:
    """Return the criteria of Akaike and of Schwarz, with the noise as an additional parameter."""
    count = residuals.size
    squares = float(residuals @ residuals)
    likelihood = count * math.log(squares / count) if squares > 0 else -math.inf
    return likelihood + 2 * (parameters + 1), likelihood + math.log(count) * (parameters + 1)


def unexplained(problem: Problem, values: Array, files: Sequence[RunErrors]) -> list[str]:
    """Return a sentence for each signal of a run of which the model explains little.

    `values` are those of all parameters, `files` the errors of the runs there.
    """
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
    fitted, held = (pooled([one for one in files if one.split == split]) for split in ("train", "test"))
    return [
        f"The error of {key.rpartition('_')[0].replace('_', ' ')} is {rmse / fitted[key]:.3g} times as large in the "
        f"runs held out as in those fitted (rmse {rmse:.3g} and {fitted[key]:.3g} {key.rpartition('_')[2]}): the "
        "model does not extrapolate to them."
        for key, rmse in held.items()
        if rmse > _MOST_WORSE * fitted.get(key, math.inf) > 0
    ]


def warnings(
    found: Uncertainty, noises: Sequence[Whiteness], best: SearchEnd, *, same: int, starts: int, parameters: int
) -> list[str]:
    """Return the caveats of a fit, a sentence each."""
    out = []
    if not best.converged:
        out.append(f"The search stopped after {MOST_STEPS} steps without having converged.")
    if starts > 2 and same == 1:
        out.append(f"Only one of {starts} starts reached the best optimum; there may be a better one.")
    effective = sum(noise.effective_samples for noise in noises)
    if effective < LEAST_PER_PARAMETER * parameters:
        out.append(
            f"Residuals are so correlated that all samples count as {effective:.3g} independent ones, for {parameters} "
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
            f"correlated, {worst.run}): the model leaves an effect out; intervals are up to {factor:.3g} times "
            "those for white noise."
        )
    return out
