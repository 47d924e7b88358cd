"""The tendon-gear equilibrium by SciPy's root finder, from the paper's equations as printed.

This is the one place besides the core that states them: a check must not share what it checks.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import elementwise

from tenodesis.instrument import TendonGear

Array = NDArray[np.float64]

_elementwise: Any = elementwise  # the stubs do not know functions of several arguments


def residual(theta_d: Array, inst: TendonGear, handle_angle: Array, force: Array) -> Array:
    """Return the moment balance (eqs. 1 and 6-8) over r cos theta_d at half output angles (rad), N."""
    big, small = inst.proximal_gear_radius, inst.distal_gear_radius
    stretch = 2 * (big * np.sin(handle_angle / 2) - small * np.sin(theta_d))
    agonist = np.maximum(0.0, inst.pretension + inst.tendon_stiffness * stretch)
    antagonist = np.maximum(0.0, inst.pretension - inst.tendon_stiffness * stretch)
    return agonist - antagonist - force * (inst.end_effector_length / (small * np.cos(theta_d)) + 1)


def brackets(inst: TendonGear, handle_angle: ArrayLike, force: ArrayLike) -> tuple[Array, Array, Array]:
    """Return where the residual peaks, the unloaded half angle, both rad, and whether there is a root between them.

    On the side that a load pushes to, the residual rises to one peak and falls again; the root next to the unloaded
    angle is the equilibrium.
    """
    handle, load = np.broadcast_arrays(np.asarray(handle_angle, float), np.asarray(force, float))
    unloaded = np.arcsin(inst.proximal_gear_radius / inst.distal_gear_radius * np.sin(handle / 2))
    sign = np.where(load < 0, -1.0, 1.0)
    far = -sign * (np.pi / 2 - 1e-9)
    peak = _elementwise.find_minimum(
        lambda theta, h, f, s: -s * residual(theta, inst, h, f),
        (np.minimum(far, unloaded), (far + unloaded) / 2, np.maximum(far, unloaded)),
        args=(handle, load, sign),
        tolerances={"xatol": 1e-12, "xrtol": 1e-12},
    ).x
    return peak, unloaded, np.asarray(sign * residual(peak, inst, handle, load) > 0)


def output_angle(inst: TendonGear, handle_angle: ArrayLike, force: ArrayLike) -> Array:
    """Return the output angle at a held handle under load (eq. 9), rad; NaN where there is no equilibrium."""
    handle, load = np.broadcast_arrays(np.asarray(handle_angle, float), np.asarray(force, float))
    peak, unloaded, solvable = brackets(inst, handle, load)
    root = _elementwise.find_root(
        lambda theta, h, f: residual(theta, inst, h, f),
        (peak, unloaded),
        args=(handle, load),
        tolerances={"xatol": 1e-14, "xrtol": 1e-15, "fatol": 0.0, "frtol": 0.0},
    )
    return np.where(load == 0, 2 * unloaded, np.where(solvable, 2 * root.x, np.nan))
