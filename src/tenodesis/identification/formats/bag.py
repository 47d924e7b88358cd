"""ROS 2 bags in SQLite, read into the same messages as MCAP files.

``rosbags`` reads a whole folder with its ``metadata.yaml``; this reads a file alone, also a damaged one, within bounds.
"""

import sqlite3
from collections.abc import Collection
from contextlib import closing
from pathlib import Path

from mcap.records import Channel, Schema

from tenodesis.errors import RecordingError
from tenodesis.recording import schemas
from tenodesis.recording.container import Contents, Message

SUFFIX = ".db3"

_MAGIC = b"SQLite format 3\0"
_ZSTANDARD = b"\x28\xb5\x2f\xfd"
_LEAST_LENGTH = 100_000
"""Length that a text of any bag may have, bytes."""
_MOST_TOPICS = 10_000
_STEPS_AT_ONCE = 10_000
_FREE_STEPS, _STEPS_PER_BYTE = 10_000_000, 10
"""Steps of its machine that reading any bag may take, and how many more by a byte of it."""
_KNOWN = (schemas.JOINT_STATE, schemas.WRENCH, schemas.FLOAT64)


def is_sqlite(path: Path) -> bool:
    """Return whether a file begins as a SQLite file does."""
    if not path.is_file():
        return False
    try:
        with path.open("rb") as file:
            return file.read(len(_MAGIC)) == _MAGIC
    except OSError:
        return False


def scan(path: Path, wanted: Collection[str]) -> Contents:
    """Return the wanted topics of a bag, in order of arrival, up to where the file is damaged.

    Raises RecordingError if the file cannot be read, is no bag, or its messages are compressed.
    """
    # a bag on a medium that cannot be written opens as unchanging, which a log left beside it is not
    left_behind = path.with_name(f"{path.name}-wal")
    closed = not left_behind.exists() or not left_behind.stat().st_size
    if not path.is_file():
        raise RecordingError(f"{path} cannot be read: it is no regular file.")
    size = path.stat().st_size + (0 if closed else left_behind.stat().st_size)
    contents = Contents()
    try:
        bag = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro{'&immutable=1' if closed else ''}", uri=True)
    except sqlite3.Error as problem:
        raise RecordingError(f"{path} cannot be read: {problem}.") from None
    with closing(bag):
        _bound(bag, size)
        try:
            _read_topics(bag, contents)
        except (sqlite3.Error, ValueError, OverflowError) as problem:
            raise RecordingError(f"{path} cannot be read as a bag of ROS 2: {problem}.") from None
        for number, channel in contents.channels.items():
            if channel.topic in wanted:
                size -= _read(bag, number, contents, size)
    if any(message.data.startswith(_ZSTANDARD) for messages in contents.messages.values() for message in messages[:1]):
        raise RecordingError(f"{path} holds compressed messages; they must be plain, as ros2 bag convert writes them.")
    return contents


def _bound(bag: sqlite3.Connection, size: int) -> None:
    """Let a bag take no more work and memory than its size explains: what is called a table may be a computation."""
    bag.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, max(size, _LEAST_LENGTH))
    left = (_FREE_STEPS + _STEPS_PER_BYTE * size) // _STEPS_AT_ONCE

    def go_on() -> bool:
        nonlocal left
        left -= 1
        return left < 0

    bag.set_progress_handler(go_on, _STEPS_AT_ONCE)


def _read_topics(bag: sqlite3.Connection, contents: Contents) -> None:
    rows = bag.execute("SELECT id, name, type, serialization_format FROM topics LIMIT ?", (_MOST_TOPICS,))
    for number, *texts in rows:
        if not isinstance(number, int) or not all(isinstance(text, str) for text in texts):
            raise ValueError("a row of its topics has no number, name, type and format")
        name, kind, encoding = texts
        definition = schemas.definition(kind) if kind in _KNOWN else ""
        contents.channels[number] = Channel(number, name, encoding, {}, number)
        contents.schemas[number] = Schema(number, definition.encode(), "ros2msg", kind)


def _read(bag: sqlite3.Connection, number: int, contents: Contents, most: int) -> int:
    """Add the messages of a topic, up to where the file is damaged; return their size, bytes, at most `most`."""
    taken = 0
    try:
        rows = bag.execute("SELECT timestamp, data FROM messages WHERE topic_id = ? ORDER BY id", (number,))
        for at, (stamp, data) in enumerate(rows):
            if not isinstance(stamp, int) or not isinstance(data, bytes):
                contents.damage = f"message {at + 1} of topic {number} has no stamp or no data"
                break
            taken += len(data) + 1
            if taken > most:
                contents.damage = "its messages are larger than the file"
                break
            contents.messages.setdefault(number, []).append(Message(at, stamp, data))
    except (sqlite3.Error, ValueError, OverflowError) as problem:
        contents.damage = str(problem)
    return min(taken, most)
