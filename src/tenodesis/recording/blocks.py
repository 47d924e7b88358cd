"""Rows of this package's recordings, block by block, so that an hour needs no more memory than a minute."""

import json
import struct
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from mcap.records import Channel
from mcap.summary import Summary
from mcap_ros2.decoder import DecoderFactory
from numpy.typing import NDArray

from tenodesis.errors import RecordingError
from tenodesis.files import open_regular
from tenodesis.recording import cdr, lab_bags, schemas
from tenodesis.recording.container import LONGEST_MAGIC, Contents, Messages, Scan, is_mcap
from tenodesis.recording.decode import Decoded, Decoder, LeftOut, Misfit
from tenodesis.run import COMPONENTS, Array, Names, Run, concatenate

LEAST_ROWS = 4000
"""Rows of a block, at least; the rest of a chunk comes with them."""
_MOST_WAITING = 200_000
"""Messages that may wait for those of other topics."""

Progress = Callable[[float, float], object]
"""Called with how much is done, and how much there is."""


class TopicInfo(NamedTuple):
    """A topic of a file: its message type, its number of messages, and their rate in Hz (NaN for fewer than two)."""

    type: str
    messages: int
    rate: float


class Event(NamedTuple):
    """What happened beside the signals: the time on the run's clock, s, and values by name."""

    time: float
    content: Mapping[str, Any]


class IrregularError(Exception):
    """The file is no recording of this package, or its topics do not go together row by row."""


@contextmanager
def opened(path: Path) -> Iterator[tuple[IO[bytes], int]]:
    """Open an MCAP file, and return it with its size; raises RecordingError if it is none."""
    try:
        file, size = open_regular(path)
        begin = file.read(LONGEST_MAGIC)
    except FileNotFoundError:
        raise RecordingError(f"{path} cannot be read: there is no such file.", key="path", value=path) from None
    except IsADirectoryError:
        raise lab_bags.no_bag(path) from None
    except OSError as problem:
        raise RecordingError(f"{path} cannot be read: {problem.strerror}.", key="path", value=path) from None
    with file:
        if not is_mcap(begin):
            found = "it is empty" if not begin else f"it begins with {begin.decode(errors='replace')!r}"
            raise RecordingError(f"{path} is no MCAP file: {found}.", key="path", value=path, allowed="an MCAP file")
        file.seek(0)
        yield file, size


class Infos:
    """Counts and rates of topics, as messages come.

    Parameters
    ----------
    seen
        Number of messages that came before, and stamps of the first and the last, by channel.
    """

    def __init__(self, seen: Mapping[int, tuple[int, int, int]] | None = None) -> None:
        self._seen = dict(seen or {})

    def add(self, found: Mapping[int, Messages]) -> None:
        """Count messages by channel."""
        for number, messages in found.items():
            if messages.parts:
                first, last = int(messages.parts[0].stamps[0]), int(messages.parts[-1].stamps[-1])
                count, first, _ = self._seen.get(number, (0, first, last))
                self._seen[number] = (count + len(messages), first, last)

    def of(self, scan: Contents | Summary) -> dict[str, TopicInfo]:
        """Return the topics of a file by name."""
        infos = {}
        for number, channel in sorted(scan.channels.items(), key=lambda item: item[1].topic):
            count, first, last = self._seen.get(number, (0, 0, 0))
            rate = (count - 1) / ((last - first) / cdr.SECOND) if last > first else float("nan")
            schema = scan.schemas.get(channel.schema_id)
            infos[channel.topic] = TopicInfo("" if schema is None else schema.name, count, rate)
        return infos


