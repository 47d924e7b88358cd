"""Instruments: a file describes an instrument, and everything else is computed from it."""

from tenodesis.instrument.dvrk import DVRK_UNKNOWN, PULLEY_RADIUS, JawAngle, dvrk_text, from_dvrk, jaw_reading
from tenodesis.instrument.full_form import FullForm, RouteError
from tenodesis.instrument.instrument import Instrument, Name
from tenodesis.instrument.joints import Crossing, Grip, Joint, Tendon
from tenodesis.instrument.mechanisms import JOINT_TYPES, Continuum, TendonGear, TendonPulley
from tenodesis.instrument.reading import (
    InstrumentLike,
    as_instrument,
    as_short_form,
    expanded,
    in_arcs,
    json_schema,
    load,
    misrouted,
    parse,
    shipped,
)
from tenodesis.instrument.short_form import PARAMETERS, AxisName, ShortForm

__all__ = [
    "DVRK_UNKNOWN",
    "JOINT_TYPES",
    "PARAMETERS",
    "PULLEY_RADIUS",
    "AxisName",
    "Continuum",
    "Crossing",
    "FullForm",
    "Grip",
    "Instrument",
    "InstrumentLike",
    "JawAngle",
    "Joint",
    "Name",
    "RouteError",
    "ShortForm",
    "Tendon",
    "TendonGear",
    "TendonPulley",
    "as_instrument",
    "as_short_form",
    "dvrk_text",
    "expanded",
    "from_dvrk",
    "in_arcs",
    "jaw_reading",
    "json_schema",
    "load",
    "misrouted",
    "parse",
    "shipped",
]


def __dir__() -> list[str]:
    return sorted(__all__)
