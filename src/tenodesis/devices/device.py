"""What every device does: sensors are read, motors are told a speed."""

from dataclasses import dataclass
from types import TracebackType
from typing import NamedTuple, Protocol, Self

from tenodesis.signals import Array


@dataclass(frozen=True)
class Capabilities:
    """What a device has and how it keeps time."""

    name: str
    """What it is called: twin, nidaq, canopen, serial."""
    axes: tuple[str, ...]
    rate: float
    """Measurements per second, Hz."""
    clocked: bool
    """Whether `read` waits for the device's own clock; otherwise it returns at once, and the caller keeps time."""
    simulated: bool
    """Whether no motor of this world moves."""
    distal_encoder: bool
    """Whether it measures the output angle, as only a bench does."""
    latency: float
    """Time from a measurement to when a command that answers it acts, as the device tells it, s."""
    stops_alone: float
    """Time without a command after which the motors stop without being told, s."""


class Measurement(NamedTuple):
    """What the sensors say at one instant."""

    time: int
    """By a clock that never runs backwards, ns."""
    handle_angle: Array
    """rad, shape (axes,)"""
    tension: Array
    """Beside the spools, agonist first, N, shape (axes, 2)"""
    spool_angle: Array
    """Positive winds, rad, shape (axes, 2)"""
    output_angle: Array
    """By a distal encoder, rad, shape (axes,); NaN without one"""


class Device(Protocol):
    """A bench: opened, read, written and closed by one thread, in that order.

    Whatever fails raises :class:`tenodesis.errors.DeviceError` in one sentence that says what to do; the motors are
    then stopped. A sensor that gives nothing is NaN, which the controller takes for the fault it is.
    """

    @property
    def capabilities(self) -> Capabilities:
        """What it has; known before it is opened, but for what only the hardware can tell."""
        ...

    def open(self) -> None:
        """Take hold of the hardware, motors enabled and at rest."""
        ...

    def read(self, timeout: float) -> Measurement | None:
        """Return the next measurement, or None where none has come within a time (s)."""
        ...

    def write(self, spool_velocity: Array) -> None:
        """Tell the motors a speed, rad/s at the spool, positive winds, shape (axes, 2).

        What is not finite stops the motor; what is beyond the device's limit is cut to it.
        """
        ...

    def close(self) -> None:
        """Stop the motors and let go of the hardware; a second time does nothing."""
        ...

    def __enter__(self) -> Self:
        """Open."""
        ...

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        ...
