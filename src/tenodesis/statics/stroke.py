"""The stroke at which a law of compensation comes to rest, without friction."""

import numpy as np
from numpy.typing import NDArray

from tenodesis.instrument import ShortForm
from tenodesis.statics.equations import Actuation, Law, compensation_stroke, tensions

_ITERATIONS = 2000
_SETTLED = 1e-15  # m


def settled_stroke(
    inst: ShortForm, handle_angle: NDArray[np.float64], force: float, actuation: Actuation, law: Law
) -> NDArray[np.float64]:
    """Return the agonist's stroke, m, at which the law requires just the stroke already made, NaN if there is none.

    A fixed-point iteration; half steps keep it from overshooting. The stiffer a backbone, the more steps it takes.
    """
    stroke = np.zeros_like(handle_angle)
    for _ in range(_ITERATIONS):
        tension = tensions(inst, handle_angle, force, wound=wound(stroke, actuation))
        solved = np.isfinite(tension.agonist)
        agonist, antagonist = (np.where(solved, measured, 0.0) for measured in tension)
        wanted = compensation_stroke(inst, agonist, antagonist, actuation, law, handle_angle=handle_angle)
        step = np.where(solved, (wanted - stroke) / 2, np.nan)
        # Points that find no equilibrium on the way get no stroke and are left out of the solves that follow.
        lost = ~np.isfinite(step)
        stroke = np.where(lost, 0.0, stroke + step)
        if np.all(lost | (np.abs(step) < _SETTLED)):
            return np.where(lost, np.nan, stroke)
    return np.full_like(stroke, np.nan)


def wound(stroke: NDArray[np.float64], actuation: Actuation) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the length that each motor has wound for an agonist's stroke, m."""
    return stroke, -stroke if actuation == "differential" else np.zeros_like(stroke)
