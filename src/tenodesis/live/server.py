"""The runtime process: a live loop, and a socket of its folder where orders are taken."""

import argparse
import json
import logging
import os
import socket
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeGuard, get_args

import numpy as np

from tenodesis import simulate
from tenodesis.control import OperatingState
from tenodesis.control.controller import ActuationName, LawName, fault_names
from tenodesis.errors import DeviceError, InstrumentError, LiveError, ProtocolError
from tenodesis.files import atomic_file
from tenodesis.instrument import Instrument, load
from tenodesis.instrument.text import to_toml
from tenodesis.live import folder as folders
from tenodesis.live.ending import on_signal
from tenodesis.live.journal import Journal
from tenodesis.live.lease import Lease
from tenodesis.live.loop import Choices, DeviceName, LiveLoop
from tenodesis.live.protocols import Player
from tenodesis.live.record import TICK, Reader, signals_of
from tenodesis.live.recording_process import RecordingProcess
from tenodesis.live.status import ProtocolState, ProtocolStatus
from tenodesis.run import Array

_TURN = 0.02
"""Between looks at what has happened, s."""
_SETTLING = 0.05
"""Between a protocol's acceptance and its first row, s."""
_LONGEST_LINE = 1 << 20
"""Of an order, bytes."""
_MOST_CLIENTS = 64
_LARGEST = sys.float_info.max
_MISSED_EVERY = 0.25
"""Between two events about ticks that were missed, s."""
_log = logging.getLogger(__name__)

EXPECTED = (DeviceError, InstrumentError, LiveError, ProtocolError, ValueError)
"""What an order may come to."""


