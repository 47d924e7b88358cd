"""SIGTERM and Ctrl-C end a process in order, even while its threads wait."""

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_SIGNALS = (signal.SIGTERM, signal.SIGINT)


@contextmanager
def on_signal(end: Callable[[], object]) -> Iterator[None]:
    """Call a function, in a thread of its own, for each SIGTERM or Ctrl-C while this context lasts.

    A handler runs between any two steps of the main thread, which may hold the very lock that the handler would wait
    for, as that of the event that it waits for. So the signal's number goes through a pipe to a thread that may wait.

    Raises
    ------
    ValueError
        This is not the main thread, to which alone signals come.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)

    def listen() -> None:
        while numbers := os.read(reading, 64):
            if any(number in _SIGNALS for number in numbers):
                end()

    listener = threading.Thread(target=listen, name="signals", daemon=True)
    listener.start()
    try:
        woken = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
        before = {number: signal.signal(number, lambda *_: None) for number in _SIGNALS}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
            signal.set_wakeup_fd(woken)
    finally:
        os.close(writing)
        listener.join()
        os.close(reading)
