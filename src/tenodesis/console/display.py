"""The signals that the page shows, at an instant or over a period of time, with one column per joint or tendon."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from tenodesis.instrument import Instrument, expanded
from tenodesis.live.controlled import live_names
from tenodesis.run import COMPONENTS, Array
from tenodesis.statics import targets
from tenodesis.statics.chain import output_angles

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
    """Handle angle, rad, shape (n, joints of the handle)"""
    output: Array
    """Output angle, rad, shape (n, joints)"""
    target: Array
    """Output angle without load and friction, rad, shape (n, joints): of the handle angle or, without a handle, of what
    the motors have wound"""
    estimated: Array
    """Output angle as estimated by the observer, rad, shape (n, joints)"""
    deviation: Array
    """Standard deviation of the estimated angle, rad, shape (n, joints)"""
    force: Array
    """Tangential load on the tip, N, shape (n, joints)"""
    wrench: Array
    """Load on the tip in its axes, N and N m, shape (n, 6)"""
    grip_force: Array
    """Force of the jaws on what they hold, N, shape (n, 1)"""
    estimated_force: Array
    """The tangential load as estimated by the observer, N, shape (n, joints)"""
    force_deviation: Array
    """Its standard deviation, N, shape (n, joints)"""
    contact_force: Array
    """Tangential force of tissue on the tip, N, shape (n, joints)"""
    friction_scale: Array
    """Friction over that of the instrument file, shape (n, joints)"""
    phase: Array
    """Of the robust law, as :attr:`tenodesis.run.Run.phase` has it, shape (n, joints)"""
    tension: Array
    """At the spools, N, shape (n, tendons)"""
    current: Array
    """Of the motors, where they measure the tensions, A, shape (n, tendons)"""
    distal_tension: Array
    """At the tip, N, shape (n, tendons)"""
    stroke: Array
    """Length that each motor has wound, m, shape (n, tendons)"""


def shown_signals(inst: Instrument, signals: Mapping[str, Any]) -> ShownSignals:
    """Return the signals to show, from signals in the shapes of :data:`tenodesis.run.SIGNALS`."""
    names = live_names(inst)
    time = np.asarray(signals["time"], float)
    served = [names.joints.index(joint) for joint in names.compensated]

    def first(sources: tuple[str, ...], columns: int) -> Array:
        """Return the first of some signals that has any finite value."""
        for name in sources:
            values = signals.get(name)
            if values is not None and np.isfinite(values).any():
                return np.asarray(values, float).reshape(*time.shape, columns)
        return np.full((*time.shape, columns), np.nan)

    def of_law(name: str) -> Array:
        """Return a controller's signal by joint."""
        values = np.full((*time.shape, len(names.joints)), np.nan)
        values[..., served] = first((name,), len(served))
        return values

    joints, tendons = len(names.joints), len(names.tendons)
    handle = first(_HANDLE, len(names.handle_joints))
    stroke = first(("measured_spool_angle", "spool_angle"), tendons) * inst.own_drives.spool_radius
    output = first(_OUTPUT[:2], joints)
    force = first(("force",), joints)
    aimed = first(("commanded_output_angle",), joints)
    if names.handle_joints:
        aimed = targets(inst, handle)
    elif not np.isfinite(aimed).any():
        aimed = _wound_to(inst, handle, stroke)
    return ShownSignals(
        time=time,
        handle=handle,
        output=output if np.isfinite(output).any() else of_law(_OUTPUT[2]),
        target=aimed,
        estimated=of_law("estimated_output_angle"),
        deviation=of_law("estimated_output_angle_std"),
        force=force if np.isfinite(force).any() or "wrench" in signals else of_law("estimated_force"),
        wrench=first(("wrench",), len(COMPONENTS)),
        grip_force=first(("grip_force",), 1),
        estimated_force=of_law("estimated_force"),
        force_deviation=of_law("estimated_force_std"),
        contact_force=first(("contact_force",), joints),
        friction_scale=of_law("friction_scale"),
        phase=of_law("phase"),
        tension=first(_TENSION, tendons),
        current=first(("measured_tension",), tendons)
        / np.array([one.per_current or np.nan for one in inst.tension_sensors]),
        distal_tension=first(_DISTAL, tendons),
        stroke=stroke,
    )


def _wound_to(inst: Instrument, handle: Array, stroke: Array) -> Array:
    """Return the angles without load and friction for strokes of the motors (..., tendons), m."""
    known = np.isfinite(stroke).all(axis=-1, keepdims=True)
    return np.where(known, output_angles(expanded(inst), handle, strokes=np.nan_to_num(stroke)), np.nan)