class Server:
    """Serves one loop until `finish`.

    Parameters
    ----------
    loop
        The loop; it is started and finished here.
    recordings
        Folder of recordings.

    Raises
    ------
    LiveError
        The folder cannot be written.
    """

    def __init__(self, loop: LiveLoop, recordings: Path) -> None:
        self.loop, self.folder = loop, loop.folder
        self._reader = Reader(self.folder)
        try:
            self._journal = Journal(self.folder, self._time)
        except OSError as problem:
            raise LiveError(f"{self.folder} cannot be written: {problem.strerror or problem}.") from None
        self._recorder = RecordingProcess(self.folder, recordings)
        self._lease = Lease(loop.core.lease)
        self._player: Player | None = None
        self._plays: _Connection | None = None
        self._playing = ""
        self._records_protocol = False
        self._begin_after = 0.0
        self._played: ProtocolStatus | None = None
        self._lock = threading.Lock()
        self._asking = threading.Lock()
        self._ending = threading.Event()
        self._told: tuple[int, int] = (-1, 0)
        self._troubled: tuple[bool, str | None] = (False, None)
        self._stops = 0
        self._missed = (0, 0.0)
        self._operator: str | None = None
        self._connections: set[_Connection] = set()
        self._looking = threading.Thread(target=self._look_after, name="look after", daemon=True)

    def start(self) -> None:
        """Begin to tick and to listen."""
        self._socket = _listening(self.folder / folders.SOCKET)
        self.loop.start()
        self._journal.tell("started", "runtime", law=self.loop.law, actuation=self.loop.actuation)
        threading.Thread(target=self._accept, name="accept", daemon=True).start()
        self._looking.start()

    def finish(self) -> None:
        """Stop the motors, close the recording, and end."""
        self._ending.set()
        self.loop.finish()
        with self._lock:
            self._records_protocol = False
            self._end_protocol("the runtime has ended")
        # The last that the recorder reads; whoever is held up has nothing to add.
        self._looking.join(1.0)
        self._journal.tell("ended", "runtime")
        self._recorder.stop()
        self._journal.close()
        with suppress(OSError):
            # Closed alone, it would still be waited at.
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        for connection in tuple(self._connections):
            connection.close()

    # ------------------------------------------------------------------ orders

    def answer(self, who: "_Connection", order: dict[str, Any]) -> Any:
        """Do what is ordered, and return what is to be told of it.

        Raises
        ------
        LiveError
            It is not allowed, or makes no sense; other errors of the package too.
        """
        op = order.get("op")
        if isinstance(op, str) and op in _WATCHING:
            return getattr(self, f"_{op}")(who, order)
        if not isinstance(op, str) or op not in _MOVING:
            raise LiveError(f"op is {op!r}; allowed are {', '.join((*_WATCHING, *_MOVING))}.")
        if not self._lease.held_by(who):
            holder = self._lease.origin
            held = "nobody operates: take over first" if holder is None else f"{holder} operates"
            raise LiveError(f"{who.origin} only watches; {held}.")
        answer = getattr(self, f"_{op}")(who, order)
        told = {key: order[key] for key in _MOVING[op] if key in order}
        (self._journal.tell_often if op in _OFTEN else self._journal.tell)(op, who.origin, **told)
        return answer

    def gone(self, who: "_Connection") -> None:
        """Forget a connection; if it was the operator's, pause."""
        self._connections.discard(who)
        if not self._ending.is_set() and self._lease.release(who):
            self._pause_for_absence(who.origin)

    def _pause_for_absence(self, origin: str) -> None:
        with suppress(LiveError):
            self.loop.request("pause")
        self._journal.tell("operator_gone", origin)

    def _hello(self, who: "_Connection", order: dict[str, Any]) -> Any:
        who.origin = str(order.get("origin", ""))[:200] or "unnamed"
        loop = self.loop
        capabilities = asdict(loop.capabilities)
        return {"period": loop.period, "capabilities": capabilities}

    def _status(self, _who: "_Connection", _order: dict[str, Any]) -> Any:
        loop, core = self.loop, self.loop.core
        tick = self._tick()
        state = _mask(tick, "operating_state", largest=True)
        compute, control, lateness = core.compute, core.control, core.lateness
        recorder = self._recorder
        said = recorder.status() if recorder.path is not None else {}
        return {
            "state": OperatingState(state).name,
            "homed": bool(tick.get("homed", 0)),
            "homing": bool(tick.get("homing", 0)),
            "stopped": bool(tick.get("stopped", 0)),
            "faults": fault_names(_mask(tick, "faults")),
            "first_faults": fault_names(int(tick.get("first_faults", 0))),
            "law": loop.law,
            "actuation": loop.actuation,
            "operator": self._lease.origin,
            "timing": {
                "ticks": core.ticks,
                "late": core.late,
                "missed": core.missed + loop.unanswered,
                "lost": int(said.get("lost", 0)),
                "p50": compute[0],
                "p99": compute[1],
                "worst": compute[2],
                "controller_p50": control[0],
                "controller_worst": control[2],
                "lateness_p99": lateness[1],
                "lateness_worst": lateness[2],
                "rate": 1 / loop.period,
            },
            "realtime": core.refused,
            "protocol": self._protocol(),
            "recording": None if recorder.path is None else str(recorder.path),
            "recorder_lost": int(said.get("lost", 0)),
            "speed": core.speed,
            "problem": self._problem(),
        }

    def _acquire(self, who: "_Connection", order: dict[str, Any]) -> Any:
        before = self._lease.origin
        operates = self._lease.held_by(who)
        in_the_way = self._lease.acquire(who, who.origin, force=_flag(order, "force"))
        if in_the_way is None and not operates:
            self._journal.tell("operator", who.origin, before=before)
        return in_the_way is None

    def _release(self, who: "_Connection", _order: dict[str, Any]) -> Any:
        if self._lease.release(who):
            self._pause_for_absence(who.origin)

    def _heartbeat(self, who: "_Connection", _order: dict[str, Any]) -> Any:
        return self._lease.renew(who)

    # Whoever sees that motors must stop may stop them.
    def _stop(self, who: "_Connection", _order: dict[str, Any]) -> Any:
        self.loop.stop()
        with self._asking:
            # From here on no protocol asks for anything; what it asked for before is stopped.
            self._stops += 1
            self.loop.stop()
        with self._lock:
            self._end_protocol("stopped")
        self._journal.tell_often("stop", who.origin)

    def _hand(self, _who: "_Connection", order: dict[str, Any]) -> Any:
        self._refuse_while_playing()
        self.loop.hand(_numbers(order, "angles"))

    def _force(self, _who: "_Connection", order: dict[str, Any]) -> Any:
        self._refuse_while_playing()
        self.loop.force(_numbers(order, "force"))

    def _radial_force(self, _who: "_Connection", order: dict[str, Any]) -> Any:
        self._refuse_while_playing()
        self.loop.radial_force(_numbers(order, "force"))

    def _request(self, _who: "_Connection", order: dict[str, Any]) -> Any:
        what = str(order.get("what"))
        with self._asking:
            player = self._player
            if player is not None:
                player.held = what in _HOLDING or (player.held and what not in _FREEING)
            self.loop.request(what)

    def _law(self, _who: "_Connection", order: dict[str, Any]) -> Any:
        self.loop.choose(str(order.get("law")), str(order.get("actuation")))

    def _speed(self, _who: "_Connection", order: dict[str, Any]) -> Any:
        self.loop.speed(_number(order, "factor"))

    def _tamper(self, _who: "_Connection", order: dict[str, Any]) -> Any:
        self.loop.tamper(
            str(order.get("place")),
            str(order.get("mode")),
            float("nan") if order.get("value") is None else _number(order, "value"),
            _number(order, "seconds"),
            order.get("axis"),
        )

    def _play(self, who: "_Connection", order: dict[str, Any]) -> Any:
        self._refuse_while_playing()
        stops = self._stops
        records = _flag(order, "record")
        protocol = simulate.parse(str(order.get("protocol")))
        if not self.loop.capabilities.simulated:
            raise LiveError("protocols move the handle and load the tip, which only the twin lets them do.")
        plan = protocol.plan(self.loop.inst, self.loop.period)
        player = Player(
            plan,
            _Rows(self.loop, lambda rows: self._push_for_protocol(rows, stops)),
            lambda what: self._ask_for_protocol(what, stops),
            self._tick,
            inst=self.loop.inst,
            time_step=self.loop.period,
        )
        with self._lock:
            if self._stops != stops or not self._lease.held_by(who):
                raise LiveError("it was stopped, or the operator went, before the protocol began.")
            self._refuse_while_playing()
            # A hand that still follows a slider would be elsewhere by the time the first rows are taken.
            self.loop.drop()
            if records and not self._recorder.recording:
                self._recorder.start(protocol.name)
                self._records_protocol = True
            self._begin_after = time.monotonic() + _SETTLING
            self._player, self._plays, self._playing = player, who, protocol.name
            self._played = ProtocolStatus(protocol.name, *player.progress, ProtocolState.RUNNING)

    # Whatever a protocol asks for comes before a stop or not at all.
    def _ask_for_protocol(self, what: str, stops: int) -> None:
        with self._asking:
            player = self._player
            if what in _HOLDING or (self._stops == stops and player is not None and not player.held):
                self.loop.request(what)

    def _push_for_protocol(self, rows: Array, stops: int) -> int:
        with self._asking:
            return self.loop.push(rows) if self._stops == stops else 0

    def _cancel(self, _who: "_Connection", _order: dict[str, Any]) -> Any:
        with self._lock:
            self._end_protocol("cancelled")

    def _record(self, _who: "_Connection", order: dict[str, Any]) -> Any:
        if not _flag(order, "on"):
            with self._lock:
                self._records_protocol = False
            self._recorder.stop_soon()
            return None
        return str(self._recorder.start(str(order.get("called") or "live")))

    def _refuse_while_playing(self) -> None:
        if self._player is not None:
            raise LiveError(f"the protocol {self._playing} runs; cancel it first.")

    # ------------------------------------------------------------------ beside the orders

    def _tick(self) -> dict[str, Any]:
        row = self._reader.newest()
        return {} if row is None else signals_of(row, self.loop.inst.axes)

    def _time(self) -> float:
        row = self._reader.newest()
        return 0.0 if row is None else float(row[TICK.index("time")])

    def _problem(self) -> str | None:
        return self.loop.problem or self._recorder.problem or self._journal.problem

    def _protocol(self) -> ProtocolStatus | None:
        with self._lock:
            return self._played

    def _accept(self) -> None:
        while not self._ending.is_set():
            try:
                connected, _ = self._socket.accept()
            except OSError:
                if self._ending.wait(_TURN):
                    return
                continue
            connection = _Connection(connected, self)
            self._make_room()
            self._connections.add(connection)
            try:
                threading.Thread(target=connection.serve, name="connection", daemon=True).start()
            except RuntimeError:
                # There are no more threads; whoever comes next may find some.
                self._connections.discard(connection)
                connected.close()

    # Whoever comes may have come to stop, and gets in: for those that have said least, the operator never among them.
    def _make_room(self) -> None:
        while len(self._connections) >= _MOST_CLIENTS:
            others = [one for one in tuple(self._connections) if not self._lease.held_by(one)]
            out = min(others, key=lambda one: (one.spoken, one.heard))
            self._connections.discard(out)
            out.close()
            self._journal.tell_often("sent_away", out.origin)

    def _look_after(self) -> None:
        while not self._ending.wait(_TURN):
            for work in (self._advance, self._recorder.look, self._tell_changes, self._journal.flush):
                try:
                    work()
                except Exception:
                    # Whatever goes wrong beside the loop must not end the look-out for the rest.
                    _log.exception("looking after the loop failed")

    def _advance(self) -> None:
        with self._lock:
            player = self._player
            if player is None or time.monotonic() < self._begin_after:
                return
            if self._records_protocol and not self._recorder.ready:
                return
            if not self._lease.held_by(self._plays):
                self._end_protocol("the operator has gone")
                return
            try:
                player.advance()
            except Exception as problem:
                self._end_protocol(str(problem))
                raise
            state = ProtocolState.RUNNING if player.problem is None else ProtocolState.WAITING
            self._played = ProtocolStatus(self._playing, *player.progress, state, player.problem)
            if player.finished:
                self._end_protocol(None)

    # With the lock held.
    def _end_protocol(self, why: str | None) -> None:
        player, self._player = self._player, None
        if player is None:
            return
        if why is not None:
            try:
                player.cancel()
            except LiveError:
                # What cannot be cancelled is stopped, which is never refused.
                self.loop.stop()
        state = ProtocolState.DONE if why is None else ProtocolState.ENDED
        self._played = ProtocolStatus(self._playing, *player.progress, state, why)
        self._journal.tell("protocol_ended", "runtime", protocol=self._playing, why=why or "done")
        if self._records_protocol:
            self._records_protocol = False
            self._recorder.stop_soon()

    def _tell_changes(self) -> None:
        tick = self._tick()
        if not tick:
            return
        now = (_mask(tick, "operating_state", largest=True), _mask(tick, "faults"))
        if now != self._told:
            self._told = now
            first = fault_names(int(tick["first_faults"]))
            self._journal.tell(
                "state", "runtime", state=OperatingState(now[0]).name, faults=fault_names(now[1]), first_faults=first
            )
        problem = self._problem()
        if (now_stopped := (bool(tick["stopped"]), problem)) != self._troubled:
            self._troubled = now_stopped
            self._journal.tell("problem", "runtime", stopped=now_stopped[0], text=problem)
        operator = self._lease.origin
        if self._operator is not None and operator is None:
            self._journal.tell("no_operator", "runtime", before=self._operator)
        self._operator = operator
        self._tell_missed()

    def _tell_missed(self) -> None:
        missed, (known, told) = self.loop.core.missed + self.loop.unanswered, self._missed
        if missed < known:
            self._missed = (missed, told)
        elif missed > known and time.monotonic() - told >= _MISSED_EVERY:
            self._missed = (missed, time.monotonic())
            self._journal.tell("ticks_missed", "runtime", ticks=missed - known, in_all=missed)


