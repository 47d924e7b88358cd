"""The lease of the operator: one client at a time may move a motor, for as long as it renews the lease."""

import threading
import time
from collections.abc import Callable

SECONDS = 1.0
"""Time without a renewal after which the lease expires, s."""


class Lease:
    """The lease of an operator, identified by a token of the caller and named by its origin.

    Parameters
    ----------
    renewed
        Called with the seconds for which the lease holds; 0 when it ends.
    clock
        Monotonic time, s.
    """

    def __init__(self, renewed: Callable[[float], object], clock: Callable[[], float] = time.monotonic) -> None:
        self._renewed, self._clock = renewed, clock
        self._lock = threading.Lock()
        self._holder: object | None = None
        self._origin: str | None = None
        self._until = 0.0

    @property
    def origin(self) -> str | None:
        """Origin of the operator; None if there is none."""
        with self._lock:
            self._expire()
            return self._origin

    def held_by(self, holder: object) -> bool:
        """Return whether this holder operates."""
        with self._lock:
            self._expire()
            return self._holder is holder

    def acquire(self, holder: object, origin: str, *, force: bool) -> str | None:
        """Take the lease if it is free, or by force; return the origin that holds it instead, None on success.

        A holder that has it already keeps it, under the new origin.
        """
        with self._lock:
            self._expire()
            if self._holder not in (None, holder) and not force:
                return self._origin
            self._holder, self._origin = holder, origin
            self._renew()
            return None

    def renew(self, holder: object) -> bool:
        """Renew the lease; return whether this holder has it."""
        with self._lock:
            self._expire()
            if self._holder is not holder:
                return False
            self._renew()
            return True

    def release(self, holder: object) -> bool:
        """End the lease; return whether this holder had it."""
        with self._lock:
            if self._holder is not holder:
                return False
            self._forget()
            self._renewed(0.0)
            return True

    def _renew(self) -> None:
        self._until = self._clock() + SECONDS
        self._renewed(SECONDS)

    # The loop has its own clock of the lease; ended here as well, it pauses even if another takes over at once.
    def _expire(self) -> None:
        if self._holder is not None and self._clock() > self._until:
            self._forget()
            self._renewed(0.0)

    def _forget(self) -> None:
        self._holder = self._origin = None
