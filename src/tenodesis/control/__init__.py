"""The controller: estimates the tip from sensors at the handle, and restores the lost angle."""

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