_WATCHING = ("hello", "status", "acquire", "release", "heartbeat", "stop")
_MOVING: dict[str, tuple[str, ...]] = {
    "hand": ("angles",),
    "force": ("force",),
    "radial_force": ("force",),
    "request": ("what",),
    "law": ("law", "actuation"),
    "speed": ("factor",),
    "tamper": ("place", "mode", "value", "seconds", "axis"),
    "play": ("protocol", "record"),
    "cancel": (),
    "record": ("on", "called"),
}
"""Orders for the operator, and what of each is written down."""
_OFTEN = ("hand", "force", "radial_force")
_HOLDING = ("pause", "disable")
"""Requests after which a protocol neither homes nor resumes by itself, until one of those that follow."""
_FREEING = ("enable", "resume", "home")


class _Rows:
    """The loop's queue of played ticks, as a player has it."""

    def __init__(self, loop: LiveLoop, push: Callable[[Array], int]) -> None:
        self._loop, self._push = loop, push

    @property
    def pending(self) -> int:
        return self._loop.pending

    def push(self, rows: Array) -> int:
        return self._push(rows)

    def drop(self) -> None:
        self._loop.drop()


class _Connection:
    """One client: a line of JSON in, a line of JSON out."""

    def __init__(self, connected: socket.socket, server: Server) -> None:
        self._socket, self._server = connected, server
        self.origin = "unnamed"
        self.spoken, self.heard = False, time.monotonic()
        """Whether it has ever said anything, and when it did last, or came."""

    def serve(self) -> None:
        try:
            with self._socket, self._socket.makefile("rb") as lines:
                while line := lines.readline(_LONGEST_LINE + 1):
                    self.spoken, self.heard = True, time.monotonic()
                    if len(line) > _LONGEST_LINE:
                        self._send({"error": f"an order is longer than {_LONGEST_LINE} bytes."})
                        return
                    self._send(self._answer(line))
        except OSError:
            pass
        finally:
            self._server.gone(self)

    def close(self) -> None:
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)

    def _answer(self, line: bytes) -> dict[str, Any]:
        try:
            order = json.loads(line)
        except (ValueError, RecursionError):
            return {"error": "an order is a line of JSON; that was none."}
        if not isinstance(order, dict):
            return {"error": "an order is a JSON object; that was none."}
        try:
            answer = {"ok": self._server.answer(self, order)}
        except EXPECTED as problem:
            answer = {"error": str(problem)}
        except Exception as problem:
            # A client's order must not end the thread that would tell of its absence.
            _log.exception("an order failed")
            answer = {"error": f"the runtime failed: {problem}"}
        return {"id": order.get("id"), **answer}

    def _send(self, answer: dict[str, Any]) -> None:
        self._socket.sendall(json.dumps(answer).encode() + b"\n")


