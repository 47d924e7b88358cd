"""The signals that the page shows, at an instant or over a period of time, with one column per axis."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tenodesis import statics
from tenodesis.instrument import ShortForm
from tenodesis.run import Array

_HANDLE = ("handle_angle", "measured_handle_angle")
_OUTPUT = ("output_angle", "measured_output_angle", "estimated_output_angle")
"""Sources of the tip angle, the best first: the twin, the encoder at the tip, the observer."""
_TENSION = ("tension", "measured_tension")
_DISTAL = ("distal_tension", "tension", "measured_tension")


class ShownSignals(NamedTuple):
    """Signals at n instants, or at a single instant without that dimension; NaN where unknown."""

    time: Array
    """s, shape (n,)"""
    handle: Array
    """Handle angle, rad, shape (n, axes)"""
    output: Array
    """Output angle, rad, shape (n, axes)"""
    target: Array
    """Output angle that the controller aims at for the handle angle, rad, shape (n, axes)"""
    estimated: Array
    """Output angle as estimated by the observer, rad, shape (n, axes)"""
    deviation: Array
    """Standard deviation of the estimated angle, rad, shape (n, axes)"""
    force: Array
    """Tangential load on the tip, N, shape (n, axes)"""
    estimated_force: Array
    """The same as estimated by the observer, N, shape (n, axes)"""
    force_deviation: Array
    """Its standard deviation, N, shape (n, axes)"""
    contact_force: Array
    """Tangential force of tissue on the tip, N, shape (n, axes)"""
    friction_scale: Array
    """Friction over that of the instrument file, shape (n, axes)"""
    phase: Array
    """Of the robust law, as :attr:`tenodesis.run.Run.phase` has it, shape (n, axes)"""
    tension: Array
    """At the spools, agonist first, N, shape (n, axes, 2)"""
    current: Array
    """Of the motors, where they measure the tensions, agonist first, A, shape (n, axes, 2)"""
    distal_tension: Array
    """At the tip, agonist first, N, shape (n, axes, 2)"""
    stroke: Array
    """Length that each motor has wound, m, shape (n, axes, 2)"""


def shown_signals(inst: ShortForm, signals: Mapping[str, ArrayLike]) -> ShownSignals:
    """Return the signals to show, from signals in the shapes of :data:`tenodesis.run.SIGNALS`."""
    axes = len(inst.axes)
    time = np.asarray(signals["time"], float)
    single, pair = (*time.shape, axes), (*time.shape, axes, 2)

    def first(names: tuple[str, ...], shape: tuple[int, ...]) -> Array:
        """Return the first of some signals that has any finite value."""
        for name in names:
            values = signals.get(name)
            if values is not None and np.isfinite(values).any():
                return np.asarray(values, float).reshape(shape)
        return np.full(shape, np.nan)

    handle = first(_HANDLE, single)
    per_current = np.array([[one.tension_sensor.per_current or np.nan] for one in inst.planar])
    return ShownSignals(
        time=time,
        handle=handle,
        output=first(_OUTPUT, single),
        target=statics.targets(inst, handle),
        estimated=first(("estimated_output_angle",), single),
        deviation=first(("estimated_output_angle_std",), single),
        force=first(("force", "estimated_force"), single),
        estimated_force=first(("estimated_force",), single),
        force_deviation=first(("estimated_force_std",), single),
        contact_force=first(("contact_force",), single),
        friction_scale=first(("friction_scale",), single),
        phase=first(("phase",), single),
        tension=first(_TENSION, pair),
        current=first(("measured_tension",), pair) / per_current,
        distal_tension=first(_DISTAL, pair),
        stroke=first(("measured_spool_angle", "spool_angle"), pair) * inst.drives.spool_radius,
    )
