"""The events of a live runtime, written to a file of JSON lines that restarts when it is long."""

import json
import os
import threading
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from tenodesis.files import atomic_file
from tenodesis.live.events import FILE, LEFT_OUT, LONGEST_LINE, NUMBER

_MOST = 16 << 20
"""Bytes after which the file restarts, since the folder is in memory."""


class Journal:
    """The file of events; repeated events of a kind are merged until `flush`.

    A file that restarts states how many events it leaves out, and keeps the last of each kind, which is in force.
    An event that cannot be written holds no command up: it is counted, and the count is written when that works again.

    Parameters
    ----------
    folder
        The runtime's folder.
    clock
        The time of the ticks, s.
    most
        Bytes after which the file starts again.

    Raises
    ------
    OSError
        The file cannot be written.
    """

    def __init__(self, folder: Path, clock: Callable[[], float], *, most: int = _MOST) -> None:
        self._path = folder / FILE
        self._clock, self._most = clock, most
        self._lock = threading.Lock()
        self._waiting: dict[tuple[str, str], dict[str, Any]] = {}
        self._latest: dict[str, tuple[int, bytes]] = {}
        """The last line of each kind, and its number."""
        self._number = self._size = self._missing = 0
        self._file: int | None = os.open(self._path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600)
        self.problem: str | None = None
        """Why events are not written, in a sentence; None while they are written."""

    def write(self, event: str, origin: str, **content: Any) -> None:
        """Write an event at once, after those that wait."""
        with self._lock:
            self._flush()
            self._put({"time": self._clock(), "event": event, "origin": origin, **content})

    def write_merged(self, event: str, origin: str, **content: Any) -> None:
        """Write an event with the next flush; several of an origin are merged into the last, with their number."""
        with self._lock:
            before = self._waiting.get((event, origin), {})
            self._waiting[event, origin] = {
                "time": self._clock(),
                "event": event,
                "origin": origin,
                **content,
                "times": before.get("times", 0) + 1,
            }

    def flush(self) -> None:
        """Write the events that wait."""
        with self._lock:
            self._flush()

    def close(self) -> None:
        """Write the events that wait, and close the file."""
        with self._lock:
            self._flush()
            if self._file is not None:
                os.close(self._file)
            self._file = None

    def _flush(self) -> None:
        waiting, self._waiting = self._waiting, {}
        for content in waiting.values():
            self._put(content)

    def _put(self, content: dict[str, Any]) -> None:
        if self._file is None:
            return
        if self._missing:
            missing = {"time": content["time"], "event": "events_missing", "origin": "runtime", "events": self._missing}
            if not self._append(missing):
                self._missing += 1
                return
            self._missing = 0
        if not self._append(content):
            self._missing += 1

    def _append(self, content: dict[str, Any]) -> bool:
        """Append an event completely or not at all, and return whether it was appended."""
        line = self._line(content)
        try:
            if self._size + len(line) > self._most:
                self._start_again(content["time"])
            self._append_all(line)
        except OSError as problem:
            self.problem = f"Events are not written: {problem.strerror or problem}; they are counted."
            return False
        self.problem = None
        self._number += 1
        self._size += len(line)
        self._latest[content["event"]] = (self._number, line)
        return True

    def _line(self, content: dict[str, Any]) -> bytes:
        line = _encoded({NUMBER: self._number + 1, **content})
        if len(line) <= LONGEST_LINE:
            return line
        kept = {name: content[name] for name in ("time", "event", "origin")}
        return _encoded({NUMBER: self._number + 1, **kept, "too_long": len(line)})

    def _start_again(self, now: float) -> None:
        kept = sorted(self._latest.values())
        left_out = {"until": self._number, "kept": [number for number, _ in kept]}
        first = _encoded({"time": now, "event": LEFT_OUT, "origin": "runtime", **left_out})
        with ExitStack() as undo:
            with atomic_file(self._path) as new:
                new.write_bytes(b"".join([first, *(line for _, line in kept)]))
                file = os.open(new, os.O_WRONLY | os.O_APPEND)
                undo.callback(os.close, file)
            undo.pop_all()
        # A reader that has the old file open reads it completely.
        assert self._file is not None
        os.close(self._file)
        self._file, self._size = file, 0

    def _append_all(self, line: bytes) -> None:
        assert self._file is not None
        size = os.fstat(self._file).st_size
        written = 0
        try:
            while written < len(line):
                written += os.write(self._file, line[written:])
        except OSError:
            os.ftruncate(self._file, size)
            raise


def _encoded(content: dict[str, Any]) -> bytes:
    return json.dumps(content).encode() + b"\n"
