"""The instrument at rest: the paper's equations 1 to 22 for any number of joints, and their exact derivatives."""

from tenodesis._core import Status
from tenodesis.statics.chain import Axes, Rates, coupling, straight_arms
from tenodesis.statics.equations import (
    Actuation,
    Law,
    compensation_stroke,
    compensation_strokes,
    equilibrium,
    estimate_output_angle,
    flexural_stiffness,
    gradient,
    handle_angle,
    loss_of_dexterity,
    output_angle,
    rates,
    reach,
    slack_force,
    tensions,
    torque_transmissibility,
    unloaded_angle,
)
from tenodesis.statics.loss import Loss, UsualLoad, hold, loss, up_to_force, usual_loads, usual_states
from tenodesis.statics.query import Equilibrium, Tensions
from tenodesis.statics.slack import slack_load
from tenodesis.statics.target import targets
from tenodesis.statics.tension_drive import strokes_at_tensions
from tenodesis.statics.wrench import TipWrench, load_matrix, tip_wrench

__all__ = [
    "Actuation",
    "Axes",
    "Equilibrium",
    "Law",
    "Loss",
    "Rates",
    "Status",
    "Tensions",
    "TipWrench",
    "UsualLoad",
    "compensation_stroke",
    "compensation_strokes",
    "coupling",
    "equilibrium",
    "estimate_output_angle",
    "flexural_stiffness",
    "gradient",
    "handle_angle",
    "hold",
    "load_matrix",
    "loss",
    "loss_of_dexterity",
    "output_angle",
    "rates",
    "reach",
    "slack_force",
    "slack_load",
    "straight_arms",
    "strokes_at_tensions",
    "targets",
    "tensions",
    "tip_wrench",
    "torque_transmissibility",
    "unloaded_angle",
    "up_to_force",
    "usual_loads",
    "usual_states",
]


def __dir__() -> list[str]:
    return sorted(__all__)
