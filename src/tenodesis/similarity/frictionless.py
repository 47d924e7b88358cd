"""The similarity error without friction, by the full quasi-static model over the working range."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tenodesis.magnitude import rms_of_finite

GRID = (161, 61)
"""Handle angles and forces of the grid on which similarity is judged."""


class ErrorStatistics:
    """Statistics of `error` (deg) between two angles (rad), NaN where an instrument has no equilibrium."""

    error: NDArray[np.float64]
    real_size_angle: NDArray[np.float64]
    scaled_up_angle: NDArray[np.float64]

    @property
    def largest(self) -> float:
        """Largest magnitude of the error, deg; NaN if there is none."""
        return largest(self.error)

    @property
    def rms(self) -> float:
        """Root mean square of the error, deg; NaN if there is none."""
        return rms_of_finite(self.error)

    @property
    def quantile_95(self) -> float:
        """Magnitude that 95 % of the errors stay below, deg; NaN if there is none."""
        finite = np.abs(self.error[np.isfinite(self.error)])
        return float(np.quantile(finite, 0.95)) if finite.size else float("nan")

    @property
    def unsolved(self) -> float:
        """Share of the points at which either instrument has no equilibrium."""
        return float(np.isnan(self.error).mean())

    @property
    def held_by_one(self) -> float:
        """Share of the points at which exactly one of the two instruments has an equilibrium."""
        return float((np.isnan(self.real_size_angle) != np.isnan(self.scaled_up_angle)).mean())


def largest(values: NDArray[np.float64]) -> float:
    """Return the largest magnitude of the finite values; NaN if there is none."""
    return float(np.fmax.reduce(np.abs(values), axis=None))


@dataclass(frozen=True)
class SimilarityError(ErrorStatistics):
    """Difference in output angle between the scaled-up and the real-size instrument over the working range.

    `handle_angle` (rad, shape (m,)) and `force` (N on the real-size instrument, shape (n,)) span the grid. `error`
    (deg, shape (m, n)) is scaled-up minus real-size, NaN where either has no equilibrium; `real_size_angle` and
    `scaled_up_angle` (rad, shape (m, n)) are NaN where that instrument has none. `stop` is the scaled-up one's, rad.
    """

    real_size_pretension: float
    scaled_up_pretension: float
    force_factor: float
    handle_angle: NDArray[np.float64]
    force: NDArray[np.float64]
    error: NDArray[np.float64]
    real_size_angle: NDArray[np.float64]
    scaled_up_angle: NDArray[np.float64]
    stop: float

    def __repr__(self) -> str:
        shape = f"{self.handle_angle.size} handle angles, {self.force.size} forces"
        return f"<SimilarityError: largest {self.largest:.4g} deg, rms {self.rms:.4g} deg, {shape}>"

    @property
    def worst(self) -> tuple[float, float]:
        """Handle angle (rad) and force (N) of the largest error."""
        at = np.unravel_index(np.nanargmax(np.abs(self.error)), self.error.shape)
        return float(self.handle_angle[at[0]]), float(self.force[at[1]])

    @property
    def snapped(self) -> NDArray[np.float64]:
        """The error, deg, with a scaled-up tip that has snapped through at its stop, where the load drives it.

        NaN where the real-size instrument has no equilibrium: that is beyond its working range.
        """
        at_stop = np.where(self.force > 0, -self.stop, self.stop)
        angle = np.where(np.isnan(self.scaled_up_angle), at_stop, self.scaled_up_angle)
        return np.degrees(angle - self.real_size_angle)

    @property
    def largest_snapped(self) -> float:
        """Largest magnitude of :attr:`snapped`, deg."""
        return largest(self.snapped)

    @property
    def rms_snapped(self) -> float:
        """Root mean square of :attr:`snapped`, deg."""
        return rms_of_finite(self.snapped)
