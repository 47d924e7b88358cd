"""Threads for what takes longer than a tick of the page; they do not keep the process from ending."""

import queue
import threading
from collections.abc import Callable


class Workers:
    """Some threads that run functions one after the other."""

    def __init__(self, count: int) -> None:
        self._waiting: queue.SimpleQueue[Callable[[], object]] = queue.SimpleQueue()
        self._closed = threading.Event()
        for number in range(count):
            # What reads a large file must not delay the end.
            threading.Thread(target=self._run, name=f"console worker {number}", daemon=True).start()

    def submit(self, work: Callable[[], object]) -> None:
        """Run a function, which raises nothing, when a thread is free."""
        self._waiting.put(work)

    def close(self) -> None:
        """Begin nothing more; what runs is not waited for."""
        self._closed.set()
        self._waiting.put(lambda: None)

    def _run(self) -> None:
        while True:
            work = self._waiting.get()
            if self._closed.is_set():
                # For the next thread.
                self._waiting.put(work)
                return
            work()
