"""Designs that no other one beats in everything: the Pareto front."""

from collections.abc import Callable

import moocore
import numpy as np
from numpy.typing import NDArray

from tenodesis.run import Array

ERROR_STEP = 0.01
"""Similarity errors, deg, that a bench cannot tell apart."""

RELATIVE_STEP = 0.01
"""Relative difference of resolutions, lengths and margins that is none."""


def levels(costs: Array) -> Array:
    """Return costs as numbers of steps that can be told apart.

    Parameters
    ----------
    costs
        Similarity error (deg), force resolution (N), overall length (m) and one over the tension margin; shape (n, 4).
    """
    relative = np.round(np.log(costs[:, 1:]) / np.log1p(RELATIVE_STEP))
    return np.column_stack([np.round(costs[:, 0] / ERROR_STEP), relative])


def search(lower: Array, refine: Callable[[NDArray[np.int64]], tuple[Array, NDArray[np.bool_]]]) -> NDArray[np.int64]:
    """Return the numbers of the designs on the front; of equal designs, the first.

    Exact, though few designs are refined: one whose lower bounds are beaten by a refined one is beaten itself.

    Parameters
    ----------
    lower
        Lower bounds of the costs, as levels, shape (n, 4).
    refine
        Returns the costs of some designs by number, as levels, shape (m, 4), and which of them are allowed after all.
    """
    costs = lower.copy()
    refined = np.zeros(len(costs), bool)
    pool = np.arange(len(costs))
    while pool.size:
        # Refined ones first: of equal rows the first is kept, and an equal bound promises nothing better.
        pool = pool[np.argsort(~refined[pool], kind="stable")]
        front: NDArray[np.int64] = pool[moocore.is_nondominated(costs[pool])]
        new = front[~refined[front]]
        if not new.size:
            return front
        costs[new], allowed = refine(new)
        refined[new] = True
        pool = pool[~np.isin(pool, new[~allowed])]
    return pool
