"""The runtime of this process: replaced by one of another instrument, ended with its parent."""

import os
import shutil
import tempfile
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tenodesis.devices.device import Capabilities
from tenodesis.errors import LiveError
from tenodesis.files import atomic_file
from tenodesis.instrument import Instrument, as_instrument, parse
from tenodesis.instrument.text import to_toml
from tenodesis.live import folder as folders
from tenodesis.live.client import Client
from tenodesis.live.commands import LiveCommand, RestartableConnection
from tenodesis.live.loop import Choices, rehearse
from tenodesis.live.runtime_process import RuntimeProcess
from tenodesis.run import Array

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
        The instrument is not valid, or no runtime can run it.
    LiveError
        The runtime does not start; the message states why.
    """

    def __init__(self, instrument: str, choices: Choices | None = None, recordings: Path = Path("recordings")) -> None:
        self.choices, self.recordings = choices or Choices(), recordings
        self._changing, self._closing = threading.RLock(), threading.Event()
        _tidy()
        self.home = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=_place()))
        """Folder around those of the runtimes, which only its owner can enter."""
        self._lock = folders.make_lock(self.home)
        self.generation = 0
        """Number of the present runtime."""
        self._started = self._stops = 0
        self._replacing = False
        """Whether the present runtime ends before the next one starts."""
        self._process: RuntimeProcess | None = None
        try:
            self.start(instrument)
        except BaseException:
            self.close()
            raise

    @property
    def folder(self) -> Path:
        """Folder of the present runtime."""
        return self.folder_of(self.generation)

    def folder_of(self, generation: int) -> Path:
        """Return the folder of a runtime by its number."""
        return self.home / str(generation)

    @property
    def pid(self) -> int | None:
        """Process id of the runtime."""
        return None if self._process is None else self._process.pid

    def start(self, instrument: str) -> None:
        """Replace the runtime by one of another instrument.

        The present runtime goes on until the new one runs. A bench can be opened only once: what can be checked without
        it is checked before the present runtime ends, which is started again where the new one does not start.

        Parameters
        ----------
        instrument
            Path or shipped name, or the text of an instrument file.

        Raises
        ------
        InstrumentError
            The instrument is not valid, or no runtime can run it.
        LiveError
            The new runtime does not start; the message states why, and what runs now.
        """
        inst = as_instrument(parse(instrument, "the instrument file") if "\n" in instrument else instrument)
        rehearse(inst, self.choices)
        with self._changing:
            file = self.home / f"{self._started + 1}.toml"
            with atomic_file(file) as new:
                new.write_text(to_toml(inst), "utf-8")
            before, generation = self._process, self.generation
            try:
                if before is None or not before.runs or not _exists_once(self.choices):
                    self._begin(file)
                    if before is not None:
                        before.end()
                else:
                    self._replace(before, file)
            finally:
                if self.generation != generation:
                    shutil.rmtree(self.folder_of(generation), ignore_errors=True)

    def again(self) -> None:
        """Start again, as after it was killed."""
        self.start(str(self.home / f"{self.generation}.toml"))

    def stop(self, origin: str) -> None:
        """Stop the motors in the name of an origin, also those of a runtime that starts or ends at this moment.

        A runtime that does not answer is killed, so that the watchdogs of its devices stop the motors.

        Raises
        ------
        LiveError
            No runtime runs.
        """
        self._stops += 1
        process = self._process
        if self._replacing and (process is None or not process.runs):
            # No motor moves, and the runtime that starts is stopped as soon as it is ready.
            return
        if process is None or not process.runs:
            raise LiveError("The runtime has ended: its motors are stopped by their own watchdogs. Start it again.")
        process.stop(origin)
        if process is not self._process and self._process is not None:
            self._process.stop(origin)

    def close(self) -> None:
        """End the runtime, motors at rest, and one that starts; a second call does nothing."""
        if self._closing.is_set():
            return
        self._closing.set()
        with self._changing:
            process, self._process = self._process, None
            if process is not None:
                process.end()
            os.close(self._lock)
            shutil.rmtree(self.home, ignore_errors=True)

    def connect(self, origin: str) -> "HostConnection":
        """Return a connection in the name of an origin, which outlasts a restart."""
        return HostConnection(self, origin)

    def _begin(self, file: Path) -> None:
        """Start a runtime, and make it the present one once it is ready."""
        self._started += 1
        stops, folder = self._stops, self.folder_of(self._started)
        process = RuntimeProcess(file, folder, self.choices, self.recordings, self._lock)
        try:
            process.wait_until_ready(self._closing)
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        self._process, self.generation = process, self._started
        if self._stops != stops:
            process.stop("stop during the start")

    def _replace(self, before: RuntimeProcess, file: Path) -> None:
        """End a runtime and start the next one, or the one before again."""
        self._replacing = True
        try:
            before.end()
            self._begin(file)
        except LiveError as problem:
            again = self.home / f"{self._started + 1}.toml"
            shutil.copyfile(before.file, again)
            try:
                self._begin(again)
            except LiveError as worse:
                raise LiveError(f"{problem} Nor does the instrument before start again: {worse}") from None
            raise LiveError(f"{problem} The instrument before runs again, its motors disabled.") from None
        finally:
            self._replacing = False


class HostConnection(RestartableConnection):
    """A :class:`~tenodesis.live.client.Client` that follows to the runtime that is started next."""

    def __init__(self, host: Host, origin: str) -> None:
        self._host, self._origin = host, origin
        self._lock = threading.Lock()
        self._generation = host.generation
        self._client = Client(host.folder_of(self._generation), origin)

    def send(self, command: LiveCommand, arguments: Mapping[str, Any]) -> Any:
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

    def stop(self) -> None:
        """Stop the motors at once; anyone may."""
        self.stop_for(self._origin)

    def stop_for(self, origin: str) -> None:
        """Stop the motors at once in the name of another origin."""
        self._host.stop(origin)

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
            raise LiveError(f"{self._origin} only watches; take over first.", key="operator", value=self._origin)
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
            present = self._host.generation
            if self._generation != present:
                self._client.close()
                self._client = Client(self._host.folder_of(present), self._origin)
                self._generation = present
            return self._client


def _exists_once(choices: Choices) -> bool:
    """Return whether a device cannot be opened while another runtime has it open."""
    return choices.device != "twin"


def _place() -> Path:
    return _SHARED if _SHARED.is_dir() else Path(tempfile.gettempdir())


def _tidy() -> None:
    """Remove the folders of killed hosts, once their runtimes and recorders have ended too."""
    for home in _place().glob(f"{_PREFIX}*"):
        if folders.is_left(home):
            shutil.rmtree(home, ignore_errors=True)