class RegularBlocks:
    """Rows of a recording of this package as runs, block by block; raises IrregularError where it is not regular.

    Parameters
    ----------
    path
        The file.
    signals
        Which signals to read; None for all.
    every
        Of how many rows one is taken.
    progress
        Called with the bytes that are read, and how many there are.
    """

    def __init__(
        self, path: Path, signals: Collection[str] | None = None, every: int = 1, progress: Progress | None = None
    ) -> None:
        self.path = path
        self.metadata: dict[str, str] = {}
        self.topics: dict[str, TopicInfo] = {}
        self.left_out: dict[str, LeftOut] = {}
        self.damage: str | None = None
        self.events: tuple[Event, ...] = ()
        self._signals = None if signals is None else {*signals, "time"}
        if self._signals is not None and "wrench" in self._signals:
            self._signals |= {f"wrench.{part}" for part in COMPONENTS}
        self._every = every
        self._progress = progress
        self._infos = Infos()
        self._names: Names | None = None
        self._decoders: dict[int, Decoder] = {}
        self._others: set[int] = set()
        """Channels whose numbers are checked, but not read."""
        self._topics: tuple[schemas.Topic, ...] = ()
        self._carried: dict[str, list[str]] = {}
        self._rows = 0
        self._has: frozenset[str] | None = None

    def __iter__(self) -> Iterator[Run]:
        gap: str | None = None
        time = -1.0
        events = Messages()
        with opened(self.path) as (file, size):
            scan = Scan(file, size)
            waiting: dict[int, Messages] = {}
            for found in chain(scan, [None]):
                self._infos.add(found or {})
                if self._progress is not None:
                    self._progress(scan.position, scan.size)
                for number, new in (found or {}).items():
                    channel = scan.channels.get(number)
                    if channel is not None and channel.topic == schemas.EVENTS:
                        events.parts += new.parts
                    elif number not in self._others:
                        waiting.setdefault(number, Messages()).parts.extend(new.parts)
                gathered = max(map(len, waiting.values()), default=0)
                if waiting and (found is None or gathered >= LEAST_ROWS):
                    run, gap = self._taken(scan, waiting)
                    if len(run):
                        time = float(run.time[-1])
                        yield self._thinned(run)
                    if gap:
                        break
        if self._names is None:
            raise IrregularError("it has no rows")
        self.metadata = scan.metadata.get(schemas.METADATA, {})
        self.topics = self._infos.of(scan)
        self.events, torn = as_events(events)
        damage = gap or scan.damage or torn
        if damage is not None:
            until = f"{time:.6g} s ({self._rows} rows)" if self._rows else "before its first row"
            self.damage = f"{self.path} is read up to {until} only: {damage}."

    def _thinned(self, run: Run) -> Run:
        if self._every == 1:
            return run
        begin = self._rows - len(run)
        return run.rows(-begin % self._every, None, self._every)

    def _taken(self, scan: Scan, waiting: dict[int, Messages]) -> tuple[Run, str | None]:
        """Return the rows whose messages all topics have, up to one that is missing, which is said."""
        if self._names is None:
            self._begin(scan, waiting)
        if set(waiting) - self._others != set(self._decoders):
            raise IrregularError("its topics are not those that it began with")
        counts = [len(messages) for number, messages in waiting.items() if number in self._decoders]
        count, gap = min(counts, default=0), None
        if max(counts, default=0) > count + _MOST_WAITING or (not count and not self._rows):
            raise IrregularError("some of its topics end before others")
        taken = {number: messages.take(count) for number, messages in waiting.items()}
        for number in self._others:
            waiting.pop(number, None)
        for messages in taken.values():
            numbers = messages.sequences
            missing = np.flatnonzero(numbers != np.arange(self._rows, self._rows + numbers.size) % 2**32)
            if missing.size and missing[0] < count:
                count, gap = int(missing[0]), "rows are missing after that"
        decoded = {}
        left_out: dict[str, LeftOut] = {}
        for number, decoder in self._decoders.items():
            found = decoder(taken[number].take(count)) if count else None
            if isinstance(found, LeftOut):
                left_out[scan.channels[number].topic] = found
            elif found is not None:
                decoded[scan.channels[number].topic] = found
        run, misfits = assembled(self._topics, self._read_names, decoded, self._carried)
        if count:
            left_out |= misfits
            has = frozenset(run.signals())
            if len(run) != count or self._has not in {None, has} or (self._rows and left_out != self.left_out):
                raise IrregularError("its topics do not go together")
            self._has, self.left_out = has, left_out
        self._rows += len(run)
        return run, gap

    @property
    def _read_names(self) -> Names:
        assert self._names is not None
        return self._names

    def _begin(self, scan: Scan, waiting: Mapping[int, Messages]) -> None:
        """Learn from the first rows what the columns are named after, and which topics to read."""
        metadata = scan.metadata.get(schemas.METADATA)
        channels = {number: channel for number, channel in scan.channels.items() if number in waiting}
        if metadata is None or schemas.TIME not in {channel.topic for channel in channels.values()}:
            raise IrregularError("it is no recording of this package")
        factory = DecoderFactory()

        def decoder(channel: Channel) -> Decoder:
            if channel.schema_id not in scan.schemas:
                raise IrregularError("it lacks a schema")
            return Decoder(factory, scan.schemas[channel.schema_id], channel.message_encoding)

        joints = {}
        for number, channel in channels.items():
            if channel.topic in schemas.JOINT_TOPICS:
                first = decoder(channel)([waiting[number].first])
                if isinstance(first, Decoded):
                    joints[channel.topic] = first.joints
        names = schemas.names_in(metadata, joints)
        if names is None or len({channel.topic for channel in channels.values()}) < len(waiting):
            raise IrregularError("it does not say what its columns are named after")
        self.metadata, self._names, self._topics = metadata, names, schemas.topics(names)
        self._carried = carried(scan.channels)
        present = {channel.topic for channel in channels.values()}
        wanted = schemas.read_topics(names)
        wanted |= {copy for copy, original in schemas.COPIES.items() if original not in present}
        for number, channel in channels.items():
            kept = self._signals is None or self._signals & set(self._carried.get(channel.topic, ()))
            if channel.topic in wanted and kept:
                self._decoders[number] = decoder(channel)
        self._others = channels.keys() - self._decoders.keys()


