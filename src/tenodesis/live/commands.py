"""The commands of a live runtime: name, arguments and result of each.

A connection sends them (:mod:`tenodesis.live.client`), the server carries them out (:mod:`tenodesis.live.server`).
"""

import inspect
import math
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, Concatenate, Literal, NamedTuple, ParamSpec, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import TypeAdapter

from tenodesis import simulate
from tenodesis.devices.device import Capabilities
from tenodesis.errors import LiveError
from tenodesis.instrument import Instrument
from tenodesis.live.status import Status
from tenodesis.run import Array
from tenodesis.simulate import Protocol

_P = ParamSpec("_P")
_R = TypeVar("_R")
_LARGEST = sys.float_info.max
_TIMEOUT = 5.0
"""Longest wait for an answer, s."""
RECORDER_TIMEOUT = 15.0
"""The same where a recorder may have to end first, s."""

ControllerRequest: TypeAlias = Literal["enable", "disable", "pause", "resume", "home", "clear"]
OrNaN: TypeAlias = Annotated[float, "or NaN"]
"""A number that need not be finite."""


class _Kind(NamedTuple):
    """Encoding of a kind of argument."""

    encode: Callable[[Any], Any]
    """Returns the argument as JSON; raises TypeError where it is of another kind."""
    decode: Callable[[Any], Any]
    """Returns JSON as the argument; raises TypeError where it is of another kind."""
    allowed: str


def _number(value: Any) -> float:
    if not isinstance(value, int | float) or isinstance(value, bool) or not abs(value) <= _LARGEST:
        raise TypeError
    return float(value)


def _numbers(values: Any) -> list[float]:
    if not isinstance(values, list):
        raise TypeError
    return [_number(value) for value in values]


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError
    return value


def _flag(value: Any) -> bool:
    if not isinstance(value, bool | np.bool_):
        raise TypeError
    return bool(value)


def _sent_number(value: Any) -> float:
    """Return a number of Python or NumPy, finite or not: what is beyond its bounds is the server's to refuse."""
    array = np.asarray(value)
    if array.dtype.kind not in "iuf" or array.size != 1:
        raise TypeError
    return float(array.reshape(())[()])


_KINDS: dict[Any, _Kind] = {
    bool: _Kind(_flag, _flag, "true or false"),
    float: _Kind(_sent_number, _number, "a finite number"),
    OrNaN: _Kind(
        lambda value: _sent_number(value) if np.isfinite(_sent_number(value)) else None,
        lambda value: math.nan if value is None else _number(value),
        "a finite number, or null for NaN",
    ),
    str: _Kind(str, _text, "text"),
    str | None: _Kind(lambda value: value, lambda value: None if value is None else _text(value), "text, or null"),
    ControllerRequest: _Kind(str, _text, "text"),
    ArrayLike: _Kind(
        lambda values: np.asarray(values, float).reshape(-1).tolist(), _numbers, "a list of finite numbers"
    ),
    Protocol: _Kind(
        lambda protocol: protocol.to_toml(), lambda text: simulate.parse(_text(text)), "the text of a protocol"
    ),
}


@dataclass(frozen=True)
class LiveCommand:
    """An entry of the table of commands."""

    name: str
    needs_lease: bool
    """Whether only the operator may send it."""
    repeatable: bool
    """Whether it may be sent again if its answer does not come."""
    by_hand: bool
    """Whether it moves or loads the instrument as a protocol does, and is refused while one runs."""
    streamed: bool
    """Whether it comes many times a second, so that its events are merged."""
    timeout: float
    """Longest wait for its answer, s."""
    parameters: Mapping[str, inspect.Parameter]
    result: TypeAdapter[Any]

    def encode(self, arguments: Mapping[str, Any]) -> dict[str, Any]:
        """Return arguments as JSON.

        Raises
        ------
        LiveError
            One is not of its kind.
        """
        message = {}
        for name, value in arguments.items():
            try:
                message[name] = self._kind(name).encode(value)
            except TypeError:
                raise LiveError(key=name, value=value, allowed=self._kind(name).allowed) from None
        return message

    def decode(self, message: Mapping[str, Any]) -> dict[str, Any]:
        """Return the arguments in a message.

        Raises
        ------
        LiveError
            One is missing, or not of its kind.
        ProtocolError
            A protocol is not valid.
        """
        arguments = {}
        for name, parameter in self.parameters.items():
            if name not in message and parameter.default is not inspect.Parameter.empty:
                arguments[name] = parameter.default
                continue
            kind, value = self._kind(name), message.get(name)
            try:
                arguments[name] = kind.decode(value)
            except TypeError:
                raise LiveError(key=name, value=value, allowed=kind.allowed) from None
        return arguments

    def call(self, on: Any, arguments: Mapping[str, Any]) -> Any:
        """Call the command on an object that accepts commands."""
        return getattr(on, self.name)(**arguments)

    def _kind(self, name: str) -> _Kind:
        return _KINDS[self.parameters[name].annotation]


COMMANDS: dict[str, LiveCommand] = {}
"""The table, by name; the class below fills it."""


def _command(
    *,
    needs_lease: bool = True,
    repeatable: bool = False,
    by_hand: bool = False,
    streamed: bool = False,
    timeout: float = _TIMEOUT,
) -> Callable[[Callable[Concatenate[Any, _P], _R]], Callable[Concatenate[Any, _P], _R]]:
    """Enter a method's signature into the table; the method then sends the command."""

    def enter(method: Callable[Concatenate[Any, _P], _R]) -> Callable[Concatenate[Any, _P], _R]:
        signature = inspect.signature(method)
        parameters = {name: one for name, one in signature.parameters.items() if name != "self"}
        result: TypeAdapter[Any] = TypeAdapter(signature.return_annotation)
        entry = LiveCommand(
            method.__name__, needs_lease, repeatable, by_hand or streamed, streamed, timeout, parameters, result
        )
        COMMANDS[entry.name] = entry

        @wraps(method)
        def send(commands: Any, /, *args: _P.args, **kwargs: _P.kwargs) -> _R:
            bound = signature.bind(commands, *args, **kwargs)
            bound.apply_defaults()
            answer: _R = commands.send(entry, {name: bound.arguments[name] for name in parameters})
            return answer

        return send

    return enter


