"""Observer and law for any routing: all joints of an instrument from the drive end of all its tendons."""

from math import hypot, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tenodesis import _core
from tenodesis.errors import ArgumentError
from tenodesis.instrument import FullForm, InstrumentLike, expanded
from tenodesis.plant import TIME_STEP
from tenodesis.routes import twin_rows, twin_values
from tenodesis.run import Array

_NAMES = _core.joint_control_parameters()
_COMPONENTS = 7
"""Of the load: force, moment, grip."""
_DEVIATIONS = 2.0
"""Of an estimate, that strokes leave room for and that the file's uncertainties mean."""
_PLAY = 4.0
"""Deviations of sensors by which a tendon counts as slipping; part of a step that a spool at rest stays within."""
_SMOOTHING = 0.05
"""Time over which the handle's encoder is smoothed where slip is found from it, s."""
_SPOOL_LAG = 0.4
"""Gain of the spools' positions by the inverse of the drives' time constant: without overshoot."""
_LAW_SHARE = 0.2
"""Rate of the law over that gain, so that spools follow it."""
_TENSION_SHARE = 0.9
"""Of what the load cells measure, that strokes may bring the tensions to where the file has no limit."""
_IMBALANCE = 1e-3
"""Moment of a joint that no load explains, as a share of what tendons can hold."""


class JointEstimate(NamedTuple):
    """What tendons show of the joints, at one tick or with a row per tick."""

    angle: Array
    """rad, (..., joints)"""
    angle_std: Array
    """rad, (..., joints)"""
    moment: Array
    """Of the tendons about the joints, N m, (..., joints)"""
    load: Array
    """Force (N) and moment (N m) at the tip in its axes, and grip force (N), (..., 7)"""
    load_std: Array
    friction_scale: Array
    """Friction over the file's"""
    friction_scale_std: Array
    far_tension: Array
    """At the ends of the tendons, N, (..., tendons)"""
    covariance: Array
    """Of the angles, rad^2, (..., joints, joints)"""

    @classmethod
    def of_rows(cls, rows: Array, joints: int, tendons: int) -> "JointEstimate":
        """Return it from the core's numbers, (..., width)."""
        widths = [joints, joints, joints, _COMPONENTS, _COMPONENTS, 1, 1, tendons, joints**2]
        angle, std, moment, load, load_std, scale, scale_std, far, covariance = np.split(
            rows, np.cumsum(widths)[:-1], axis=-1
        )
        square = covariance.reshape(*rows.shape[:-1], joints, joints)
        return cls(angle, std, moment, load, load_std, scale[..., 0], scale_std[..., 0], far, square)