def first_run(path: Path) -> tuple[Run, dict[str, str]] | None:
    """Return the first rows of a recording of this package and its metadata, None where it is none."""
    blocks = RegularBlocks(path)
    with suppress(IrregularError, RecordingError):
        return next(((run, blocks.metadata) for run in blocks), None)
    return None


def as_events(messages: Messages) -> tuple[tuple[Event, ...], str | None]:
    """Return messages as events up to the first that is missing, and what is wrong with one that cannot be read."""
    found: list[Event] = []
    for number, message in enumerate(messages):
        if message.sequence != number % 2**32:
            break
        event = as_event(message.data)
        if event is None:
            return tuple(found), f"event {number + 1} cannot be read"
        found.append(event)
    return tuple(found), None


def as_event(data: bytes) -> Event | None:
    """Return a message as an event, None if it is none."""
    try:
        content = json.loads(cdr.content(data))
        return Event(float(content.pop("time")), content)
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError, struct.error):
        return None


def carried(channels: Mapping[int, Channel]) -> dict[str, list[str]]:
    """Return the signals that topics carry by definition, by topic."""
    return {
        channel.topic: channel.metadata["signals"].split()
        for channel in channels.values()
        if "signals" in channel.metadata
    }


def assembled(
    topics: Collection[schemas.Topic], names: Names, decoded: Mapping[str, Decoded], carried: Mapping[str, list[str]]
) -> tuple[Run, dict[str, LeftOut]]:
    """Return the run of the topics that fit together, and the reasons why others do not."""
    left_out: dict[str, LeftOut] = {}
    stamps = max((topic.stamps for topic in decoded.values()), key=len, default=np.empty(0, np.int64))
    rows = stamps.size
    columns: dict[str, list[Array]] = {}
    for topic in topics:
        name = topic.before if topic.before in decoded and topic.name not in decoded else topic.name
        found = decoded.get(name)
        if found is None:
            continue
        given = carried.get(name, list(topic.signals.values()) if name == topic.name else [])
        if not set(given) & set(topic.signals.values()):
            continue
        if (found.stamps != stamps[: found.stamps.size]).any():
            left_out[name] = LeftOut(Misfit.STAMPS, "its stamps are not those of the other topics")
            continue
        joints = found.joints or topic.joints
        order = schemas.places(topic.joints, joints)
        if order is None:
            left_out[name] = LeftOut(Misfit.JOINTS, f"its joints are {', '.join(joints)}")
            continue
        for array, signal in topic.signals.items():
            values = found.numbers.get(array)
            if values is None or signal not in given:
                continue
            if topic.joints and values.shape[1] != len(joints):
                why = f"it has {values.shape[1]} values of {array} for {len(joints)} joints"
                left_out[name] = LeftOut(Misfit.JOINTS, why)
                continue
            columns.setdefault(signal, []).append(values[:, order] if topic.joints else values)
        rows = min(rows, found.stamps.size)
    signals = {signal: np.concatenate([part[:rows] for part in parts], axis=1) for signal, parts in columns.items()}
    time = signals.pop("time", None)
    return schemas.run_of(names, _seconds(stamps[:rows]) if time is None else time[:, 0], signals), left_out


def joined(runs: Iterator[Run]) -> Run | None:
    """Return consecutive runs as one, without holding all of them twice; None for none."""
    first = next(runs, None)
    if first is None:
        return None
    parts: dict[str, list[Array]] = {name: [values] for name, values in first.signals().items()}
    times = [first.time]
    for run in runs:
        times.append(run.time)
        for name, values in run.signals().items():
            parts[name].append(values)
    signals: dict[str, Any] = {name: np.concatenate(parts.pop(name)) for name in tuple(parts)}
    return replace(first, time=np.concatenate(times), **signals)


class Thinned:
    """Rows of consecutive runs, of which one in `every` is kept: 1 at first, twice as many where they become too many.

    Parameters
    ----------
    most
        Largest number of rows that are kept.
    """

    def __init__(self, most: int) -> None:
        self.every = 1
        self._most, self._rows, self._count = most, 0, 0
        self._kept: list[Run] = []

    def add(self, run: Run) -> None:
        """Take the next rows."""
        # joined alone, since a part of a block would hold all of it
        self._kept.append(concatenate([run.rows(-self._rows % self.every, None, self.every)]))
        self._rows, self._count = self._rows + len(run), self._count + len(self._kept[-1])
        while self._count > self._most:
            self._kept = [concatenate([self.run.rows(step=2)])]
            self.every, self._count = 2 * self.every, len(self._kept[0])

    @property
    def run(self) -> Run:
        """The rows that are kept."""
        return concatenate(self._kept)


def _seconds(stamps: NDArray[np.int64]) -> Array:
    seconds: Array = (stamps - stamps[:1].sum()) / cdr.SECOND
    return seconds
