"""The closed loop: protocols from TOML or Python, their execution on a twin, and fault injection.

Angles in rad, forces in N, speeds in rad/s or m/s, durations in s, or text with a unit. Forces may jump, the handle
never does: a phase that begins at a handle angle of its own moves there smoothly first. A command that a phase does not
name stays as it was, spool velocities included.
"""

from tenodesis.errors import ProtocolError
from tenodesis.run import concatenate
from tenodesis.simulate import campaign
from tenodesis.simulate.chirp import Chirp
from tenodesis.simulate.command import Plant
from tenodesis.simulate.default import default_protocol
from tenodesis.simulate.execution import execute
from tenodesis.simulate.fault_injection import INJECTION_POINTS, FaultInjection
from tenodesis.simulate.loads import LoadStep, Wrench
from tenodesis.simulate.motion import Motion
from tenodesis.simulate.phases import Cycles, GrippedObject, Hold, Ramp, StepLoad, TissueContact
from tenodesis.simulate.pretension import Pretension
from tenodesis.simulate.protocol import AnyPhase, Protocol, json_schema, load, parse, shipped

__all__ = [
    "INJECTION_POINTS",
    "AnyPhase",
    "Chirp",
    "Cycles",
    "FaultInjection",
    "GrippedObject",
    "Hold",
    "LoadStep",
    "Motion",
    "Plant",
    "Pretension",
    "Protocol",
    "ProtocolError",
    "Ramp",
    "StepLoad",
    "TissueContact",
    "Wrench",
    "campaign",
    "concatenate",
    "default_protocol",
    "execute",
    "json_schema",
    "load",
    "parse",
    "shipped",
]


def __dir__() -> list[str]:
    return sorted(__all__)
