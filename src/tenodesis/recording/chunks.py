"""Write an MCAP file chunk by chunk, the messages of many rows at once.

The records are those that the library ``mcap`` writes, byte by byte; on one core and 22 topics this writes 111,000
rows/s, 55 times what a bench gives, as simulated time may run, ``mcap`` 11,000, and ``foxglove-sdk`` 39,000, which
numbers messages itself, does not say why a disk fails, and would add 53 MB to every installation.
"""

import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import IO

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

_HEAD = [
    ("opcode", "u1"),
    ("length", "<u8"),
    ("channel", "<u2"),
    ("sequence", "<u4"),
    ("log", "<u8"),
    ("publish", "<u8"),
]
_HEAD_SIZE = np.dtype(_HEAD).itemsize
_UNCOUNTED = 9
"""Bytes of a record's opcode and length, which the length does not include."""
_INDEX_ENTRY = np.dtype([("time", "<u8"), ("offset", "<u8")])
_INDEX_HEAD = struct.Struct("<BQHI")


@dataclass
class _Open:
    """The chunk in progress."""

    parts: list[bytes] = field(default_factory=list)
    size: int = 0
    messages: int = 0
    first: int = 0
    last: int = 0
    indices: dict[int, list[bytes]] = field(default_factory=dict)
    """Times of the messages and their positions in the chunk, by channel."""

    def add(self, part: bytes) -> None:
        self.parts.append(part)
        self.size += len(part)


