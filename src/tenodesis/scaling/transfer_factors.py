"""The factors that convert signals of a scaled-up instrument to real-size units."""

import math
from collections.abc import Mapping

from tenodesis import plant
from tenodesis.errors import ArgumentError
from tenodesis.instrument import ShortForm
from tenodesis.similarity import Comparison, compare

KEYS = (
    "length",
    "force",
    "tension",
    "torque",
    "handle_torque",
    "motor_stroke",
    "spool_angle",
    "spool_velocity",
    "time",
)
"""The factors, scaled-up over real-size, as in :attr:`tenodesis.similarity.Comparison.factors`."""

QUANTITY = {
    "force": "force",
    "contact_force": "force",
    "contact_stiffness": "contact_stiffness",
    "contact_damping": "contact_damping",
    "estimated_force": "force",
    "estimated_force_std": "force",
    # A radial force bends the joint by its radius alone, as a tension does, and not by the end-effector's length.
    "radial_force": "tension",
    "measured_tension": "tension",
    # Of the same motor on the same spool.
    "measured_current": "tension",
    "tension": "tension",
    "distal_tension": "tension",
    "handle_torque": "handle_torque",
    "measured_spool_angle": "spool_angle",
    "spool_angle": "spool_angle",
    "commanded_spool_velocity": "spool_velocity",
    "spool_velocity": "spool_velocity",
    "output_velocity": "output_velocity",
}
"""Factor of each signal that scales; the others are the same on both instruments: angles, ratios and states."""


def as_built(inst: ShortForm) -> ShortForm:
    """Return a one-axis instrument with the true stiffness and pretension of its table mismatch."""
    mismatch = inst.mismatch
    if mismatch.stiffness_ratio == 1 and mismatch.pretension_ratio == 1:
        return inst
    return inst.replace(
        **{
            "tendon_stiffness": inst.tendon_stiffness * mismatch.stiffness_ratio,
            "pretension": inst.pretension * mismatch.pretension_ratio,
            "mismatch.stiffness_ratio": None,
            "mismatch.pretension_ratio": None,
            # The default inertia depends on the nominal stiffness.
            "dynamics.tip_inertia": plant.parameters(inst)["tip_inertia"],
        }
    )


def comparison(real_size: ShortForm, scaled_up: ShortForm) -> Comparison:
    """Return the comparison of two one-axis instruments as built, with their tables mismatch."""
    return compare(as_built(real_size), as_built(scaled_up))


def factors(compared: Comparison, time_factor: float | None = None) -> Mapping[str, float]:
    """Return the factors of two instruments, scaled-up over real-size, by :data:`KEYS`, and those that follow.

    That is, of angular velocity, and of tissue that the tips bend into by the same angles.

    Raises ValueError if the time factor is not a number above 0.
    """
    found = {key: float(compared.factors[key]) for key in KEYS}
    if time_factor is not None:
        if not 0 < time_factor < math.inf:
            raise ArgumentError(key="time_factor", value=time_factor, allowed="a number above 0")
        found["time"] = float(time_factor)
        found["spool_velocity"] = found["spool_angle"] / found["time"]
    # Force over the tip's way, whose factor is that of torque over force.
    stiffness = found["force"] ** 2 / found["torque"]
    return found | {
        "output_velocity": 1 / found["time"],
        "contact_stiffness": stiffness,
        "contact_damping": stiffness * found["time"],
    }
