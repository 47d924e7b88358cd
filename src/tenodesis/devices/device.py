"""The interface of a device: sensors are read, motors are commanded a speed."""

from abc import ABC, abstractmethod
from collections import Counter
from dataclasses import dataclass
from types import TracebackType
from typing import NamedTuple, Self

import numpy as np

from tenodesis.errors import ArgumentError, DeviceError
from tenodesis.run import Array


@dataclass(frozen=True)
class Capabilities:
    """What a device has and how it keeps time."""

    name: str
    """Name: twin, nidaq, canopen, serial."""
    axes: tuple[str, ...]
    rate: float
    """Measurements per second, Hz."""
    clocked: bool
    """Whether `read` waits for the device's own clock; otherwise it returns at once, and the caller keeps time."""
    simulated: bool
    """Whether no real motor moves."""
    distal_encoder: bool
    """Whether it measures the output angle, as only a bench does."""
    latency: float
    """Time from a measurement until a command that answers it acts, by the device's own account, s."""
    stops_alone: float
    """Time without a command after which the motors stop by themselves, s."""
    tendons: tuple[str, ...] = ()
    """Tendons, where the device names them; otherwise every axis has an agonist and an antagonist."""

    holds_tension: bool = False
    """Whether its drives may hold tensions instead of following speeds."""

    @property
    def spools(self) -> tuple[int, ...]:
        """Shape of what it has per spool: (tendons,), or (axes, 2) where it does not name them."""
        return (len(self.tendons),) if self.tendons else (len(self.axes), 2)


class Measurement(NamedTuple):
    """The values of all sensors at one instant."""

    time: int
    """By a clock that never runs backwards, ns."""
    handle_angle: Array
    """rad, shape (joints of the handle,)"""
    tension: Array
    """Beside the spools, N, in the shape :attr:`Capabilities.spools`: agonist first, or by tendon"""
    spool_angle: Array
    """Positive winds, rad, in the same shape"""
    output_angle: Array
    """By a distal encoder, rad, shape (joints,); NaN if there is none"""


class Device(ABC):
    """A bench: opened, read, written and closed by one thread, in that order; as a context it is open within.

    A failure raises :class:`tenodesis.errors.DeviceError` in one sentence that states what to do; the motors are then
    stopped. A sensor without a value is NaN, which the controller treats as a fault.
    """

    capabilities: Capabilities
    """What the device has; known before it is opened, except for what only the hardware can report."""

    @abstractmethod
    def open(self) -> None:
        """Take hold of the hardware, motors enabled and at rest."""

    @abstractmethod
    def read(self, timeout: float) -> Measurement | None:
        """Return the next measurement, or None where none has come within a time (s)."""

    @abstractmethod
    def write(self, spool_velocity: Array) -> None:
        """Command the motors a speed, rad/s at the spool, positive winds, in the shape of the measurements.

        A speed that is not finite stops its motor; one beyond the device's limit is cut to it.
        """

    def hold(self, spool_tension: Array) -> None:
        """Have drives hold tensions, N, in the shape of the measurements, from the next `write` on.

        0 is a drive that follows its speed. Raises ArgumentError where the device has no such drives.
        """
        if np.any(spool_tension):
            raise ArgumentError(key="spool_tension", value=spool_tension, allowed="0: its drives follow speeds")

    def cut_power(self) -> None:
        """Take the motors' supply away, since one of them does not obey, and let go of the hardware.

        By default it is closed, which stops the motors that do obey.
        """
        self.close()

    @abstractmethod
    def close(self) -> None:
        """Stop the motors and let go of the hardware; a second time does nothing."""

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close; what fails then does not hide why it was left."""
        try:
            self.close()
        except DeviceError as worse:
            if problem is None:
                raise
            problem.add_note(str(worse))


class Bench(Device):
    """What benches with motors share: bounds of a spool's speed (rad/s), and no command to motors after a failure."""

    def __init__(self, capabilities: Capabilities, speed_limit: float) -> None:
        self.capabilities = capabilities
        self._speed_limit = speed_limit
        self._opened = False
        self._failed: DeviceError | None = None
        self.counts: Counter[str] = Counter()
        """Number of flawed measurements by kind of problem."""
        self.problem = ""
        """The latest problem, in one sentence."""

    def _begin(self) -> None:
        """Forget earlier problems, before it is opened."""
        if self._opened:
            raise DeviceError(
                f"The {self.capabilities.name} bench is open already; close it first.", key="state", value="open"
            )
        self._failed = None
        self.counts.clear()
        self.problem = ""

    def _refuse(self) -> None:
        if self._failed is not None:
            failed = self._failed
            raise DeviceError(str(failed), key=failed.key, value=failed.value, allowed=failed.allowed)
        if not self._opened:
            raise DeviceError(
                f"The {self.capabilities.name} bench is not open; open it first.", key="state", value="closed"
            )

    def _speeds(self, spool_velocity: Array) -> Array:
        """Return the speeds that motors may be commanded: cut to the limit, and 0 where they are not finite."""
        speeds = np.asarray(spool_velocity, float)
        allowed = self.capabilities.spools
        if speeds.shape != allowed:
            sentence = f"spool_velocity has shape {speeds.shape}; it must be {allowed}."
            raise ArgumentError(sentence, key="spool_velocity", value=speeds, allowed=f"shape {allowed}")
        return np.where(np.isfinite(speeds), np.clip(speeds, -self._speed_limit, self._speed_limit), 0.0)

    def _note(self, kind: str, sentence: str, count: int = 1) -> None:
        """Count a problem, and keep its sentence."""
        self.counts[kind] += count
        self.problem = sentence[0].upper() + sentence[1:]
