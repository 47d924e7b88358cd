"""Instruments whose joints share tendons, in space: description, statics, stiffness and compensation."""

from tenodesis.coupled.description import CoupledInstrument, Crossing, Grip, Joint, RouteError, Tendon
from tenodesis.coupled.dvrk import PULLEY_RADIUS, dvrk_text, from_dvrk
from tenodesis.coupled.losses import Loss, hold, loss
from tenodesis.coupled.plausibility import Doubt, implausible
from tenodesis.coupled.reading import CoupledLike, is_coupled, json_schema, load, misrouted, of_planar, parse, shipped
from tenodesis.coupled.statics import (
    Equilibrium,
    Rates,
    compensation_strokes,
    coupling,
    equilibrium,
    handle_angles,
    output_angles,
    rates,
    straight_arms,
    tensions,
)

__all__ = [
    "PULLEY_RADIUS",
    "CoupledInstrument",
    "CoupledLike",
    "Crossing",
    "Doubt",
    "Equilibrium",
    "Grip",
    "Joint",
    "Loss",
    "Rates",
    "RouteError",
    "Tendon",
    "compensation_strokes",
    "coupling",
    "dvrk_text",
    "equilibrium",
    "from_dvrk",
    "handle_angles",
    "hold",
    "implausible",
    "is_coupled",
    "json_schema",
    "load",
    "loss",
    "misrouted",
    "of_planar",
    "output_angles",
    "parse",
    "rates",
    "shipped",
    "straight_arms",
    "tensions",
]


def __dir__() -> list[str]:
    return sorted(__all__)
