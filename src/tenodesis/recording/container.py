"""Read an MCAP file from its start up to the first damage, chunk by chunk.

The messages of a chunk that come in rows, as ours do, are taken together: on one core and 14 topics this reads 220,000
rows/s, the reader of ``mcap`` 4,600, and that does not say where a file is damaged.
"""

import struct
import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from io import BytesIO
from typing import IO, NamedTuple

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Metadata, Schema
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

from tenodesis.recording.inflate import Allowance, InflationError, inflate

_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_HEAD = [("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"), ("log", "<u8"), ("sent", "<u8")]
"""Fields of a message before its bytes."""
LONGEST_MAGIC = len(MCAP0_MAGIC)
"""Bytes that a file begins with."""
_INVALID = 0
"""Opcode that no record has."""
_LONGEST_ROW = 4096
"""Messages after which those of a chunk are not searched for a row that repeats."""
_PIECE = 2**24
"""Bytes of a file that are read at once where they are not kept, and of messages outside chunks that are."""
_KEPT = {Opcode.CHUNK, Opcode.METADATA, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.DATA_END}


_BETWEEN = {Opcode.CHUNK, Opcode.DATA_END, Opcode.FOOTER}
"""Before these, messages outside chunks are taken."""


class Message(NamedTuple):
    """A message: its number on its topic, its stamp in ns, and its bytes."""

    sequence: int
    stamp: int
    data: bytes


class MessageRows(NamedTuple):
    """Successive messages of a topic that are equally long: numbers (n,), stamps (n,) in ns, and bytes (n, size)."""

    sequences: NDArray[np.uint32]
    stamps: NDArray[np.uint64]
    data: NDArray[np.uint8]

    def rows(self, first: int, last: int) -> "MessageRows":
        """Return some of them."""
        return MessageRows(self.sequences[first:last], self.stamps[first:last], self.data[first:last])


class Messages(Iterable[Message]):
    """Messages of a topic, in parts."""

    def __init__(self, parts: Iterable[MessageRows] = ()) -> None:
        self.parts = list(parts)

    @classmethod
    def of(cls, messages: "Sequence[Message] | Messages") -> "Messages":
        """Return messages in parts."""
        if isinstance(messages, Messages):
            return messages
        found = cls()
        first = 0
        for last in range(1, len(messages) + 1):
            if last == len(messages) or len(messages[last].data) != len(messages[first].data):
                same = messages[first:last]
                data = np.frombuffer(b"".join(one.data for one in same), np.uint8)
                found.parts.append(
                    MessageRows(
                        np.array([one.sequence % 2**32 for one in same], np.uint32),
                        np.array([one.stamp for one in same]).astype(np.uint64),
                        data.reshape(len(same), -1 if data.size else 0),
                    )
                )
                first = last
        return found

    def __len__(self) -> int:
        return sum(part.stamps.size for part in self.parts)

    def __iter__(self) -> Iterator[Message]:
        for part in self.parts:
            numbers = zip(part.sequences.tolist(), part.stamps.tolist(), part.data, strict=True)
            yield from (Message(sequence, stamp, data.tobytes()) for sequence, stamp, data in numbers)

    @property
    def first(self) -> Message:
        """The first of them."""
        return next(iter(self))

    @property
    def sequences(self) -> NDArray[np.int64]:
        """Their numbers (n,)."""
        return np.concatenate([np.empty(0, np.int64), *(part.sequences for part in self.parts)]).astype(np.int64)

    @property
    def stamps(self) -> NDArray[np.int64]:
        """Their stamps (n,), ns."""
        return np.concatenate([np.empty(0, np.uint64), *(part.stamps for part in self.parts)]).astype(np.int64)

    def take(self, count: int) -> "Messages":
        """Take the first messages away, and return them."""
        taken = Messages()
        while count and self.parts:
            first = self.parts[0]
            taken.parts.append(first.rows(0, count))
            self.parts[:1] = [first.rows(count, first.stamps.size)] if count < first.stamps.size else []
            count -= taken.parts[-1].stamps.size
        return taken


@dataclass
class Contents:
    """Records of an MCAP file, and the reason if not all of them could be read."""

    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    messages: dict[int, Messages] = field(default_factory=dict)
    damage: str | None = None


class _DamageError(Exception):
    """The file is damaged; the message states where."""


def is_mcap(data: bytes) -> bool:
    """Return whether these bytes begin as an MCAP file does."""
    return data.startswith(MCAP0_MAGIC)


def contents_of(file: IO[bytes], size: int) -> Contents:
    """Read an MCAP file, at its start, of so many bytes, up to the first damage."""
    scanned = Scan(file, size)
    for more in scanned:
        for number, new in more.items():
            scanned.messages.setdefault(number, Messages()).parts.extend(new.parts)
    return scanned


