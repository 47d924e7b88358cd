"""Names that have moved to :mod:`tenodesis.statics`."""

from tenodesis.statics.chain import (
    Axes,
    Rates,
    compensation_strokes,
    coordinates,
    coupling,
    equilibrium,
    handle_angles,
    output_angles,
    rates,
    straight_arms,
    tensions,
)
from tenodesis.statics.query import Equilibrium

__all__ = [
    "Axes",
    "Equilibrium",
    "Rates",
    "compensation_strokes",
    "coordinates",
    "coupling",
    "equilibrium",
    "handle_angles",
    "output_angles",
    "rates",
    "straight_arms",
    "tensions",
]
