"""The state of a live runtime, as its server reports it and a connection returns it."""

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import NamedTuple


class RuntimeState(StrEnum):
    """Operating state of the controller; GONE where there is no runtime any more."""

    DISABLED = "DISABLED"
    ENABLED = "ENABLED"
    PAUSED = "PAUSED"
    FAULT = "FAULT"
    GONE = "GONE"


class ProtocolState(StrEnum):
    """How a protocol stands."""

    RUNNING = "running"
    WAITING = "waiting"
    """For the operator: its problem says what to do, and it goes on after that."""
    DONE = "done"
    ENDED = "ended"
    """Before it was done: its problem says why."""


class ProtocolStatus(NamedTuple):
    """The protocol that runs, or ran last."""

    name: str
    done: float
    """Time that it has run for, s."""
    total: float
    """Time that it takes, s."""
    state: ProtocolState
    problem: str | None = None
    """Why it waits or has ended, in a sentence."""

    @property
    def runs(self) -> bool:
        """Whether it runs or waits, so that no other can begin."""
        return self.state in (ProtocolState.RUNNING, ProtocolState.WAITING)


@dataclass(frozen=True)
class Timing:
    """How the loop keeps time; durations in s."""

    ticks: int
    late: int
    """Ticks that began more than half a period late."""
    missed: int
    """Ticks that did not take place, or were not caught up with."""
    lost: int
    """Ticks that the recorder did not get."""
    p50: float
    """Median of the compute time of a tick through the runtime."""
    p99: float
    worst: float
    controller_p50: float
    """Of the controller alone, in the same ticks."""
    controller_worst: float
    lateness_p99: float
    lateness_worst: float
    rate: float
    """Ticks per second, Hz."""


@dataclass(frozen=True)
class Status:
    """The state of a runtime."""

    state: RuntimeState
    homed: bool
    """Whether the zero of the spools is known."""
    homing: bool
    stopped: bool
    """Whether a stop holds the motors."""
    faults: tuple[str, ...]
    """Names of the faults."""
    first_faults: tuple[str, ...]
    """Names of those that came first."""
    law: str
    actuation: str
    operator: str | None
    """Origin of the operator; None without one."""
    timing: Timing
    realtime: tuple[str, ...]
    """What the operating system did not grant, in sentences."""
    protocol: ProtocolStatus | None
    recording: Path | None
    """File that is being recorded."""
    recorder_lost: int
    """Ticks that the recorder did not keep up with."""
    speed: float
    """Simulated time by wall time."""
    problem: str | None
    """What is wrong with the runtime itself, in a sentence."""

    @property
    def protocol_runs(self) -> bool:
        """Whether a protocol runs or waits."""
        return self.protocol is not None and self.protocol.runs
