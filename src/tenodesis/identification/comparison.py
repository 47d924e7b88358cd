"""Models of the same recordings compared: friction laws, and arrangements of contacts along a tendon."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from tenodesis.errors import IdentificationError, InstrumentError
from tenodesis.identification.fit import fit
from tenodesis.identification.problem import Problem
from tenodesis.identification.results import Fit, Interval, by_unit
from tenodesis.identification.uncertainty import LossName, autocorrelation, correlation_samples
from tenodesis.json_values import json_values
from tenodesis.magnitude import rms
from tenodesis.run import Array


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
    return LawRow(
        law,
        len(one.free),
        one.train_rmse[key],
        one.test_rmse.get(key, math.nan),
        key.rpartition("_")[2],
        float(bic),
        float(aic),
        one,
    )


DECISIVE = 10.0
"""Difference of the Bayesian information criterion that is very strong evidence (Kass and Raftery 1995)."""
LEAST_EXCESS = 1.1
"""Ratio of residuals to the sensors' noise up to which no other arrangement can do better to any effect."""
MOST_EXCESS = 1.5
"""Ratio of residuals to the sensors' noise above which, if they are not white, an arrangement does not fit."""


PROMISING = 4.0
"""Ratio of an arrangement's squared errors to the least up to which it is fitted with care."""


class Fitted(NamedTuple):
    """An arrangement as it was fitted."""

    problem: Problem
    fit: Fit


@dataclass(frozen=True)
class ArrangementRow:
    """Result of an arrangement."""

    name: str
    parameters: int
    """Number of fitted parameters."""
    bic: float
    """Bayesian information criterion (Schwarz 1978) of the fitted runs, over that of the best arrangement."""
    excess: float
    """Largest ratio of residuals to the sensors' noise, over the fitted runs and the sensors that are not white."""
    fit: Fit


@dataclass(frozen=True)
class ArrangementComparison:
    """The arrangements by their criterion, the best first, and the chosen one."""

    rows: tuple[ArrangementRow, ...]
    own: str
    """Arrangement of the instrument file."""
    chosen: str
    samples: float
    """Independent samples that the criterion counts."""

    def __getitem__(self, name: str) -> ArrangementRow:
        """Return an arrangement by its name."""
        return next(row for row in self.rows if row.name == name)

    @property
    def fits(self) -> bool:
        """Whether the chosen arrangement explains the recordings but for the sensors' noise."""
        return self[self.chosen].excess <= MOST_EXCESS

    @property
    def statements(self) -> tuple[str, ...]:
        """What the comparison says, a sentence each."""
        own, chosen = self[self.own], self[self.chosen]
        if self.own == self.chosen:
            said = [f"Of {len(self.rows)} arrangements the recordings ask for that of the instrument file: {own.name}."]
        else:
            said = [
                f"The recordings ask for {chosen.name}, but the instrument file has {own.name}: the information "
                f"criterion is lower by {own.bic - chosen.bic:.3g}."
            ]
        if not self.fits:
            said.append(
                f"No arrangement fits: with the best, {chosen.name}, residuals are {chosen.excess:.3g} times the "
                f"sensors' noise, where {MOST_EXCESS:g} is the most, and not white; intervals are widened to those of "
                "all arrangements, and the values are not to be relied on."
            )
        return tuple(said)

    @property
    def result(self) -> Fit:
        """The fit of the chosen arrangement, with its intervals widened if none fits."""
        found = self[self.chosen].fit
        if not self.fits:
            found = replace(found, interval_95=self._hull(found))
        return replace(found, warnings=(*self.statements, *found.warnings))

    def _hull(self, found: Fit) -> dict[str, Interval]:
        """Return intervals over those of all arrangements, each as many times wider as its residuals are."""
        hull: dict[str, Interval] = {}
        for one in found.parameters:
            if one.name not in found.interval_95:
                continue
            ends = []
            for row in self.rows:
                if one.name in row.fit.interval_95:
                    value, factor = row.fit.values[one.name], max(1.0, row.excess)
                    ends += [value + factor * (end - value) for end in row.fit.interval_95[one.name]]
            hull[one.name] = (max(one.lower, min(ends)), min(one.upper, max(ends)))
        return hull

    def to_json(self) -> list[dict[str, Any]]:
        """Return the arrangements as plain values for JSON, the best first."""
        rows = [
            {
                "arrangement": row.name,
                "own": row.name == self.own,
                "chosen": row.name == self.chosen,
                "parameters": row.parameters,
                "bic": row.bic,
                "excess": row.excess,
                **{f"train_rmse_{unit}": value for unit, value in by_unit(row.fit.train_rmse).items()},
                **{f"test_rmse_{unit}": value for unit, value in by_unit(row.fit.test_rmse).items()},
            }
            for row in self.rows
        ]
        return list(json_values(rows))


