"""A runtime process of this process: restarted with another instrument, ended with its parent."""

import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from tenodesis.devices.device import Capabilities
from tenodesis.errors import LiveError
from tenodesis.files import atomic_file
from tenodesis.instrument import Instrument, load, parse
from tenodesis.instrument.text import to_toml
from tenodesis.live.client import Client
from tenodesis.live.commands import Command, RestartableConnection
from tenodesis.live.loop import Choices
from tenodesis.run import Array

_TO_START = 30.0
_TO_END = 15.0
_SHARED = Path("/dev/shm")
"""A folder in memory, so that the ring is not written to a disk."""
_PREFIX = "tenodesis-"


class Host:
    """Runs the runtime process of an instrument.

    Parameters
    ----------
    instrument
        Instrument file, or the name of one that is shipped.
    choices
        Device, law and more.
    recordings
        Folder of recordings.

    Raises
    ------
    InstrumentError
        The instrument is not valid.
    LiveError
        The runtime does not start; the message states why.
    """

    def __init__(self, instrument: str, choices: Choices | None = None, recordings: Path = Path("recordings")) -> None:
        self.choices, self.recordings = choices or Choices(), recordings
        self._lock = threading.RLock()
        _tidy()
        self._home = Path(tempfile.mkdtemp(prefix=f"{_PREFIX}{os.getpid()}-", dir=_place()))
        self.generation = 0
        """Number of runtimes started."""
        self._process: subprocess.Popen[bytes] | None = None
        try:
            self.start(instrument)
        except BaseException:
            self.close()
            raise

    @property
    def folder(self) -> Path:
        """Folder of the present runtime."""
        return self._home / str(self.generation)

    @property
    def pid(self) -> int | None:
        """Process id of the runtime."""
        return None if self._process is None else self._process.pid

    def start(self, instrument: str) -> None:
        """Restart with another instrument; if it is not valid, the present runtime continues.

        Parameters
        ----------
        instrument
            Path or shipped name, or the text of an instrument file.
        """
        inst = parse(instrument, "the instrument file") if "\n" in instrument else load(instrument)
        with self._lock:
            self._end()
            self.generation += 1
            file = self._home / f"{self.generation}.toml"
            with atomic_file(file) as new:
                new.write_text(to_toml(inst), "utf-8")
            self._begin(file)

    def again(self) -> None:
        """Start again, as after it was killed."""
        self.start(str(self._home / f"{self.generation}.toml"))

    def close(self) -> None:
        """End the runtime, motors at rest; a second call does nothing."""
        with self._lock:
            self._end()
            shutil.rmtree(self._home, ignore_errors=True)

    def connect(self, origin: str) -> "HostConnection":
        """Return a connection in the name of an origin, which outlasts a restart."""
        return HostConnection(self, origin)

    def _begin(self, file: Path) -> None:
        choices = self.choices
        options = {
            "--instrument": str(file),
            "--device": choices.device,
            "--law": choices.law,
            "--actuation": choices.actuation,
            "--speed": str(choices.speed),
            "--seed": str(choices.seed),
            "--recordings": str(self.recordings.absolute()),
        } | ({} if choices.address is None else {"--address": choices.address})
        arguments = [part for pair in options.items() for part in pair]
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tenodesis.live.server", str(self.folder), "--attached", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )
        try:
            self._wait()
        except BaseException:
            # A runtime that starts later would occupy its device unnoticed.
            self._end()
            raise

    def _wait(self) -> None:
        end = time.monotonic() + _TO_START
        process = self._process
        assert process is not None
        while True:
            try:
                Client(self.folder, "host").close()
            except LiveError:
                pass
            else:
                # Nothing reads its output from here on, and a full pipe would block it.
                threading.Thread(target=_drain, args=(process,), daemon=True).start()
                return
            if process.poll() is not None:
                said = b"" if process.stderr is None else process.stderr.read()
                lines = said.decode("utf-8", "replace").strip().splitlines()
                why = lines[-1].removeprefix("tenodesis: ") if lines else f"it ended with code {process.returncode}."
                raise LiveError(why)
            if time.monotonic() > end:
                raise LiveError(f"the runtime has not started within {_TO_START:g} s.")
            time.sleep(0.05)

    def _end(self) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        process.terminate()
        try:
            process.wait(_TO_END)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        for pipe in (process.stdin, process.stderr):
            if pipe is not None:
                pipe.close()


class HostConnection(RestartableConnection):
    """A :class:`~tenodesis.live.client.Client` that follows to the runtime that is started next."""

    def __init__(self, host: Host, origin: str) -> None:
        self._host, self._origin = host, origin
        self._lock = threading.Lock()
        self._generation = host.generation
        self._client = Client(host.folder, origin)

    def send(self, command: Command, arguments: Mapping[str, Any]) -> Any:
        """Send a command to the runtime that runs now, and return its answer."""
        return command.call(self._current(), arguments)

    @property
    def inst(self) -> Instrument:
        """The instrument that runs."""
        return self._current().inst

    @property
    def capabilities(self) -> Capabilities:
        """Capabilities of its device."""
        return self._current().capabilities

    @property
    def alive(self) -> bool:
        """Whether the runtime still runs."""
        return self._current().alive

    def latest(self) -> dict[str, Any]:
        """Return the signals of the newest tick by name; empty before the first."""
        return self._current().latest()

    def history(self, seconds: float, rows: int = 500) -> dict[str, Array]:
        """Return the signals of the last seconds by name."""
        return self._current().history(seconds, rows)

    def load(self, instrument: str) -> None:
        """Start with another instrument, by path, shipped name or text, and operate that; needs the lease.

        Raises
        ------
        InstrumentError
            It is not valid; the present runtime goes on.
        LiveError
            This connection does not hold the lease.
        """
        client = self._current()
        if client.alive and not client.heartbeat():
            raise LiveError(f"{self._origin} only watches; take over first.")
        self._host.start(instrument)
        self._current().acquire()

    def restart(self) -> None:
        """Restart a runtime that has ended."""
        if not self._current().alive:
            self._host.again()

    def close(self) -> None:
        """Close the connection."""
        with self._lock:
            self._client.close()

    def _current(self) -> Client:
        with self._lock:
            if self._generation != self._host.generation:
                self._client.close()
                self._client = Client(self._host.folder, self._origin)
                self._generation = self._host.generation
            return self._client


def _place() -> Path:
    return _SHARED if _SHARED.is_dir() else Path(tempfile.gettempdir())


def _tidy() -> None:
    """Remove the folders of killed hosts, once their runtimes and recorders have ended too."""
    for folder in _place().glob(f"{_PREFIX}*-*"):
        pid = folder.name.removeprefix(_PREFIX).partition("-")[0]
        if pid.isdecimal() and not Path(f"/proc/{pid}").exists() and not _used(folder):
            shutil.rmtree(folder, ignore_errors=True)


def _used(folder: Path) -> bool:
    """Return whether a process works in a folder, by its arguments: a runtime that is still closing, its recorder."""
    within = os.fsencode(folder) + b"/"
    for arguments in Path("/proc").glob("[0-9]*/cmdline"):
        # A process that ends meanwhile uses nothing.
        with suppress(OSError):
            if any(one.startswith(within) for one in arguments.read_bytes().split(b"\0")):
                return True
    return False


def _drain(process: "subprocess.Popen[bytes]") -> None:
    if process.stderr is not None:
        try:
            while process.stderr.read(4096):
                pass
        except ValueError:
            return
