"""The parameters of a twin that recordings may identify, and where they stand in an instrument file."""

from collections.abc import Callable
from math import pi
from typing import Any, NamedTuple

from tenodesis.instrument import ShortForm
from tenodesis.run import TENDONS


class Unknown(NamedTuple):
    """A parameter of the twin: its name in the core, unit, bounds, meaning, changes to an instrument, and group."""

    number: str
    unit: str
    lower: float
    upper: float
    meaning: str
    changes: Callable[[ShortForm, float], dict[str, Any]]
    group: str


def _stiffness(inst: ShortForm, ratio: float) -> dict[str, Any]:
    if inst.given_stiffness is not None:
        return {"tendon_stiffness": inst.given_stiffness * ratio}
    return {"tendon_modulus": (inst.tendon_modulus or 0.0) * ratio}


def _pretension(inst: ShortForm, ratio: float) -> dict[str, Any]:
    return {"pretension": inst.pretension * ratio}


def _key(key: str) -> Callable[[ShortForm, float], dict[str, Any]]:
    return lambda _, value: {key: value}


def _of_pair(key: str, place: int) -> Callable[[ShortForm, float], dict[str, Any]]:
    def changes(inst: ShortForm, value: float) -> dict[str, Any]:
        pair = list(getattr(inst.mismatch, key))
        pair[place] = value
        return {f"mismatch.{key}": tuple(pair)}

    return changes


# The largest bend and coefficient together stay below the largest friction exponent that the core takes.
_KEYS = (
    ("friction.vertex_coefficient", "1", 0.0, 1.0, "friction coefficient at the joints", "friction"),
    ("friction.sheath_coefficient", "1", 0.0, 1.0, "friction coefficient in the sheath", "friction"),
    ("friction.sheath_bend", "rad", 0.0, 3 * pi, "total bend of the sheath", "sheath"),
    ("friction.base_wrap", "rad", 0.0, 1.0, "wrap angle of a joint when it is straight", "friction"),
    ("friction.load_index", "1", 0.3, 1.0, "power of the tension that friction grows with", "friction"),
    ("friction.constant", "N", 0.0, 20.0, "load-independent friction of each joint and of the sheath", "friction"),
    ("friction.static_ratio", "1", 1.0, 3.0, "static over kinetic friction coefficient", "friction"),
    ("friction.stribeck_speed", "m/s", 1e-5, 0.1, "slip speed at which static friction has vanished", "friction"),
    ("friction.viscous", "N*s/m", 0.0, 100.0, "viscous friction of each joint and of the sheath", "viscous"),
    ("dynamics.tip_damping", "N*m*s", 0.0, 1.0, "viscous damping of the tip", "viscous"),
    ("dynamics.tip_inertia", "kg*m^2", 1e-12, 1e3, "inertia about the output angle", "inertia"),
    ("drives.backlash", "rad", 0.0, 0.5, "backlash of the gearbox, at the spool", "drives"),
    ("drives.gear_efficiency", "1", 0.3, 1.0, "efficiency of the gearbox, as currents show it", "drives"),
    ("drives.friction_torque", "N*m", 0.0, 1.0, "friction of motor and gearbox, as currents show it", "drives"),
    ("mismatch.handle_encoder_offset", "rad", -0.3, 0.3, "offset of the handle's encoder", "sensors"),
    ("mismatch.output_encoder_offset", "rad", -0.3, 0.3, "offset of the distal encoder", "sensors"),
)
"""Key of an instrument file, unit, bounds, meaning and group of the parameters that are a key's value."""

UNKNOWNS = {
    "stiffness_ratio": Unknown(
        "stiffness_ratio", "1", 0.2, 3.0, "true over nominal stiffness of the tendons", _stiffness, "stiffness"
    ),
    "handle_length_share": Unknown(
        "handle_length_share",
        "1",
        0.02,
        0.8,
        "share of a tendon's compliance between spool and handle joint",
        _key("friction.handle_compliance_share"),
        "stiffness",
    ),
    "pretension_ratio": Unknown(
        "pretension_ratio", "1", 0.1, 4.0, "true over nominal pretension", _pretension, "pretension"
    ),
    **{
        key: Unknown(key.partition(".")[2], unit, lower, upper, meaning, _key(key), group)
        for key, unit, lower, upper, meaning, group in _KEYS
    },
    **{
        f"mismatch.load_cell_{kind}.{tendon}": Unknown(
            f"{tendon}_load_cell_{kind}",
            unit,
            lower,
            upper,
            f"{kind} of the {tendon}'s load cell",
            _of_pair(f"load_cell_{kind}", place),
            "load_cells",
        )
        for kind, unit, lower, upper in (("gain", "1", 0.5, 2.0), ("bias", "N", -20.0, 20.0))
        for place, tendon in enumerate(TENDONS)
    },
}
"""Every parameter that recordings may identify, by name."""

SHOWN_BY_CURRENTS = ("drives.gear_efficiency", "drives.friction_torque")
"""Parameters that load cells beside the spools do not show."""

LARGEST_OFFSET = UNKNOWNS["mismatch.handle_encoder_offset"].upper
