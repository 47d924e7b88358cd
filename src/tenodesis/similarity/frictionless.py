"""The similarity error without friction, by the full model over the whole working range."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

GRID = (161, 61)
"""Handle angles and forces of the grid that similarity is judged on."""


class Spread:
    """What errors (deg, NaN where one instrument has none) come to; whoever holds `error` inherits it."""

    error: NDArray[np.float64]

    @property
    def largest(self) -> float:
        """Largest magnitude of the error, deg; NaN if there is none."""
        return float(np.fmax.reduce(np.abs(self.error), axis=None))

    @property
    def rms(self) -> float:
        """Root mean square of the error, deg; NaN if there is none."""
        return rms(self.error)

    @property
    def quantile_95(self) -> float:
        """Magnitude that 95 % of the errors stay below, deg; NaN if there is none."""
        there = np.abs(self.error[np.isfinite(self.error)])
        return float(np.quantile(there, 0.95)) if there.size else float("nan")

    @property
    def unsolved(self) -> float:
        """Share of the points at which either instrument has no equilibrium."""
        return float(np.isnan(self.error).mean())


def rms(values: NDArray[np.float64]) -> float:
    """Return the root mean square of the values that are there; NaN if none is."""
    there = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(there**2))) if there.size else float("nan")


@dataclass(frozen=True)
class SimilarityError(Spread):
    """How far the prototype's output angle strays from the model's over the working range.

    Angles in deg, forces in N on the model. `handle_angle` (rad, length m) and `force` (N, length n) span the grid,
    `error` (deg, m by n) is prototype minus model, NaN where either has no equilibrium; `model_angle` and
    `prototype_angle` (rad, m by n) are NaN where it has none itself. `stop` is the prototype's, rad.
    """

    model_pretension: float
    prototype_pretension: float
    force_factor: float
    handle_angle: NDArray[np.float64]
    force: NDArray[np.float64]
    error: NDArray[np.float64]
    model_angle: NDArray[np.float64]
    prototype_angle: NDArray[np.float64]
    stop: float

    @property
    def worst(self) -> tuple[float, float]:
        """Handle angle (rad) and force (N) of the largest error."""
        at = np.unravel_index(np.nanargmax(np.abs(self.error)), self.error.shape)
        return float(self.handle_angle[at[0]]), float(self.force[at[1]])

    @property
    def held_by_one(self) -> float:
        """Share of the grid that exactly one of the two instruments holds."""
        return float((np.isnan(self.model_angle) != np.isnan(self.prototype_angle)).mean())

    @property
    def snapped(self) -> NDArray[np.float64]:
        """The error, deg, if a prototype that has snapped through stands at its stop, where the load drives it.

        NaN where the model has no equilibrium: that is beyond the range the prototype is meant for.
        """
        at_stop = np.where(self.force > 0, -self.stop, self.stop)
        angle = np.where(np.isnan(self.prototype_angle), at_stop, self.prototype_angle)
        return np.degrees(angle - self.model_angle)

    @property
    def largest_snapped(self) -> float:
        """Largest magnitude of :attr:`snapped`, deg."""
        return float(np.fmax.reduce(np.abs(self.snapped), axis=None))

    @property
    def rms_snapped(self) -> float:
        """Root mean square of :attr:`snapped`, deg."""
        return rms(self.snapped)
