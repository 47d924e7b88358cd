"""Parameters that controller and twin share: those of an instrument in the core's order, its longest time step."""

from collections.abc import Sequence
from math import ceil, floor, log10, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from tenodesis import _core
from tenodesis.errors import ArgumentError, InstrumentError
from tenodesis.instrument import PARAMETERS, FullForm, ShortForm
from tenodesis.instrument.compliance import compliance_shares
from tenodesis.instrument.hardware import Drives, Hand, Sensors
from tenodesis.instrument.tip_motion import straight_stiffness, tip_damping, tip_inertia
from tenodesis.run import TENDONS
from tenodesis.statics import straight_arms

TIME_STEP = 5e-4
"""Default time step, s."""
_TWIN_PARAMETERS = _core.twin_parameters()
LARGEST_PHASE_STEP = 0.5
"""Phase of the fastest oscillation that a time step may take, rad: a twelfth of its period; beyond, errors grow."""
_LONGEST_TICK = 1.0
"""Time between ticks that a controller allows without a watchdog, s."""
_MOST_STEPS = 2**31 - 1
_DIVISION_ERROR = 1e-6
RIPPLE_PERIODS = 12
"""Periods of a torque's ripple per turn of the motor."""
STOP_STIFFNESS_RATIO = 20.0
"""Stiffness of a mechanical stop over that of its joint."""

Array = NDArray[np.float64]


def natural_frequency(inst: ShortForm) -> float:
    """Return the angular natural frequency of the straight, unloaded, frictionless tip, rad/s."""
    return sqrt(straight_stiffness(inst) / tip_inertia(inst))


def longest_step(inst: ShortForm) -> float:
    """Return the longest time step that the tip's natural frequency allows, s."""
    return LARGEST_PHASE_STEP / natural_frequency(inst)


def least_tip_inertia(inst: ShortForm) -> float:
    """Return the smallest inertia of the tip that time steps of the default length can follow, kg m^2."""
    return straight_stiffness(inst) * (TIME_STEP / LARGEST_PHASE_STEP) ** 2


def parameters(inst: ShortForm, time_step: float = TIME_STEP) -> dict[str, float]:
    """Return the parameters of an instrument's twin and axis, SI units, by the core's names; NaN where not given."""
    return dict(zip((*_TWIN_PARAMETERS, *PARAMETERS), parameter_row(inst, time_step), strict=True))


def parameter_row(inst: ShortForm, time_step: float) -> list[float]:
    """Return the parameters of a twin, then those of its axis, SI units, in the core's order."""
    friction, drives = inst.friction, inst.drives
    sensors, mismatch = inst.sensors, inst.mismatch
    stiffness = straight_stiffness(inst)
    shares, joints = compliance_shares(inst), _core.joint_shares(inst.spec)
    radius = friction.reference_radius if friction.vertex_radius is None else friction.vertex_radius
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
        "tip_inertia": tip_inertia(inst),
        "tip_damping": tip_damping(inst),
        "output_stop": inst.output_stop,
        "stop_stiffness": STOP_STIFFNESS_RATIO * stiffness,
        **hand_parameters(inst.dynamics),
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
    """Return the parameters of drives and encoders without their errors, SI units, by the core's names."""
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
    }


def current_parameters(drives: Drives) -> dict[str, float]:
    """Return what currents show of drives, SI units, by the core's names."""
    names = ("gear_efficiency", "friction_torque", "torque_ripple", "thermal_drift", "thermal_time")
    own = {name: getattr(drives, name) for name in names}
    return own | {"ripple_rate": RIPPLE_PERIODS * drives.gear_ratio / (2 * pi)}


def spec(inst: ShortForm, time_step: float, quasi_static: bool) -> _core.TwinSpec:
    """Return the specification of a twin of the core; errors as :func:`steps_per_sample`."""
    per_sample = steps_per_sample(inst, time_step, quasi_static)
    parameters = parameter_row(inst, time_step)[: len(_TWIN_PARAMETERS)]
    return core_spec(inst, inst.spec, parameters, per_sample, quasi_static)


