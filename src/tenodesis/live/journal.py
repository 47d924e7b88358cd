"""What happens beside the ticks, written down: a line of JSON each, in a file that only grows."""

import json
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tenodesis.live.events import FILE


class Journal:
    """The file of events; repeated ones of a kind are drawn together until `flush`.

    Parameters
    ----------
    folder
        The runtime's folder.
    clock
        The time of the ticks, s.
    """

    def __init__(self, folder: Path, clock: Callable[[], float]) -> None:
        self._file = (folder / FILE).open("a", encoding="utf-8")
        self._clock = clock
        self._lock = threading.Lock()
        self._waiting: dict[tuple[str, str], dict[str, Any]] = {}

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
            self._file.close()

    def _flush(self) -> None:
        for content in self._waiting.values():
            self._write(content)
        self._waiting.clear()

    def _write(self, content: dict[str, Any]) -> None:
        if self._file.closed:
            return
        self._file.write(json.dumps(content) + "\n")
        self._file.flush()
