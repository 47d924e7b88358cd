"""Model, scale, test and control tendon-driven hand-held surgical instruments."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from tenodesis import control, kinematics, protocols, similarity, statics, tendon, twin
from tenodesis.errors import (
    DesignError,
    IdentificationError,
    InstrumentError,
    NoSolutionError,
    ProtocolError,
    RecordingError,
    StudyError,
)
from tenodesis.instrument import Continuum, Instrument, TendonGear, TendonPulley, load, parse, shipped
from tenodesis.recording import Recorder, Recording
from tenodesis.signals import Run
from tenodesis.threads import set_threads

if TYPE_CHECKING:
    from tenodesis import identification, scaling, tolerance

__version__ = "0.1.0"

__all__ = [
    "Continuum",
    "DesignError",
    "IdentificationError",
    "Instrument",
    "InstrumentError",
    "NoSolutionError",
    "ProtocolError",
    "Recorder",
    "Recording",
    "RecordingError",
    "Run",
    "StudyError",
    "TendonGear",
    "TendonPulley",
    "control",
    "identification",
    "kinematics",
    "load",
    "parse",
    "protocols",
    "scaling",
    "set_threads",
    "shipped",
    "similarity",
    "statics",
    "tendon",
    "tolerance",
    "twin",
]

_LATE = ("identification", "scaling", "tolerance")


def __getattr__(name: str) -> Any:
    """Return a subpackage that is only loaded when it is asked for, for the libraries it needs."""
    if name in _LATE:
        return import_module(f"tenodesis.{name}")
    raise AttributeError(f"module 'tenodesis' has no attribute {name!r}")
