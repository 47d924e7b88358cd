"""The controller's parameters for an instrument, by their names in the C interface."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tenodesis import _core, plant
from tenodesis.control.pairs import compensated
from tenodesis.errors import ArgumentError
from tenodesis.instrument import Instrument, InstrumentLike, ShortForm
from tenodesis.instrument.compliance import compliance_shares
from tenodesis.instrument.tension import TensionSensor, tension_sensor


class Constant(NamedTuple):
    """A constant of the controller."""

    value: float
    unit: str
    """SI, ``1`` without"""
    source: str
    """Literature, ``bound`` of what is plausible, the study it was chosen by, or ``chosen``"""
    meaning: str


FAULTS = tuple(name for name, _, _ in _core.faults())
"""Names of the faults, in the order of their bits."""

HOMING_REASONS = dict(_core.homing_reasons())
"""Why homing may fail, and what each reason means, in the order of their numbers."""

COMMON, AXIS = (
    tuple(name for name, _, _ in rows) for rows in (_core.control_parameters(), _core.control_axis_parameters())
)

TUNING = {name: Constant(value, unit, source, meaning) for name, value, unit, source, meaning in _core.tuning()}
"""Constants of the law and what it stands on that no instrument changes, by name."""

_USUAL_GAIN = 12.0  # 1/s
# An integrating loop becomes unstable at twice the damping ratio of a free tip times its angular frequency.
GAIN_PER_SWING = 0.23
# Longest delay of motors that take tremor away, s.
_LATEST = TUNING["tremor_quickest"].value * TUNING["tremor_half_period"].value
_USUAL_LIMIT = 80.0  # N
# Of the compliance up to a contact, which the core wants positive.
_LEAST_SHARE = 1e-3
FAULT_OVER_LIMIT = 1.25
# Of friction: what the file may state too low.
_UNDERSTATED = 1.3
# What the weakest of eight tissues of the abdomen bears, N (Rodrigues et al., Surg. Endosc. 26, 2012); a margin over
# the largest load that an instrument is meant for.
_TISSUE = 1.25
_OVER_LOAD = 5 / 3
# Of the tip while its motors return, rad/s.
_RETURN = np.radians(10)
# Of the tip while homing, rad: moved by one motor's jog, by one tendon alone, and what a cell's error may cost.
_JOG, _PULL, _TIP_ERROR = np.radians([0.8, 1.6, 0.5])
# Of a drive's friction, by its current: what the file may state wrongly, and the angle over which it turns, rad.
_UNSURE, _TURNS = _core.UNKNOWN_DRIVE_FRICTION, 3e-3
# A load cell's gain may be twice as far off as its data sheet says: strokes show it.
_GAIN_DOUBT = 2.0
# Where the file has a law of friction, however little it states.
_LEAST_COEFFICIENT = 0.05
_NONE = 1e-9  # m; the core wants a positive stroke
# Of a tip that one tendon alone pulls: it coasts when the motor stops, rad/s.
_PULL_SPEED = 1.0


class Parameters(NamedTuple):
    """Parameters of a controller: those that all axes share, and per axis its own and its limits."""

    joint_type: int
    common: dict[str, float]
    axes: tuple[dict[str, float], ...]
    limits: tuple[dict[str, tuple[float, float]], ...]
    """Threshold and persistence (s) of each fault, and of the spools' jumps."""

    def rows(self) -> tuple[list[float], NDArray[np.float64], NDArray[np.float64]]:
        """Return common, axes' and limits' values in the core's order."""
        return (
            [self.common[name] for name in COMMON],
            np.array([[axis[name] for name in AXIS] for axis in self.axes]),
            np.array([[limits[name] for name in (*FAULTS, "spool_jump")] for limits in self.limits]),
        )