class Scan(Contents):
    """Messages of an MCAP file by channel, chunk after chunk, up to the first damage; what else it has by then.

    Parameters
    ----------
    file, size
        The file, at its start, and its size, bytes.
    """

    def __init__(self, file: IO[bytes], size: int) -> None:
        super().__init__()
        self.position = 0
        """Bytes that are read."""
        self.size = size
        self._file = file
        self._allowance = Allowance(size)
        self._checksum = 0

    def __iter__(self) -> Iterator[dict[int, Messages]]:
        outside = _Loose()
        try:
            yield from self._chunks(outside)
        except _DamageError as damage:
            yield outside.taken()
            self.damage = str(damage)

    def _chunks(self, outside: "_Loose") -> Iterator[dict[int, Messages]]:  # noqa: PLR0912
        self._read(len(MCAP0_MAGIC))
        while True:
            start, checksum = self.position, self._checksum
            opcode, length = self._record()
            if opcode in _BETWEEN or outside.size > _PIECE:
                yield outside.taken()
            if opcode in {Opcode.DATA_END, Opcode.FOOTER}:
                body = self._read(length)
                stated = int.from_bytes(body, "little") if opcode == Opcode.DATA_END else 0
                if stated and stated != checksum:
                    raise _DamageError("bytes outside its chunks are corrupted, maybe among the metadata")
                # the summary only repeats what came before, and has no checksum of its own where it is cut off
                while opcode != Opcode.FOOTER:
                    opcode, length = self._record()
                    self._skip(length)
                if self._read(len(MCAP0_MAGIC) + 1) != MCAP0_MAGIC:
                    raise _DamageError("the end of the file is cut off or corrupted")
                return
            if opcode not in _KEPT:
                self._skip(length)
                continue
            body = self._read(length)
            try:
                if opcode == Opcode.CHUNK:
                    found = self._chunk(body)
                elif opcode == Opcode.METADATA:
                    record = Metadata.read(record_stream(body))
                    self.metadata[record.name] = record.metadata
                elif opcode == Opcode.MESSAGE:
                    outside.add(body, 0, len(body))
                else:
                    _define(opcode, body, self.schemas, self.channels)
            except InflationError as problem:
                raise _DamageError(f"the chunk at byte {start} {problem}") from None
            # zstandard and lz4 have errors of their own, which have nothing but Exception in common
            except Exception as problem:
                kind = "chunk" if opcode == Opcode.CHUNK else "record"
                raise _DamageError(f"the {kind} at byte {start} is corrupted") from problem
            if opcode == Opcode.CHUNK:
                yield found

    def _record(self) -> tuple[int, int]:
        """Return opcode and length of the next record, whose beginning is read."""
        start = self.position
        if start == self.size:
            raise _DamageError("the file ends before it was closed")
        if start + _RECORD.size > self.size:
            raise _DamageError(f"the record at byte {start} is cut off")
        opcode, length = _RECORD.unpack(self._read(_RECORD.size))
        if self.position + length > self.size or opcode == _INVALID:
            raise _DamageError(f"the record at byte {start} is cut off or corrupted")
        return opcode, length

    def _read(self, count: int) -> bytes:
        data = self._file.read(count)
        self._checksum = zlib.crc32(data, self._checksum)
        self.position += len(data)
        return data

    def _skip(self, count: int) -> None:
        while count > 0 and (data := self._read(min(count, _PIECE))):
            count -= len(data)

    def _chunk(self, body: bytes) -> dict[int, Messages]:
        """Return a chunk's messages, and add its other records, all or none."""
        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}
        messages = chunk_messages(body, self._allowance, schemas, channels)
        self.schemas |= schemas
        self.channels |= channels
        return messages


def chunk_messages(
    body: bytes,
    allowance: Allowance,
    schemas: dict[int, Schema] | None = None,
    channels: dict[int, Channel] | None = None,
) -> dict[int, Messages]:
    """Return the messages by channel of a chunk's record, and add its schemas and channels; raises what may be."""
    chunk = Chunk.read(record_stream(body))
    data = inflate(chunk.data, chunk.compression, chunk.uncompressed_size, allowance)
    if chunk.uncompressed_crc and chunk.uncompressed_crc != zlib.crc32(data):
        raise ValueError("its checksum differs")
    return _split(data, {} if schemas is None else schemas, {} if channels is None else channels, allowance)


