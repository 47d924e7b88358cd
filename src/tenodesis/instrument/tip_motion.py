"""Inertia and damping of the tip, and the stiffness that it swings on."""

from math import pi, sqrt
from typing import TYPE_CHECKING

import numpy as np

from tenodesis import _core

if TYPE_CHECKING:
    from tenodesis.instrument.short_form import ShortForm

_DEFAULT_NATURAL_FREQUENCY = 2 * pi * 20.0  # rad/s
_DEFAULT_DAMPING_RATIO = 0.2


def straight_stiffness(inst: "ShortForm") -> float:
    """Return the stiffness of the straight tip of an axis, N m/rad (eq. 16)."""
    out, status = np.empty((1, 1, 1)), np.empty(1, np.uint8)
    _core.evaluate(inst.spec, "flexural_stiffness", [np.zeros(1)], out, status, 1)
    return float(out[0, 0, 0])


def tip_inertia(inst: "ShortForm") -> float:
    """Return the inertia about the output angle, kg m^2: as given, or such that the unloaded tip has 20 Hz."""
    given = inst.dynamics.tip_inertia
    return straight_stiffness(inst) / _DEFAULT_NATURAL_FREQUENCY**2 if given is None else given


def tip_damping(inst: "ShortForm") -> float:
    """Return the damping of the output angle, N m s/rad: as given, or a fifth of critical damping."""
    given = inst.dynamics.tip_damping
    critical = 2 * sqrt(straight_stiffness(inst) * tip_inertia(inst))
    return _DEFAULT_DAMPING_RATIO * critical if given is None else given
