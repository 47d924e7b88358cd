"""Instruments whose joints share tendons, in space: description, statics, stiffness and compensation."""

from tenodesis.coupled.description import CoupledInstrument, Crossing, Grip, Joint, RouteError, Tendon
from tenodesis.coupled.reading import is_coupled, load, misrouted, of_planar, parse, shipped
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
    "Crossing",
    "Equilibrium",
    "Grip",
    "Joint",
    "Rates",
    "RouteError",
    "Tendon",
    "compensation_strokes",
    "coupling",
    "equilibrium",
    "handle_angles",
    "is_coupled",
    "load",
    "misrouted",
    "of_planar",
    "output_angles",
    "parse",
    "rates",
    "shipped",
    "straight_arms",
    "tensions",
]
