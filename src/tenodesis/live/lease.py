"""Who may move a motor: one operator at a time, for as long as it says that it is there."""

import threading
import time
from collections.abc import Callable

SECONDS = 1.0
"""Time without a word after which the operator is taken to be gone, s."""


class Lease:
    """Holds the one operator, known by a token of the caller's, called by its origin.

    Parameters
    ----------
    renewed
        Called with the seconds for which the operator is known to be there; 0 where there is none.
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
        """Who operates."""
        with self._lock:
            self._expire()
            return self._origin

    def held_by(self, holder: object) -> bool:
        """Return whether this one operates."""
        with self._lock:
            self._expire()
            return self._holder is holder

    def acquire(self, holder: object, origin: str, *, force: bool) -> str | None:
        """Become the operator if there is none, or by force; return who is in the way, None if nobody.

        Who operates already stays so, under the new name.
        """
        with self._lock:
            self._expire()
            if self._holder not in (None, holder) and not force:
                return self._origin
            self._holder, self._origin = holder, origin
            self._renew()
            return None

    def renew(self, holder: object) -> bool:
        """Say that the operator is there; False from whom that is not."""
        with self._lock:
            self._expire()
            if self._holder is not holder:
                return False
            self._renew()
            return True

    def release(self, holder: object) -> bool:
        """Stop being the operator; False from whom that is not."""
        with self._lock:
            if self._holder is not holder:
                return False
            self._forget()
            self._renewed(0.0)
            return True

    def _renew(self) -> None:
        self._until = self._clock() + SECONDS
        self._renewed(SECONDS)

    # The loop has its own clock of the lease; told here as well, it pauses even if another takes over at once.
    def _expire(self) -> None:
        if self._holder is not None and self._clock() > self._until:
            self._forget()
            self._renewed(0.0)

    def _forget(self) -> None:
        self._holder = self._origin = None
