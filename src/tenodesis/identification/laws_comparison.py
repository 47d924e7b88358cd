"""Friction laws fitted to the same recordings, and compared on recordings held out from all of them."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tenodesis.errors import IdentificationError
from tenodesis.identification.fit import fit
from tenodesis.identification.problem import Problem
from tenodesis.identification.results import Fit
from tenodesis.identification.uncertainty import LossName
from tenodesis.identification.whiteness import autocorrelation, correlation_samples


@dataclass(frozen=True)
class LawRow:
    """Result of a friction law."""

    law: str
    parameters: int
    """Number of fitted parameters."""
    train_rmse: float
    test_rmse: float
    """Over all held-out samples, in `unit`; NaN if none were held out."""
    unit: str
    worst_test_rmse: float
    """Of the held-out run that it predicts worst."""
    bic: float
    """Bayesian information criterion (Schwarz 1978) of the training runs, over that of the best law."""
    aic: float
    """Akaike's (1974), likewise."""
    fit: Fit


def compare_laws(
    problem_factory: Callable[[str], Problem],
    train: Sequence[int],
    test: Sequence[int],
    *,
    laws: Sequence[str],
    starts: int = 8,
    seed: int = 0,
    loss: LossName = "linear",
) -> tuple[LawRow, ...]:
    """Return the results of the laws, ordered by their error on the held-out runs.

    Residuals of one run are not independent, so the criterion counts samples by their autocorrelation time; the least
    count of all laws holds for all, or a law would be preferred for leaving slower errors.

    `problem_factory` returns the same model of the same recordings with the friction law of a name; `train` and `test`
    are indices of the runs to fit and of those held out. The criteria use the loss of the fits: twice its mean in place
    of the variance of the residuals.

    Raises IdentificationError if there is no law to compare, or one cannot be fitted.
    """
    if not laws:
        raise IdentificationError("laws is empty; it must name at least one friction law.", key="laws")
    problems = [problem_factory(law) for law in laws]
    fits = [fit(problem, train=train, test=test, starts=starts, seed=seed, loss=loss) for problem in problems]
    samples = min(_independent(problem, one, train) for problem, one in zip(problems, fits, strict=True))
    misfit = np.array([samples * math.log(2 * one.cost / one.samples) for one in fits])
    counts = np.array([len(one.free) for one in fits])
    bic, aic = misfit + counts * math.log(samples), misfit + 2 * counts
    rows = [
        _row(law, one, schwarz, akaike)
        for law, one, schwarz, akaike in zip(laws, fits, bic - bic.min(), aic - aic.min(), strict=True)
    ]
    return tuple(sorted(rows, key=lambda row: row.train_rmse if math.isnan(row.test_rmse) else row.test_rmse))


def _independent(problem: Problem, one: Fit, train: Sequence[int]) -> float:
    """Return the effective number of independent samples among the residuals of the training runs."""
    values = np.array([one.values[parameter.name] for parameter in problem.parameters])
    residuals = [problem.residuals(values, run) for run in train]
    return float(sum(r.size / correlation_samples(autocorrelation(r)) for r in residuals))


def _row(law: str, one: Fit, bic: float, aic: float) -> LawRow:
    key = next(iter(one.train_rmse))
    held = [run.rmse[key] for run in one.files if run.split == "test"]
    return LawRow(
        law,
        len(one.free),
        one.train_rmse[key],
        one.test_rmse.get(key, math.nan),
        key.rpartition("_")[2],
        max(held, default=math.nan),
        float(bic),
        float(aic),
        one,
    )
