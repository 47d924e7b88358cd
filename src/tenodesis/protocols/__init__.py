"""Protocols: what is done on the bench, from TOML or from Python, and running it on a twin.

Angles in rad, forces in N, speeds in rad/s or m/s, durations in s; text with a unit is taken as well. Forces may
jump, the handle never does: a phase that begins at a handle angle of its own moves there smoothly first. What a phase
does not name stays as it was, spool velocities included.
"""

from tenodesis.errors import ProtocolError
from tenodesis.protocols.cycles import Cycles
from tenodesis.protocols.execution import execute
from tenodesis.protocols.files import load, parse, shipped
from tenodesis.protocols.hold import Hold
from tenodesis.protocols.motion import Motion
from tenodesis.protocols.pretension import Pretension
from tenodesis.protocols.protocol import Protocol
from tenodesis.protocols.ramp import Ramp
from tenodesis.protocols.step_load import StepLoad
from tenodesis.protocols.twin import Twin
from tenodesis.signals import concatenate

__all__ = [
    "Cycles",
    "Hold",
    "Motion",
    "Pretension",
    "Protocol",
    "ProtocolError",
    "Ramp",
    "StepLoad",
    "Twin",
    "concatenate",
    "execute",
    "load",
    "parse",
    "shipped",
]