def compare_arrangements(
    own: str, others: Sequence[str], fitted: Callable[[str, bool], Fitted], *, train: Sequence[int]
) -> ArrangementComparison:
    """Return the results of arrangements of the same recordings.

    The least plain residuals are nearest to noise: all arrangements are judged by residuals that are whitened as theirs
    are, and the criterion counts as many independent samples as they have. The file's own arrangement stays unless
    another one is better by `DECISIVE`; of several that differ by less, the one with the fewest parameters is chosen.
    `fitted` returns an arrangement by its name, with the fit of the runs `train`: at first without care, and with care
    if its errors are not far above the least; those that cannot be fitted are left out.

    Raises IdentificationError if the file's own cannot be fitted.
    """

    def squares(residuals: Sequence[Array]) -> float:
        return sum(float(one @ one) for one in residuals)

    def plain(one: Fitted) -> float:
        return squares([one.problem.plain_residuals(one.fit.vector, run) for run in train])

    found = {own: fitted(own, True)}
    for name in others:
        try:
            found[name] = fitted(name, False)
        except (IdentificationError, InstrumentError):
            continue
    errors = {name: plain(one) for name, one in found.items()}
    for name, error in errors.items():
        if name != own and error <= PROMISING * min(errors.values()):
            found[name] = fitted(name, True)
    nearest = min(found.values(), key=plain)
    independent = max(2.0, sum(noise.effective_samples for noise in nearest.fit.whiteness))
    there = (nearest.problem, nearest.fit.vector)
    misfits = {
        name: squares([one.problem.residuals_near(one.fit.vector, run, *there) for run in train])
        for name, one in found.items()
    }
    # what all leave beyond the sensors' noise is taken for noise (Lebreton et al. 1992)
    dispersion = max(1.0, min(misfits.values()) / nearest.fit.samples)
    bic = {
        name: misfits[name] * independent / (dispersion * one.fit.samples) + len(one.fit.free) * math.log(independent)
        for name, one in found.items()
    }
    best = min(bic.values())
    near = [name for name in found if bic[name] <= best + DECISIVE]
    chosen = own if own in near else min(near, key=lambda name: (len(found[name].fit.free), bic[name]))
    rows = [
        ArrangementRow(name, len(one.fit.free), bic[name] - best, excess(*one, train), one.fit)
        for name, one in found.items()
    ]
    return ArrangementComparison(tuple(sorted(rows, key=lambda row: row.bic)), own, chosen, independent)


def excess(problem: Problem, found: Fit, train: Sequence[int]) -> float:
    """Return the largest ratio of residuals to the sensors' noise among those that are not white; 0 if all are."""
    largest, noises = 0.0, iter(found.whiteness)
    for run in train:
        series = problem.residuals(found.vector, run).reshape(problem.channels(run), -1)
        for residuals, expected in zip(series, problem.sensor_noise(run), strict=True):
            if not next(noises).white:
                largest = max(largest, rms(residuals) / expected)
    return largest
