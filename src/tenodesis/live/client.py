"""A connection to a runtime process: what it does, and what it is asked, in somebody's name."""

import json
import socket
import threading
import time
from collections import deque
from contextlib import closing
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tenodesis.devices.device import Capabilities
from tenodesis.errors import LiveError
from tenodesis.instrument import Instrument
from tenodesis.live import folder as folders
from tenodesis.live.record import Reader, run_of, signals_of
from tenodesis.live.status import ProtocolState, ProtocolStatus, RuntimeState, Status, Timing
from tenodesis.run import Array
from tenodesis.simulate import Protocol

_TIMEOUT = 5.0
"""Longest wait for an answer, s."""
_LONG_TIMEOUT = 15.0
"""The same where a recorder is ended first, s."""
_KEPT_RATE = 50.0
"""Ticks kept for `history`, Hz."""
_KEPT_SECONDS = 60.0
_DEAF = "The runtime runs and does not answer: try again, or end it; its loop pauses without an operator."
_AT_ONCE = 0.05
"""Longest wait of a stop for another order's answer, s."""
_AGAIN = ("status", "acquire", "heartbeat", "release", "stop")
"""Orders that may be given twice: a runtime closes connections that have said nothing for long where it has many."""
_GONE = "The runtime has gone: its motors are stopped by their own watchdogs. Start it again."


