"""Residuals with the errors of a twin's commands marginalised out."""

from collections.abc import Callable, Sequence
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array, diags_array

from tenodesis.identification.twin_model import tuning
from tenodesis.identification.twin_model.steps import InputError, SteppedRun
from tenodesis.run import Array
from tenodesis.threads import thread_pool


class Marginalisation(NamedTuple):
    """How residuals are whitened when commands have errors.

    With M the effect of independent command errors on n residuals, residuals have the covariance 1 + M M'.
    """

    weights: Array
    """Of the residuals, (n,): less than 1 where errors have nonlinear effects."""
    effects: csc_array
    """Of each error on the weighted residuals, (n, errors)."""
    shrinkage: Array
    """Shares by which residuals are shrunk in the directions of these, (errors, errors)."""
    nonlinear: Array
    """Effects that are not linear in the errors, each group of one standard deviation, (n, groups)."""

    def whitened(self, residuals: Array) -> Array:
        """Return residuals, (n,) or (n, m), shrunk in the directions of the effects to the variance of all others."""
        weighted = (self.weights * residuals.T).T
        return np.asarray(weighted - self.effects @ (self.shrinkage @ (self.effects.T @ weighted)))


def marginalise(run: SteppedRun, expected: Callable[[Array], Array]) -> Marginalisation:
    """Return how the residuals of a run with errors of its inputs are whitened.

    `expected` maps commands to readings in standard deviations, one sensor after the other.
    """
    effects, nonlinear = _effects(run, expected)
    weights = 1 / np.sqrt(1 + run.stride * np.sum(nonlinear**2, axis=1))
    effects = csc_array(diags_array(weights) @ effects)
    mixed = run.mixing.T @ (effects.T @ effects).toarray() @ run.mixing
    sizes, directions = np.linalg.eigh(run.stride * mixed)
    sizes = np.maximum(sizes, tuning.NEGLIGIBLE_EFFECT)
    inner = run.mixing @ directions
    # (1 + M M')^(-1/2) = 1 - M (...) M'
    shrinkage = run.stride * inner * ((1 - 1 / np.sqrt(1 + sizes)) / sizes) @ inner.T
    return Marginalisation(weights, effects, shrinkage, nonlinear)


def _effects(run: SteppedRun, expected: Callable[[Array], Array]) -> tuple[csc_array, Array]:
    """Return linear effects of each error on residuals, (n, errors), and nonlinear effects by group, (n, groups).

    Errors that are far apart share a run of the model: the effect of each ends where the next one begins.
    """
    errors = run.input_errors
    undisturbed = expected(run.commands)
    sensors, count = len(run.measured), len(run.kept)
    columns: list[Array] = [np.zeros(0)] * len(errors)
    places: list[NDArray[np.intp]] = [np.zeros(0, dtype=np.intp)] * len(errors)

    def disturbed(group: Sequence[int]) -> list[Array]:
        both = []
        for sign in (1, -1):
            commands = run.commands.copy()
            for index in group:
                error = errors[index]
                commands[error.first : error.first + error.shape.size, error.column] += sign * error.shape
            both.append((expected(commands) - undisturbed).reshape(sensors, -1))
        return both

    groups = _groups(errors, len(run.commands), run.time_step)
    with thread_pool() as pool:
        found = list(pool.map(disturbed, groups))
    nonlinear = []
    for group, (plus, minus) in zip(groups, found, strict=True):
        linear = (plus - minus) / 2
        # the mean square of a normal deviate's square is three
        nonlinear.append(sqrt(3) * (plus + minus).ravel() / 2)
        begins = np.searchsorted(run.kept, [errors[index].first for index in group]).tolist()
        for index, begin, end in zip(group, begins, [*begins[1:], count], strict=True):
            columns[index] = linear[:, begin:end].ravel()
            places[index] = (np.arange(sensors)[:, None] * count + np.arange(begin, end)).ravel()
    owner = np.repeat(np.arange(len(errors)), [column.size for column in columns])
    entries = np.concatenate(columns), (np.concatenate(places), owner)
    return coo_array(entries, shape=(sensors * count, len(errors))).tocsc(), np.stack(nonlinear, axis=1)


def _groups(errors: Sequence[InputError], steps: int, time_step: float) -> list[list[int]]:
    """Return indices of errors by run of the model, each as long before the next as the number of runs allows."""
    order = sorted(range(len(errors)), key=lambda index: errors[index].first)
    memory = float(steps)
    while True:
        groups: list[list[int]] = []
        free_from: list[float] = []
        for index in order:
            error = errors[index]
            end = error.first + error.shape.size + memory
            at = min(range(len(groups)), key=free_from.__getitem__, default=None)
            if at is None or free_from[at] > error.first:
                groups.append([index])
                free_from.append(end)
            else:
                groups[at].append(index)
                free_from[at] = end
        if len(groups) <= tuning.MOST_RUNS or memory * time_step <= tuning.LEAST_MEMORY:
            return groups
        memory *= tuning.MEMORY_SHRINKAGE
