"""What controller and twin both need of an instrument: its parameters in the core's order, and its time step."""

from math import pi, sqrt

import numpy as np

from tenodesis import _core, statics
from tenodesis.instrument import PARAMETERS, Instrument

TIME_STEP = 5e-4
"""Default time step, s."""
_ROW = _core.twin_parameters()
# More would leave fewer than a dozen steps to a swing of the tip, and the rule's error no longer small.
_MOST_PHASE = 0.5
_DEFAULT_SWING = 2 * pi * 20.0  # rad/s
_DEFAULT_DAMPING_RATIO = 0.2
_STOP_STIFFENING = 20.0  # stop over tip


def natural_frequency(inst: Instrument) -> float:
    """Return the angular frequency of the straight, unloaded, frictionless tip, rad/s."""
    return sqrt(float(statics.flexural_stiffness(inst, 0.0)) / tip_inertia(inst))


def longest_step(inst: Instrument) -> float:
    """Return the longest time step that a swing of the tip allows, s."""
    return _MOST_PHASE / natural_frequency(inst)


def tip_inertia(inst: Instrument) -> float:
    """Return the inertia by the output angle, kg m^2: as given, or such that the unloaded tip swings at 20 Hz."""
    given = inst.dynamics.tip_inertia
    return float(statics.flexural_stiffness(inst, 0.0)) / _DEFAULT_SWING**2 if given is None else given


def handle_compliance_share(inst: Instrument) -> float:
    """Return the share of a tendon's compliance between spool and handle joint, by length unless it is given."""
    given = inst.friction.handle_compliance_share
    return inst.handle_length / (inst.tendon_length or inst.overall_length) if given is None else given


def parameters(inst: Instrument, time_step: float = TIME_STEP) -> dict[str, float]:
    """Return what an instrument's twin and axis are made of, in SI units, by the core's names; NaN where not given."""
    return dict(zip((*_ROW, *PARAMETERS), parameter_row(inst, time_step), strict=True))


def parameter_row(inst: Instrument, time_step: float) -> list[float]:
    """Return the parameters of a twin, then those of its axis, in the core's order."""
    friction, dynamics, drives = inst.friction, inst.dynamics, inst.drives
    sensors, mismatch = inst.sensors, inst.mismatch
    stiffness = float(statics.flexural_stiffness(inst, 0.0))
    inertia = tip_inertia(inst)
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
        "handle_length_share": handle_compliance_share(inst),
        "stiffness_ratio": mismatch.stiffness_ratio,
        "pretension_ratio": mismatch.pretension_ratio,
        "tip_inertia": inertia,
        "tip_damping": 2 * _DEFAULT_DAMPING_RATIO * sqrt(stiffness * inertia) if damping is None else damping,
        "output_stop": inst.output_stop,
        "stop_stiffness": _STOP_STIFFENING * stiffness,
        "hand_stiffness": dynamics.hand_stiffness,
        "hand_damping": dynamics.hand_damping,
        "hand_inertia": dynamics.hand_inertia,
        "spool_radius": drives.spool_radius,
        "spool_speed_limit": drives.motor_speed / drives.gear_ratio,
        "spool_acceleration_limit": drives.motor_acceleration / drives.gear_ratio,
        "drive_time_constant": drives.time_constant,
        "backlash": drives.backlash,
        "rig_pulley_radius": inst.conditions.cable_pulley_radius or 0.0,
        "encoder_noise": sensors.encoder_noise,
        "encoder_range": sensors.encoder_range,
        "encoder_resolution": sensors.encoder_range / 2**sensors.encoder_bits,
        "handle_encoder_offset": mismatch.handle_encoder_offset,
        "output_encoder_offset": mismatch.output_encoder_offset,
        "motor_encoder_resolution": 2 * pi / drives.encoder_counts / drives.gear_ratio,
        "load_cell_noise": sensors.load_cell_noise,
        "load_cell_range": sensors.load_cell_range,
        # The converter's range reaches to either side.
        "load_cell_resolution": 2 * sensors.load_cell_range / 2**sensors.load_cell_bits,
        "time_step": time_step,
    }
    for n, tendon in enumerate(("agonist", "antagonist")):
        values[f"{tendon}_load_cell_gain"] = mismatch.load_cell_gain[n]
        values[f"{tendon}_load_cell_bias"] = mismatch.load_cell_bias[n]
    return [values[name] for name in _ROW] + inst.spec.__getstate__()[1]


def spec(inst: Instrument, time_step: float, quasi_static: bool) -> _core.TwinSpec:
    """Return what a twin of the core is made from; errors as :func:`steps_per_sample`."""
    per_sample = steps_per_sample(inst, time_step, quasi_static)
    parameters = parameter_row(inst, time_step)[: len(_ROW)]
    friction = inst.friction
    return _core.TwinSpec(
        inst.spec, parameters, friction.law == "stribeck", friction.sheath_contacts, per_sample, quasi_static
    )


def steps_per_sample(inst: Instrument, time_step: float, quasi_static: bool) -> int:
    """Return how many steps a sample takes, unless the time step or the tendons' lengths do not suit the instrument."""
    if not (np.isfinite(time_step) and time_step > 0):
        raise ValueError(f"time_step is {time_step!r}; allowed is a time above 0 s.")
    longest = longest_step(inst)
    if not quasi_static and time_step > longest:
        raise ValueError(
            f"time_step is {time_step:g} s; allowed is at most {longest:.3g} s, a twelfth of a swing of the tip of "
            f"{inst.name} ({natural_frequency(inst) / (2 * pi):.3g} Hz)."
        )
    per_sample = max(1, round(1 / (inst.sensors.sampling_rate * time_step)))
    if (
        1 / inst.sensors.sampling_rate > time_step
        and abs(per_sample * time_step * inst.sensors.sampling_rate - 1) > 1e-6
    ):
        raise ValueError(
            f"time_step is {time_step:g} s; allowed is a whole part of the sampling period of "
            f"{1 / inst.sensors.sampling_rate:g} s, or more."
        )
    joints = sum(_core.joint_shares(inst.spec))
    if not handle_compliance_share(inst) + joints < 1:
        given = inst.friction.handle_compliance_share
        what, instead = (
            ("handle_length and joints take", "of the length of a tendon")
            if given is None
            else (
                f"friction.handle_compliance_share is {given:g}, which with the joints makes",
                "of the compliance",
            )
        )
        allowed = (
            "all of it: a shorter handle_length or a longer tendon_length."
            if given is None
            else f"all of it: a share below {1 - joints:.3g}."
        )
        raise ValueError(
            f"{what} {handle_compliance_share(inst) + joints:.3g} {instead} of {inst.name}; "
            f"allowed is less than {allowed}"
        )
    return per_sample
