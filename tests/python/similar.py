"""Instruments that are similar by construction, for the claims about similarity."""

from typing import Any

from tenodesis import plant
from tenodesis.instrument import Instrument

FRICTION = {
    "friction.law": "stribeck",
    "friction.vertex_coefficient": 0.12,
    "friction.sheath_coefficient": 0.1,
    "friction.sheath_bend": 0.5,
    "friction.sheath_bend_per_handle_angle": 0.3,
    "friction.sheath_contacts": 2,
    "friction.constant": 0.2,
    "friction.viscous": 20.0,
    "friction.static_ratio": 1.3,
    "friction.stribeck_speed": 2e-3,
    "friction.memory": 2e-2,
}
"""Everything that friction has."""


def geometrically_scaled(inst: Instrument, s: float) -> Instrument:
    """Return the instrument with every length times s of the same material: time goes with s, force with s squared."""
    changes: dict[str, Any] = {}
    for key, value, quantity in inst.quantities():
        power = {"m": 1, "N": 2, "N*m^2": 4}.get(quantity.unit, 0)
        if key != "tendon_stiffness" and power:
            changes[key] = value * s**power
    derived = plant.parameters(inst)
    powers = {
        "dynamics.tip_inertia": (derived["tip_inertia"], 5),
        "dynamics.tip_damping": (derived["tip_damping"], 4),
        "dynamics.hand_stiffness": (inst.dynamics.hand_stiffness, 3),
        "dynamics.hand_damping": (inst.dynamics.hand_damping, 4),
        "dynamics.hand_inertia": (inst.dynamics.hand_inertia, 5),
        "friction.constant": (inst.friction.constant, 2),
        "friction.viscous": (inst.friction.viscous, 2),
        "friction.memory": (inst.friction.memory, 1),
        "drives.spool_radius": (inst.drives.spool_radius, 1),
        "drives.motor_speed": (inst.drives.motor_speed, -1),
        "drives.motor_acceleration": (inst.drives.motor_acceleration, -2),
        "drives.time_constant": (inst.drives.time_constant, 1),
    }
    if inst.friction.law == "capstan-power" or inst.friction.bends:
        powers |= {
            "friction.reference_tension": (inst.friction.reference_tension, 2),
            "friction.reference_radius": (inst.friction.reference_radius, 1),
            "friction.vertex_radius": (inst.friction.vertex_radius or 0.0, 1),
            "friction.tendon_bending_stiffness": (inst.friction.tendon_bending_stiffness, 4),
        }
    return inst.replace(**changes, **{key: value * s**power for key, (value, power) in powers.items() if value})
