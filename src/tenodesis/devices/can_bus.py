"""A CAN bus as a bench uses it: frames out, frames in, and objects written by SDO without the help of SYNC."""

import struct
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import can

from tenodesis.errors import DeviceError, Error
from tenodesis.instrument.devices import CanOpen

_ANSWER_TIME = 0.2  # s, of an SDO server to what stops a motor, or changes nothing
_ERRORS = (can.CanError, OSError, ValueError)
"""What python-can raises on a bus that carries no frames, or only damaged frames."""


class BusError(DeviceError):
    """A bus does not carry frames."""


class CanBus:
    """The bus that a bench's table devices.canopen names, or a given bus of python-can, open, which stays open."""

    def __init__(self, settings: CanOpen, given: can.BusABC | None = None) -> None:
        self._settings, self._given = settings, given
        self._open: can.BusABC | None = None
        self.name = f"CAN interface {settings.interface}, channel {settings.channel},"

    @property
    def bus(self) -> can.BusABC:
        """The open bus of python-can."""
        assert self._open is not None
        return self._open

    def open(self) -> None:
        """Open the bus; raises DeviceError if there is no such bus."""
        settings = self._settings
        if self._given is not None:
            self._open = self._given
            return
        options: dict[str, Any] = dict(settings.options)
        if settings.bitrate is not None:
            options["bitrate"] = settings.bitrate
        try:
            self._open = can.Bus(interface=settings.interface, channel=settings.channel, **options)
        except (*_ERRORS, ImportError, TypeError) as problem:
            raise DeviceError(f"{self.name} cannot be opened: {cause(problem)}") from None

    def close(self) -> None:
        """Close the bus, unless it was given."""
        if self._given is None and self._open is not None:
            self._open.shutdown()
            self._open = None

    @contextmanager
    def carrying(self) -> Iterator[None]:
        """Raise BusError where the libraries say within this context that the bus does not carry frames."""
        try:
            yield
        except Error:
            raise
        except _ERRORS as problem:
            raise BusError(f"{self.name} does not carry frames: {cause(problem)}") from None

    def send(self, can_id: int, data: bytes) -> None:
        """Send a frame; raises BusError."""
        with self.carrying():
            self.bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))

    def receive(self, wait: float) -> can.Message | None:
        """Return the next frame, or None where none comes within a time, s; raises BusError."""
        with self.carrying():
            return self.bus.recv(wait)

    def write_object(self, nodes: Iterable[int], index: int, sub: int, value: bytes) -> set[int]:
        """Write an object of nodes by SDO, which needs no SYNC, and return the nodes that have not confirmed it.

        Raises BusError if the bus does not carry the frames.
        """
        request = struct.pack("<BHB", 0x23 | 4 - len(value) << 2, index, sub) + value.ljust(4, b"\0")
        waiting = set(nodes)
        for node in sorted(waiting):
            self.send(0x600 + node, request)
        end = time.monotonic() + _ANSWER_TIME
        while waiting and (left := end - time.monotonic()) > 0:
            message = self.receive(left)
            if message is not None and bytes(message.data[:4]) == b"\x60" + request[1:4]:
                waiting.discard(message.arbitration_id - 0x580)
        return waiting


def cause(problem: BaseException) -> str:
    """Return a problem of a library as the end of a sentence."""
    text = " ".join(str(problem).split()).rstrip(".")
    return f"{text or type(problem).__name__}."