class Client:
    """A connection in the name of an origin; orders raise LiveError unless this one operates.

    Parameters
    ----------
    folder
        The runtime's folder.
    origin
        In whose name.

    Raises
    ------
    LiveError
        There is no runtime.
    """

    def __init__(self, folder: str | Path, origin: str) -> None:
        self.folder, self.origin = Path(folder), origin
        self._reader = Reader(self.folder)
        self._lock = threading.Lock()
        self._number = 0
        self._closed = False
        self._socket: socket.socket | None = None
        try:
            self._connect()
        except OSError as problem:
            raise LiveError(f"{self.folder} cannot be connected to: {problem.strerror or problem}.") from None
        hello = self._ask("hello", origin=origin)
        self.capabilities = Capabilities(**{**hello["capabilities"], "axes": tuple(hello["capabilities"]["axes"])})
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
    def axes(self) -> tuple[str, ...]:
        """Its axes."""
        return self._reader.axes

    @property
    def time_step(self) -> float:
        """Between ticks, s."""
        return self._reader.time_step

    @property
    def device(self) -> str:
        """Name of the device."""
        return self.capabilities.name

    @property
    def alive(self) -> bool:
        """Whether the runtime still runs."""
        return self._reader.alive

    def latest(self) -> dict[str, Any]:
        """Return the newest tick's signals by name, numbers or arrays by axis and tendon; empty before the first."""
        row = self._reader.newest()
        return {} if row is None else signals_of(row, self.axes)

    def history(self, seconds: float, rows: int = 500) -> dict[str, Array]:
        """Return the signals of the last seconds by name, time among them, at most so many rows."""
        with self._history_lock:
            self._keep()
            table = np.array(self._kept) if self._kept else np.empty((0, self._reader.columns))
        if len(table):
            table = table[table[:, 0] > table[-1, 0] - seconds]
        every = -(-len(table) // max(rows, 1)) or 1
        run = run_of(table[::-1][::every][::-1], self.axes, simulated=True, distal=True)
        return {"time": run.time, **run.signals()}

    def status(self) -> Status:
        """Return the state; where there is no runtime, that."""
        try:
            said = self._ask("status")
        except LiveError as problem:
            return self._gone(str(problem))
        values = {one.name: said[one.name] for one in fields(Status)}
        for name in ("faults", "first_faults", "realtime"):
            values[name] = tuple(values[name])
        values["timing"] = Timing(**said["timing"])
        values["state"] = RuntimeState(said["state"])
        if said["protocol"] is not None:
            name, done, total, state, wrong = said["protocol"]
            values["protocol"] = ProtocolStatus(name, done, total, ProtocolState(state), wrong)
        values["recording"] = None if said["recording"] is None else Path(said["recording"])
        self._last_status = Status(**values)
        return self._last_status

    def acquire(self, force: bool = False) -> bool:
        """Become the operator, from another if forced; return whether that worked."""
        return bool(self._ask("acquire", force=force))

    def release(self) -> None:
        """Stop being the operator; the controller pauses."""
        self._ask("release")

    def heartbeat(self) -> bool:
        """Say that the operator is still there; False from whom that is not."""
        return bool(self._ask("heartbeat"))

    def hand(self, angles: ArrayLike) -> None:
        """Let the hand go to handle angles, rad, shape (axes,)."""
        self._ask("hand", angles=_list(angles))

    def force(self, force: ArrayLike) -> None:
        """Load the tip tangentially, N, shape (axes,)."""
        self._ask("force", force=_list(force))

    def radial_force(self, force: ArrayLike) -> None:
        """Load the tip along the end-effector, N, shape (axes,)."""
        self._ask("radial_force", force=_list(force))

    def request(self, what: str) -> None:
        """Ask the controller to enable, disable, pause, resume, home or clear."""
        self._ask("request", what=what)

    def stop(self) -> None:
        """Stop the motors at once; anyone may. It waits for no other order's answer."""
        if not self._lock.acquire(timeout=_AT_ONCE):
            with closing(Client(self.folder, self.origin)) as another:
                another.stop()
            return
        try:
            self._asked("stop", {})
        finally:
            self._lock.release()

    def law(self, law: str, actuation: str) -> None:
        """Choose compensation law and actuation mode."""
        self._ask("law", law=law, actuation=actuation)

    def speed(self, factor: float) -> None:
        """Run simulated time so many times as fast as the clock; 0: as fast as it goes."""
        self._ask("speed", factor=factor)

    def tamper(self, place: str, mode: str, value: float, seconds: float, axis: str | None = None) -> None:
        """Spoil a signal of the twin for a time; a value that is not finite stands for NaN."""
        given = float(value) if np.isfinite(value) else None
        self._ask("tamper", place=place, mode=mode, value=given, seconds=seconds, axis=axis)

    def play(self, protocol: Protocol, *, record: bool = True) -> None:
        """Run a protocol, recorded unless that is not wanted."""
        self._ask("play", protocol=protocol.to_toml(), record=record)

    def cancel(self) -> None:
        """End the protocol."""
        self._ask("cancel")

    def record(self, on: bool, called: str = "live") -> Path | None:
        """Begin to record, and return where to; or end that."""
        path = self._ask("record", on=on, called=called)
        return None if path is None else Path(path)

    def close(self) -> None:
        """Let go of the runtime; if this one operates, the controller pauses."""
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

    def _ask(self, op: str, **content: Any) -> Any:
        with self._lock:
            return self._asked(op, content)

    # With the lock held.
    def _asked(self, op: str, content: dict[str, Any]) -> Any:
        self._number = number = self._number + 1
        try:
            answer = self._answered(op, content)
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
            raise LiveError(answer["error"])
        return answer["ok"]

    def _answered(self, op: str, content: dict[str, Any]) -> dict[str, Any] | None:
        if self._closed:
            raise OSError("the connection is closed")
        fresh = self._socket is None
        if fresh:
            self._connect()
            if op != "hello":
                self._exchange({"id": 0, "op": "hello", "origin": self.origin})
        order = {"id": self._number, "op": op, **content}
        try:
            answer = self._exchange(order)
        except (BrokenPipeError, ConnectionResetError):
            answer = None
        if answer is None and not fresh and op in _AGAIN:
            self._drop()
            return self._answered(op, content)
        return answer

    def _exchange(self, order: dict[str, Any]) -> dict[str, Any] | None:
        assert self._socket is not None
        self._socket.settimeout(_LONG_TIMEOUT if order["op"] in ("cancel", "stop") else _TIMEOUT)
        self._socket.sendall(json.dumps(order).encode() + b"\n")
        line = self._lines.readline()
        answer: dict[str, Any] | None = json.loads(line) if line else None
        return answer

    def _connect(self) -> None:
        connected = socket.socket(socket.AF_UNIX)
        try:
            connected.settimeout(_TIMEOUT)
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
        timing = Timing(0, 0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1 / self.time_step)
        return Status(
            RuntimeState.GONE,
            False,
            False,
            True,
            (),
            (),
            "off" if last is None else last.law,
            "differential" if last is None else last.actuation,
            None,
            timing if last is None else last.timing,
            (),
            None,
            None,
            0 if last is None else last.recorder_lost,
            0.0,
            problem,
        )


def wait_for(folder: Path, origin: str, *, seconds: float = 20.0) -> Client:
    """Return a connection to a runtime that is only starting.

    Raises
    ------
    LiveError
        It does not come to that in time.
    """
    end = time.monotonic() + seconds
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


def _list(values: ArrayLike) -> list[float]:
    return [float(one) for one in np.asarray(values, float).reshape(-1)]
