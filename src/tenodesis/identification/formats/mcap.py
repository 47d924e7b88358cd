"""Recordings of an instrument: files of ROS 2 messages, as ``tenodesis record`` and a bench write them.

A file is MCAP or SQLite; a bag of ROS 2 is a folder of such files, whose topics may each have a clock of their own.
SQLite is read here, also damaged, within bounds.
Topics and joints of other names need a map, with which :mod:`tenodesis.recording.lab_bags` reads them.
"""

import sqlite3
from collections.abc import Collection, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mcap.records import Channel, Schema
from numpy.typing import NDArray

from tenodesis.errors import IdentificationError, InstrumentError, RecordingError
from tenodesis.identification.formats.csv import as_identification
from tenodesis.identification.formats.instrument_run import (
    SECONDS,
    USED,
    InstrumentRun,
    checked,
    columns_of,
    first_axis,
)
from tenodesis.identification.formats.measured import Raw
from tenodesis.instrument import ShortForm, as_short_form
from tenodesis.recording import Blocks, Recording, cdr, container, schemas
from tenodesis.recording.blocks import Progress, assembled, opened
from tenodesis.recording.container import Contents, Message, Messages
from tenodesis.recording.decode import Decoded, LeftOut, Misfit, decoded
from tenodesis.recording.lab_bags import SQLITE, covered
from tenodesis.run import Array, Names, Run, concatenate

SUFFIX = ".db3"

MOST_ROWS = 2_000_000
"""Rows of a recording that are taken, 1,000 s at 2 kHz; one of four would move estimates out of their intervals."""

_ZSTANDARD = b"\x28\xb5\x2f\xfd"
_LEAST_LENGTH = 100_000
"""Length that a text of any bag may have, bytes."""
_MOST_TOPICS = 10_000
_STEPS_AT_ONCE = 10_000
_FREE_STEPS, _STEPS_PER_BYTE = 10_000_000, 10
"""Steps of its machine that reading any bag may take, and how many more by a byte of it."""


def is_sqlite(path: Path) -> bool:
    """Return whether a file begins as a SQLite file does."""
    if not path.is_file():
        return False
    try:
        with path.open("rb") as file:
            return file.read(len(SQLITE)) == SQLITE
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
        raise RecordingError(
            f"{path} cannot be read: it is no regular file.", key="path", value=path, allowed="a regular file"
        )
    size = path.stat().st_size + (0 if closed else left_behind.stat().st_size)
    contents = Contents()
    try:
        bag = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro{'&immutable=1' if closed else ''}", uri=True)
    except sqlite3.Error as problem:
        raise RecordingError(f"{path} cannot be read: {problem}.", key="path", value=path) from None
    with closing(bag):
        _bound(bag, size)
        try:
            _read_topics(bag, contents)
        except (sqlite3.Error, ValueError, OverflowError) as problem:
            raise RecordingError(
                f"{path} cannot be read as a bag of ROS 2: {problem}.", key="path", value=path
            ) from None
        for number, channel in contents.channels.items():
            if channel.topic in wanted:
                size -= _read(bag, number, contents, size)
    if any(messages.first.data.startswith(_ZSTANDARD) for messages in contents.messages.values()):
        raise RecordingError(
            f"{path} holds compressed messages; they must be plain, as ros2 bag convert writes them.",
            key="path",
            value=path,
            allowed="a bag of plain messages",
        )
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
        definition = schemas.definition(kind) if kind in schemas.NUMBERS else ""
        contents.channels[number] = Channel(number, name, encoding, {}, number)
        contents.schemas[number] = Schema(number, definition.encode(), "ros2msg", kind)


def _read(bag: sqlite3.Connection, number: int, contents: Contents, most: int) -> int:
    """Add the messages of a topic, up to where the file is damaged; return their size, bytes, at most `most`."""
    taken = 0
    found: list[Message] = []
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
            found.append(Message(at, stamp, data))
    except (sqlite3.Error, ValueError, OverflowError) as problem:
        contents.damage = str(problem)
    if found:
        contents.messages[number] = Messages.of(found)
    return min(taken, most)


_CLOCK = "/tendons/measured_js"