def core_spec(
    inst: ShortForm, axis: _core.Spec, parameters: Sequence[float], per_sample: int, quasi_static: bool
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


def check_runnable(inst: ShortForm) -> None:
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


def _check_inertia(inst: ShortForm) -> None:
    if longest_step(inst) >= TIME_STEP:
        return
    raise _not_runnable(
        "dynamics.tip_inertia",
        f"{inst.dynamics.tip_inertia:g} kg*m^2",
        f"at least {_rounded_up(least_tip_inertia(inst)):g} kg*m^2, so that the tip swings slowly enough for time "
        f"steps of {TIME_STEP:g} s",
    )


def _check_ticks(inst: ShortForm) -> None:
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


def steps_per_sample(inst: ShortForm, time_step: float, quasi_static: bool) -> int:
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


def _check_compliance(inst: ShortForm) -> None:
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


def link_rows(inst: FullForm) -> Array:
    """Return mass, its centre, inertia about x, y, z, damping, stops, their stiffness, reach of the tip's joints."""
    stiffness = np.diag(stiffness_matrix(inst)).copy()
    for i, tie in enumerate(inst.ties):
        # What ties joints does not damp or stop them.
        if tie.is_rigid:
            stiffness[[i, tie.to]] -= tie.stiffness * np.array([1.0, tie.ratio**2])
    rods = _links(inst, 1.0)
    lowest = _frequencies(inst, rods)[0]
    density = (lowest / (2 * pi * inst.dynamics.natural_frequency)) ** 2
    links = _links(inst, density)
    inertia, _ = mass_matrix(inst, links, np.zeros(len(inst.tip_joints)))
    rows = np.zeros((len(inst.tip_joints), 10))
    rows[:, :5] = links
    for i in reversed(range(len(inst.tip_joints))):
        beyond = [
            other.offset + other.chord + rows[j, 9]
            for j, (other, on) in enumerate(zip(inst.tip_joints, inst.parents, strict=True))
            if on == i
        ]
        rows[i, 9] = max([inst.tip_joints[i].end_effector_length or 0.0, *beyond])
    for i, joint in enumerate(inst.tip_joints):
        critical = 2 * sqrt(stiffness[i] * inertia[i, i])
        damping = inst.dynamics.damping_ratio * critical if joint.damping is None else joint.damping
        rows[i, 5:9] = damping, *joint.stops, STOP_STIFFNESS_RATIO * stiffness[i]
    return rows


def _links(inst: FullForm, density: float) -> Array:
    """Return mass, its centre and inertias of links; what is not given is that of a rod of a density, kg/m."""
    joints = inst.tip_joints
    around = {joint.within for joint in joints}
    rows = np.zeros((len(joints), 5))
    for i, joint in enumerate(joints):
        if joint.name in around:
            continue  # nothing is between it and the joint within it
        beyond = [other.offset + other.chord for other, on in zip(joints, inst.parents, strict=True) if on == i]
        grip = inst.grip.length if inst.grip is not None and i in inst.jaws else None
        length = joint.end_effector_length or max([*beyond, grip or 0.0, joint.radius])
        only_inertia = joint.inertia is not None and joint.mass is None
        mass = (0.0 if only_inertia else density * length) if joint.mass is None else joint.mass
        centre = length / 2 if joint.centre_of_mass is None else joint.centre_of_mass
        across = mass * (centre**2 + length**2 / 12) if joint.inertia is None else joint.inertia
        rows[i] = mass, centre, across, across, mass * joint.radius**2 / 2
    return rows


def stiffness_matrix(inst: FullForm) -> Array:
    """Return the stiffness of the straight, unloaded wrist with all tendons taut, (joints, joints), N m/rad."""
    arms = straight_arms(inst)
    return np.asarray(arms.T @ (inst.stiffnesses[:, np.newaxis] * arms) + inst.springs)


def natural_frequencies(inst: FullForm) -> Array:
    """Return the angular natural frequencies of the straight, unloaded, frictionless wrist, rising, rad/s.

    The arcs of a backbone bend alike, and joints that are tied turn with the others: how these swing against each other
    needs no small time steps, since the twin's trapezoidal rule is stable for any.
    """
    alike = np.array([inst.bent(unit) for unit in np.eye(len(inst.bends))]).T
    return _frequencies(inst, link_rows(inst)[:, :5], alike)


def _frequencies(inst: FullForm, links: Array, motions: Array | None = None) -> Array:
    inertia, _ = mass_matrix(inst, links, np.zeros(len(inst.tip_joints)))
    stiffness = stiffness_matrix(inst)
    if motions is not None:
        inertia, stiffness = motions.T @ inertia @ motions, motions.T @ stiffness @ motions
    return np.asarray(np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(inertia, stiffness)).real)))


def mass_matrix(inst: FullForm, links: Array, angles: Array, speeds: Array | None = None) -> tuple[Array, Array]:
    """Return the mass matrix of the tip's joints, kg m^2, and the moments that their rates take, N m.

    Links as :func:`link_rows` has them, their first five columns; angles (rad) and rates (rad/s) of shape (joints,).
    """
    count = len(inst.tip_joints)
    rows = np.zeros((count, 10))
    rows[:, :5] = links[:, :5]
    matrix, bias = np.empty((1, count, count)), np.empty((1, count))
    moving = np.zeros(count) if speeds is None else speeds
    at = np.ascontiguousarray(angles, float)[np.newaxis]
    _core.chain_inertia(inst.core, rows, at, np.ascontiguousarray(moving, float)[np.newaxis], matrix, bias)
    return matrix[0], bias[0]