def _listening(path: Path) -> socket.socket:
    made = socket.socket(socket.AF_UNIX)
    try:
        made.bind(str(path))
    except OSError as problem:
        raise LiveError(f"{path} cannot be listened on: {problem.strerror or problem}.") from None
    path.chmod(0o600)
    made.listen(2 * _MOST_CLIENTS)
    return made


def _mask(tick: dict[str, Any], name: str, *, largest: bool = False) -> int:
    values = np.nan_to_num(np.atleast_1d(tick.get(name, 0.0))).astype(np.int64)
    return int(values.max() if largest else np.bitwise_or.reduce(values))


def _numbers(order: dict[str, Any], key: str) -> list[float]:
    values = order.get(key)
    if not isinstance(values, list) or not all(_is_number(one) for one in values):
        raise LiveError(f"{key} is {values!r}; allowed is a list of finite numbers.")
    return [float(one) for one in values]


def _number(order: dict[str, Any], key: str) -> float:
    value = order.get(key)
    if not _is_number(value):
        raise LiveError(f"{key} is {value!r}; allowed is a finite number.")
    return float(value)


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _LARGEST


def _flag(order: dict[str, Any], key: str) -> bool:
    value = order.get(key, False)
    if not isinstance(value, bool):
        raise LiveError(f"{key} is {value!r}; allowed are true and false.")
    return value


