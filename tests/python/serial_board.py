"""What the tests of the serial link are made of: a board under QEMU, boards that misbehave, and a line that does.

Frames are made and read here by Python's own means, so that the C++ ones are not their own witness.
"""

import fcntl
import os
import select
import shutil
import socket
import struct
import subprocess
import tempfile
import threading
import zlib
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import NamedTuple

import pytest

from tenodesis.control.export import INTERFACE_VERSION

from .conftest import ROOT, until

VERSION = 3
PARAMETERS_SIZE = 800
HELLO, PARAMETERS, STEP, RESET, COUNTS, STOP, STREAM, KEEP = range(1, 9)
BOARD, DONE, OUTPUT, STREAMED, REFUSED = 0x81, 0x82, 0x83, 0x87, 0xFF


class Frame(NamedTuple):
    type: int
    session: int
    sequence: int
    payload: bytes = b""
    version: int = VERSION

    def encoded(self) -> bytes:
        content = struct.pack("<BBHI", self.version, self.type, self.session, self.sequence) + self.payload
        return b"\0" + _stuffed(content + struct.pack("<I", zlib.crc32(content))) + b"\0"


def decoded(stuffed: bytes) -> Frame | None:
    content = _unstuffed(stuffed)
    if len(content) < 12 or zlib.crc32(content[:-4]) != struct.unpack("<I", content[-4:])[0]:
        return None
    version, kind, session, sequence = struct.unpack("<BBHI", content[:8])
    return Frame(kind, session, sequence, content[8:-4], version)


def _stuffed(content: bytes) -> bytes:
    out = bytearray()
    for run in content.split(b"\0"):
        for at in range(0, len(run) + 1, 254):
            part = run[at : at + 254]
            out += bytes([len(part) + 1]) + part
    return bytes(out)


def _unstuffed(stuffed: bytes) -> bytes:
    out, at = bytearray(), 0
    while at < len(stuffed):
        code = stuffed[at]
        out += stuffed[at + 1 : at + code]
        at += code
        if code < 255 and at < len(stuffed):
            out.append(0)
    return bytes(out)


class Split:
    """Frames, still stuffed, out of what has come so far."""

    def __init__(self) -> None:
        self._rest = b""

    def __call__(self, received: bytes) -> list[bytes]:
        *whole, self._rest = (self._rest + received).split(b"\0")
        return [one for one in whole if one]


# ---- a board under QEMU


