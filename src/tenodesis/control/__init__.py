"""The controller: estimates the tip from sensors at the handle, and restores the lost angle."""

from tenodesis.control.controller import (
    Controller,
    FlightRecord,
    LawName,
    ObserverName,
    OperatingState,
    Output,
    Request,
    homing_failure,
)
from tenodesis.control.export import export_header, header, identifier
from tenodesis.control.parameters import FAULTS, HOMING_REASONS, Parameters, parameters, tension_from_current
from tenodesis.control.resolution import Resolution, resolution

__all__ = [
    "FAULTS",
    "HOMING_REASONS",
    "Controller",
    "FlightRecord",
    "LawName",
    "ObserverName",
    "OperatingState",
    "Output",
    "Parameters",
    "Request",
    "Resolution",
    "export_header",
    "header",
    "homing_failure",
    "identifier",
    "parameters",
    "resolution",
    "tension_from_current",
]


def __dir__() -> list[str]:
    return sorted(__all__)
