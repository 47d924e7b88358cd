"""Model, scale, test and control tendon-driven hand-held surgical instruments."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tenodesis import (
        cad,
        control,
        errors,
        identification,
        instrument,
        kinematics,
        live,
        plot,
        poses,
        recording,
        scaling,
        similarity,
        simulate,
        statics,
        tendon,
        tolerance,
        twin,
        workshop,
    )
    from tenodesis.errors import (
        ArgumentError,
        DesignError,
        Error,
        IdentificationError,
        InstrumentError,
        NoSolutionError,
        ProtocolError,
        RecordingError,
        StudyError,
    )
    from tenodesis.headers import get_cmake_dir, get_include
    from tenodesis.instrument import (
        Continuum,
        Instrument,
        InstrumentLike,
        TendonGear,
        TendonPulley,
        load,
        parse,
        shipped,
    )
    from tenodesis.recording import Recorder, Recording
    from tenodesis.run import Run
    from tenodesis.threads import set_threads
    from tenodesis.version import __version__

__all__ = [
    "ArgumentError",
    "Continuum",
    "DesignError",
    "Error",
    "IdentificationError",
    "Instrument",
    "InstrumentError",
    "InstrumentLike",
    "NoSolutionError",
    "ProtocolError",
    "Recorder",
    "Recording",
    "RecordingError",
    "Run",
    "StudyError",
    "TendonGear",
    "TendonPulley",
    "__version__",
    "cad",
    "control",
    "errors",
    "get_cmake_dir",
    "get_include",
    "identification",
    "instrument",
    "kinematics",
    "live",
    "load",
    "parse",
    "plot",
    "poses",
    "recording",
    "scaling",
    "set_threads",
    "shipped",
    "similarity",
    "simulate",
    "statics",
    "tendon",
    "tolerance",
    "twin",
    "workshop",
]

_HOME = {
    "errors": (
        "ArgumentError",
        "DesignError",
        "Error",
        "IdentificationError",
        "InstrumentError",
        "NoSolutionError",
        "ProtocolError",
        "RecordingError",
        "StudyError",
    ),
    "headers": ("get_cmake_dir", "get_include"),
    "instrument": (
        "Continuum",
        "Instrument",
        "InstrumentLike",
        "TendonGear",
        "TendonPulley",
        "load",
        "parse",
        "shipped",
    ),
    "recording": ("Recorder", "Recording"),
    "run": ("Run",),
    "threads": ("set_threads",),
    "version": ("__version__",),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import a module when it is first used, so that `import tenodesis` loads no library."""
    if name in _MODULE_OF:
        return getattr(import_module(f"tenodesis.{_MODULE_OF[name]}"), name)
    if name in __all__:
        return import_module(f"tenodesis.{name}")
    raise AttributeError(f"module 'tenodesis' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