class Commands:
    """The commands that a runtime accepts: each method sends its command, unless a class carries it out itself.

    Commands that move the instrument or change what it does need the operator's lease. LiveError is raised without it,
    and for every command that the runtime cannot carry out.
    """

    def send(self, command: LiveCommand, arguments: Mapping[str, Any]) -> Any:
        """Send a command and return its answer."""
        raise LiveError(f"the command {command.name} is not available here.", key="op", value=command.name)

    @_command(needs_lease=False)
    def hello(self, origin: str = "") -> Capabilities:
        """Name the connection by its origin, and return the device's capabilities."""
        raise NotImplementedError

    @_command(needs_lease=False, repeatable=True)
    def status(self) -> Status:
        """Return the state of the runtime."""
        raise NotImplementedError

    @_command(needs_lease=False, repeatable=True)
    def acquire(self, force: bool = False) -> bool:
        """Become the operator, taking the lease from another if forced; return whether that worked."""
        raise NotImplementedError

    @_command(needs_lease=False, repeatable=True)
    def release(self) -> None:
        """Stop being the operator; the controller pauses."""

    @_command(needs_lease=False, repeatable=True)
    def heartbeat(self) -> bool:
        """Renew the operator's lease; return whether this connection holds it."""
        raise NotImplementedError

    @_command(needs_lease=False, repeatable=True, timeout=RECORDER_TIMEOUT)
    def stop(self) -> None:
        """Stop the motors at once; anyone may."""

    @_command(streamed=True)
    def hand(self, angles: ArrayLike) -> None:
        """Move the handle's joints or, without a handle, those at the tip by their motors, to angles, rad."""

    @_command(streamed=True)
    def motors(self, angles: ArrayLike) -> None:
        """Turn the spools whose motors no controller commands to angles, rad, in the order of their tendons."""

    @_command(streamed=True)
    def force(self, force: ArrayLike) -> None:
        """Load the tip tangentially, N, shape (axes,)."""

    @_command(streamed=True)
    def radial_force(self, force: ArrayLike) -> None:
        """Load the tip along the end-effector, N, shape (axes,)."""

    @_command(streamed=True)
    def wrench(self, wrench: ArrayLike) -> None:
        """Load the tip with a force (N) and a moment (N m) in its axes, shape (6,)."""

    @_command(streamed=True)
    def grip_force(self, force: float) -> None:
        """Press the jaws apart with a force, N."""

    @_command(by_hand=True)
    def hold(self, opening: float, stiffness: float, damping: float = 0.0) -> None:
        """Put something between the jaws, as :class:`tenodesis.twin.Held`; a stiffness of 0 takes it away."""

    @_command()
    def request(self, what: ControllerRequest) -> None:
        """Request the controller to enable, disable, pause, resume, home or clear."""

    @_command()
    def law(self, law: str, actuation: str) -> None:
        """Choose compensation law and actuation mode."""

    @_command()
    def speed(self, factor: float) -> None:
        """Run simulated time at this multiple of wall time; 0: as fast as possible."""

    @_command()
    def inject_fault(self, point: str, mode: str, value: OrNaN, seconds: float, axis: str | None = None) -> None:
        """Inject a fault into a signal of the twin for a time, on one axis or all; a value may be NaN."""

    @_command()
    def play(self, protocol: Protocol, record: bool = True) -> None:
        """Run a protocol, and record it."""

    @_command(timeout=RECORDER_TIMEOUT)
    def cancel(self) -> None:
        """End the protocol."""

    @_command()
    def record(self, on: bool, called: str = "live") -> Path | None:
        """Begin to record, and return the file; or end the recording."""
        raise NotImplementedError


class Connection(Commands, ABC):
    """A connection to a live instrument in the name of an origin: commands, and the signals of its ticks."""

    @property
    @abstractmethod
    def inst(self) -> Instrument:
        """The instrument that runs."""

    @property
    @abstractmethod
    def capabilities(self) -> Capabilities:
        """Capabilities of the device."""

    @property
    def device(self) -> str:
        """Name of the device."""
        return self.capabilities.name

    @abstractmethod
    def latest(self) -> dict[str, Any]:
        """Return the signals of the newest tick by name, with ``time`` (s); empty before the first."""

    @abstractmethod
    def history(self, seconds: float, rows: int = 500) -> dict[str, Array]:
        """Return the signals of the last seconds by name, with ``time`` (s), thinned to at most `rows` rows."""

    @abstractmethod
    def close(self) -> None:
        """Close the connection; if it holds the lease, the controller pauses."""


class RestartableConnection(Connection):
    """A connection that outlasts its runtime."""

    @abstractmethod
    def stop_for(self, origin: str) -> None:
        """Stop the motors at once in the name of another origin, which needs no connection of its own."""

    @abstractmethod
    def load(self, instrument: str) -> None:
        """Start with another instrument, by path, shipped name or text, and operate that."""

    @abstractmethod
    def restart(self) -> None:
        """Restart a runtime that has ended."""


Connect: TypeAlias = Callable[[str], RestartableConnection]
"""Opens a connection in the name of an origin."""
