"""Instruments whose joints share tendons, in space: description, statics, stiffness and compensation."""

from tenodesis.coupled.description import CoupledInstrument, Crossing, Grip, Joint, Tendon
from tenodesis.coupled.reading import load, of_planar, parse, shipped
from tenodesis.coupled.statics import (
    Equilibrium,
    Rates,
    compensation_strokes,
    coupling,
    equilibrium,
    handle_angles,
    output_angles,
    rates,
    tensions,
)

__all__ = [
    "CoupledInstrument",
    "Crossing",
    "Equilibrium",
    "Grip",
    "Joint",
    "Rates",
    "Tendon",
    "compensation_strokes",
    "coupling",
    "equilibrium",
    "handle_angles",
    "load",
    "of_planar",
    "output_angles",
    "parse",
    "rates",
    "shipped",
    "tensions",
]
