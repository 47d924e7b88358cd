"""How a plan names dimensions and writes their tolerances."""

from tenodesis.scaling.plan import plain, quantity
from tenodesis.workshop.budget import PULLEY, Dimension

NAMES = {
    "distal_gear_radius": "distal gears, axis to tunnel",
    "proximal_gear_radius": "proximal gears, axis to tunnel",
    "distal_pulley_radius": "distal pulley, to rope's centre",
    "proximal_pulley_radius": "proximal pulley, to rope's centre",
    "distal_tendon_offset": "discs, backbone to tendon",
    "end_effector_length": "distal joint to tip l_d",
    "handle_length": "proximal joint to hand l_p",
    "overall_length": "overall length L",
    "backbone_length": "backbone length",
    PULLEY: "load rig's pulley, to cable's centre",
    "distal_gear_backlash": "distal gears, play at the encoder",
    "proximal_gear_backlash": "proximal gears, play at the encoder",
    "tendon_modulus": "tendons' modulus",
    "tendon_stiffness": "tendons' stiffness",
    "pretension": "pretension",
    "backbone_rigidity": "backbone's rigidity",
}
"""Dimensions and settings by key of the instrument file."""

_UNITS = {
    "tendon_modulus": ("GPa", "Pa"),
    "tendon_stiffness": ("N/mm", "N/m"),
    "pretension": ("N", "N"),
    "backbone_rigidity": ("N*mm^2", "N*m^2"),
}


def nominal(one: Dimension) -> str:
    """Return the nominal value with its unit."""
    unit, si = _UNITS.get(one.key, ("mm", "m"))
    return quantity(one.nominal, unit, 6, si)


def tolerance(one: Dimension) -> str:
    """Return the tolerance with its unit: plus or minus, or the standard deviation of a setting in percent."""
    if one.key in _UNITS:
        return f"s = {plain(100 * one.tolerance / one.nominal, 2)} %"
    return f"± {quantity(one.tolerance, 'mm', 3, 'm')}"
