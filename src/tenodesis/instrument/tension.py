"""What measures tensions: load cells, or the motors' currents as tensions with the drives' friction still in them."""

from math import hypot, log, sqrt
from typing import NamedTuple

from tenodesis.errors import ArgumentError
from tenodesis.instrument.hardware import Drives, Sensors


class TensionSensor(NamedTuple):
    """A sensor of a tendon's tension, N."""

    range: float
    resolution: float
    noise: float
    """Standard deviation"""
    offset: float
    """Standard deviation of its constant error"""
    gain_error: float
    """Standard deviation of its gain"""
    per_current: float = 0.0
    """Tension per current, N/A; 0 of a load cell"""
    gain: float = 1.0
    """Of a reading over a motor's pull"""
    friction: float = 0.0
    """Of the drive at the pretension, as the exponent of a contact"""
    constant: float = 0.0
    """Part of it that does not grow with the tension, N"""


def tension_sensor(drives: Drives, sensors: Sensors, pretension: float) -> TensionSensor:
    """Return what measures the tensions.

    A motor's pull at a tension T is within T e - f and T / e + f, with the gearbox's efficiency e and its constant
    friction f. At the pretension this is a band from g T exp(-x) to g T exp(x): friction x, and a gain g that the
    reading is divided by.

    Raises
    ------
    ValueError
        Currents without a torque constant; drives that hold the pretension without any current.
    """
    if sensors.kind == "load-cell":
        # The converter's range is to either side of 0.
        step = 2 * sensors.load_cell_range / 2**sensors.load_cell_bits
        return TensionSensor(
            sensors.load_cell_range,
            step,
            sensors.load_cell_noise,
            sensors.load_cell_offset,
            sensors.load_cell_gain_error,
        )
    if drives.torque_constant is None or sensors.current_range is None:
        raise ArgumentError(
            'sensors.kind is "current", but drives.torque_constant is not given; give it, or take load cells',
            key="drives.torque_constant",
        )
    constant = drives.friction_torque / drives.spool_radius
    share = constant / pretension if pretension > 0 else 0.0
    least, most = drives.gear_efficiency - share, 1 / drives.gear_efficiency + share
    if least <= 0:
        raise ArgumentError(
            f"drives.friction_torque is {drives.friction_torque:g} N*m, with which drives of gear_efficiency "
            f"{drives.gear_efficiency:g} hold the pretension of {pretension:g} N without any current; sensors.kind "
            "must be load-cell, or the drives must turn back by themselves",
            key="drives.friction_torque",
        )
    gain = 1 / sqrt(least * most)
    per_current = drives.torque_constant * drives.gear_ratio / drives.spool_radius * gain
    full = sensors.current_range
    noise = full / 500 if sensors.current_noise is None else sensors.current_noise
    offset = full / 1000 if sensors.current_offset is None else sensors.current_offset
    return TensionSensor(
        full * per_current,
        2 * full / 2**sensors.current_bits * per_current,
        noise * per_current,
        offset * per_current,
        # A triangular ripple is within its amplitude with a deviation of a root-third of it.
        hypot(sensors.torque_constant_error, drives.thermal_drift, drives.torque_ripple / sqrt(3)),
        per_current,
        gain,
        log(most / least) / 2,
        constant,
    )
