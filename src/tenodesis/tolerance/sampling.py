"""Samples and sensitivity indices, by SALib."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tenodesis.extras import require
from tenodesis.run import Array
from tenodesis.tolerance.parameters import UncertainParameter

CONFIDENCE = 0.95
"""Level of the intervals of the indices."""
_RESAMPLES = 200
CLOSE = 0.1
"""Half width of the confidence intervals up to which indices count as converged."""


@dataclass(frozen=True)
class Indices:
    """Sobol indices of a response by parameter, with half widths of their 95 % confidence intervals.

    A first index is the share of the variance that would vanish if this parameter alone were known, a total index the
    share that remains if it alone is unknown.
    """

    first: Array
    first_half_width: Array
    total: Array
    total_half_width: Array

    @property
    def converged(self) -> bool:
        """Whether every total index is known within a tenth."""
        return bool(self.total_half_width.max() <= CLOSE)


def _problem(parameters: Sequence[UncertainParameter]) -> dict[str, Any]:
    """Return SALib's description of deviations from the nominal values; its triangles must not be negative."""
    described = [_described(one) for one in parameters]
    return {
        "num_vars": len(parameters),
        "names": [f"{one.instrument} {one.key}" for one in parameters],
        "dists": [dist for dist, _ in described],
        "bounds": [bounds for _, bounds in described],
    }


def _described(parameter: UncertainParameter) -> tuple[str, list[float]]:
    width = parameter.width
    if parameter.distribution == "uniform":
        return "unif", [-width, width]
    if parameter.distribution == "triangular":
        return "triang", [-width, width, 0.5]
    return "truncnorm", [parameter.lower - parameter.nominal, parameter.upper - parameter.nominal, 0.0, width]


def scheme(parameters: Sequence[UncertainParameter], samples: int, seed: int) -> Array:
    """Return Saltelli's scheme: per base sample a row of A, a row of A per parameter with that from B, and a row of B.

    Values are in SI units, shape (samples * (parameters + 2), parameters).
    """
    sobol = require("SALib.sample.sobol", "design")

    deviations = sobol.sample(_problem(parameters), samples, calc_second_order=False, seed=seed)
    return _nominal(parameters) + np.asarray(deviations, np.float64)


def levels(parameters: Sequence[UncertainParameter], probabilities: Sequence[float]) -> Array:
    """Return the parameters' quantiles, SI units, shape (probabilities, parameters)."""
    scale_samples = require("SALib.util", "design").scale_samples

    shares = np.tile(np.asarray(probabilities, np.float64)[:, np.newaxis], (1, len(parameters)))
    return _nominal(parameters) + np.asarray(scale_samples(shares, _problem(parameters)), np.float64)


def estimate(parameters: Sequence[UncertainParameter], values: Array, seed: int) -> Indices:
    """Return the Sobol indices of a response, given for every row of the scheme."""
    sobol = require("SALib.analyze.sobol", "design")

    found = sobol.analyze(
        _problem(parameters),
        values,
        calc_second_order=False,
        num_resamples=_RESAMPLES,
        conf_level=CONFIDENCE,
        # SALib takes zero for no seed.
        seed=seed + 1,
    )
    return Indices(*(np.asarray(found[key], np.float64) for key in ("S1", "S1_conf", "ST", "ST_conf")))


def _nominal(parameters: Sequence[UncertainParameter]) -> Array:
    return np.array([one.nominal for one in parameters])
