"""Messages in CDR, little endian, written as arrays: the messages of a topic differ only in stamp and numbers.

On one core and 22 topics this writes 111,000 rows/s into a file, ``mcap-ros2-support``, message by message, 3,400.
"""

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

_HEADER = bytes((0, 1, 0, 0))

SECOND = 1_000_000_000
"""A second in nanoseconds."""


class MessageLayout:
    """Offsets of a message's stamp and numbers, the open fields, among bytes that are the same in every message."""

    def __init__(self) -> None:
        self._template = bytearray(_HEADER)
        self._fields: dict[str, tuple[np.dtype[np.void] | str, int]] = {}

    def header(self, frame: str) -> "MessageLayout":
        """Append a header with its stamp open."""
        self._open("sec", "<i4", 4)
        self._open("nanosec", "<u4", 4)
        self._string(frame)
        return self

    def strings(self, texts: Sequence[str]) -> "MessageLayout":
        """Append a sequence of strings."""
        self._count(len(texts))
        for text in texts:
            self._string(text)
        return self

    def sequence(self, name: str, count: int) -> "MessageLayout":
        """Append a sequence of `count` numbers, which are open."""
        self._count(count)
        return self.numbers(name, count) if count else self

    def numbers(self, name: str, count: int = 1) -> "MessageLayout":
        """Append `count` numbers without their count."""
        self._align(8)
        self._open(name, f"({count},)<f8", 8 * count)
        return self

    @property
    def size(self) -> int:
        """Bytes of a message."""
        return len(self._template)

    @cached_property
    def dtype(self) -> np.dtype[np.void]:
        """The open fields of a message as a structured type."""
        formats = [kind for kind, _ in self._fields.values()]
        offsets = [offset for _, offset in self._fields.values()]
        return np.dtype({"names": [*self._fields], "formats": formats, "offsets": offsets, "itemsize": self.size})

    def encode(self, stamps: NDArray[np.int64], numbers: Mapping[str, NDArray[np.float64]]) -> bytes:
        """Return the messages with these stamps (n,), in ns, and numbers (n, count), joined."""
        buffer = bytearray(self._template * stamps.size)
        rows = np.frombuffer(buffer, self.dtype)
        if "sec" in self._fields:
            rows["sec"], rows["nanosec"] = np.divmod(stamps, SECOND)
        for name, values in numbers.items():
            rows[name] = values
        return bytes(buffer)

    def decode(self, messages: NDArray[np.uint8]) -> NDArray[np.void] | None:
        """Return the open fields of messages, bytes (n, size), as (n,), or None if a message has another layout."""
        if messages.shape[1] != self.size:
            return None
        same = np.frombuffer(self._template, np.uint8)
        if any((messages[:, part] != same[part]).any() for part in self._closed):
            return None
        return np.ascontiguousarray(messages).view(self.dtype)[:, 0]

    @cached_property
    def _closed(self) -> list[slice]:
        """Where the bytes are that are the same in every message."""
        begins = [0, *(offset + self.dtype[name].itemsize for name, (_, offset) in self._fields.items())]
        ends = [*(offset for _, offset in self._fields.values()), self.size]
        return [slice(begin, end) for begin, end in zip(begins, ends, strict=True) if end > begin]

    def _align(self, size: int) -> None:
        self._template.extend(bytes(-(self.size - len(_HEADER)) % size))

    def _count(self, count: int) -> None:
        self._align(4)
        self._template.extend(count.to_bytes(4, "little"))

    def _string(self, text: str) -> None:
        data = text.encode() + b"\0"
        self._count(len(data))
        self._template.extend(data)

    def _open(self, name: str, kind: str, size: int) -> None:
        self._fields[name] = (kind, self.size)
        self._template.extend(bytes(size))


def text(content: str) -> bytes:
    """Return the message of a String."""
    data = content.encode() + b"\0"
    return _HEADER + len(data).to_bytes(4, "little") + data


def content(message: bytes) -> str:
    """Return the text of the message of a String."""
    start = len(_HEADER) + 4
    return message[start : start + int.from_bytes(message[len(_HEADER) : start], "little") - 1].decode()
