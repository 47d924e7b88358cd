"""Names that have moved to :mod:`tenodesis.instrument`."""

from tenodesis.instrument.full_form import FullForm as CoupledInstrument
from tenodesis.instrument.full_form import RouteError
from tenodesis.instrument.joints import (
    AXES,
    SIGNS,
    Crossing,
    Grip,
    Joint,
    Tendon,
)

__all__ = ["AXES", "SIGNS", "CoupledInstrument", "Crossing", "Grip", "Joint", "RouteError", "Tendon"]
