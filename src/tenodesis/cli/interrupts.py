"""Ctrl-C, also one whose exception Python drops because it came amid a callback."""

import signal

CAME: list[int] = []
"""The number of each signal that came."""


def install() -> None:
    """Count interrupts from now on, unless the command was started without any."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupt)


def _interrupt(number: int, _: object) -> None:
    CAME.append(number)
    raise KeyboardInterrupt
