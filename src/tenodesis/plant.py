"""Parameters that controller and twin share: those of an instrument in the core's order, its longest time step."""

from collections.abc import Sequence
from math import ceil, floor, log10, pi, sqrt
from typing import NamedTuple

import numpy as np

from tenodesis import _core, statics
from tenodesis.errors import ArgumentError, InstrumentError
from tenodesis.instrument import PARAMETERS, Instrument
from tenodesis.instrument.hardware import Drives, Hand, Sensors
from tenodesis.run import TENDONS

TIME_STEP = 5e-4
"""Default time step, s."""
_TWIN_PARAMETERS = _core.twin_parameters()
LARGEST_PHASE_STEP = 0.5
"""Phase of the fastest oscillation that a time step may take, rad: a twelfth of its period; beyond, errors grow."""
_LONGEST_TICK = 1.0
"""Time between ticks that a controller allows without a watchdog, s."""
_MOST_STEPS = 2**31 - 1
_DIVISION_ERROR = 1e-6
_DEFAULT_NATURAL_FREQUENCY = 2 * pi * 20.0  # rad/s
_DEFAULT_DAMPING_RATIO = 0.2
RIPPLE_PERIODS = 12
"""Periods of a torque's ripple per turn of the motor."""
STOP_STIFFNESS_RATIO = 20.0
"""Stiffness of a mechanical stop over that of its joint."""


class ComplianceShares(NamedTuple):
    """Shares of a tendon's compliance by segment, from the spool."""

    handle: float
    handle_joint: float
    stem: float
    tip_joint: float
    anchor: float
    """Beyond a second vertex of the tip's joint; 0 for joints of one vertex."""


def natural_frequency(inst: Instrument) -> float:
    """Return the angular natural frequency of the straight, unloaded, frictionless tip, rad/s."""
    stiffness = _straight_stiffness(inst)
    return sqrt(stiffness / _tip_inertia(inst, stiffness))


def longest_step(inst: Instrument) -> float:
    """Return the longest time step that the tip's natural frequency allows, s."""
    return LARGEST_PHASE_STEP / natural_frequency(inst)


def least_tip_inertia(inst: Instrument) -> float:
    """Return the smallest inertia of the tip that time steps of the default length can follow, kg m^2."""
    return _straight_stiffness(inst) * (TIME_STEP / LARGEST_PHASE_STEP) ** 2


def parameters(inst: Instrument, time_step: float = TIME_STEP) -> dict[str, float]:
    """Return the parameters of an instrument's twin and axis, SI units, by the core's names; NaN where not given."""
    return dict(zip((*_TWIN_PARAMETERS, *PARAMETERS), parameter_row(inst, time_step), strict=True))


def parameter_row(inst: Instrument, time_step: float) -> list[float]:
    """Return the parameters of a twin, then those of its axis, SI units, in the core's order."""
    friction, dynamics, drives = inst.friction, inst.dynamics, inst.drives
    sensors, mismatch = inst.sensors, inst.mismatch
    stiffness = _straight_stiffness(inst)
    shares, joints = compliance_shares(inst), _core.joint_shares(inst.spec)
    radius = friction.reference_radius if friction.vertex_radius is None else friction.vertex_radius
    inertia = _tip_inertia(inst, stiffness)
    damping = dynamics.tip_damping
    values = {
        "vertex_coefficient": friction.vertex_coefficient,
        "sheath_coefficient": friction.sheath_coefficient,
        "sheath_bend": friction.sheath_bend,
        "sheath_bend_rate": friction.sheath_bend_per_handle_angle,
        "viscous": friction.viscous,
        "constant": friction.constant,
        "static_ratio": friction.static_ratio,
        "stribeck_speed": friction.stribeck_speed,
        "memory": friction.memory,
        "base_wrap": friction.base_wrap,
        "load_index": friction.load_index,
        "reference_tension": friction.reference_tension,
        "vertex_radius_ratio": radius / friction.reference_radius,
        "bending_loss": friction.tendon_bending_stiffness / (2 * radius**2),
        "handle_length_share": shares.handle,
        "handle_span_ratio": shares.handle_joint / joints[0],
        "tip_span_ratio": shares.tip_joint / joints[1],
        "anchor_share": shares.anchor,
        "stiffness_ratio": mismatch.stiffness_ratio,
        "pretension_ratio": mismatch.pretension_ratio,
        "tip_inertia": inertia,
        "tip_damping": 2 * _DEFAULT_DAMPING_RATIO * sqrt(stiffness * inertia) if damping is None else damping,
        "output_stop": inst.output_stop,
        "stop_stiffness": STOP_STIFFNESS_RATIO * stiffness,
        **hand_parameters(dynamics),
        "rig_pulley_radius": inst.conditions.cable_pulley_radius or 0.0,
        "handle_encoder_offset": mismatch.handle_encoder_offset,
        "output_encoder_offset": mismatch.output_encoder_offset,
        **hardware_parameters(drives, sensors),
        **current_parameters(drives),
        "time_step": time_step,
    }
    sensor = inst.tension_sensor
    values |= {f"load_cell_{name}": getattr(sensor, name) for name in ("range", "resolution", "noise")}
    values["tension_gain"] = sensor.gain
    for n, tendon in enumerate(TENDONS):
        values[f"{tendon}_load_cell_gain"] = mismatch.load_cell_gain[n]
        values[f"{tendon}_load_cell_bias"] = mismatch.load_cell_bias[n]
    return [values[name] for name in _TWIN_PARAMETERS] + inst.spec.__getstate__()[1]


