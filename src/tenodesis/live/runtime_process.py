"""A runtime as a process of its own: start, readiness, stop, end."""

import subprocess
import sys
import threading
import time
from contextlib import closing
from pathlib import Path

from tenodesis.errors import LiveError
from tenodesis.live.client import Client
from tenodesis.live.layout import TICK
from tenodesis.live.loop import Choices
from tenodesis.live.ticks import Reader

_TO_START = 30.0
_TO_END = 15.0
_TO_STOP = 0.8
"""Longest wait for the answer to a stop, and then for its effect, s."""
_SILENT = 0.2
"""Time without a tick after which a loop that was asked to end has ended, s."""


class RuntimeProcess:
    """A runtime process, until it is ended.

    Parameters
    ----------
    file
        The instrument file.
    folder
        The runtime's folder.
    choices
        Device, law and more.
    recordings
        Folder of recordings.
    lock
        Descriptor of the lock of the folder around it, which the process inherits.
    """

    def __init__(self, file: Path, folder: Path, choices: Choices, recordings: Path, lock: int) -> None:
        self.file, self.folder, self._ending = file, folder, False
        options = {
            "--instrument": str(file),
            "--device": choices.device,
            "--law": choices.law,
            "--actuation": choices.actuation,
            "--speed": str(choices.speed),
            "--seed": str(choices.seed),
            "--recordings": str(recordings.absolute()),
        } | ({} if choices.address is None else {"--address": choices.address})
        arguments = [part for pair in options.items() for part in pair]
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tenodesis.live.server", str(folder), "--attached", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            start_new_session=True,
            pass_fds=(lock,),
        )

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def runs(self) -> bool:
        """Whether the process runs."""
        return self._process.poll() is None

    def wait_until_ready(self, cancelled: threading.Event) -> None:
        """Return when it accepts commands.

        Raises
        ------
        LiveError
            It does not come to that, or is cancelled, and has ended; the message states why.
        """
        try:
            self._wait_until_ready(cancelled)
        except BaseException:
            # A runtime that starts later would occupy its device unnoticed.
            self.end()
            raise
        # Nothing reads its output from here on, and a full pipe would block it.
        threading.Thread(target=self._drain, daemon=True).start()

    def stop(self, origin: str) -> None:
        """Stop its motors in the name of an origin; a process that does not is killed, so that watchdogs stop them."""
        try:
            with closing(Client(self.folder, origin, patience=_TO_STOP)) as link:
                link.stop()
        except LiveError:
            end = time.monotonic() + _TO_STOP
            while self.runs and not self._rests():
                if time.monotonic() > end:
                    self._process.kill()
                    self._process.wait()
                time.sleep(0.02)

    def end(self) -> None:
        """End it, motors at rest; a second call does nothing."""
        self._ending = True
        self._process.terminate()
        try:
            self._process.wait(_TO_END)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        for pipe in (self._process.stdin, self._process.stderr):
            if pipe is not None:
                pipe.close()

    def _rests(self) -> bool:
        """Return whether the loop has stopped the motors although no answer came, or ended as it was asked to."""
        try:
            reader = Reader(self.folder)
        except LiveError:
            return False
        row = reader.newest()
        stopped = row is not None and bool(row[TICK.index("stopped")])
        return (stopped and reader.silence < _SILENT) or (self._ending and reader.silence > _SILENT)

    def _wait_until_ready(self, cancelled: threading.Event) -> None:
        end = time.monotonic() + _TO_START
        process = self._process
        while True:
            try:
                Client(self.folder, "host").close()
            except LiveError:
                pass
            else:
                return
            if process.poll() is not None:
                said = b"" if process.stderr is None else process.stderr.read()
                lines = said.decode("utf-8", "replace").strip().splitlines()
                why = lines[-1].removeprefix("tenodesis: ") if lines else f"it ended with code {process.returncode}."
                raise LiveError(why)
            if time.monotonic() > end:
                raise LiveError(f"the runtime has not started within {_TO_START:g} s.")
            if cancelled.wait(0.05):
                raise LiveError("the instrument is closed while the runtime starts.")

    def _drain(self) -> None:
        if self._process.stderr is not None:
            try:
                while self._process.stderr.read(4096):
                    pass
            except ValueError:
                return
