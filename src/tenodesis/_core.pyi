"""The C++ core over arrays; the package's modules are its interface."""

from collections.abc import Sequence
import enum

import numpy
from numpy.typing import NDArray


class Status(enum.IntEnum):
    """How a solve ended."""

    OK = 0
    """solved"""

    NO_EQUILIBRIUM = 1
    """loaded past the fold: the joint snaps through"""

    UNREACHABLE = 2
    """outside what the mechanism can bend to"""

    BOTH_SLACK = 3
    """neither tendon holds the joint"""

    NO_AUTHORITY = 4
    """no stroke of the acting motors gives the angle back"""

    OUT_OF_RANGE = 5
    """handle angle beyond the handle's range"""

    NOT_FINITE = 6
    """NaN or infinite input"""

class JointType(enum.Enum):
    """Joint mechanism."""

    TENDON_GEAR = 0

    TENDON_PULLEY = 1

    CONTINUUM = 2

class Spec:
    """One axis of an instrument, as numbers in SI units."""

    def __init__(self, joint_type: JointType, parameters: Sequence[float], handle_range: float) -> None: ...

    def __getstate__(self) -> tuple[JointType, list[float], float]: ...

    def __setstate__(self, arg: tuple[JointType, Sequence[float], float], /) -> None: ...

def parameters() -> list[str]:
    """Names of a spec's parameters, in their order."""

def tendon_stiffness(spec: Spec) -> float:
    """Stiffness of one tendon, N/m."""

def unloaded_limit(spec: Spec) -> float:
    """
    Unloaded distal coordinate at the end of the handle's range, as a share of the joint's limit.
    """

def evaluate(spec: Spec, operation: str, inputs: Sequence[NDArray[numpy.float64]], out: NDArray[numpy.float64], status: NDArray[numpy.uint8], threads: int) -> None:
    """
    Write an operation's outputs, by output, 1 and point, and the status of every point.
    """

def gradient(spec: Spec, operation: str, inputs: Sequence[NDArray[numpy.float64]], variables: Sequence[int], out: NDArray[numpy.float64], status: NDArray[numpy.uint8], threads: int) -> None:
    """
    Write the derivatives, by output, variable and point, and the status of every point.
    """