def hand_parameters(hand: Hand) -> dict[str, float]:
    """Return the parameters of the hand, SI units, by the core's names."""
    return {name: getattr(hand, name) for name in Hand.model_fields}


def hardware_parameters(drives: Drives, sensors: Sensors) -> dict[str, float]:
    """Return the parameters of drives and sensors without their errors, SI units, by the core's names."""
    return {
        "spool_radius": drives.spool_radius,
        "spool_speed_limit": drives.motor_speed / drives.gear_ratio,
        "spool_acceleration_limit": drives.motor_acceleration / drives.gear_ratio,
        "drive_time_constant": drives.time_constant,
        "backlash": drives.backlash,
        "encoder_noise": sensors.encoder_noise,
        "encoder_range": sensors.encoder_range,
        "encoder_resolution": sensors.encoder_range / 2**sensors.encoder_bits,
        "motor_encoder_resolution": 2 * pi / drives.encoder_counts / drives.gear_ratio,
        "load_cell_noise": sensors.load_cell_noise,
        "load_cell_range": sensors.load_cell_range,
        # The converter's range is to either side of 0.
        "load_cell_resolution": 2 * sensors.load_cell_range / 2**sensors.load_cell_bits,
    }


def current_parameters(drives: Drives) -> dict[str, float]:
    """Return what currents show of drives, SI units, by the core's names."""
    names = ("gear_efficiency", "friction_torque", "torque_ripple", "thermal_drift", "thermal_time")
    own = {name: getattr(drives, name) for name in names}
    return own | {"ripple_rate": RIPPLE_PERIODS * drives.gear_ratio / (2 * pi)}


def spec(inst: Instrument, time_step: float, quasi_static: bool) -> _core.TwinSpec:
    """Return the specification of a twin of the core; errors as :func:`steps_per_sample`."""
    per_sample = steps_per_sample(inst, time_step, quasi_static)
    parameters = parameter_row(inst, time_step)[: len(_TWIN_PARAMETERS)]
    return core_spec(inst, inst.spec, parameters, per_sample, quasi_static)


def core_spec(
    inst: Instrument, axis: _core.Spec, parameters: Sequence[float], per_sample: int, quasi_static: bool
) -> _core.TwinSpec:
    """Return a twin with an instrument's law and contacts; axis, parameters and steps per sample are given."""
    friction = inst.friction
    return _core.TwinSpec(
        axis,
        parameters,
        speed_dependent=friction.law == "stribeck",
        tension_dependent=friction.law == "capstan-power" or friction.bends,
        sheath_contacts=friction.sheath_contacts,
        vertices_per_joint=friction.vertices_per_joint,
        steps_per_sample=per_sample,
        quasi_static=quasi_static,
        currents=inst.sensors.kind == "current",
    )


def compliance_shares(inst: Instrument) -> ComplianceShares:
    """Return how a tendon's compliance is shared among its segments: as given, or by length."""
    friction = inst.friction
    by_handle, by_tip = _core.joint_shares(inst.spec)
    by_length = inst.handle_length / (inst.tendon_length or inst.overall_length)
    handle = by_length if friction.handle_compliance_share is None else friction.handle_compliance_share
    handle_joint = by_handle if (given := friction.handle_joint_compliance_share) is None else given
    tip_joint = by_tip if (given := friction.tip_joint_compliance_share) is None else given
    anchor = 0.0
    if friction.vertices_per_joint > 1:
        anchor = tip_joint / 2 if (given := friction.anchor_compliance_share) is None else given
    return ComplianceShares(handle, handle_joint, 1 - handle - handle_joint - tip_joint - anchor, tip_joint, anchor)


def check_runnable(inst: Instrument) -> None:
    """Refuse an instrument that no twin of the default time step, and so no live loop, can run.

    Raises
    ------
    InstrumentError
        A value prevents it; the message names the key, the value and what is allowed.
    ArgumentError
        Its joints and handle leave no compliance to the stem.
    """
    for planar in inst.planar:
        _check_inertia(planar)
    _check_ticks(inst)
    for planar in inst.planar:
        _check_compliance(planar)


def _check_inertia(inst: Instrument) -> None:
    if longest_step(inst) >= TIME_STEP:
        return
    raise _not_runnable(
        "dynamics.tip_inertia",
        f"{inst.dynamics.tip_inertia:g} kg*m^2",
        f"at least {_rounded_up(least_tip_inertia(inst)):g} kg*m^2, so that the tip swings slowly enough for time "
        f"steps of {TIME_STEP:g} s",
    )