class _Loose:
    """Messages that are gathered one by one."""

    def __init__(self) -> None:
        self._found: dict[int, list[Message]] = {}
        self._parts: dict[int, Messages] = {}
        self.size = 0

    def add(self, data: bytes, start: int, end: int) -> None:
        channel, sequence, stamp, _ = _MESSAGE.unpack_from(data, start)
        self._found.setdefault(channel, []).append(Message(sequence, stamp, data[start + _MESSAGE.size : end]))
        self.size += end - start

    def add_part(self, channel: int, part: MessageRows) -> None:
        """Add several at once."""
        messages = self._parts.setdefault(channel, Messages())
        messages.parts += Messages.of(self._found.pop(channel, [])).parts
        messages.parts.append(part)

    def taken(self) -> dict[int, Messages]:
        """Take all of them."""
        for channel, messages in self._found.items():
            self._parts.setdefault(channel, Messages()).parts.extend(Messages.of(messages).parts)
        found, self._parts, self._found, self.size = self._parts, {}, {}, 0
        return found


def _split(
    data: bytes, schemas: dict[int, Schema], channels: dict[int, Channel], allowance: Allowance
) -> dict[int, Messages]:
    """Return the messages of a chunk's content, and add its schemas and channels."""
    found = _Loose()
    row: list[tuple[int, int]] = []
    """Channel and length of the messages since one came twice on its channel, or something else came."""
    seen: set[int] = set()
    begin = position = 0
    skip = patience = 0
    """How many rows are taken singly before the next try to find one that repeats, which doubles."""
    while position < len(data):
        opcode, start, end = _record_at(data, position)
        channel = int.from_bytes(data[start : start + 2], "little") if opcode == Opcode.MESSAGE else -1
        if (channel in seen or channel < 0) and row:
            taken = 0 if skip or channel < 0 else _rows(data, begin, row, found)
            if skip:
                skip -= 1
            elif channel >= 0:
                patience = skip = 0 if taken else min(2 * patience + 1, _LONGEST_ROW)
            if not taken:
                _take_singly(data, begin, position, found)
            allowance.take_records(max(taken, 1) * len(row))
            begin = position = begin + max(taken, 1) * (position - begin)
            row, seen = [], set()
            continue
        if channel < 0:
            allowance.take_records(1)
            _define(opcode, data[start:end], schemas, channels)
            begin = end
        else:
            row.append((channel, end - start))
            seen.add(channel)
        position = end
    _take_singly(data, begin, position, found)
    allowance.take_records(len(row))
    return found.taken()


def _rows(data: bytes, begin: int, row: Sequence[tuple[int, int]], found: _Loose) -> int:
    """Add the rows that begin somewhere and repeat these channels and lengths; return how many, 0 for fewer than 2."""
    if len(row) > _LONGEST_ROW or any(length < _MESSAGE.size for _, length in row):
        return 0
    kind = _row_of(tuple(length - _MESSAGE.size for _, length in row))
    count = (len(data) - begin) // kind.itemsize
    if count < 2:
        return 0
    rows = np.frombuffer(data, kind, count, begin)
    same = np.ones(count, bool)
    for n, (channel, length) in enumerate(row):
        head = rows[f"head{n}"]
        same &= (head["opcode"] == Opcode.MESSAGE) & (head["length"] == length) & (head["channel"] == channel)
    count = count if same.all() else int(np.argmin(same))
    if count < 2:
        return 0
    for n, (channel, _) in enumerate(row):
        head = rows[f"head{n}"][:count]
        found.add_part(channel, MessageRows(head["sequence"], head["log"], rows[f"data{n}"][:count]))
    return count


@lru_cache(16)
def _row_of(sizes: tuple[int, ...]) -> "np.dtype[np.void]":
    """Return messages with so many bytes each, as a type."""
    return np.dtype(
        [part for n, size in enumerate(sizes) for part in ((f"head{n}", _HEAD), (f"data{n}", f"({size},)u1"))]
    )


def _take_singly(data: bytes, position: int, end: int, found: _Loose) -> None:
    while position < end:
        _, start, position = _record_at(data, position)
        found.add(data, start, position)


def _record_at(data: bytes, position: int) -> tuple[int, int, int]:
    """Return a record's opcode, and where its body starts and ends."""
    if position + _RECORD.size > len(data):
        raise _DamageError(f"the record at byte {position} is cut off")
    opcode, length = _RECORD.unpack_from(data, position)
    start: int = position + _RECORD.size
    if start + length > len(data) or opcode == _INVALID:
        raise _DamageError(f"the record at byte {position} is cut off or corrupted")
    return opcode, start, start + length


def _define(opcode: int, body: bytes, schemas: dict[int, Schema], channels: dict[int, Channel]) -> None:
    """Add a schema or channel."""
    if opcode == Opcode.CHANNEL:
        channel = Channel.read(record_stream(body))
        channels[channel.id] = channel
    elif opcode == Opcode.SCHEMA:
        schema = Schema.read(record_stream(body))
        schemas[schema.id] = schema


def record_stream(body: bytes) -> ReadDataStream:
    """Return the body of a record as ``mcap`` reads it."""
    return ReadDataStream(BytesIO(body))