def main(arguments: list[str] | None = None) -> int:
    """Run until SIGTERM or Ctrl-C, and say what stands against it."""
    parser = argparse.ArgumentParser(prog="python -m tenodesis.live.server", description="Run a live instrument.")
    parser.add_argument("folder", type=Path, help="folder for its ring and socket; made, for its owner alone")
    parser.add_argument("--instrument", default="scaled-up")
    parser.add_argument("--device", default="twin", choices=get_args(DeviceName))
    parser.add_argument("--address", help="of a serial device")
    parser.add_argument("--law", default="robust", choices=get_args(LawName))
    parser.add_argument("--actuation", default="differential", choices=get_args(ActuationName))
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--recordings", type=Path, default=Path("recordings"))
    parser.add_argument("--attached", action="store_true", help="end when standard input does: with what started it")
    given = parser.parse_args(arguments)
    told = threading.Event()
    with on_signal(told.set):
        try:
            server = _started(given)
        except (*EXPECTED, OSError) as problem:
            print(f"tenodesis: {problem}", file=sys.stderr)
            return 1
        if given.attached:
            threading.Thread(target=_end_with_input, args=(told,), name="attached", daemon=True).start()
        told.wait()
        server.finish()
    return 0


# Not through sys.stdin, which the interpreter cannot close at its end while a thread waits in it.
def _end_with_input(told: threading.Event) -> None:
    with suppress(OSError, ValueError):
        while os.read(sys.stdin.fileno(), 4096):
            pass
    told.set()


def _started(given: argparse.Namespace) -> Server:
    server = _made(given)
    try:
        server.start()
    except BaseException:
        server.loop.finish()
        raise
    return server


def _made(given: argparse.Namespace) -> Server:
    inst = load(given.instrument)
    given.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    others = given.folder.stat().st_mode & 0o077
    if others:
        raise LiveError(
            f"{given.folder} is open to others (mode {others:03o}); allowed is a folder of its owner alone."
        )
    with atomic_file(given.folder / folders.INSTRUMENT) as new:
        new.write_text(to_toml(inst), "utf-8")
    choices = Choices(
        device=given.device,
        address=given.address,
        law=given.law,
        actuation=given.actuation,
        speed=given.speed,
        seed=given.seed,
    )
    loop = LiveLoop(inst, given.folder, choices)
    try:
        return _served(given, inst, loop)
    except BaseException:
        loop.finish()
        raise


def _served(given: argparse.Namespace, inst: Instrument, loop: LiveLoop) -> Server:
    capabilities = loop.capabilities
    started = datetime.now(UTC).isoformat(timespec="milliseconds")
    folders.tell(
        given.folder,
        folders.About(
            inst,
            capabilities.name,
            loop.period,
            capabilities.simulated,
            capabilities.distal_encoder,
            started,
            os.getpid(),
        ),
    )
    return Server(loop, given.recordings)


if __name__ == "__main__":
    sys.exit(main())