def firmware() -> Path:
    """Build the firmware; skip where its tools are missing."""
    for tool in ("qemu-system-arm", "arm-none-eabi-g++", "make"):
        if shutil.which(tool) is None:
            pytest.skip(f"needs {tool}")
    # Another test process must not start from a file that is still being written.
    with (Path(tempfile.gettempdir()) / f"tenodesis-firmware-{os.getuid()}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        command = ["make", "-C", str(ROOT / "firmware"), "link"]
        made = subprocess.run(command, check=False, capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
    return ROOT / "build/firmware/link.elf"


@contextmanager
def qemu(folder: Path, *, by_instructions: bool = True) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """Start the firmware; gives the address of its line. Time is what it computes, or that of the PC."""
    path = folder / "line"
    command = ["qemu-system-arm", "-M", "mps2-an386", "-display", "none", "-kernel", str(firmware())]
    command += ["-icount", "shift=6"] if by_instructions else []
    said = folder / "qemu.log"
    with said.open("wb") as log:
        process = subprocess.Popen([*command, "-serial", f"unix:{path},server=on,wait=on"], stderr=log)
    try:
        until(lambda: _listens(path), process)
        yield f"unix://{path}", process
    finally:
        process.kill()
        process.wait()


def _listens(path: Path) -> bool:
    """Whether a socket is not only bound to a path, but listens."""
    accepts = 0x10000
    lines = (line.split() for line in Path("/proc/net/unix").read_text("utf-8").splitlines()[1:])
    return any(line[-1] == str(path) and int(line[3], 16) & accepts for line in lines)


def connected(address: str) -> socket.socket:
    """Return a bare line to a board."""
    line = socket.socket(socket.AF_UNIX)
    line.settimeout(10)
    line.connect(address.removeprefix("unix://"))
    return line


def answer_to(line: socket.socket, frame: Frame, before: bytes = b"") -> Frame:
    """Send a frame, with bytes before it, and return its answer; what the last line has left over is not it."""
    line.sendall(before + frame.encoded())
    return next(one for one in frames_from(line) if one.sequence == frame.sequence)


def frames_from(line: socket.socket, until: Callable[[Frame], bool] = lambda _: False) -> Iterator[Frame]:
    """Give the whole frames that come, to the first that ends it."""
    split = Split()
    while True:
        for stuffed in split(line.recv(4096)):
            found = decoded(stuffed)
            if found is not None:
                yield found
                if until(found):
                    return


# ---- boards of Python, good and bad

Reply = Callable[[Frame], list[bytes]]


class FakeBoard:
    """Answers by its replies; without any, as a board whose controller is disabled.

    Parameters
    ----------
    reply
        Returns the bytes that answer a frame, or None for what a good board says.
    """

    def __init__(self, reply: Callable[[Frame], list[bytes] | None]) -> None:
        self._reply = reply
        self._last = 0
        self.ticks = 0

    def __call__(self, frame: Frame) -> list[bytes]:
        self.ticks += frame.type == STEP
        answer = self._reply(frame)
        if frame.type != HELLO:
            self._last = max(self._last, frame.sequence)
        return self.good(frame) if answer is None else answer

    def good(self, frame: Frame) -> list[bytes]:
        match frame.type:
            case 1:
                return [info(frame, last=self._last).encoded()]
            case 3:
                return [output(frame).encoded()]
            case _:
                return [Frame(DONE, frame.session, frame.sequence).encoded()]


def info(
    asked: Frame,
    *,
    interface: int = INTERFACE_VERSION,
    real: int = 4,
    parameters: int = PARAMETERS_SIZE,
    last: int = 0,
    streams: bool = False,
) -> Frame:
    """Return what a board says of itself: sizes in bytes, the last sequence it has answered, and if it has sensors."""
    said = struct.pack("<8I32s", interface, real, parameters, 2, 0, last, 25_000_000, streams, b"fake")
    return Frame(BOARD, asked.session, asked.sequence, said)


def refusal(asked: Frame, why: int, more: int = 0) -> Frame:
    return Frame(REFUSED, asked.session, asked.sequence, struct.pack("<2I", why, more))


def output(
    step: Frame, velocity: float = 0.0, *, state: int = 0, phase: int = 0, time: int | None = None, sequence: int = 0
) -> Frame:
    """Return the answer to a tick of one axis."""
    stamp = struct.unpack("<Q", step.payload[:8])[0] if time is None else time
    axis = struct.pack("<8f2I", velocity, velocity, 0.1, 0.01, 0, 0, 1, 0, 0, phase)
    return Frame(
        OUTPUT, step.session, sequence or step.sequence, struct.pack("<Q6I", stamp, state, 1, 0, 0, 0, 0) + axis
    )


def keep(number: int, request: int, session: int, sequence: int) -> Frame:
    """Return what keeps a board that streams going, by the robust law."""
    return Frame(KEEP, session, sequence, struct.pack("<2I2HI", request, number, 4, 1, 0))


class Streamed(NamedTuple):
    """A tick of one axis that a board has measured itself."""

    time: int
    """ns"""
    kept: int = 0
    number: int = 0
    state: int = 0
    flags: int = 0
    tension: tuple[float, float] = (25.0, 25.0)
    velocity: tuple[float, float] = (0.0, 0.0)

    def frame(self, session: int, sequence: int) -> Frame:
        measured = struct.pack("<5f", 0.0, *self.tension, 0.0, 0.0)
        answer = struct.pack("<8f2I", *self.velocity, 0.1, 0.01, 0, 0, 1, 0, 0, 0)
        tick = struct.pack("<Q6I", self.time, self.state, self.flags, 0, 0, 0, 0)
        return Frame(STREAMED, session, sequence, struct.pack("<2I", self.kept, self.number) + tick + measured + answer)

    @classmethod
    def of(cls, frame: Frame) -> "Streamed":
        kept, number, time, state, flags = struct.unpack("<2IQ2I", frame.payload[:24])
        measured, answer = struct.unpack("<5f", frame.payload[40:60]), struct.unpack("<2f", frame.payload[60:68])
        return cls(time, kept, number, state, flags, measured[1:3], answer)


@contextmanager
def behind(serve: Callable[[socket.socket], None]) -> Iterator[str]:
    """Give the address of what a thread serves over TCP."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=serve, args=(server,), daemon=True)
        thread.start()
        yield f"socket://127.0.0.1:{server.getsockname()[1]}"
    thread.join(5)


def served(reply: Reply) -> AbstractContextManager[str]:
    """Give the address of a board that a thread serves over TCP."""
    return behind(partial(_serve_once, reply=reply))


def _serve_once(server: socket.socket, reply: Reply) -> None:
    with suppress(OSError):
        line, _ = server.accept()
        with line:
            split = Split()
            while received := line.recv(4096):
                for stuffed in split(received):
                    frame = decoded(stuffed)
                    for answer in [] if frame is None else reply(frame):
                        line.sendall(answer)


@contextmanager
def terminal(reply: Reply) -> Iterator[str]:
    """Give the path of a terminal behind which a thread serves a board."""
    master, slave = os.openpty()
    ended = threading.Event()

    def serve() -> None:
        split = Split()
        while not ended.is_set():
            if not select.select([master], [], [], 0.05)[0]:
                continue
            for stuffed in split(os.read(master, 4096)):
                frame = decoded(stuffed)
                for answer in [] if frame is None else reply(frame):
                    os.write(master, answer)

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    yield os.ttyname(slave)
    ended.set()
    thread.join(5)
    os.close(master)
    os.close(slave)


# ---- a line that loses, doubles, delays and damages frames


class BadLine:
    """Stands between PC and board, and does something to every so many frames once it is started."""

    MISCHIEF = ("drop", "twice", "hold", "flip", "noise")

    def __init__(self, address: str, every: int) -> None:
        self._address = address
        self._every = every
        self._count = 0
        self._held: dict[socket.socket, bytes] = {}
        self._forgets = False
        self._parameters = Frame(PARAMETERS, 0, 0)
        self.bad = False
        self.done: dict[str, int] = dict.fromkeys(self.MISCHIEF, 0)

    def forget_session(self) -> None:
        """Have another program begin a session with the board before the next frame goes through."""
        self._forgets = True

    def between(self) -> AbstractContextManager[str]:
        return behind(self._run)

    def _run(self, server: socket.socket) -> None:
        line, _ = server.accept()
        line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        with line, connected(self._address) as board, suppress(OSError):
            others = {line: board, board: line}
            splits = {line: Split(), board: Split()}
            while True:
                for one in select.select([line, board], [], [])[0]:
                    received = one.recv(4096)
                    if not received:
                        return
                    for stuffed in splits[one](received):
                        if one is line:
                            board.sendall(self._another_program(stuffed))
                        others[one].sendall(self._passed(one, b"\0" + stuffed + b"\0"))

    def _another_program(self, stuffed: bytes) -> bytes:
        frame = decoded(stuffed)
        if frame is not None and frame.type == PARAMETERS:
            self._parameters = frame
        if not self._forgets or frame is None:
            return b""
        self._forgets = False
        return self._parameters._replace(session=self._parameters.session ^ 1, sequence=frame.sequence).encoded()

    def _passed(self, one: socket.socket, frame: bytes) -> bytes:
        late = self._held.pop(one, b"")
        if not self.bad:
            return frame + late
        self._count += 1
        if self._count % self._every:
            return frame + late
        mischief = self.MISCHIEF[self._count // self._every % len(self.MISCHIEF)]
        self.done[mischief] += 1
        if mischief == "hold":
            self._held[one] = frame
        damaged = bytearray(frame)
        damaged[len(damaged) // 2] ^= 1 << self._count % 8
        passed = {
            "drop": b"",
            "twice": frame + frame,
            "hold": b"",
            "flip": bytes(damaged),
            "noise": b"\x07noise\xff\x55" + frame,
        }
        return passed[mischief] + late
