"""The runtime process: a live loop, and a socket in its folder that accepts commands as lines of JSON."""

import argparse
import json
import logging
import os
import socket
import sys
import threading
import time
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, get_args

from numpy.typing import ArrayLike

from tenodesis.control.controller import ActuationName, LawName
from tenodesis.devices.device import Capabilities
from tenodesis.errors import Error, LiveError
from tenodesis.files import atomic_file
from tenodesis.instrument import as_instrument
from tenodesis.instrument.text import to_toml
from tenodesis.live import folder as folders
from tenodesis.live.commands import COMMANDS, Commands, ControllerRequest
from tenodesis.live.loop import Choices, DeviceName, LiveLoop
from tenodesis.live.runtime import Runtime
from tenodesis.live.shutdown import on_signal
from tenodesis.live.status import Status
from tenodesis.simulate import Protocol
from tenodesis.twin import Held

_RETRY = 0.02
"""Wait after a connection that could not be accepted, s."""
_LONGEST_LINE = 1 << 20
"""Largest size of a command, bytes."""
_MOST_CLIENTS = 64
_log = logging.getLogger(__name__)

EXPECTED = (Error, ValueError)
"""Exceptions that a command may raise."""


class Server:
    """Serves a loop until `finish`.

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
        self.loop = loop
        self.runtime = Runtime(loop, recordings)
        self._ending = threading.Event()
        self._clients: set[_ClientHandler] = set()

    def start(self) -> None:
        """Begin to tick and to listen."""
        self._socket = _listening(self.loop.folder / folders.SOCKET)
        self.runtime.start()
        threading.Thread(target=self._accept, name="accept", daemon=True).start()

    def finish(self) -> None:
        """Stop the motors, close the recording, and end."""
        self._ending.set()
        self.runtime.finish()
        with suppress(OSError):
            # Closed alone, the thread that accepts would still wait for it.
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        for client in tuple(self._clients):
            client.disconnect()

    def gone(self, client: "_ClientHandler") -> None:
        """Forget a client; if it was the operator, pause."""
        self._clients.discard(client)
        self.runtime.release(client, client.origin)

    def _accept(self) -> None:
        while not self._ending.is_set():
            try:
                connected, _ = self._socket.accept()
            except OSError:
                if self._ending.wait(_RETRY):
                    return
                continue
            client = _ClientHandler(connected, self)
            self._make_room()
            self._clients.add(client)
            try:
                threading.Thread(target=client.serve, name="client", daemon=True).start()
            except RuntimeError:
                # There are no more threads; the next client may find some.
                self._clients.discard(client)
                connected.close()

    # A new client may be needed to stop, so it is accepted, and the least active is closed; never the operator.
    def _make_room(self) -> None:
        while len(self._clients) >= _MOST_CLIENTS:
            others = [client for client in tuple(self._clients) if not self.runtime.lease.held_by(client)]
            out = min(others, key=lambda client: (client.spoken, client.heard))
            self._clients.discard(out)
            out.disconnect()
            self.runtime.journal.write_merged("sent_away", out.origin)


def _details(problem: Exception) -> dict[str, Any]:
    """Return key, value and what is allowed of an error, as JSON can carry them."""
    if not isinstance(problem, Error) or not problem.key:
        return {}
    value = problem.value
    plain = value if value is None or isinstance(value, bool | int | float | str) else str(value)
    return {"key": problem.key, "value": plain, "allowed": problem.allowed}


class _ClientHandler(Commands):
    """Carries out the commands of a client: a line of JSON in, a line of JSON out."""

    def __init__(self, connected: socket.socket, server: Server) -> None:
        self._socket, self._server, self._runtime = connected, server, server.runtime
        self.origin = "unnamed"
        self.spoken, self.heard = False, time.monotonic()
        """Whether it has ever sent a command, and the time of its last command or its connection."""
        self._stops = 0
        """Number of stops of the motors when the command came."""

    def serve(self) -> None:
        try:
            with self._socket, self._socket.makefile("rb") as lines:
                while line := lines.readline(_LONGEST_LINE + 1):
                    self.spoken, self.heard = True, time.monotonic()
                    if len(line) > _LONGEST_LINE:
                        self._send({"error": f"a command is longer than {_LONGEST_LINE} bytes."})
                        return
                    self._send(self._answer(line))
        except OSError:
            pass
        finally:
            self._server.gone(self)

    def disconnect(self) -> None:
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)

    def _answer(self, line: bytes) -> dict[str, Any]:
        try:
            message = json.loads(line)
        except (ValueError, RecursionError):
            return {"error": "a command is a line of JSON; that was none."}
        if not isinstance(message, dict):
            return {"error": "a command is a JSON object; that was none."}
        try:
            answer = {"ok": self._carry_out(message)}
        except EXPECTED as problem:
            answer = {"error": str(problem), **_details(problem)}
        except Exception as problem:
            # A client's command must not end the thread that would notice its absence.
            _log.exception("a command failed")
            answer = {"error": f"the runtime failed: {problem}"}
        return {"id": message.get("id"), **answer}

    def _send(self, answer: dict[str, Any]) -> None:
        self._socket.sendall(json.dumps(answer).encode() + b"\n")

    def _carry_out(self, message: dict[str, Any]) -> Any:
        name = message.get("op")
        command = COMMANDS.get(name) if isinstance(name, str) else None
        if command is None:
            raise LiveError(key="op", value=name, allowed=f"one of {', '.join(COMMANDS)}")
        runtime = self._runtime
        # Before the arguments are read, which may take long: a stop meanwhile wins.
        self._stops = runtime.protocols.stops
        if command.needs_lease and not runtime.lease.held_by(self):
            holder = runtime.lease.origin
            held = "there is no operator: take over first" if holder is None else f"{holder} operates"
            raise LiveError(
                f"{self.origin} only watches; {held}.", key="operator", value=holder, allowed=str(self.origin)
            )
        arguments = command.decode(message)
        if command.by_hand:
            runtime.protocols.refuse_while_playing()
        # What has no method here, the loop carries out by its own.
        result = command.call(self if command.name in vars(_ClientHandler) else runtime.loop, arguments)
        if command.needs_lease:
            write = runtime.journal.write_merged if command.streamed else runtime.journal.write
            write(command.name, self.origin, **{key: message[key] for key in command.parameters if key in message})
        return command.result.dump_python(result, mode="json")

    def hello(self, origin: str = "") -> Capabilities:
        self.origin = origin[:200] or "unnamed"
        return self._runtime.loop.capabilities

    def status(self) -> Status:
        return self._runtime.status()

    def acquire(self, force: bool = False) -> bool:
        lease = self._runtime.lease
        before, operates = lease.origin, lease.held_by(self)
        acquired = lease.acquire(self, self.origin, force=force) is None
        if acquired and not operates:
            self._runtime.journal.write("operator", self.origin, before=before)
        return acquired

    def release(self) -> None:
        self._runtime.release(self, self.origin)

    def heartbeat(self) -> bool:
        return self._runtime.lease.renew(self)

    def stop(self) -> None:
        self._runtime.protocols.stop()
        self._runtime.journal.write_merged("stop", self.origin)

    def motors(self, angles: ArrayLike) -> None:
        self._runtime.loop.move_motors(angles)

    def hold(self, opening: float, stiffness: float, damping: float = 0.0) -> None:
        self._runtime.hold(Held(opening, stiffness, damping) if stiffness else None)

    def request(self, what: ControllerRequest) -> None:
        self._runtime.protocols.request(what)

    def law(self, law: str, actuation: str) -> None:
        self._runtime.loop.choose(law, actuation)

    def play(self, protocol: Protocol, record: bool = True) -> None:
        self._runtime.protocols.play(protocol, self, record=record, stops=self._stops)

    def cancel(self) -> None:
        self._runtime.protocols.end("cancelled")

    def record(self, on: bool, called: str = "live") -> Path | None:
        recorder = self._runtime.recorder
        if on:
            return recorder.start(called or "live")
        self._runtime.protocols.leave_recording()
        recorder.stop_soon()
        return None


def _listening(path: Path) -> socket.socket:
    made = socket.socket(socket.AF_UNIX)
    try:
        made.bind(str(path))
    except OSError as problem:
        raise LiveError(
            f"{path} cannot be listened on: {problem.strerror or problem}.", key="path", value=path
        ) from None
    path.chmod(0o600)
    made.listen(2 * _MOST_CLIENTS)
    return made


def main(arguments: list[str] | None = None) -> int:
    """Run until SIGTERM or Ctrl-C; return the exit code."""
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
    ending = threading.Event()
    with on_signal(ending.set):
        try:
            server = _started(given)
        except (*EXPECTED, OSError) as problem:
            print(f"tenodesis: {problem}", file=sys.stderr)
            return 1
        if given.attached:
            threading.Thread(target=_end_with_input, args=(ending,), name="attached", daemon=True).start()
        ending.wait()
        server.finish()
    return 0


# Not through sys.stdin, which the interpreter cannot close at its end while a thread waits in it.
def _end_with_input(ending: threading.Event) -> None:
    with suppress(OSError, ValueError):
        while os.read(sys.stdin.fileno(), 4096):
            pass
    ending.set()


def _started(given: argparse.Namespace) -> Server:
    inst = as_instrument(given.instrument)
    given.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    others = given.folder.stat().st_mode & 0o077
    if others:
        raise LiveError(
            f"{given.folder} is open to others (mode {others:03o}); it must be its owner's alone.",
            key="folder",
            value=given.folder,
            allowed="its owner's alone",
        )
    with atomic_file(given.folder / folders.INSTRUMENT) as new:
        new.write_text(to_toml(inst), "utf-8")
    options = ("device", "address", "law", "actuation", "speed", "seed")
    loop = LiveLoop(inst, given.folder, Choices(**{name: getattr(given, name) for name in options}))
    try:
        folders.write(given.folder, _about(loop))
        server = Server(loop, given.recordings)
        server.start()
    except BaseException:
        loop.finish()
        raise
    return server


def _about(loop: LiveLoop) -> folders.About:
    """Return the description of the runtime of this process."""
    has, started = loop.capabilities, datetime.now(UTC).isoformat(timespec="milliseconds")
    columns = loop.device.commands, loop.device.signals
    return folders.About(
        loop.inst, has.name, loop.period, has.simulated, has.distal_encoder, started, os.getpid(), *columns
    )


if __name__ == "__main__":
    sys.exit(main())
