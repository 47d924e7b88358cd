"""What happens beside the ticks, written down: a line of JSON each, in a file that begins anew when it is long."""

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
"""Bytes after which the file begins anew: the folder is in memory."""


class Journal:
    """The file of events; repeated ones of a kind are drawn together until `flush`.

    A file that begins anew says how many events it leaves out, and keeps the last of each kind: what is in force.
    An order is not held up by an event that cannot be written: it is counted, and told when that works again.

    Parameters
    ----------
    folder
        The runtime's folder.
    clock
        The time of the ticks, s.
    most
        Bytes after which the file begins anew.

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
        """Why events are not written down, in a sentence; None while they are."""

    def tell(self, event: str, origin: str, **content: Any) -> None:
        """Write an event down at once, after those that wait."""
        with self._lock:
            self._flush()
            self._write({"time": self._clock(), "event": event, "origin": origin, **content})

    def tell_often(self, event: str, origin: str, **content: Any) -> None:
        """Write an event down with the next flush; of many of an origin only the last, and how many there were."""
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
        """Write down what waits."""
        with self._lock:
            self._flush()

    def close(self) -> None:
        """Write down what waits, and close the file."""
        with self._lock:
            self._flush()
            if self._file is not None:
                os.close(self._file)
            self._file = None

    def _flush(self) -> None:
        waiting, self._waiting = self._waiting, {}
        for content in waiting.values():
            self._write(content)

    def _write(self, content: dict[str, Any]) -> None:
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
        """Append an event whole or not at all, and return which."""
        line = self._line(content)
        try:
            if self._size + len(line) > self._most:
                self._begin_anew(content["time"])
            self._append_whole(line)
        except OSError as problem:
            self.problem = f"What happens is not written down: {problem.strerror or problem}; it is counted."
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
        told = {name: content[name] for name in ("time", "event", "origin")}
        return _encoded({NUMBER: self._number + 1, **told, "too_long": len(line)})

    def _begin_anew(self, now: float) -> None:
        kept = sorted(self._latest.values())
        left_out = {"until": self._number, "kept": [number for number, _ in kept]}
        first = _encoded({"time": now, "event": LEFT_OUT, "origin": "runtime", **left_out})
        with ExitStack() as undo:
            with atomic_file(self._path) as new:
                new.write_bytes(b"".join([first, *(line for _, line in kept)]))
                file = os.open(new, os.O_WRONLY | os.O_APPEND)
                undo.callback(os.close, file)
            undo.pop_all()
        # Whoever has the old one open reads it to its end.
        assert self._file is not None
        os.close(self._file)
        self._file, self._size = file, 0

    def _append_whole(self, line: bytes) -> None:
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
