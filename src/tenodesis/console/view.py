"""What the page shows of one instant, or of a stretch of time, by axis whatever their number."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tenodesis import statics
from tenodesis.instrument import Instrument
from tenodesis.run import Array

_HANDLE = ("handle_angle", "measured_handle_angle")
_OUTPUT = ("output_angle", "measured_output_angle", "estimated_output_angle")
"""Where the tip is: as the twin knows it, as a bench measures it, as the observer takes it to be."""
_TENSION = ("tension", "measured_tension")
_DISTAL = ("distal_tension", "tension", "measured_tension")


class View(NamedTuple):
    """Signals of n instants, or of one without that dimension; NaN where nothing tells them."""

    time: Array
    """s, shape (n,)"""
    handle: Array
    """Handle angle, rad, shape (n, axes)"""
    output: Array
    """Output angle, rad, as handle"""
    wanted: Array
    """Output angle that the handle angle asks for, which the controller aims at, rad, as handle"""
    estimated: Array
    deviation: Array
    """Standard deviation of the estimated angle, rad, as handle"""
    force: Array
    """Tangential force at the tip, N, as handle"""
    friction_scale: Array
    tension: Array
    """Beside the spools, agonist first, N, shape (n, axes, 2)"""
    distal_tension: Array
    """At the tip, as tension"""
    stroke: Array
    """What each motor has wound, m, as tension"""


def view(inst: Instrument, signals: Mapping[str, ArrayLike]) -> View:
    """Return what signals show, in the shapes of :data:`tenodesis.run.SIGNALS`."""
    axes = len(inst.axes)
    time = np.asarray(signals["time"], float)
    single, pair = (*time.shape, axes), (*time.shape, axes, 2)

    def first(names: tuple[str, ...], shape: tuple[int, ...]) -> Array:
        """Return the first of some signals that tells anything."""
        for name in names:
            values = signals.get(name)
            if values is not None and np.isfinite(values).any():
                return np.asarray(values, float).reshape(shape)
        return np.full(shape, np.nan)

    handle = first(_HANDLE, single)
    return View(
        time=time,
        handle=handle,
        output=first(_OUTPUT, single),
        wanted=asked(inst, handle),
        estimated=first(("estimated_output_angle",), single),
        deviation=first(("estimated_output_angle_std",), single),
        force=first(("force", "estimated_force"), single),
        friction_scale=first(("friction_scale",), single),
        tension=first(_TENSION, pair),
        distal_tension=first(_DISTAL, pair),
        stroke=first(("measured_spool_angle", "spool_angle"), pair) * inst.drives.spool_radius,
    )


def asked(inst: Instrument, handle: Array) -> Array:
    """Return the output angle that handle angles of shape (..., axes) ask for, rad (eq. 18)."""
    wanted = np.empty(handle.shape)
    for n, name in enumerate(inst.axes):
        alone = inst.axis(name) if len(inst.axes) > 1 else inst
        within = np.nan_to_num(np.clip(handle[..., n], -alone.handle_range, alone.handle_range))
        # Eq. 19 with equal tensions.
        angles = statics.estimate_output_angle(alone, within, alone.pretension, alone.pretension)
        wanted[..., n] = np.where(np.isfinite(handle[..., n]), angles, np.nan)
    return wanted
