"""The state of a live runtime, as its server reports it and a connection returns it."""

from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import NamedTuple


class RuntimeState(StrEnum):
    """Operating state of the controller; GONE if the runtime has ended."""

    DISABLED = "DISABLED"
    ENABLED = "ENABLED"
    PAUSED = "PAUSED"
    FAULT = "FAULT"
    GONE = "GONE"


class ProtocolState(StrEnum):
    """State of a protocol."""

    RUNNING = "running"
    WAITING = "waiting"
    """For the operator: its problem states what to do before it continues."""
    DONE = "done"
    ENDED = "ended"
    """Before it was done: its problem states why."""


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
    """Timing of the loop; durations in s."""

    rate: float
    """Ticks per second, Hz."""
    ticks: int = 0
    late: int = 0
    """Ticks that began more than half a period late."""
    missed: int = 0
    """Ticks that were skipped."""
    lost: int = 0
    """Ticks that the recorder did not get."""
    p50: float = 0.0
    """Median of the compute time of a tick through the runtime."""
    p99: float = 0.0
    worst: float = 0.0
    controller_p50: float = 0.0
    """Of the controller alone, in the same ticks."""
    controller_worst: float = 0.0
    lateness_p99: float = 0.0
    lateness_worst: float = 0.0


@dataclass(frozen=True)
class Status:
    """The state of a runtime; by default that of one that has ended."""

    state: RuntimeState
    law: str
    actuation: str
    timing: Timing
    homed: bool = False
    """Whether the zero of the spools is known."""
    homing: bool = False
    stopped: bool = True
    """Whether a stop is in force."""
    faults: tuple[str, ...] = ()
    """Names of the faults."""
    first_faults: tuple[str, ...] = ()
    """Names of the first faults."""
    operator: str | None = None
    """Origin of the operator; None if there is none."""
    realtime: tuple[str, ...] = ()
    """Real-time requests that the operating system refused, in sentences."""
    protocol: ProtocolStatus | None = None
    recording: Path | None = None
    """File of the present recording."""
    recorder_lost: int = 0
    """Ticks that the recorder did not keep up with."""
    speed: float = 0.0
    """Simulated over wall time."""
    problem: str | None = None
    """Problem of the runtime itself, in a sentence."""
    homing_failures: dict[str, str] = field(default_factory=dict)
    """Why the last homing failed, as of :func:`tenodesis.control.homing_failure`, by axis; without axes where it did
    not."""
    wound: dict[str, float] = field(default_factory=dict)
    """How far the motors hold the tip from where it would be with their spools at home, rad, by axis, where known."""

    @property
    def protocol_runs(self) -> bool:
        """Whether a protocol runs or waits."""
        return self.protocol is not None and self.protocol.runs