class _Signals(NamedTuple):
    """Signals of the first axis over time, each (n,) or per tendon (n, 2)."""

    time: Array
    axes: tuple[str, ...]
    signals: Mapping[str, Array]
    notes: tuple[str, ...]
    instrument: ShortForm | None


def load(path: Path, progress: Progress | None = None) -> InstrumentRun:
    """Return the first axis of a recording or of a bag: an MCAP or SQLite file, or a folder of them.

    Columns: handle_angle (commanded, where the recording has it, otherwise measured), measured_handle_angle,
    measured_output_angle (rad), tension_agonist, tension_antagonist, force, radial_force (N), spool_agonist,
    spool_antagonist (rad). What was not recorded is left out; without a force the tip is taken to be free. Topics with
    stamps of their own are brought to those of the load cells.

    Raises IdentificationError if the file is no recording, lacks what is needed, or is not usable.
    """
    files = _files(path)
    with as_identification():
        read = _recorded(files[0], progress) if len(files) == 1 and not is_sqlite(files[0]) else None
        read = _merged(path, files) if read is None else read
    notes = list(read.notes)
    columns = columns_of(read.signals, str(path), notes)
    name = path.resolve().name
    return checked(name, read.time, columns, notes=notes, instrument=read.instrument, axes=read.axes, clocks=SECONDS)


def _files(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path]
    mcap, sqlite = (sorted(path.glob(f"*{suffix}")) for suffix in (".mcap", SUFFIX))
    if mcap and sqlite:
        raise IdentificationError(
            f"{path} holds {mcap[0].name} and {sqlite[0].name}, which may be the same twice; it must be a bag of "
            "one kind, or one of its files.",
            key="path",
            value=path,
            allowed="a bag of one kind, or one of its files",
        )
    if not mcap and not sqlite:
        packed = next(iter(sorted(path.glob("*.zstd"))), None)
        found = "" if packed is None else f" ({packed.name} is compressed: unpack it first)"
        raise IdentificationError(
            f"{path} holds no MCAP file and no {SUFFIX} file{found}; it must be a recording, or the folder of a ROS 2 ",
            key="path",
            value=path,
        )
    return mcap or sqlite


def _recorded(path: Path, progress: Progress | None) -> _Signals | None:
    """Return a recording whose topics share their stamps, or None if they do not."""
    recording, notes = first_rows(path, USED, progress)
    if any(topic.reason is Misfit.STAMPS for topic in recording.left_out.values()):
        return None
    run, inst = recording.run, _instrument(recording)
    cut = bool(notes)
    notes += [f"{topic} is left out: {reason}" for topic, reason in recording.left_out.items()]
    longest = max((info.messages for name, info in recording.topics.items() if name in schemas.TOPICS), default=0)
    if not cut and longest > len(run):
        notes.append(f"topics do not end together: the first {len(run)} of up to {longest} rows are taken")
    return _Signals(run.time, run.axes, first_axis(run), tuple(notes), inst)


def first_rows(path: Path, signals: Collection[str], progress: Progress | None = None) -> tuple[Recording, list[str]]:
    """Return signals of a recording's first rows, after which a long one is not read, and what to say about that.

    Raises
    ------
    RecordingError
        As for :meth:`tenodesis.recording.Recording.open`, or it is damaged before its first row.
    """
    blocks = Blocks(path, signals=signals, progress=progress)
    kept: list[Run] = []
    rows = 0
    notes: list[str] = []
    try:
        for run in blocks:
            if rows >= MOST_ROWS:
                notes.append(f"it is long: its first {kept[-1].time[-1] - kept[0].time[0]:.4g} s are taken")
                break
            kept.append(run)
            rows += len(run)
        recording = blocks.recording(concatenate(kept))
    except RecordingError:
        recording = Recording.open(path, signals=signals)
    if recording.damage is not None and not len(recording.run):
        raise RecordingError(recording.damage, key="path", value=path, allowed="a whole recording")
    return recording, notes if recording.damage is None else [recording.damage]


