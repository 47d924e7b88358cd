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
from tenodesis.control.export import export_header, export_joints_header, header, identifier, joints_header
from tenodesis.control.joints import JointController, JointEstimate, JointOutput
from tenodesis.control.pairs import Pair, compensated, names_of, pairs
from tenodesis.control.parameters import (
    FAULTS,
    HOMING_REASONS,
    TUNING,
    Constant,
    Parameters,
    parameters,
    tension_from_current,
)
from tenodesis.control.plausibility import Implausible, implausible
from tenodesis.control.resolution import Resolution, resolution
from tenodesis.control.wrench import estimated_wrench

__all__ = [
    "FAULTS",
    "HOMING_REASONS",
    "TUNING",
    "Constant",
    "Controller",
    "FlightRecord",
    "Implausible",
    "JointController",
    "JointEstimate",
    "JointOutput",
    "LawName",
    "ObserverName",
    "OperatingState",
    "Output",
    "Pair",
    "Parameters",
    "Request",
    "Resolution",
    "compensated",
    "estimated_wrench",
    "export_header",
    "export_joints_header",
    "header",
    "homing_failure",
    "identifier",
    "implausible",
    "joints_header",
    "names_of",
    "pairs",
    "parameters",
    "resolution",
    "tension_from_current",
]


def __dir__() -> list[str]:
    return sorted(__all__)
