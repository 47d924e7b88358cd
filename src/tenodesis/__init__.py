"""Model, scale, test and control tendon-driven hand-held surgical instruments."""

from tenodesis import control, protocols, similarity, statics, tendon, twin
from tenodesis.errors import InstrumentError, NoSolutionError, ProtocolError, RecordingError
from tenodesis.instrument import Continuum, Instrument, TendonGear, TendonPulley, load, parse, shipped
from tenodesis.recording import Recorder, Recording
from tenodesis.signals import Run
from tenodesis.threads import set_threads

__version__ = "0.1.0"

__all__ = [
    "Continuum",
    "Instrument",
    "InstrumentError",
    "NoSolutionError",
    "ProtocolError",
    "Recorder",
    "Recording",
    "RecordingError",
    "Run",
    "TendonGear",
    "TendonPulley",
    "control",
    "load",
    "parse",
    "protocols",
    "set_threads",
    "shipped",
    "similarity",
    "statics",
    "tendon",
    "twin",
]