def _merged(path: Path, files: Sequence[Path]) -> _Signals:
    """Return the topics of the files, interpolated to the stamps of the load cells."""
    notes: list[str] = []
    topics = _topics(files, notes)
    axes = schemas.axes_of({name: parts[0].joints for name, parts in topics.items()}) or ("yaw",)
    if _CLOCK not in topics:
        raise RecordingError(
            f"{path} lacks measured_tension; its topics are {', '.join(topics) or 'none of these'}"
            f"{''.join(f'; {note}' for note in notes)}; for topics and joints of "
            f"other names tenodesis map {path} writes a map.",
            key="signals",
            value=["measured_tension"],
        )
    begin = int(topics[_CLOCK][0].stamps[0])
    found = {name: _ordered(path, name, parts, begin, notes) for name, parts in topics.items()}
    clock = found[_CLOCK].stamps
    names = Names.paired(axes)
    used = {topic.name for topic in schemas.topics(names) if {*USED} & {*topic.signals.values()}}
    found = {name: one for name, one in found.items() if name in used}
    inside = np.logical_and.reduce([covered(clock, one.stamps) for one in found.values()])
    if any(not np.array_equal(clock, one.stamps) for one in found.values()):
        notes.append("topics have stamps of their own: all are interpolated to those of the load cells")
    onto = {name: _onto(clock, one) for name, one in found.items()}
    run, left_out = assembled(schemas.topics(names), names, onto, {})
    notes += [f"{topic} is left out: {reason}" for topic, reason in left_out.items()]
    signals = {name: values[inside] for name, values in first_axis(run).items()}
    return _Signals(run.time[inside], axes, signals, tuple(notes), None)


def _onto(clock: NDArray[np.int64], topic: Decoded) -> Decoded:
    """Return a topic's numbers interpolated to the stamps of another."""
    # counted from the first, for a float has no digits for nanoseconds since 1970
    at, of = clock - clock[0], topic.stamps - clock[0]
    numbers = {
        name: np.stack([np.interp(at, of, column) for column in values.T], axis=1)
        for name, values in topic.numbers.items()
    }
    return Decoded(clock, topic.joints, numbers)


def _topics(files: Sequence[Path], notes: list[str]) -> dict[str, list[Decoded]]:
    """Return the topics of recordings in these files, by name and in order of their stamps."""
    topics: dict[str, list[Decoded]] = {}
    for file in files:
        contents = _contents(file)
        if contents.damage is not None:
            notes.append(f"{file.name} is read in part only: {contents.damage}")
        for number in contents.messages.keys() - contents.channels.keys():
            notes.append(f"{file.name} holds messages of a channel that it does not describe: {number}")
        for topic, found in decoded(contents, schemas.TOPICS):
            parts = topics.get(topic, [])
            if isinstance(found, LeftOut):
                notes.append(f"{topic} is left out of {file.name}: {found}")
            elif parts and found.joints != parts[0].joints:
                notes.append(f"{topic} is left out of {file.name}: its joints are not those of other files")
            else:
                topics[topic] = [*parts, found]
    return {name: sorted(parts, key=lambda part: int(part.stamps[0])) for name, parts in topics.items()}


def _contents(file: Path) -> container.Contents:
    if is_sqlite(file):
        return scan(file, schemas.TOPICS)
    with opened(file) as (data, size):
        return container.contents_of(data, size)


def _ordered(path: Path, name: str, parts: Sequence[Decoded], begin: int, notes: list[str]) -> Decoded:
    """Return a topic's messages of all files, less those that came twice or whose clock ran back."""
    fields = [field for field in parts[0].numbers if all(field in part.numbers for part in parts)]
    numbers = {field: np.concatenate([part.numbers[field] for part in parts]) for field in fields}
    columns = {f"{field} {at}": column for field, values in numbers.items() for at, column in enumerate(values.T)}
    stamps = np.concatenate([part.stamps for part in parts])
    raw = Raw(f"{path.name}: {name}", (stamps - begin) / cdr.SECOND, columns)
    raw.ordered()
    notes += [f"{name}: {note}" for note in raw.notes]
    kept = {
        field: np.stack([raw.columns[f"{field} {at}"] for at in range(values.shape[1])], axis=1)
        for field, values in numbers.items()
    }
    return Decoded(np.rint(raw.time * cdr.SECOND).astype(np.int64) + begin, parts[0].joints, kept)


def _instrument(recording: Recording) -> ShortForm | None:
    if "instrument" not in recording.metadata:
        return None
    try:
        return as_short_form(recording.instrument()).planar[0]
    except InstrumentError:
        return None
