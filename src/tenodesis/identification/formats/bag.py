"""ROS 2 bags in SQLite, read into the same messages as MCAP files."""

import sqlite3
from collections.abc import Collection
from pathlib import Path

from mcap.records import Channel, Schema

from tenodesis.errors import RecordingError
from tenodesis.recording import schemas
from tenodesis.recording.container import Contents, Message

SUFFIX = ".db3"

_MAGIC = b"SQLite format 3\0"
_ZSTANDARD = b"\x28\xb5\x2f\xfd"
_KNOWN = (schemas.JOINT_STATE, schemas.WRENCH, schemas.FLOAT64)


def is_sqlite(path: Path) -> bool:
    """Return whether a file begins as a SQLite file does."""
    try:
        with path.open("rb") as file:
            return file.read(len(_MAGIC)) == _MAGIC
    except OSError:
        return False


def scan(path: Path, wanted: Collection[str]) -> Contents:
    """Return the wanted topics of a bag, in order of arrival, up to where the file is damaged.

    Raises
    ------
    RecordingError
        The file cannot be read, is no bag, or its messages are compressed.
    """
    # a bag on a medium that cannot be written opens as unchanging, which a log left beside it is not
    left_behind = path.with_name(f"{path.name}-wal")
    closed = not left_behind.exists() or not left_behind.stat().st_size
    contents = Contents()
    try:
        bag = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro{'&immutable=1' if closed else ''}", uri=True)
    except sqlite3.Error as problem:
        raise RecordingError(f"{path} cannot be read: {problem}.") from None
    try:
        for number, name, kind, encoding in bag.execute("SELECT id, name, type, serialization_format FROM topics"):
            definition = schemas.definition(kind) if kind in _KNOWN else ""
            contents.channels[number] = Channel(number, name, encoding, {}, number)
            contents.schemas[number] = Schema(number, definition.encode(), "ros2msg", kind)
    except sqlite3.Error as problem:
        bag.close()
        raise RecordingError(f"{path} cannot be read as a bag of ROS 2: {problem}.") from None
    for number, channel in contents.channels.items():
        if channel.topic in wanted:
            _read(bag, number, contents)
    bag.close()
    if any(message.data.startswith(_ZSTANDARD) for messages in contents.messages.values() for message in messages[:1]):
        raise RecordingError(f"{path} holds compressed messages; they must be plain, as ros2 bag convert writes them.")
    return contents


def _read(bag: sqlite3.Connection, number: int, contents: Contents) -> None:
    """Add the messages of a topic, up to where the file is damaged."""
    rows = bag.execute("SELECT timestamp, data FROM messages WHERE topic_id = ? ORDER BY id", (number,))
    try:
        for at, (stamp, data) in enumerate(rows):
            contents.messages.setdefault(number, []).append(Message(at, stamp, data))
    except sqlite3.Error as problem:
        contents.damage = str(problem)
