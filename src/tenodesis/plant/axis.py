"""Parameters of a twin of one axis in the core's order."""

from collections.abc import Sequence
from math import pi

from tenodesis import _core
from tenodesis.instrument import PARAMETERS, ShortForm
from tenodesis.instrument.compliance import compliance_shares
from tenodesis.instrument.hardware import Drives, Hand, Sensors
from tenodesis.instrument.tip_motion import straight_stiffness, tip_damping, tip_inertia
from tenodesis.plant.time_steps import TIME_STEP, steps_per_sample
from tenodesis.run import TENDONS

_TWIN_PARAMETERS = _core.twin_parameters()
RIPPLE_PERIODS = 12
"""Periods of a torque's ripple per turn of the motor."""
STOP_STIFFNESS_RATIO = 20.0
"""Stiffness of a mechanical stop over that of its joint."""


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