class JointController:
    """Observer and law of all joints of any instrument, with or without a handle.

    Targets are the angles that joints had if no tendon stretched: of an instrument with a handle those of its handle,
    of a tool without one those that are commanded. The motors give back what the joints lose, as far as the estimate's
    deviation leaves no doubt, but leave the grip as commanded where something presses the jaws apart; tendons about to
    go slack are tightened without turning a joint.

    Parameters
    ----------
    inst
        The instrument: its table friction is the observer's assumption, its table control has uncertainties and limits.
    compensates
        Whether the motors give back what is lost; else they follow the commands alone, as by a rigid coupling matrix.
    period
        Time between ticks, s; by default the instrument's sampling period.

    Raises
    ------
    ValueError
        Neither tendon nor spring holds a joint, or the period is not above 0 and below 1 s.
    """

    def __init__(self, inst: InstrumentLike, *, compensates: bool = True, period: float | None = None) -> None:
        given = expanded(inst)
        self.inst, self.compensates = given, bool(compensates)
        self.period = 1 / given.sensors.sampling_rate if period is None else period
        if not 0 < self.period < 1:
            raise ArgumentError(key="period", value=period, allowed="a time above 0 and below 1 s")
        rows = twin_rows(given, TIME_STEP, quasi_static=True)
        values = twin_values(given, TIME_STEP) | _values(given, self.period)
        numbers = [float(values[name]) for name in _NAMES]
        self.core = _core.JointController(given.core, rows.passages, rows.contacts, rows.segments, numbers, rows.law)

    def __repr__(self) -> str:
        return f"<JointController for {self.inst.name!r}: {len(self.inst.tip_joints)} joints>"

    def step(
        self,
        tensions: ArrayLike,
        spool_angles: ArrayLike,
        handle_angle: ArrayLike = (),
        target: ArrayLike | None = None,
    ) -> tuple[Array, JointEstimate]:
        """Return the spools' velocities (rad/s, by tendon) for the next tick, and the estimate.

        Parameters
        ----------
        tensions
            Beside the spools, N, by tendon.
        spool_angles
            rad, from the pretension at straight joints, positive winds; by tendon.
        handle_angle
            rad, by joint of the handle.
        target
            Of a tool without a handle: angles commanded, rad, by joint of the tip; by default straight.

        Raises
        ------
        ValueError
            A shape does not fit the instrument. A measurement that is not finite stops the spools instead.
        """
        joints, tendons = len(self.inst.tip_joints), len(self.inst.tendons)
        out = np.empty(self.core.width + tendons)
        wanted = np.zeros(joints) if target is None else target
        handle, tension, spool, aim = (
            np.ascontiguousarray(one, float) for one in (handle_angle, tensions, spool_angles, wanted)
        )
        self.core.step(handle, tension, spool, aim, self.compensates, out)
        return out[self.core.width :], JointEstimate.of_rows(out[: self.core.width], joints, tendons)

    def reset(self) -> None:
        """Return to the state in which it was made."""
        self.core.reset()


def _values(inst: FullForm, period: float) -> dict[str, float]:
    """Return the numbers of observer and law that are not the plant's, by the core's names."""
    control, sensor, drives = inst.control, inst.tension_sensors[0], inst.own_drives
    step = 2 * np.pi / drives.encoder_counts / drives.gear_ratio * drives.spool_radius
    sensors, handle_arms = inst.sensors, inst.tendon_arms("handle")
    resolution = sensors.encoder_range / 2**sensors.encoder_bits
    drawn = float(np.max(np.abs(handle_arms), initial=0.0)) * hypot(sensors.encoder_noise, resolution)
    smoothing = period / (_SMOOTHING + period)
    arms = np.abs(inst.tendon_arms("tip"))
    pretension = float(np.max(inst.pretensions))
    held = float(np.max(arms.T @ np.maximum(inst.pretensions, _IMBALANCE * pretension)))
    last = max(joint.end_effector_length or 0.0 for joint in inst.tip_joints)
    reach = last + sum(joint.offset + joint.chord for joint in inst.tip_joints) or float(np.max(arms))
    gain = min(_SPOOL_LAG / max(drives.time_constant, period), 1 / (10 * period))
    return {
        "play": step / _PLAY + _PLAY * drawn * sqrt(smoothing / 2),
        "tension_play": _PLAY * (sensor.noise + sensor.resolution),
        "smoothing": smoothing,
        "tension_deviation": hypot(sensor.noise, sensor.resolution, sensor.offset / _DEVIATIONS),
        "length_deviation": hypot(step / sqrt(12), drawn / _DEVIATIONS, control.reference_uncertainty / _DEVIATIONS),
        "friction_deviation": control.friction_uncertainty / _DEVIATIONS,
        "stiffness_deviation": control.stiffness_uncertainty / _DEVIATIONS,
        "force_deviation": held / reach,
        "moment_deviation": held,
        "grip_deviation": held / reach,
        "imbalance": _IMBALANCE * held,
        "rate": _LAW_SHARE * gain,
        "gain": gain,
        "speed": drives.motor_speed / drives.gear_ratio * drives.spool_radius,
        "tension_limit": control.tension_limit or _TENSION_SHARE * sensor.range,
        "least_tension": control.least_tension,
        "deviations": _DEVIATIONS,
        "period": period,
    }
