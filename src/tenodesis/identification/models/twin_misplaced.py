"""Errors of a twin's commands, and residuals that do not mind them."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array, diags_array

from tenodesis.identification.models.twin_runs import Misplaced, Prepared
from tenodesis.run import Array
from tenodesis.threads import threads

_MOST_RUNS = 20
_LEAST_MEMORY = 0.2
"""Time after its end for which an error is felt at least, s: friction forgets it where the handle next turns."""
_SHORTER = 0.8
_UNSEEN = 1e-12


class Marginalised(NamedTuple):
    """How residuals are whitened that errors of commands move."""

    weights: Array
    """What residuals count, (n,): less where errors do what is not linear in them."""
    moved: csc_array
    """By how much each error moves the residuals so weighted, (n, errors)."""
    shrunk: Array
    """Shares by which residuals are shrunk in the directions of these, (errors, errors)."""
    bent: Array
    """What errors do to residuals that is not linear in them, one deviation of each group of them, (n, groups)."""

    def whitened(self, residuals: Array) -> Array:
        """Return residuals, (n,) or (n, m), shrunk in these directions to the variance of all else."""
        weighted = (self.weights * residuals.T).T
        return np.asarray(weighted - self.moved @ (self.shrunk @ (self.moved.T @ weighted)))


def marginalised(run: Prepared, expected: Callable[[Array], Array]) -> Marginalised:
    """Return how residuals are whitened in whose commands there are errors.

    Parameters
    ----------
    run
        The run, with errors.
    expected
        Readings in standard deviations, one sensor after the other, of commands.
    """
    moved, bent = _moves(run, expected)
    weights = 1 / np.sqrt(1 + run.stride * np.sum(bent**2, axis=1))
    moved = csc_array(diags_array(weights) @ moved)
    mixed = run.mixing.T @ (moved.T @ moved).toarray() @ run.mixing
    sizes, directions = np.linalg.eigh(run.stride * mixed)
    sizes = np.maximum(sizes, _UNSEEN)
    inner = run.mixing @ directions
    # (1 + M M')^(-1/2) = 1 - M (...) M'
    shrunk = run.stride * inner * ((1 - 1 / np.sqrt(1 + sizes)) / sizes) @ inner.T
    return Marginalised(weights, moved, shrunk, bent)


def _moves(run: Prepared, expected: Callable[[Array], Array]) -> tuple[csc_array, Array]:
    """Return by how much each error moves residuals, (n, errors), and what is not linear in them by group, (n, groups).

    Errors that are far apart share a run of the model: each counts until the next one begins.
    """
    errors = run.misplaced
    still = expected(run.commands)
    sensors, count = len(run.measured), len(run.kept)
    columns: list[Array] = [np.zeros(0)] * len(errors)
    places: list[NDArray[np.intp]] = [np.zeros(0, dtype=np.intp)] * len(errors)

    def pushed(group: Sequence[int]) -> list[Array]:
        both = []
        for sign in (1, -1):
            commands = run.commands.copy()
            for index in group:
                one = errors[index]
                commands[one.first : one.first + one.shape.size, one.column] += sign * one.shape
            both.append((expected(commands) - still).reshape(sensors, -1))
        return both

    groups = _groups(errors, len(run.commands), run.time_step)
    with ThreadPoolExecutor(threads()) as pool:
        found = list(pool.map(pushed, groups))
    bent = []
    for group, (there, back) in zip(groups, found, strict=True):
        moved = (there - back) / 2
        # the mean square of a normal deviate's square is three
        bent.append(sqrt(3) * (there + back).ravel() / 2)
        begins = np.searchsorted(run.kept, [errors[index].first for index in group]).tolist()
        for index, begin, end in zip(group, begins, [*begins[1:], count], strict=True):
            columns[index] = moved[:, begin:end].ravel()
            places[index] = (np.arange(sensors)[:, None] * count + np.arange(begin, end)).ravel()
    owner = np.repeat(np.arange(len(errors)), [column.size for column in columns])
    shape = (sensors * count, len(errors))
    return coo_array((np.concatenate(columns), (np.concatenate(places), owner)), shape=shape).tocsc(), np.stack(
        bent, axis=1
    )


def _groups(errors: Sequence[Misplaced], steps: int, time_step: float) -> list[list[int]]:
    """Return errors by run of the model, each as long before the next as the number of runs allows."""
    order = sorted(range(len(errors)), key=lambda index: errors[index].first)
    memory = float(steps)
    while True:
        groups: list[list[int]] = []
        free_from: list[float] = []
        for index in order:
            one = errors[index]
            end = one.first + one.shape.size + memory
            at = min(range(len(groups)), key=free_from.__getitem__, default=None)
            if at is None or free_from[at] > one.first:
                groups.append([index])
                free_from.append(end)
            else:
                groups[at].append(index)
                free_from[at] = end
        if len(groups) <= _MOST_RUNS or memory * time_step <= _LEAST_MEMORY:
            return groups
        memory *= _SHORTER