def parameters(inst: InstrumentLike, period: float | None = None) -> Parameters:
    """Return the controller's parameters; period: of its ticks, s, by default the instrument's sampling period."""
    inst = compensated(inst)
    single = inst.planar
    tick = 1 / inst.sensors.sampling_rate if period is None else period
    first = single[0]
    drives = first.drives
    speed = drives.motor_speed / drives.gear_ratio
    arm = min(plant.parameters(one)["distal_radius"] for one in single)
    common = {
        "period": tick,
        "speed_limit": speed,
        "acceleration_limit": drives.motor_acceleration / drives.gear_ratio,
        "engage_time": 0.2,
        "tension_limit": min(FAULT_OVER_LIMIT * tension_limit(one) for one in single),
        "hold_time": 0.5,
        "neutral_speed": min(speed, _RETURN * arm / drives.spool_radius),
        "relief": first.pretension / (2 * first.tendon_stiffness * drives.spool_radius),
    }
    joint_type = int(_core.JointType[inst.joint_type.replace("-", "_").upper()].value)
    axes = tuple(_axis(one, tick, is_first=n == 0) for n, one in enumerate(single))
    checks = tuple(limits(one, tick, one.pretension, one.tension_sensor) for one in single)
    return Parameters(joint_type, common, axes, checks)


def safe_state(inst: ShortForm) -> str:
    """Return what motors do after a fault: ``hold`` or ``neutral``."""
    return inst.control.safe_state or ("neutral" if inst.control.stop == "return" else "hold")


def tension_from_current(inst: InstrumentLike, current: ArrayLike, axis: str | None = None) -> NDArray[np.float64]:
    """Return what motor currents (A, any shape) of an axis stand for as tensions, N, as a controller takes them.

    By default the axis is the first; axes differ where their pretensions do.

    They end with the currents' range, where the controller distrusts them, and have the drives' friction in them, which
    its observer takes out.

    Raises
    ------
    ValueError
        The instrument has load cells.
    InstrumentError
        It has no such axis.
    """
    inst = compensated(inst)
    sensor = inst.axis(axis or inst.axes[0]).tension_sensor
    if not sensor.per_current:
        raise ArgumentError(
            "inst has load cells; its sensors.kind must be current to measure tensions by currents.", key="inst"
        )
    convert = np.vectorize(_core.tension_from_current, otypes=[float], excluded=(1, 2))
    return np.asarray(convert(current, sensor.per_current, sensor.range / sensor.per_current))


def slack_tension(inst: ShortForm) -> float:
    """Return the tension (N) below which a tendon counts as slack: above the noise of its sensor."""
    return max(0.01 * inst.pretension, 8 * inst.tension_sensor.noise)


def tension_limit(inst: Instrument) -> float:
    """Return the tension (N) above which no tendon is wound."""
    given = inst.control.tension_limit
    if given is not None:
        return given
    strength = np.inf if inst.breaking_load is None else inst.breaking_load / (1.5 * FAULT_OVER_LIMIT)
    # Of an instrument whose joints share tendons, too.
    read = tension_sensor(inst.drives, inst.sensors, inst.pretension).range
    return float(min(max(_USUAL_LIMIT, 3 * inst.pretension), strength, read / (1.1 * FAULT_OVER_LIMIT)))


def force_limit(inst: Instrument) -> float:
    """Return the force (N) at the tip beyond which the motors yield."""
    given = inst.control.force_limit
    return max(_TISSUE, _OVER_LOAD * max(inst.conditions.forces, default=0.0)) if given is None else given


def _friction(inst: ShortForm) -> float:
    """Return the largest friction exponent of a tendon, over the ranges of both joints."""
    friction = inst.friction
    bend = friction.sheath_bend + friction.sheath_bend_per_handle_angle * inst.handle_range
    wrap = inst.handle_range + inst.output_range + 2 * friction.base_wrap
    return friction.sheath_coefficient * bend + friction.vertex_coefficient * wrap


def _least_coefficient(inst: ShortForm) -> float:
    return 0.0 if inst.friction.law == "none" else _LEAST_COEFFICIENT


