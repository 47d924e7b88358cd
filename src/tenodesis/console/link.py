"""What the page needs of the runtime: to look at it, and to ask it for things in somebody's name."""

from collections.abc import Callable, Mapping
from typing import Literal, Protocol, TypeAlias

from tenodesis.instrument import Instrument
from tenodesis.live.status import Status
from tenodesis.run import Array
from tenodesis.simulate import Protocol as BenchProtocol


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


Connect: TypeAlias = Callable[[str], Link]
"""Opens a link in the name of an origin."""
