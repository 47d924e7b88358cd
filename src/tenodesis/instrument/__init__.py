"""Instruments: a file describes an instrument, and everything else is computed from it."""

from tenodesis.instrument.instrument import PARAMETERS, AxisName, Instrument, Name
from tenodesis.instrument.mechanisms import JOINT_TYPES, Continuum, TendonGear, TendonPulley
from tenodesis.instrument.reading import json_schema, load, parse, shipped

__all__ = [
    "JOINT_TYPES",
    "PARAMETERS",
    "AxisName",
    "Continuum",
    "Instrument",
    "Name",
    "TendonGear",
    "TendonPulley",
    "json_schema",
    "load",
    "parse",
    "shipped",
]
