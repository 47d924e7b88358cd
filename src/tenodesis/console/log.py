"""Logs that nobody can fill: each message comes once in a while, however often a browser causes it."""

import logging
import time

_EVERY = 60.0
"""Time within which a message is logged once, s."""


class Rarely(logging.Filter):
    """Lets a message pass once within a time."""

    def __init__(self) -> None:
        super().__init__()
        self._passed: dict[str, float] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether a record is to be logged."""
        # The sentences of a program are few; what they are about is in the arguments.
        key, now = str(record.msg), time.monotonic()
        if now - self._passed.get(key, -_EVERY) < _EVERY:
            return False
        self._passed[key] = now
        return True


def rare_log(name: str) -> logging.Logger:
    """Return a logger of a name whose messages come rarely."""
    log = logging.getLogger(name)
    if not any(isinstance(one, Rarely) for one in log.filters):
        log.addFilter(Rarely())
    return log


def connection_log() -> logging.Logger:
    """Return the logger of connections, whose malformed beginnings are nobody's fault here."""
    log = rare_log("tenodesis.console.connections")
    log.addFilter(_is_no_handshake)
    return log


def _is_no_handshake(record: logging.LogRecord) -> bool:
    return record.getMessage() != "opening handshake failed"