class ChunkedFile:
    """An MCAP file being written; a chunk is closed by `flush` alone.

    Parameters
    ----------
    file
        Where to; its errors are passed on.
    profile, library
        For the file's header.
    """

    def __init__(self, file: IO[bytes], profile: str, library: str) -> None:
        self._file = file
        self._position = self._checksum = 0
        self._open = _Open()
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._counts: dict[int, int] = {}
        self._chunks, self._first, self._last = 0, 0, 0
        self._chunk_indices = bytearray()
        self._metadata_indices: list[MetadataIndex] = []
        self._dtypes: dict[tuple[int, ...], np.dtype[np.void]] = {}
        self._write(MCAP0_MAGIC)
        self._write(_bytes(Header(profile, library)))

    def add_metadata(self, name: str, content: Mapping[str, str]) -> None:
        """Append texts by key."""
        data = _bytes(Metadata(name, dict(content)))
        self._metadata_indices.append(MetadataIndex(self._position, len(data), name))
        self._write(data)

    def add_schema(self, name: str, encoding: str, definition: bytes) -> int:
        """Append a schema and return its number."""
        self._schemas.append(Schema(id=len(self._schemas) + 1, data=definition, encoding=encoding, name=name))
        self._open.add(_bytes(self._schemas[-1]))
        return len(self._schemas)

    def add_channel(self, topic: str, encoding: str, schema: int, metadata: Mapping[str, str]) -> int:
        """Append a channel and return its number."""
        number = len(self._channels) + 1
        self._channels.append(Channel(number, topic, encoding, dict(metadata), schema))
        self._open.add(_bytes(self._channels[-1]))
        return number

    def add_rows(self, stamps: NDArray[np.int64], sequences: NDArray[np.int64], blocks: Mapping[int, bytes]) -> None:
        """Append messages, row by row: on each channel n messages of equal size, with stamps (n,), in ns."""
        count = stamps.size
        sizes = tuple(len(block) // count for block in blocks.values())
        rows = np.empty(count, self._rows_of(sizes))
        times = stamps.astype(np.uint64)
        chunk = self._open
        place = chunk.size + rows.itemsize * np.arange(count)
        for n, ((channel, block), size) in enumerate(zip(blocks.items(), sizes, strict=True)):
            head = rows[f"head{n}"]
            head["opcode"], head["length"] = Opcode.MESSAGE, _HEAD_SIZE - _UNCOUNTED + size
            head["channel"], head["sequence"] = channel, sequences
            head["log"] = head["publish"] = times
            rows[f"data{n}"] = np.frombuffer(block, f"V{size}")
            entries = np.empty(count, _INDEX_ENTRY)
            entries["time"] = times
            entries["offset"] = place
            place += _HEAD_SIZE + size
            chunk.indices.setdefault(channel, []).append(entries.tobytes())
            self._counts[channel] = self._counts.get(channel, 0) + count
        first, last = int(times.min()), int(times.max())
        chunk.first = min(first, chunk.first) if chunk.messages else first
        chunk.last = max(last, chunk.last)
        chunk.messages += count * len(blocks)
        chunk.add(rows.tobytes())

    def flush(self) -> None:
        """Close the chunk in progress, if it has messages, and flush to the operating system."""
        if self._open.messages:
            self._close_chunk()
        self._file.flush()

    def finish(self) -> None:
        """Close the chunk in progress, and write the end and the index of the file."""
        if self._open.messages:
            self._close_chunk()
        self._write(_bytes(DataEnd(self._checksum)))
        start = self._position
        groups = {
            Opcode.SCHEMA: b"".join(map(_bytes, self._schemas)),
            Opcode.CHANNEL: b"".join(map(_bytes, self._channels)),
            Opcode.STATISTICS: _bytes(self._statistics()),
            Opcode.CHUNK_INDEX: bytes(self._chunk_indices),
            Opcode.ATTACHMENT_INDEX: b"",
            Opcode.METADATA_INDEX: b"".join(map(_bytes, self._metadata_indices)),
        }
        offsets, place = b"", start
        for opcode, group in groups.items():
            offsets += _bytes(SummaryOffset(opcode, place, len(group)))
            place += len(group)
        summary = b"".join(groups.values()) + offsets
        # The checksum of the summary includes the footer up to its own position.
        footer = _bytes(Footer(start, place, 0))
        checksum = zlib.crc32(summary + footer[: -struct.calcsize("<I")])
        self._write(summary + _bytes(Footer(start, place, checksum)) + MCAP0_MAGIC)

    def _rows_of(self, sizes: tuple[int, ...]) -> "np.dtype[np.void]":
        if sizes not in self._dtypes:
            fields = [part for n, size in enumerate(sizes) for part in ((f"head{n}", _HEAD), (f"data{n}", f"V{size}"))]
            self._dtypes[sizes] = np.dtype(fields)
        return self._dtypes[sizes]

    def _close_chunk(self) -> None:
        """Write the chunk in progress and the index of its messages."""
        done, self._open = self._open, _Open()
        data = b"".join(done.parts)
        packed = zstandard.compress(data)
        chunk = Chunk("zstd", packed, done.last, done.first, zlib.crc32(data), len(data))
        start, record = self._position, _bytes(chunk)
        self._write(record)
        indices, offsets = b"", {}
        for channel, parts in done.indices.items():
            offsets[channel] = self._position + len(indices)
            entries = b"".join(parts)
            length = _INDEX_HEAD.size - _UNCOUNTED + len(entries)
            indices += _INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, length, channel, len(entries)) + entries
        self._write(indices)
        index = ChunkIndex(
            chunk_length=len(record),
            chunk_start_offset=start,
            compression=chunk.compression,
            compressed_size=len(packed),
            message_end_time=done.last,
            message_index_length=len(indices),
            message_index_offsets=offsets,
            message_start_time=done.first,
            uncompressed_size=len(data),
        )
        self._chunk_indices += _bytes(index)
        self._first = min(done.first, self._first) if self._chunks else done.first
        self._last = max(done.last, self._last)
        self._chunks += 1

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=self._chunks,
            message_count=sum(self._counts.values()),
            message_end_time=self._last,
            message_start_time=self._first,
            metadata_count=len(self._metadata_indices),
            schema_count=len(self._schemas),
        )

    def _write(self, data: bytes) -> None:
        self._checksum = zlib.crc32(data, self._checksum)
        self._position += len(data)
        self._file.write(data)


def _bytes(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()
    return data
