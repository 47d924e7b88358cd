"""A connection to a runtime process over the socket in its folder."""

import json
import math
import socket
import threading
import time
from collections import deque
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from tenodesis.devices.device import Capabilities
from tenodesis.errors import LiveError
from tenodesis.instrument import Instrument
from tenodesis.live import folder as folders
from tenodesis.live.commands import COMMANDS, Connection, LiveCommand
from tenodesis.live.status import RuntimeState, Status, Timing
from tenodesis.live.ticks import Reader
from tenodesis.run import Array, Names

_TO_START = 20.0
"""Longest wait for a runtime that is starting, s."""
_TIMEOUT = 5.0
"""Longest wait for a connection, s."""
_KEPT_RATE = 50.0
"""Ticks kept for `history`, Hz."""
_KEPT_SECONDS = 60.0
_DEAF = "The runtime runs and does not answer: try again, or end it; its loop pauses without an operator."
_AT_ONCE = 0.05
"""Longest wait of a stop for another command's answer, s."""
_GONE = "The runtime has ended: its motors are stopped by their own watchdogs. Start it again."

_ABOUT = ("key", "value", "allowed")
"""What an error of the runtime carries beside its sentence."""


class Client(Connection):
    """A connection to a runtime process in the name of an origin.

    Parameters
    ----------
    folder
        The runtime's folder.
    origin
        Name of the client, as others see it.
    patience
        Longest wait for an answer, s; by default that of each command.

    Raises
    ------
    LiveError
        There is no runtime.
    """

    def __init__(self, folder: str | Path, origin: str, *, patience: float = math.inf) -> None:
        self.folder, self.origin, self._patience = Path(folder), origin, patience
        self._reader = Reader(self.folder)
        self._lock = threading.Lock()
        self._number = 0
        self._closed = False
        self._socket: socket.socket | None = None
        try:
            self._connect()
        except OSError as problem:
            raise LiveError(
                f"{self.folder} cannot be connected to: {problem.strerror or problem}.", key="folder", value=self.folder
            ) from None
        self._capabilities = self.hello(origin)
        self._every = max(1, round(1 / _KEPT_RATE / self.time_step))
        self._kept: deque[Array] = deque(maxlen=round(_KEPT_SECONDS * _KEPT_RATE))
        self._history_lock = threading.Lock()
        self._next = 0
        self._last_status: Status | None = None

    @property
    def inst(self) -> Instrument:
        """The instrument."""
        return self._reader.inst

    @property
    def names(self) -> Names:
        """What the columns of its rows are named after."""
        return self._reader.names

    @property
    def time_step(self) -> float:
        """Between ticks, s."""
        return self._reader.time_step

    @property
    def capabilities(self) -> Capabilities:
        """Capabilities of the device."""
        return self._capabilities

    @property
    def alive(self) -> bool:
        """Whether the runtime still runs."""
        return self._reader.alive

    def latest(self) -> dict[str, Any]:
        """Return the newest tick's signals by name, scalars or arrays by joint and tendon; empty before the first."""
        return self._reader.signals()

    def history(self, seconds: float, rows: int = 500) -> dict[str, Array]:
        """Return the signals of the last seconds by name, with ``time`` (s), thinned to at most `rows` rows."""
        with self._history_lock:
            self._keep()
            table = np.array(self._kept) if self._kept else np.empty((0, self._reader.columns))
        if len(table):
            table = table[table[:, 0] > table[-1, 0] - seconds]
        every = -(-len(table) // max(rows, 1)) or 1
        return self._reader.layout.history_of(table[::-1][::every][::-1])

    def status(self) -> Status:
        """Return the state of the runtime; GONE if it has ended."""
        try:
            self._last_status = super().status()
        except LiveError as problem:
            return self._gone(str(problem))
        return self._last_status

    def stop(self) -> None:
        """Stop the motors at once; anyone may. It waits for no other command's answer."""
        if not self._lock.acquire(timeout=_AT_ONCE):
            with closing(Client(self.folder, self.origin)) as another:
                another.stop()
            return
        try:
            self._ask(COMMANDS["stop"], {})
        finally:
            self._lock.release()

    def close(self) -> None:
        """Close the connection; if it holds the lease, the controller pauses."""
        with self._lock:
            self._closed = True
            self._drop()

    def _keep(self) -> None:
        while True:
            rows, lost = self._reader.rows(4096)
            first = (self._next - lost) % self._every
            self._kept.extend(rows[first :: self._every].copy())
            self._next = (first - len(rows)) % self._every
            if len(rows) < 4096:
                return

    def send(self, command: LiveCommand, arguments: Mapping[str, Any]) -> Any:
        """Send a command, and return the runtime's answer."""
        message = command.encode(arguments)
        with self._lock:
            answer = self._ask(command, message)
        return command.result.validate_python(answer)

    # With the lock held.
    def _ask(self, command: LiveCommand, message: dict[str, Any]) -> Any:
        self._number = number = self._number + 1
        try:
            answer = self._answer(command, message)
        except (OSError, ValueError) as problem:
            answer = None
            why = f"{_DEAF} ({problem})" if isinstance(problem, TimeoutError | ValueError) else _GONE
        else:
            why = _GONE if answer is None else _DEAF
        if answer is None or answer.get("id") != number:
            self._drop()
        if answer is None or answer.get("id") not in (None, number):
            raise LiveError(why)
        if "error" in answer:
            raise LiveError(answer.pop("error"), **{name: answer[name] for name in _ABOUT if name in answer})
        return answer["ok"]

    def _answer(self, command: LiveCommand, message: dict[str, Any]) -> dict[str, Any] | None:
        if self._closed:
            raise OSError("the connection is closed")
        fresh = self._socket is None
        if fresh:
            self._connect()
            if command is not COMMANDS["hello"]:
                self._exchange({"id": 0, "op": "hello", "origin": self.origin}, COMMANDS["hello"].timeout)
        try:
            answer = self._exchange({"id": self._number, "op": command.name, **message}, command.timeout)
        except (BrokenPipeError, ConnectionResetError):
            answer = None
        # A runtime with many connections closes those that have been silent for long.
        if answer is None and not fresh and command.repeatable:
            self._drop()
            return self._answer(command, message)
        return answer

    def _exchange(self, message: dict[str, Any], timeout: float) -> dict[str, Any] | None:
        assert self._socket is not None
        self._socket.settimeout(min(timeout, self._patience))
        self._socket.sendall(json.dumps(message).encode() + b"\n")
        line = self._lines.readline()
        answer: dict[str, Any] | None = json.loads(line) if line else None
        return answer

    def _connect(self) -> None:
        connected = socket.socket(socket.AF_UNIX)
        try:
            connected.settimeout(min(_TIMEOUT, self._patience))
            _reach(connected, self.folder / folders.SOCKET)
        except OSError:
            connected.close()
            raise
        self._socket, self._lines = connected, connected.makefile("rb")

    # After an answer that did not come, the next might be that one.
    def _drop(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._lines.close()
        self._socket = None

    def _gone(self, problem: str) -> Status:
        last = self._last_status
        return Status(
            state=RuntimeState.GONE,
            law="off" if last is None else last.law,
            actuation="differential" if last is None else last.actuation,
            timing=Timing(1 / self.time_step) if last is None else last.timing,
            recorder_lost=0 if last is None else last.recorder_lost,
            problem=problem,
        )


def wait_for(folder: Path, origin: str) -> Client:
    """Return a connection to a runtime that may still be starting.

    Raises
    ------
    LiveError
        It does not come to that in time.
    """
    end = time.monotonic() + _TO_START
    while True:
        try:
            return Client(folder, origin)
        except LiveError:
            if time.monotonic() > end:
                raise
            time.sleep(0.05)


def _reach(connected: socket.socket, path: Path) -> None:
    end = time.monotonic() + _TIMEOUT
    while True:
        try:
            connected.connect(str(path))
        except BlockingIOError:
            # So many others come at once that there is no place to wait in.
            if time.monotonic() > end:
                raise
            time.sleep(0.005)
        else:
            return