def _axis(inst: ShortForm, period: float, *, is_first: bool) -> dict[str, float]:
    numbers = plant.parameters(inst, period)
    drives, control = inst.drives, inst.control
    pretension, stiffness = inst.pretension, inst.tendon_stiffness
    shares = compliance_shares(inst)
    # The controller knows a capstan alone: a coefficient that depends on tension is that at pretension.
    at_pretension = float((pretension / inst.friction.reference_tension) ** (inst.friction.load_index - 1))
    lag = (TUNING["smoothing"].value + 1) * period + 1.5 * TUNING["tremor_smoothing"].value
    delay = 1.05 * (drives.time_constant + lag)
    sensor = inst.tension_sensor
    in_handle = shares.handle / 2
    coefficient, bend, before = _before_handle(inst, in_handle, at_pretension)
    handle_step = max(numbers["encoder_resolution"], 2 * numbers["encoder_noise"])
    spool_step = numbers["motor_encoder_resolution"] * drives.spool_radius
    slip_play = max(0.4 * numbers["proximal_radius"] * handle_step, spool_step, 1e-6)
    stretch = pretension / stiffness
    speed = drives.motor_speed / drives.gear_ratio
    arm = numbers["distal_radius"]
    homing_speed = min(control.homing_speed, _PULL_SPEED * arm)
    notice = max((2 if sensor.per_current else 5) * sensor.noise, 0.005 * pretension) + 2 * _UNSURE * sensor.constant
    # What a free tip resists by when one tendon pulls it, beside friction.
    noticed = not sensor.per_current or notice < 1.5 * numbers["tip_damping"] * homing_speed / arm**2
    play = max(2 * spool_step, _TURNS * drives.spool_radius) if sensor.per_current else 0.0
    return {
        "proximal_radius": numbers["proximal_radius"],
        "distal_radius": numbers["distal_radius"],
        "handle_length": inst.handle_length,
        "end_effector_length": inst.end_effector_length,
        "backbone_length": float(np.nan_to_num(numbers["backbone_length"])),
        "backbone_rigidity": float(np.nan_to_num(numbers["backbone_rigidity"])),
        "handle_range": inst.handle_range,
        "output_stop": inst.output_stop,
        "tip_frequency": plant.natural_frequency(inst),
        "stiffness": stiffness,
        "pretension": pretension,
        "share_sheath": before,
        "share_handle": shares.handle - before + shares.handle_joint,
        "share_stem": shares.stem,
        "share_tip": shares.tip_joint + shares.anchor,
        "vertex_coefficient": max(
            inst.friction.vertex_coefficient * inst.friction.vertex_factor * at_pretension, _least_coefficient(inst)
        ),
        "base_wrap": inst.friction.base_wrap,
        "sheath_coefficient": coefficient,
        "sheath_bend": bend,
        "sheath_bend_rate": inst.friction.sheath_bend_per_handle_angle,
        "passing_coefficient": 0.0 if is_first else inst.friction.passing_coefficient,
        "spool_radius": drives.spool_radius,
        "drive_time_constant": drives.time_constant,
        "hand_play": max(0.7 * handle_step, 1e-5),
        "sheath_play": max(3e-6, 10 * sensor.noise * before / stiffness, spool_step if sensor.friction else 0.0),
        "play": slip_play,
        "friction_scale_std": control.friction_uncertainty,
        "reference_std": control.reference_uncertainty,
        "compliance_std": control.stiffness_uncertainty,
        "slack_tension": slack_tension(inst),
        # Strokes show constant gains; that of a current turns with its motor.
        "cell_gain_std": 0.0 if sensor.per_current else _GAIN_DOUBT * sensor.gain_error,
        "bias_std": np.linalg.norm(
            [
                sensor.offset / stiffness / np.sqrt(2),
                numbers["proximal_radius"] * inst.sensors.encoder_offset,
                slip_play / 4,
                sensor.gain_error * stretch if sensor.per_current else 0.0,
            ]
        ),
        "tremor_delay": min(delay, _LATEST),
        # Motors that follow later would shake the tip.
        "tremor_gain": 1.05 if delay <= _LATEST else 0.0,
        "gain": control.gain or min(_USUAL_GAIN, GAIN_PER_SWING * plant.natural_frequency(inst)),
        "position_gain": control.position_gain,
        "dead_band": control.dead_band,
        "tendon_speed": control.tendon_speed or 0.5 * speed * drives.spool_radius,
        "common_stroke": control.common_stroke * stretch,
        "least_tension": control.least_tension * pretension,
        "tension_limit": tension_limit(inst),
        "force_limit": force_limit(inst),
        "assistance": control.assistance,
        "homing_speed": homing_speed,
        "homing_stroke": control.homing_stroke,
        # No tendon is to be wound above the limit.
        "homing_overshoot": min(max(0.95 * tension_limit(inst) / pretension - 1, 0.02), 0.4)
        if sensor.friction
        else 0.15,
        "homing_tolerance": max(0.004, 0.8 * sensor.noise / pretension) if sensor.per_current else 0.004,
        "homing_jog": max(4 * spool_step, _JOG * arm) + (2 * play if sensor.friction else 0.0),
        "homing_travel": _PULL * arm if noticed else _NONE,
        "homing_offset": max(
            max(2 * stiffness * arm * _TIP_ERROR, (4 if sensor.per_current else 8) * sensor.noise)
            + _UNSURE * sensor.constant,
            1.2 * sensor.constant,
        ),
        "homing_notice": notice,
        "homing_efficiency": drives.gear_efficiency if sensor.per_current else 1.0,
        "homing_friction": sensor.constant,
        "homing_play": play,
        # Both drives may wind, so that their friction, unlike the tendons', changes both tensions alike.
        "mean_band": max(control.mean_band, np.expm1(_UNDERSTATED * _friction(inst)) / 2) * np.exp(sensor.friction)
        + np.expm1(sensor.friction),
        "load_cell_range": sensor.range - sensor.resolution,
        "handle_noise": 6 * handle_step,
        "spool_noise": 2.5 * numbers["motor_encoder_resolution"],
    }


