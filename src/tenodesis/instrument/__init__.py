"""Instruments: a file describes an instrument, and everything else is computed from it."""

from tenodesis.instrument.instrument import PARAMETERS, AxisName, Instrument, Name
from tenodesis.instrument.mechanisms import JOINT_TYPES, Continuum, TendonGear, TendonPulley
from tenodesis.instrument.reading import InstrumentLike, as_instrument, json_schema, load, parse, shipped

__all__ = [
    "JOINT_TYPES",
    "PARAMETERS",
    "AxisName",
    "Continuum",
    "Instrument",
    "InstrumentLike",
    "Name",
    "TendonGear",
    "TendonPulley",
    "as_instrument",
    "json_schema",
    "load",
    "parse",
    "shipped",
]


def __dir__() -> list[str]:
    return sorted(__all__)
