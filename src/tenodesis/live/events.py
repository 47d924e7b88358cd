"""The file of events of a live runtime, a JSON object per line, with its reader."""

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

FILE = "events.jsonl"
"""Name of the file in the runtime's folder."""

LIVE = "live"
"""Value of `mode` in the metadata of a recording of a live runtime."""

LONGEST = 1e7
"""Longest running time of a runtime, s."""

LONGEST_LINE = 1 << 18
"""Largest number of bytes of a line; a longer line is no event."""

NUMBER = "number"
"""Key of a line's number, counted from 1."""

LEFT_OUT = "events_left_out"
"""First event of a file that started again: events up to number `until` are left out, except those `kept`."""

_SHOWN = 200
"""Characters kept of a line that is no event."""


class RuntimeEvent(NamedTuple):
    """An event: its time, s on the runtime's clock (NaN where it has none), and its content."""

    time: float
    content: Mapping[str, Any]

    def at(self, now: float) -> float:
        """Return its time, s; now (s) if it has no time, or an impossible time."""
        return self.time if 0 <= self.time <= LONGEST else now


class Tail:
    """The events of a file, each once, even where the file starts again meanwhile.

    Events that were left out before they were read appear as the event ``events_lost``, with their number.

    Parameters
    ----------
    path
        The file; it may come later.
    at_end
        Whether to leave out what it holds already.
    """

    def __init__(self, path: Path, *, at_end: bool = False) -> None:
        self._path = path
        self._file: BinaryIO | None = None
        self._position = 0
        self._number = 0
        self._skipping = False
        if at_end:
            while self.read():
                pass

    def read(self) -> list[RuntimeEvent]:
        """Return the new events, in portions if there are many; an unreadable line counts as an event.

        Raises
        ------
        OSError
            The file is there and cannot be read.
        """
        while True:
            # Checked first: everything written before the file restarted is then in the open file.
            replaced = self._replaced()
            lines = self._lines()
            if not lines:
                if not replaced:
                    return []
                self.close()
                continue
            events = []
            for line in lines:
                # Of a line that is too long only the beginning is read.
                if not self._skipping and line.strip() and (event := self._event(line)) is not None:
                    events.append(event)
                self._skipping = not line.endswith(b"\n")
            if events:
                return events

    def close(self) -> None:
        """Close the file; the next read begins at the start of the file that exists then."""
        if self._file is not None:
            self._file.close()
        self._file, self._position, self._skipping = None, 0, False

    def _replaced(self) -> bool:
        if self._file is None:
            return False
        try:
            there = self._path.stat()
        except FileNotFoundError:
            return False
        return not os.path.samestat(there, os.fstat(self._file.fileno()))

    def _lines(self) -> list[bytes]:
        if self._file is None:
            try:
                self._file = self._path.open("rb", buffering=0)
            except FileNotFoundError:
                return []
        self._file.seek(self._position)
        data = self._file.read(LONGEST_LINE)
        end = data.rfind(b"\n") + 1
        if not end and len(data) == LONGEST_LINE:
            end = LONGEST_LINE
        self._position += end
        return data[:end].splitlines(keepends=True)

    def _event(self, line: bytes) -> RuntimeEvent | None:
        """Return the event of a line; None if it was read before."""
        try:
            content = json.loads(line)
            time = content.pop("time", math.nan)
            time = float(time) if isinstance(time, int | float) else math.nan
            if content.get("event") == LEFT_OUT:
                lost = content["until"] - self._number - sum(number > self._number for number in content["kept"])
                summary = {"event": "events_lost", "origin": content["origin"], "events": lost}
                return RuntimeEvent(time, summary) if lost > 0 else None
            number = content.pop(NUMBER, None)
            if isinstance(number, int):
                if number <= self._number:
                    return None
                self._number = number
            return RuntimeEvent(time, content)
        except (ValueError, AttributeError, TypeError, KeyError, RecursionError, OverflowError):
            return RuntimeEvent(
                math.nan, {"event": "unreadable", "line": line[:_SHOWN].decode("utf-8", "replace").rstrip()}
            )
