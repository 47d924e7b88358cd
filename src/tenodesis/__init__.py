"""Model, scale, test and control tendon-driven hand-held surgical instruments."""

from tenodesis import similarity, statics
from tenodesis.errors import InstrumentError, NoSolutionError
from tenodesis.instrument import Instrument, load, parse, shipped
from tenodesis.threads import set_threads

__version__ = "0.1.0"

__all__ = [
    "Instrument",
    "InstrumentError",
    "NoSolutionError",
    "load",
    "parse",
    "set_threads",
    "shipped",
    "similarity",
    "statics",
]
