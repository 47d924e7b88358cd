"""Instruments: one file describes one, and everything else is computed from it."""

from tenodesis.instrument.instrument import (
    JOINT_TYPES,
    PARAMETERS,
    AxisName,
    Continuum,
    Instrument,
    Name,
    TendonGear,
    TendonPulley,
    json_schema,
    load,
    parse,
    shipped,
    unit_of,
)

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
    "unit_of",
]
