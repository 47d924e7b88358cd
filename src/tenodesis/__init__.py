"""Model, scale, test and control tendon-driven hand-held surgical instruments."""

from tenodesis import similarity, statics
from tenodesis.errors import InstrumentError, NoSolutionError
from tenodesis.instrument import Continuum, Instrument, TendonGear, TendonPulley, load, parse, shipped
from tenodesis.threads import set_threads

__version__ = "0.1.0"

__all__ = [
    "Continuum",
    "Instrument",
    "InstrumentError",
    "NoSolutionError",
    "TendonGear",
    "TendonPulley",
    "load",
    "parse",
    "set_threads",
    "shipped",
    "similarity",
    "statics",
]