def _check_ticks(inst: Instrument) -> None:
    rate, watchdog = inst.sensors.sampling_rate, inst.control.watchdog
    period = max(1 / rate, TIME_STEP)
    longest = watchdog or _LONGEST_TICK
    if period < longest:
        _check_division(rate, period)
    elif period > TIME_STEP:
        reason = "after which control.watchdog stops the motors" if watchdog else "the longest time between ticks"
        allowed = f"above {1 / longest:g} Hz: its period must be shorter than {longest:g} s, {reason}"
        raise _not_runnable("sensors.sampling_rate", f"{rate:g} Hz", allowed)
    else:
        allowed = f"above {TIME_STEP:g} s, the time between ticks, or 0"
        raise _not_runnable("control.watchdog", f"{watchdog:g} s", allowed)


def _check_division(rate: float, period: float) -> None:
    steps = round(period / TIME_STEP)
    if abs(steps * TIME_STEP / period - 1) > _DIVISION_ERROR:
        allowed = f"such that a period takes whole time steps of {TIME_STEP:g} s, as {1 / (steps * TIME_STEP):g} Hz"
        raise _not_runnable("sensors.sampling_rate", f"{rate:g} Hz", allowed)


def _not_runnable(key: str, value: str, allowed: str) -> InstrumentError:
    return InstrumentError(f"{key} is {value}; to run it must be {allowed}.", key=key, value=value, allowed=allowed)


def _rounded_up(value: float) -> float:
    """Return a value of three digits that is at least as large."""
    unit = 10.0 ** (floor(log10(value)) - 2)
    return ceil(value / unit) * unit


def steps_per_sample(inst: Instrument, time_step: float, quasi_static: bool) -> int:
    """Return how many time steps (s) a sampling period takes.

    Raises
    ------
    ValueError
        The time step does not suit the instrument, or its joints and handle leave no compliance to the stem.
    """
    if not (np.isfinite(time_step) and time_step > 0):
        raise ArgumentError(key="time_step", value=time_step, allowed="a time above 0 s")
    if not quasi_static and time_step > (longest := longest_step(inst)):
        allowed = f"at most {longest:.3g} s"
        problem = (
            f"time_step is {time_step:g} s; it must be {allowed}, a twelfth of a period of the tip of {inst.name} "
            f"({natural_frequency(inst) / (2 * pi):.3g} Hz)."
        )
        raise ArgumentError(problem, key="time_step", value=time_step, allowed=allowed)
    per_sample = steps_per_period(inst.sensors.sampling_rate, time_step)
    _check_compliance(inst)
    return per_sample


def steps_per_period(rate: float, time_step: float) -> int:
    """Return how many time steps (s) a sampling period takes; raises ArgumentError where they do not divide it."""
    period = 1 / rate
    per_sample = max(1, round(period / time_step))
    if per_sample > _MOST_STEPS:
        allowed = f"at least {1 / (_MOST_STEPS * time_step):.3g} Hz"
        problem = f"sensors.sampling_rate is {rate:g} Hz; with time steps of {time_step:g} s it must be {allowed}."
        raise ArgumentError(problem, key="sensors.sampling_rate", value=rate, allowed=allowed)
    if period > time_step and abs(per_sample * time_step / period - 1) > _DIVISION_ERROR:
        allowed = f"an integer fraction of the sampling period of {period:g} s, or more"
        problem = f"time_step is {time_step:g} s; it must be {allowed}."
        raise ArgumentError(problem, key="time_step", value=time_step, allowed=allowed)
    return per_sample


def _check_compliance(inst: Instrument) -> None:
    """Raise ArgumentError if handle and joints leave no share of a tendon's compliance to the stem."""
    shares = compliance_shares(inst)
    share, joints = shares.handle, shares.handle_joint + shares.tip_joint + shares.anchor
    if shares.stem > 0:
        return
    if inst.friction.handle_compliance_share is None:
        raise ArgumentError(
            f"handle_length and joints take {share + joints:.3g} of the length of a tendon of {inst.name}; it must be "
            "less than 1: give a shorter handle_length or a longer tendon_length.",
            key="handle_length",
            value=inst.handle_length,
            allowed="less than the tendon's length without the joints",
        )
    raise ArgumentError(
        f"friction.handle_compliance_share is {share:g}, which with the joints makes {share + joints:.3g} of the "
        f"compliance of {inst.name}; it must be below {1 - joints:.3g}.",
        key="friction.handle_compliance_share",
        value=share,
        allowed=f"below {1 - joints:.3g}",
    )


def tip_inertia(inst: Instrument) -> float:
    """Return the inertia about the output angle, kg m^2: as given, or such that the unloaded tip has 20 Hz."""
    return _tip_inertia(inst, _straight_stiffness(inst))


def _tip_inertia(inst: Instrument, stiffness: float) -> float:
    given = inst.dynamics.tip_inertia
    return stiffness / _DEFAULT_NATURAL_FREQUENCY**2 if given is None else given


def _straight_stiffness(inst: Instrument) -> float:
    """Return the stiffness of the straight tip, N m/rad."""
    return float(statics.flexural_stiffness(inst, 0.0))
