"""The instrument at rest: the paper's equations 1 to 22 as functions of an instrument, and their exact derivatives."""

from tenodesis._core import Status
from tenodesis.statics.equations import (
    Actuation,
    Equilibrium,
    Law,
    Tensions,
    compensation_stroke,
    equilibrium,
    estimate_output_angle,
    flexural_stiffness,
    gradient,
    handle_angle,
    loss_of_dexterity,
    output_angle,
    reach,
    slack_force,
    tensions,
    torque_transmissibility,
)

__all__ = [
    "Actuation",
    "Equilibrium",
    "Law",
    "Status",
    "Tensions",
    "compensation_stroke",
    "equilibrium",
    "estimate_output_angle",
    "flexural_stiffness",
    "gradient",
    "handle_angle",
    "loss_of_dexterity",
    "output_angle",
    "reach",
    "slack_force",
    "tensions",
    "torque_transmissibility",
]


def __dir__() -> list[str]:
    return sorted(__all__)
