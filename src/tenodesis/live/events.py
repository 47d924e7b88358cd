"""What happens beside the signals, as the live runtime tells it: a file that only grows, one JSON object a line."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

FILE = "events.jsonl"
"""Name of the file in the runtime's folder."""

LONGEST = 1e7
"""Time that a runtime runs at most, s."""

_MOST = 1 << 18
"""Bytes read at a time, and in a line at most."""
_SHOWN = 200
"""Characters kept of a line that is no event."""


class Happened(NamedTuple):
    """An event: when, s on the runtime's clock, NaN where that is not told, and the rest of what is told."""

    time: float
    content: Mapping[str, Any]

    def at(self, now: float) -> float:
        """Return when it was, s; now (s) where it tells no time, or none that can be."""
        return self.time if 0 <= self.time <= LONGEST else now


class Tail:
    """The events of a file, each once.

    Parameters
    ----------
    path
        The file; it may come later.
    at_end
        Whether to leave out what it holds already.
    """

    def __init__(self, path: Path, *, at_end: bool = False) -> None:
        self._path = path
        self._position = 0
        self._skipping = False
        if at_end:
            while self.read():
                pass

    def read(self) -> list[Happened]:
        """Return the events that have come, not all at once where they are many; a line that is none is told as one.

        Raises
        ------
        OSError
            The file is there and cannot be read.
        """
        try:
            with self._path.open("rb") as file:
                file.seek(self._position)
                data = file.read(_MOST)
        except FileNotFoundError:
            return []
        end = data.rfind(b"\n") + 1
        if not end and len(data) == _MOST:
            end = _MOST
        self._position += end
        lines = data[:end].splitlines(keepends=True)
        events = []
        for line in lines:
            # Of a line that is too long only the beginning is told.
            if not self._skipping and line.strip():
                events.append(_event(line))
            self._skipping = not line.endswith(b"\n")
        return events


def _event(line: bytes) -> Happened:
    try:
        content = json.loads(line)
        time = content.pop("time", math.nan)
        return Happened(float(time) if isinstance(time, int | float) else math.nan, content)
    except (ValueError, AttributeError, TypeError, RecursionError, OverflowError):
        return Happened(math.nan, {"event": "unreadable", "line": line[:_SHOWN].decode("utf-8", "replace").rstrip()})
