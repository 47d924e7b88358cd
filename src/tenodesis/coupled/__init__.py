"""Instruments whose joints share tendons, in space: description, statics, stiffness and compensation."""

from tenodesis.coupled.description import CoupledInstrument, Crossing, Grip, Joint, Tendon
from tenodesis.coupled.dvrk import PULLEY_RADIUS, dvrk_text, from_dvrk
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
    "PULLEY_RADIUS",
    "CoupledInstrument",
    "Crossing",
    "Equilibrium",
    "Grip",
    "Joint",
    "Rates",
    "Tendon",
    "compensation_strokes",
    "coupling",
    "dvrk_text",
    "equilibrium",
    "from_dvrk",
    "handle_angles",
    "load",
    "of_planar",
    "output_angles",
    "parse",
    "rates",
    "shipped",
    "tensions",
]


def __dir__() -> list[str]:
    return sorted(__all__)
