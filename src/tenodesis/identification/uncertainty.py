"""How well parameters are known: the covariance of a fit whose residuals are not independent."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from scipy import linalg

from tenodesis.signals import Array

LossName: TypeAlias = Literal["linear", "soft_l1"]

_BLOCKS = 1000
"""Of a run's scores, summed before their correlation is estimated: the sum's variance is that of all samples."""
_LARGEST_ROOT = 0.97
"""Of the autoregression that whitens the scores (Andrews and Monahan 1992)."""
_BLIND = 1e-8
"""Singular value, as a share of the largest, below which a direction is not seen at all."""


@dataclass(frozen=True)
class Linearised:
    """A run at the optimum."""

    residuals: Array
    """(n,), whitened."""
    jacobian: Array
    """(n, free parameters), in units of the parameters' scales."""
    channels: int = 1
    """Sensors, one after the other in the residuals."""


@dataclass(frozen=True)
class Spread:
    """Covariances of the free parameters in units of their scales, over the directions that are seen."""

    covariance: Array
    """Corrected for residuals that are not independent."""
    white: Array
    """As if they were."""
    blind: Array
    """Directions that the recordings do not see at all, shape (free parameters, how many)."""

    @property
    def std(self) -> Array:
        """Corrected standard deviations; infinite where a blind direction takes part."""
        return _std(self.covariance, self.blind)

    @property
    def white_std(self) -> Array:
        """Standard deviations as if residuals were independent."""
        return _std(self.white, self.blind)

    @property
    def full(self) -> Array:
        """Corrected covariance in all directions, with a blind one known a thousand times worse than its range."""
        return np.asarray(self.covariance + 1e6 * self.blind @ self.blind.T, dtype=np.float64)

    @property
    def correlation(self) -> Array:
        """Correlation matrix of that covariance."""
        size = np.sqrt(np.diag(self.full))
        size[size == 0] = 1
        return np.asarray(self.full / np.outer(size, size), dtype=np.float64)


def influence(residuals: Array, loss: LossName) -> tuple[Array, Array]:
    """Return what a residual pulls with, and its slope: the derivative of the loss over residuals, twice."""
    if loss == "linear":
        return residuals, np.ones_like(residuals)
    root = np.sqrt(1 + residuals**2)
    return residuals / root, root**-3


def spread(runs: Sequence[Linearised], loss: LossName = "linear") -> Spread:
    """Return the covariance of the parameters: curvature on either side of the scores' long-run covariance.

    The sandwich of Huber (1967) and White (1980) with the estimator of Andrews and Monahan (1992) between.
    """
    count = sum(run.residuals.size for run in runs)
    free = runs[0].jacobian.shape[1]
    weighted, scores, squares = [], [], 0.0
    for run in runs:
        pull, slope = influence(run.residuals, loss)
        weighted.append(np.sqrt(slope)[:, None] * run.jacobian)
        score = (pull[:, None] * run.jacobian).reshape(run.channels, -1, free).sum(axis=0)
        scores.append(_summed(score))
        squares += float(pull @ pull)
    _, sizes, rows = linalg.svd(np.linalg.qr(np.concatenate(weighted), mode="r"))
    seen = sizes > _BLIND * sizes.max(initial=0.0)
    directions, blind = rows[seen].T, rows[~seen].T
    inverse = directions / sizes[seen] ** 2 @ directions.T
    correction = count / max(1, count - free)
    middle = long_run([score @ directions for score in scores])
    bread = directions / sizes[seen] ** 2
    return Spread(
        covariance=correction * bread @ middle @ bread.T,
        white=inverse * squares / max(1, count - free),
        blind=blind,
    )


def long_run(scores: Sequence[Array]) -> Array:
    """Return the covariance of the sum of all scores, each (n, m), correlated within a run and not between runs.

    Prewhitened by a first-order vector autoregression, then by the quadratic spectral kernel with its automatic
    bandwidth (Andrews 1991).
    """
    width = scores[0].shape[1]
    if width == 0:
        return np.zeros((0, 0))
    count = sum(len(one) for one in scores)
    middle = sum(one.sum(axis=0) for one in scores) / count
    centred = [one - middle for one in scores]
    size = np.sqrt(np.mean(np.concatenate(centred) ** 2, axis=0))
    size[size == 0] = 1
    centred = [one / size for one in centred]
    before, after = np.concatenate([one[:-1] for one in centred]), np.concatenate([one[1:] for one in centred])
    roots = linalg.lstsq(before, after)[0].T
    left, stretch, right = linalg.svd(roots)
    roots = left * np.minimum(stretch, _LARGEST_ROOT) @ right
    innovations = [one[1:] - one[:-1] @ roots.T for one in centred]
    white = sum(_kernel_sum(one, _bandwidth(innovations)) for one in innovations)
    white = white * count / sum(len(one) for one in innovations)
    colour = linalg.inv(np.eye(width) - roots) * size[:, None]
    return np.asarray(colour @ white @ colour.T, dtype=np.float64)


def _summed(scores: Array) -> Array:
    """Return scores summed over blocks of equal length; what is left over goes to the last."""
    block = max(1, len(scores) // _BLOCKS)
    return np.add.reduceat(scores, np.arange(0, len(scores) - block + 1, block), axis=0)


def _bandwidth(series: Sequence[Array]) -> float:
    """Return the bandwidth of Andrews (1991), eq. 6.4, with first-order autoregressions of equal weight."""
    above = below = 0.0
    for column in range(series[0].shape[1]):
        before = np.concatenate([one[:-1, column] for one in series])
        after = np.concatenate([one[1:, column] for one in series])
        power = float(before @ before)
        root = float(np.clip(before @ after / power, -_LARGEST_ROOT, _LARGEST_ROOT)) if power > 0 else 0.0
        noise = float(np.mean((after - root * before) ** 2))
        above += 4 * root**2 * noise**2 / (1 - root) ** 8
        below += noise**2 / (1 - root) ** 4
    length = max(len(one) for one in series)
    return max(1.0, 1.3221 * (above / below * length) ** 0.2) if below > 0 else 1.0


def _kernel_sum(series: Array, bandwidth: float) -> Array:
    """Return the sum of autocovariances, weighted by the quadratic spectral kernel, times the length."""
    total = series.T @ series
    # beyond fifty bandwidths the kernel is below 1e-4
    for lag in range(1, min(len(series), math.ceil(50 * bandwidth))):
        angle = 6 * math.pi * lag / bandwidth / 5
        weight = 3 / angle**2 * (math.sin(angle) / angle - math.cos(angle))
        product = series[lag:].T @ series[:-lag]
        total = total + weight * (product + product.T)
    return np.asarray(total, dtype=np.float64)


def _std(covariance: Array, blind: Array) -> Array:
    std = np.sqrt(np.maximum(np.diag(covariance), 0))
    std[np.abs(blind).max(axis=1, initial=0.0) > 1e-4] = np.inf
    return np.asarray(std, dtype=np.float64)
