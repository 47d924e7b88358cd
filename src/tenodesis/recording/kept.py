"""What a recorder keeps at the end of its recording about the rows, so that they need not be read to describe them."""

import json
import struct
import zlib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO

import numpy as np
import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.summary import Summary
from mcap.writer import MCAP0_MAGIC
from pydantic import TypeAdapter

from tenodesis.control import FAULTS
from tenodesis.errors import InstrumentError, RecordingError
from tenodesis.recording import schemas
from tenodesis.recording.blocks import LEAST_ROWS, Event, Infos, Progress, as_events, opened
from tenodesis.recording.container import Messages, chunk_messages
from tenodesis.recording.inflate import Allowance, InflationError
from tenodesis.recording.metadata import controller_choices
from tenodesis.recording.outcome import Facts, Seen
from tenodesis.recording.reader import Recording
from tenodesis.run import Names, Run, concatenate
from tenodesis.version import __version__

_DATA_END = struct.Struct("<BQI")
_FOOTER = struct.Struct("<BQQQI")
_RECORD = struct.Struct("<BQ")
_UNREADABLE = (
    *(McapError, zstandard.ZstdError, InflationError, RecordingError, OSError, struct.error),
    *(AttributeError, LookupError, OverflowError, RecursionError, TypeError, ValueError),
)
"""What is raised where a damaged file has any number in the place of an offset, or any text in that of JSON."""
_PIECE = 2**24
"""Bytes of a file that are read at once."""


@dataclass
class _Kept(Facts):
    channels: dict[int, tuple[int, int, int]]
    """Number of messages, and stamps of the first and the last, by channel."""


def seen_of(recording: Recording) -> Seen:
    """Return what takes the rows of a recording, without an outcome where the instrument is not known."""
    try:
        faults = (controller_choices(recording) or {}).get("faults")
        names = [str(name) for name in faults] if isinstance(faults, list) else []
        return Seen(recording.instrument(), names or FAULTS)
    except (InstrumentError, RecordingError):
        return Seen()


class Keeper:
    """Gathers what the rows of a recording hold while they are written, in the blocks in which they are read again.

    Of rows that do not go with the instrument nothing is kept; they are written all the same.

    Parameters
    ----------
    path, names, metadata
        Of the recording.
    """

    def __init__(self, path: Path, names: Names, metadata: Mapping[str, str]) -> None:
        self._waiting: list[Run] = []
        self._seen: Seen | None = seen_of(Recording(path, Run(np.empty(0), *names), metadata, {}, {}, None))

    def add(self, run: Run, start: int, stop: int) -> None:
        """Take rows of a run, which are copied."""
        if self._seen is not None:
            self._waiting.append(concatenate([run.rows(start, stop)]))

    def end_chunk(self, least: int = LEAST_ROWS) -> None:
        """Evaluate the rows that wait, if they are enough for a block."""
        if self._seen is None or sum(map(len, self._waiting)) < least:
            return
        seen, waiting, self._seen, self._waiting = self._seen, self._waiting, None, []
        with suppress(LookupError, ValueError), np.errstate(all="ignore"):
            seen.add(concatenate(waiting))
            self._seen = seen

    def texts(self, messages: Mapping[int, tuple[int, int, int]]) -> dict[str, str]:
        """Return what to keep, by key: nothing without rows.

        Parameters
        ----------
        messages
            Number of messages, and stamps of the first and the last, by channel.
        """
        if self._waiting:
            self.end_chunk(1)
        if self._seen is None or not self._seen.rows:
            return {}
        return {"json": json.dumps({**asdict(self._seen.done()), "channels": messages})}


def read(path: Path, progress: Progress | None = None) -> tuple[Recording, Facts] | None:
    """Return a recording without its rows and what its recorder kept about them.

    None if the recorder kept nothing, was of another version, or was killed, or the file is damaged or no longer what
    was recorded; all of its bytes are read to know that, which takes a tenth of the time of reading the rows.
    """
    with suppress(*_UNREADABLE), opened(path) as (file, size):
        return _read(path, file, size, progress)
    return None


def _read(path: Path, file: IO[bytes], size: int, progress: Progress | None) -> tuple[Recording, Facts] | None:
    reader = SeekingReader(file, record_size_limit=size)
    index = reader.get_summary()
    if index is None or index.statistics is None or schemas.SEEN not in {one.name for one in index.metadata_indexes}:
        return None
    texts = {one.name: one.metadata for one in reader.iter_metadata()}
    metadata = texts[schemas.METADATA]
    names = schemas.names_in(metadata, {})
    kept = TypeAdapter(_Kept).validate_json(texts[schemas.SEEN]["json"])
    messages = kept.channels
    counts = {number: count for number, (count, _, _) in messages.items()}
    of_events = {number for number, channel in index.channels.items() if channel.topic == schemas.EVENTS}
    if (
        names is None
        or metadata["tenodesis"] != __version__
        or counts != index.statistics.channel_message_counts
        or {count for number, count in counts.items() if number not in of_events} != {kept.rows}
        or not _is_whole(file, size, progress)
    ):
        return None
    events, torn = _events(file, size, index, of_events)
    if torn is not None:
        return None
    topics = Infos(messages).of(index)
    return Recording(path, Run(np.empty(0), *names), metadata, topics, {}, None, events), kept


def _is_whole(file: IO[bytes], size: int, progress: Progress | None) -> bool:
    """Return whether a file's two checksums, of its data and of its index, are there and right."""
    end = size - len(MCAP0_MAGIC) - _FOOTER.size
    tail = _at(file, end, size - end)
    _, _, start, _, of_index = _FOOTER.unpack_from(tail)
    data_end = start - _DATA_END.size
    rest = _at(file, data_end, end - data_end)
    opcode, _, of_data = _DATA_END.unpack_from(rest)
    index = rest[_DATA_END.size :] + tail[: _FOOTER.size - struct.calcsize("<I")]
    if opcode != Opcode.DATA_END or not tail.endswith(MCAP0_MAGIC) or not of_data or zlib.crc32(index) != of_index:
        return False
    file.seek(0)
    checksum = 0
    for position in range(0, data_end, _PIECE):
        checksum = zlib.crc32(file.read(min(_PIECE, data_end - position)), checksum)
        if progress is not None:
            progress(position, size)
    return bool(checksum == of_data)


def _events(file: IO[bytes], size: int, index: Summary, channels: set[int]) -> tuple[tuple[Event, ...], str | None]:
    allowance, found = Allowance(size), Messages()
    for place in index.chunk_indexes:
        if channels & place.message_index_offsets.keys():
            body = _at(file, place.chunk_start_offset, place.chunk_length)[_RECORD.size :]
            for number, messages in chunk_messages(body, allowance).items():
                found.parts += messages.parts if number in channels else []
    return as_events(found)


def _at(file: IO[bytes], position: int, count: int) -> bytes:
    file.seek(position)
    return file.read(count)
