"""The controller: know the tip from what the handle's end tells, and give the lost angle back."""

from tenodesis.control.controller import (
    Controller,
    FlightRecord,
    LawName,
    ObserverName,
    OperatingState,
    Output,
    Request,
)
from tenodesis.control.export import export_header, header, identifier
from tenodesis.control.parameters import FAULTS, Parameters, parameters

__all__ = [
    "FAULTS",
    "Controller",
    "FlightRecord",
    "LawName",
    "ObserverName",
    "OperatingState",
    "Output",
    "Parameters",
    "Request",
    "export_header",
    "header",
    "identifier",
    "parameters",
]
