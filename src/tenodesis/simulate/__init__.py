"""The closed loop: protocols from TOML or Python, their execution on a twin, and fault injection.

Angles in rad, forces in N, speeds in rad/s or m/s, durations in s; text with a unit is taken as well. Forces may
jump, the handle never does: a phase that begins at a handle angle of its own moves there smoothly first. What a phase
does not name stays as it was, spool velocities included.
"""

from tenodesis.errors import ProtocolError
from tenodesis.run import concatenate
from tenodesis.simulate.command import Plant
from tenodesis.simulate.execution import execute
from tenodesis.simulate.fault_injection import INJECTION_POINTS, FaultInjection
from tenodesis.simulate.files import load, parse, shipped
from tenodesis.simulate.motion import Motion
from tenodesis.simulate.phases import Cycles, Hold, Ramp, StepLoad
from tenodesis.simulate.pretension import Pretension
from tenodesis.simulate.protocol import Protocol

__all__ = [
    "INJECTION_POINTS",
    "Cycles",
    "FaultInjection",
    "Hold",
    "Motion",
    "Plant",
    "Pretension",
    "Protocol",
    "ProtocolError",
    "Ramp",
    "StepLoad",
    "concatenate",
    "execute",
    "load",
    "parse",
    "shipped",
]