def _before_handle(inst: ShortForm, share: float, at_pretension: float) -> tuple[float, float, float]:
    """Return coefficient and bend of what lies before the handle's joint, and the compliance share up to it.

    The friction of a drive whose current measures the tension is at the spool: with that of the sheath it makes one
    contact, in their middle weighted by friction.
    """
    friction, drive = inst.friction, inst.tension_sensor.friction
    coefficient, bend = friction.sheath_coefficient * at_pretension, friction.sheath_bend
    if not drive:
        return max(coefficient, _least_coefficient(inst)), bend, share
    own = coefficient * bend
    if not coefficient:
        return 1.0, drive, _LEAST_SHARE * share
    return coefficient, bend + drive / coefficient, share * max(own / (own + drive), _LEAST_SHARE)


def limits(inst: Instrument, period: float, pretension: float, sensor: TensionSensor) -> dict[str, tuple[float, float]]:
    """Return threshold and persistence (s) of each fault, and of the spools' jumps, for tendons with a pretension (N).

    The period of ticks is in s.
    """
    sensors = inst.sensors
    speed = inst.drives.motor_speed / inst.drives.gear_ratio
    # A cell without noise does not flicker, and one that is sampled slower than ticks stands still between samples.
    # By a drive that reverses, whose current measures the tension.
    reversal = 2 * np.sinh(sensor.friction) * pretension
    stuck = 0.3 * sensor.noise if sensor.noise > 2 * sensor.resolution else 0.0
    sample = max(period, 1 / sensors.sampling_rate)
    return {
        "tendon_break": (0.08 * pretension + sensor.constant, 0.008),
        "tendon_slack": (0.02 * pretension + sensor.constant, 2.0),
        "over_tension": (FAULT_OVER_LIMIT * tension_limit(inst), 0.003),
        "load_cell_stuck": (stuck, max(0.04, 30 * sample)),
        "load_cell_range": (0.08 * pretension + sensor.constant, 0.005),
        "load_cell_drift": (0.05 * pretension, 0.5),
        "encoder_dropout": (0.1, 0.005),
        "encoder_jump": (30.0, 1.2 * period),
        "spool_slip": (max(0.1 * pretension, 15 * sensor.noise) + reversal, 0.006),
        "motor_not_following": (0.008, 0.005),
        "tick_late": (inst.control.watchdog, 0.0),
        "not_a_number": (0.0, 0.0),
        "homing_failed": (0.0, 0.0),
        "stroke_unexplained": (np.radians(1), 1.0),
        # Sheaths that the hand bends, and friction a third off, look like 3 deg in hours of normal work.
        "rope_length": (np.radians(4), 0.5),
        "spool_jump": (3 * speed, 1.2 * period),
    }
