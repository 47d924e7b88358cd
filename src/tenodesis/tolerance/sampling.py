"""Samples and sensitivity indices, by SALib."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from tenodesis.extras import require
from tenodesis.run import Array
from tenodesis.tolerance.parameters import Parameter

CONFIDENCE = 0.95
"""Level of the intervals of the indices."""
_RESAMPLES = 200


class Estimate(NamedTuple):
    """Sensitivity indices by parameter, with half widths of their confidence intervals."""

    first: Array
    first_half_width: Array
    total: Array
    total_half_width: Array


def _problem(parameters: Sequence[Parameter]) -> dict[str, Any]:
    """Return SALib's description, of deviations from the nominal value since it takes no negative triangles."""
    described = [_described(one) for one in parameters]
    return {
        "num_vars": len(parameters),
        "names": [f"{one.instrument} {one.key}" for one in parameters],
        "dists": [dist for dist, _ in described],
        "bounds": [bounds for _, bounds in described],
    }


def _described(parameter: Parameter) -> tuple[str, list[float]]:
    width = parameter.width
    if parameter.distribution == "uniform":
        return "unif", [-width, width]
    if parameter.distribution == "triangular":
        return "triang", [-width, width, 0.5]
    return "truncnorm", [parameter.lower - parameter.nominal, parameter.upper - parameter.nominal, 0.0, width]


def scheme(parameters: Sequence[Parameter], samples: int, seed: int) -> Array:
    """Return Saltelli's scheme: for every base sample a row of A, one per parameter from B into A, and one of B.

    Returns
    -------
    numpy.ndarray
        Values in SI units, shape (samples * (parameters + 2), parameters).
    """
    sobol = require("SALib.sample.sobol", "design")

    deviations = sobol.sample(_problem(parameters), samples, calc_second_order=False, seed=seed)
    return _nominal(parameters) + np.asarray(deviations, np.float64)


def levels(parameters: Sequence[Parameter], probabilities: Sequence[float]) -> Array:
    """Return the parameters' quantiles, SI units, shape (probabilities, parameters)."""
    scale_samples = require("SALib.util", "design").scale_samples

    shares = np.tile(np.asarray(probabilities, np.float64)[:, np.newaxis], (1, len(parameters)))
    return _nominal(parameters) + np.asarray(scale_samples(shares, _problem(parameters)), np.float64)


def estimate(parameters: Sequence[Parameter], values: Array, seed: int) -> Estimate:
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
    return Estimate(*(np.asarray(found[key], np.float64) for key in ("S1", "S1_conf", "ST", "ST_conf")))


def _nominal(parameters: Sequence[Parameter]) -> Array:
    return np.array([one.nominal for one in parameters])
