"""Arrangements of contacts fitted to the same recordings: which one they ask for, and whether any explains them."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tenodesis.errors import IdentificationError
from tenodesis.identification.problem import Problem
from tenodesis.identification.results import Fit, Interval, by_unit

DECISIVE = 10.0
"""Difference of the Bayesian information criterion that is very strong evidence (Kass and Raftery 1995)."""
MOST_EXCESS = 1.5
"""Ratio of residuals to the sensors' noise above which, if they are not white, an arrangement does not fit."""


@dataclass(frozen=True)
class ArrangementRow:
    """Result of an arrangement."""

    name: str
    parameters: int
    """Number of fitted parameters."""
    bic: float
    """Bayesian information criterion (Schwarz 1978) of the fitted runs, over that of the best arrangement."""
    excess: float
    """Largest ratio, over sensors and fitted runs, of the residuals that are not white to the sensors' noise."""
    test_rmse: Mapping[str, float]
    """Of the runs held out, by unit; empty if there are none."""
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
            told = [f"Of {len(self.rows)} arrangements the recordings ask for that of the instrument file, {own.name}."]
        else:
            told = [
                f"The recordings ask for {chosen.name}, where the instrument file has {own.name}: its criterion is "
                f"lower by {own.bic - chosen.bic:.3g}."
            ]
        if not self.fits:
            told.append(
                f"None of the arrangements fits: with the best, {chosen.name}, residuals are {chosen.excess:.3g} times "
                f"the sensors' noise and not white (a fit has at most {MOST_EXCESS:g}); the intervals are widened to "
                "those of all arrangements, and the parameters are not to be relied on."
            )
        return tuple(told)

    @property
    def result(self) -> Fit:
        """The fit of the chosen arrangement, its intervals widened where none fits."""
        chosen = self[self.chosen]
        widened = chosen.fit if self.fits else _widened(chosen, self.rows)
        return replace(widened, warnings=(*self.statements, *widened.warnings))


def compare_arrangements(
    names: Sequence[str],
    problem_of: Callable[[str], Problem],
    fit_of: Callable[[str, Problem], Fit],
    *,
    train: Sequence[int],
) -> ArrangementComparison:
    """Return the results of arrangements of the same recordings, the instrument file's first among the names.

    The criterion counts as many independent samples as the residuals of the arrangement with the least error have,
    which are nearest to noise. The file's arrangement is kept unless another one is better by `DECISIVE`; of those
    that differ by less, the one with the fewest parameters is chosen.

    Raises IdentificationError if there is nothing to compare, or an arrangement cannot be fitted.
    """
    if not names:
        raise IdentificationError("names is empty; it must name at least one arrangement.", key="names")
    problems = {name: problem_of(name) for name in names}
    fits = {name: fit_of(name, problems[name]) for name in names}
    least = min(fits.values(), key=lambda one: one.cost)
    samples = max(2.0, sum(noise.effective_samples for noise in least.whiteness))
    bic = {
        name: samples * math.log(2 * one.cost / one.samples) + len(one.free) * math.log(samples)
        for name, one in fits.items()
    }
    best = min(bic.values())
    near = [name for name in names if bic[name] <= best + DECISIVE]
    chosen = names[0] if names[0] in near else min(near, key=lambda name: (len(fits[name].free), bic[name]))
    rows = [
        ArrangementRow(
            name, len(one.free), bic[name] - best, excess(problems[name], one, train), by_unit(one.test_rmse), one
        )
        for name, one in fits.items()
    ]
    return ArrangementComparison(tuple(sorted(rows, key=lambda row: row.bic)), names[0], chosen, samples)


def excess(problem: Problem, found: Fit, train: Sequence[int]) -> float:
    """Return the largest ratio of residuals to the sensors' noise among those that are not white; 0 if all are."""
    largest, noises = 0.0, iter(found.whiteness)
    for run in train:
        series = problem.residuals(found.vector, run).reshape(problem.channels(run), -1)
        for residuals, expected in zip(series, problem.noise(run), strict=True):
            if not next(noises).white:
                largest = max(largest, float(np.sqrt(np.mean(residuals**2))) / expected)
    return largest


def _widened(chosen: ArrangementRow, rows: Sequence[ArrangementRow]) -> Fit:
    """Return the chosen fit with intervals over those of all arrangements, each as much wider as its residuals are."""
    intervals: dict[str, Interval] = {}
    for one in chosen.fit.parameters:
        if one.name not in chosen.fit.interval_95:
            continue
        ends = [chosen.fit.values[one.name]]
        for row in rows:
            if one.name in row.fit.interval_95:
                value = row.fit.values[one.name]
                ends += [value + row.excess * (end - value) for end in row.fit.interval_95[one.name]]
        intervals[one.name] = (max(one.lower, min(ends)), min(one.upper, max(ends)))
    return replace(chosen.fit, interval_95=intervals)
