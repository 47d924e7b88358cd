"""Instruments whose joints share tendons, in space: description, statics, stiffness and compensation."""

from tenodesis.coupled.description import CoupledInstrument, Crossing, Grip, Joint, RouteError, Tendon
from tenodesis.coupled.loss import Loss, hold, loss
from tenodesis.coupled.plausibility import Doubt, implausible
from tenodesis.coupled.reading import CoupledLike, is_coupled, load, misrouted, of_planar, parse, shipped
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
    "equilibrium",
    "handle_angles",
    "hold",
    "implausible",
    "is_coupled",
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
