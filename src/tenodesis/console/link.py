"""What the page needs of the runtime: to look at it, and to ask it for things in somebody's name."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Literal, Protocol, TypeAlias

from tenodesis.instrument import Instrument
from tenodesis.run import Array
from tenodesis.simulate import Protocol as BenchProtocol


class Timing(Protocol):
    """How the loop keeps time; durations in s."""

    @property
    def ticks(self) -> int:
        """Ticks done."""
        ...

    @property
    def late(self) -> int:
        """Ticks that began late."""
        ...

    @property
    def missed(self) -> int:
        """Ticks that did not take place."""
        ...

    @property
    def lost(self) -> int:
        """Ticks that were not kept for the recorder."""
        ...

    @property
    def p50(self) -> float:
        """Median of the compute time per tick, s."""
        ...

    @property
    def p99(self) -> float:
        """Compute time that 99 % of the ticks stay below, s."""
        ...

    @property
    def worst(self) -> float:
        """Longest compute time of a tick, s."""
        ...

    @property
    def rate(self) -> float:
        """Ticks per second, Hz."""
        ...


class Status(Protocol):
    """The state of the runtime."""

    @property
    def state(self) -> str:
        """DISABLED, ENABLED, PAUSED, FAULT; GONE where there is no runtime any more."""
        ...

    @property
    def stopped(self) -> bool:
        """Whether motors are held by a stop."""
        ...

    @property
    def homed(self) -> bool:
        """Whether the spools' zero is known."""
        ...

    @property
    def homing(self) -> bool:
        """Whether it is being looked for."""
        ...

    @property
    def faults(self) -> tuple[str, ...]:
        """Names of the faults."""
        ...

    @property
    def first_faults(self) -> tuple[str, ...]:
        """Names of those that came first."""
        ...

    @property
    def law(self) -> str:
        """Compensation law."""
        ...

    @property
    def actuation(self) -> str:
        """Actuation mode."""
        ...

    @property
    def operator(self) -> str | None:
        """Origin of whoever operates; None if nobody does."""
        ...

    @property
    def timing(self) -> Timing:
        """How the loop keeps time."""
        ...

    @property
    def realtime(self) -> tuple[str, ...]:
        """What the operating system did not grant, in sentences."""
        ...

    @property
    def protocol(self) -> tuple[str, float, float, str | None] | None:
        """Name, seconds done, seconds in all and problem of the protocol that runs or ran last; see :func:`running`."""
        ...

    @property
    def recording(self) -> Path | None:
        """Where it is recorded to."""
        ...

    @property
    def recorder_lost(self) -> int:
        """Ticks that the recorder did not keep up with."""
        ...

    @property
    def speed(self) -> float:
        """Simulated time by wall time."""
        ...

    @property
    def problem(self) -> str | None:
        """What is wrong with the runtime itself, in a sentence."""
        ...


class Capabilities(Protocol):
    """The part of a device's capabilities that shows on the page."""

    @property
    def simulated(self) -> bool:
        """Whether no motor of this world moves."""
        ...

    @property
    def distal_encoder(self) -> bool:
        """Whether the output angle is measured."""
        ...


Asked: TypeAlias = Literal["enable", "disable", "pause", "resume", "home", "clear"]


class Link(Protocol):
    """A connection to the runtime in somebody's name; whoever does not operate gets LiveError for orders."""

    @property
    def inst(self) -> Instrument:
        """The instrument that runs."""
        ...

    @property
    def device(self) -> str:
        """Name of the device."""
        ...

    @property
    def capabilities(self) -> Capabilities:
        """What the device has."""
        ...

    def latest(self) -> Mapping[str, float | Array]:
        """Return the signals of the newest tick by name, with ``time`` (s); empty before the first."""
        ...

    def history(self, seconds: float, rows: int = 500) -> Mapping[str, Array]:
        """Return the signals of the last seconds, thinned to at most so many rows."""
        ...

    def status(self) -> Status:
        """Return the state."""
        ...

    def acquire(self, force: bool = False) -> bool:
        """Become the operator, from another if forced; return whether that worked."""
        ...

    def release(self) -> None:
        """Stop being the operator."""
        ...

    def heartbeat(self) -> bool:
        """Say that the operator is still there; False from whom that is not."""
        ...

    def hand(self, angles: Array) -> None:
        """Move the handle to angles, rad, shape (axes,)."""
        ...

    def force(self, force: Array) -> None:
        """Load the tip tangentially, N, shape (axes,)."""
        ...

    def request(self, what: Asked) -> None:
        """Ask the controller for something."""
        ...

    def stop(self) -> None:
        """Stop the motors at once; anyone may."""
        ...

    def law(self, law: str, actuation: str) -> None:
        """Choose compensation law and actuation mode."""
        ...

    def speed(self, factor: float) -> None:
        """Run simulated time so many times as fast as the clock."""
        ...

    def load(self, instrument: str) -> None:
        """Start with another instrument, by path, shipped name or text, and operate that."""
        ...

    def restart(self) -> None:
        """Start a runtime that has gone again."""
        ...

    def tamper(self, place: str, mode: str, value: float, seconds: float) -> None:
        """Spoil a signal of the twin for a time."""
        ...

    def play(self, protocol: BenchProtocol) -> None:
        """Run a protocol."""
        ...

    def cancel(self) -> None:
        """End the protocol."""
        ...

    def close(self) -> None:
        """Let go of the runtime."""
        ...


_WAITS = " waits at "
"""In the problem of a protocol that goes on once that is mended; any other problem has ended it."""


def running(status: Status) -> bool:
    """Return whether a protocol runs, be it that it waits for something."""
    if status.protocol is None:
        return False
    _, done, total, problem = status.protocol
    return done < total and (problem is None or _WAITS in problem)


Connect: TypeAlias = Callable[[str], Link]
"""Opens a link in the name of an origin."""
