"""The recorder as a separate process: start, supervision, end."""

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from datetime import datetime
from pathlib import Path
from typing import Any

from tenodesis.errors import LiveError
from tenodesis.files import write_errors
from tenodesis.live import folder as folders
from tenodesis.live.recorder import STATUS

_TO_END = 10.0
_PATIENCE = 0.5
"""Longest wait for the previous recorder, s: the operator's lease must be renewed every second."""
_LONGEST_NAME = 80
_TO_BEGIN = 10.0
"""Longest wait for the first status of a recorder, s."""
_SILENT = 1.0
"""Time without a status after which a recorder counts as hanging, s; it writes four in that time."""


class RecordingProcess:
    """The recorder of a runtime; at most one runs at a time.

    Parameters
    ----------
    folder
        The runtime's folder.
    recordings
        Where recordings go; made if absent.
    """

    def __init__(self, folder: Path, recordings: Path) -> None:
        self._folder, self._recordings = folder, recordings
        self._process: subprocess.Popen[bytes] | None = None
        self.path: Path | None = None
        """File of the present recording; None if there is none."""
        self._ended_because: str | None = None
        """Why the recording has ended."""
        self._heard: tuple[int, float] = (0, 0.0)
        """Stamp of the last status, ns, and when it was seen first, on the monotonic clock, s."""
        self._hangs = False
        self._lock = threading.RLock()
        self._stopping = False
        self._begun = False

    def start(self, called: str) -> Path:
        """Start a recorder, and return its file.

        Raises
        ------
        LiveError
            There is one already, the one before has not closed its file yet, or it cannot be written.
        """
        if not self._lock.acquire(timeout=_PATIENCE):
            raise LiveError(f"{self.path} is still being closed; record a little later.", key="path", value=self.path)
        try:
            return self._start(called)
        finally:
            self._lock.release()

    def _start(self, called: str) -> Path:
        if self.path is not None:
            raise LiveError(f"{self.path} is being recorded already; stop that first.", key="path", value=self.path)
        name = re.sub(r"[^\w.-]+", "-", called[:_LONGEST_NAME]).strip("-.") or "live"
        stamp = datetime.now().astimezone().strftime("%Y-%m-%d-%H%M%S")
        with write_errors(self._recordings, LiveError):
            self._recordings.mkdir(parents=True, exist_ok=True)
        path = _free(self._recordings / f"{stamp}-{name}.mcap")
        (self._folder / STATUS).unlink(missing_ok=True)
        lock = folders.hold(self._folder.parent)
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "tenodesis.live.recorder", str(self._folder), str(path)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                start_new_session=True,
                pass_fds=() if lock is None else (lock,),
            )
        finally:
            if lock is not None:
                os.close(lock)
        self._ended_because, self.path, self._begun = None, path, False
        self._heard, self._hangs = (0, time.monotonic()), False
        return path

    @property
    def problem(self) -> str | None:
        """Why the recording has ended, or that its recorder hangs, in a sentence."""
        path = self.path
        if self._hangs and path is not None:
            return f"The recorder of {path} hangs: what happens now may not be in its file."
        return self._ended_because

    @property
    def recording(self) -> bool:
        """Whether a recorder runs and is not closing its file."""
        return self.path is not None and not self._stopping

    @property
    def ready(self) -> bool:
        """Whether it records, or no recording is under way."""
        self._begun = self._begun or bool(self.status())
        return self.path is None or self._begun

    def status(self) -> dict[str, Any]:
        """Return the status that the recorder writes; empty before it is ready."""
        try:
            content = json.loads((self._folder / STATUS).read_text("utf-8"))
        except (OSError, ValueError):
            return {}
        return content if isinstance(content, dict) else {}

    def look(self) -> None:
        """Check whether it still runs and writes; if not, set `problem`."""
        # While it closes its file it writes no status.
        self._hangs = self.path is not None and not self._stopping and self._is_silent()
        if self._stopping:
            return
        with self._lock:
            self._look()

    def _is_silent(self) -> bool:
        try:
            stamp = (self._folder / STATUS).stat().st_mtime_ns
        except OSError:
            stamp = 0
        known, since = self._heard
        if stamp != known:
            self._heard = (stamp, time.monotonic())
            return False
        return time.monotonic() - since > (_SILENT if stamp else _TO_BEGIN)

    def _look(self) -> None:
        if self._process is None or self._process.poll() is None:
            return
        self._explain_end(self._process)
        self._forget()

    def stop_soon(self) -> None:
        """Request it to close its file, which may take seconds, and do not wait."""
        self._stopping = True
        threading.Thread(target=self.stop, name="recorder", daemon=True).start()

    def stop(self) -> None:
        """Request it to close its file, and wait; without a recorder do nothing."""
        self._stopping = True
        try:
            with self._lock:
                self._stop()
        finally:
            self._stopping = False

    def _stop(self) -> None:
        if self._process is None:
            return
        self._process.send_signal(signal.SIGTERM)
        try:
            self._process.wait(_TO_END)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
            self._ended_because = f"The recorder of {self.path} did not end, and was ended; its file can be read."
        else:
            self._explain_end(self._process, asked=True)
        self._forget()

    def _explain_end(self, process: "subprocess.Popen[bytes]", *, asked: bool = False) -> None:
        """Set the problem if it did not end as expected."""
        said = b"" if process.stderr is None else process.stderr.read()
        lines = said.decode("utf-8", "replace").strip().splitlines()
        why = lines[-1].removeprefix("tenodesis: ") if lines else ""
        if self.path is not None and not self.path.exists():
            self._ended_because = f"The recorder of {self.path} has ended, and there is no such file: "
            self._ended_because += why or f"it ended with {_named(process.returncode)}"
        elif process.returncode or not asked:
            why = why or f"it ended with {_named(process.returncode)}"
            self._ended_because = f"The recorder of {self.path} has ended: {why} What it wrote before can be read."
        elif why:
            self._ended_because = f"{self.path}: {why}"

    def _forget(self) -> None:
        if self._process is not None and self._process.stderr is not None:
            self._process.stderr.close()
        self._process, self.path = None, None


def _free(path: Path) -> Path:
    number, found = 1, path
    while found.exists():
        number += 1
        found = path.with_stem(f"{path.stem}-{number}")
    return found


def _named(code: int) -> str:
    if code >= 0:
        return f"code {code}."
    try:
        return f"{signal.Signals(-code).name}."
    except ValueError:
        return f"signal {-code}."
