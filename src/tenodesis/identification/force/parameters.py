"""Parameters of a tool read from its near end, and what is believed of them before anything is recorded."""

from typing import Final, NamedTuple

from tenodesis.identification.force.signals import Signal


class Unknown(NamedTuple):
    """A parameter with its prior over tools, a normal distribution within bounds, in SI units."""

    name: str
    unit: str
    start: float
    spread: float
    """Standard deviation between tools."""
    lower: float
    upper: float
    group: str
    meaning: str


_FAR = 1e3

TOOL: Final = (
    Unknown("angle_offset", "rad", 0.0, 1.0, -_FAR, _FAR, "offset", "Jaw angle at the middle of the spindle's travel"),
    Unknown("torque_offset", "N*m", 0.0, 0.03, -1.0, 1.0, "offset", "Spindle torque without load in mid-travel"),
    Unknown("ratio", "1", 1.0, 0.2, 0.1, 5.0, "kinematics", "Jaw angle per spindle angle"),
    Unknown("torque_ratio", "1", 1.0, 0.1, 0.1, 5.0, "kinematics", "Jaw torque per torque of the tendon"),
    Unknown("near_compliance", "rad/(N*m)", 0.1, 0.2, 0.0, 5.0, "stiffness", "Compliance before the tendon's friction"),
    Unknown("compliance", "rad/(N*m)", 0.5, 0.5, 0.0, 5.0, "stiffness", "Compliance all along the tendon's friction"),
    Unknown("far_compliance", "rad/(N*m)", 0.5, 0.5, 0.0, 5.0, "stiffness", "Compliance behind the tendon's friction"),
    Unknown("near_stiffness", "N*m/rad", 0.0, 0.02, -0.2, 0.5, "stiffness", "What springs back at the spindle"),
    Unknown("far_stiffness", "N*m/rad", 0.0, 0.02, -0.2, 0.5, "stiffness", "What springs back at the jaw"),
    Unknown("near_friction", "N*m", 0.01, 0.02, 0.0, 0.3, "friction", "Load-independent friction at the spindle"),
    Unknown("friction_exponent", "1", 0.5, 0.2, 0.0, 3.0, "friction", "Friction coefficient times wrap angle"),
    Unknown("joint_friction", "N*m", 0.005, 0.01, 0.0, 0.2, "friction", "Load-independent friction at the jaw"),
    Unknown("pretension", "N*m", 0.05, 0.04, 0.0, 0.5, "pretension", "Pretension times the spindle's radius"),
    Unknown("play", "rad", 0.05, 0.03, 0.005, 0.3, "slip", "Motion by which a contact counts as slipping"),
)
WRIST: Final = (
    Unknown("coupling", "1", 0.0, 1.0, -2.0, 2.0, "wrist", "Jaw angle by pitch, the spindle held"),
    Unknown("bend_growth", "1/rad", 0.3, 0.5, 0.0, 3.0, "wrist", "Growth of friction and compliance with the bend"),
)
DRIVE: Final = (
    Unknown("torque_constant", "N*m/A", 1.0, 0.5, 0.01, 50.0, "drive", "Torque at the spindle per motor current"),
    Unknown("current_offset", "N*m", 0.0, 0.01, -1.0, 1.0, "offset", "Torque that the motor's current reads too high"),
    Unknown("drive_friction", "N*m", 0.02, 0.02, 0.0, 1.0, "friction", "Friction of motor and gearbox in mid-travel"),
    Unknown("drive_friction_slope", "N*m/rad", 0.0, 0.03, -1.0, 1.0, "friction", "Its growth along the travel"),
    Unknown("load_friction", "1", 0.1, 0.15, 0.0, 0.9, "friction", "Share of motor torque lost in the gearbox"),
    Unknown("viscous", "N*m*s/rad", 0.0, 0.01, 0.0, 0.5, "friction", "Viscous friction of motor and gearbox"),
    Unknown("drive_play", "rad", 0.05, 0.1, 0.001, 1.0, "drive", "Motion by which the gearbox counts as slipping"),
    Unknown("ripple_sine", "N*m", 0.0, 0.005, -0.1, 0.1, "drive", "Torque ripple of the motor, by the sine"),
    Unknown("ripple_cosine", "N*m", 0.0, 0.005, -0.1, 0.1, "drive", "Torque ripple of the motor, by the cosine"),
    Unknown("heat_loss", "1/A^2", 0.0, 0.5, 0.0, 10.0, "drive", "Share of the torque constant lost to heat"),
)
RECALIBRATED: Final = ("offset", "friction", "pretension")
"""Groups that a short recording of a new tool determines; the others are carried over."""
BETWEEN_TOOLS: Final = 0.3
"""Standard deviation of friction and pretension between tools of a kind, of that of the one that is known."""
_LEAST_SPREAD = 0.1
"""The same of a value near zero, of the spread between tools of all kinds."""


def recalibrated(one: Unknown, known: float) -> Unknown:
    """Return a parameter with its prior over tools like one that is known."""
    if one.lower < 0:  # of no scale of its own
        return one._replace(start=known)
    spread = min(one.spread, max(BETWEEN_TOOLS * abs(known), _LEAST_SPREAD * one.spread))
    return one._replace(start=known, spread=spread)


def unknowns(signal: Signal, *, wrist: bool) -> tuple[Unknown, ...]:
    """Return the parameters of an estimate from a signal, with those of a wrist if several pitches are known."""
    return (*TOOL, *(WRIST if wrist else ()), *(DRIVE if signal == "current" else ()))
