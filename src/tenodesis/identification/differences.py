"""Derivatives by differences: for models without their own, and to check those that have them."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tenodesis.identification.problem import Parameter, Problem
from tenodesis.run import Array

STEP = 1e-6
"""Step as a share of a parameter's scale."""
_IMAGINARY = 1e-30
"""Imaginary step: its square vanishes beside any real part."""


def differenced(function: Callable[[Array], Array], at: Array, lower: Array, upper: Array, scale: Array) -> Array:
    """Return the derivatives of a vector function by central differences within bounds, shape (n, parameters)."""
    columns = []
    for index in range(at.size):
        above, below = at.copy(), at.copy()
        above[index] = min(at[index] + STEP * scale[index], upper[index])
        below[index] = max(at[index] - STEP * scale[index], lower[index])
        columns.append((function(above) - function(below)) / (above[index] - below[index]))
    return np.stack(columns, axis=1)


def complex_step(function: Callable[[NDArray[Any]], NDArray[Any]], at: Array) -> Array:
    """Return the derivatives of an analytic vector function, exact to rounding, shape (n, parameters).

    By an imaginary step (Squire and Trapp, SIAM Review 40:110-112, 1998), which leaves nothing to cancel.
    """
    steps = at + 1j * _IMAGINARY * np.eye(at.size)
    return np.stack([function(one).imag / _IMAGINARY for one in steps], axis=1)


def scales(parameters: Sequence[Parameter], values: Array) -> Array:
    """Return the scales of changes of parameters, shape (parameters,): the ranges between their bounds.

    A quantity that cannot be zero is measured by its value where that is less.
    """
    pairs = zip(parameters, values.tolist(), strict=True)
    return np.array(
        [min(one.upper - one.lower, value) if one.lower > 0 else one.upper - one.lower for one, value in pairs]
    )


def jacobian_error(problem: Problem, values: Array, run: int, *, quantile: float = 1.0) -> float:
    """Return how far a problem's own derivatives are from differences, as a share of each column's largest.

    Values have the shape (parameters,). A quantile of the deviations below 1 leaves out the few samples where a
    difference steps over stick and slip.
    """
    own = problem.jacobian(values, run)
    if own is None:
        return 0.0
    lower = np.array([one.lower for one in problem.parameters])
    upper = np.array([one.upper for one in problem.parameters])
    other = differenced(lambda at: problem.residuals(at, run), values, lower, upper, scales(problem.parameters, values))
    size = np.maximum(np.abs(other).max(axis=0), 1e-12 * np.abs(other).max() + 1e-300)
    return float(np.quantile(np.abs(own - other) / size, quantile, axis=0).max())
