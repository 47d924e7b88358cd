"""Write runs into a recording that stays readable if writing is interrupted at any time."""

import math
import platform
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from itertools import pairwise
from pathlib import Path
from typing import IO, Any, NamedTuple, Self

import numpy as np
from mcap.well_known import MessageEncoding, Profile, SchemaEncoding
from numpy.typing import NDArray

from tenodesis.errors import RecordingError
from tenodesis.files import write_errors
from tenodesis.recording import cdr, schemas
from tenodesis.recording.chunks import ChunkedFile
from tenodesis.recording.kept import Keeper
from tenodesis.recording.schemas import TopicMessages
from tenodesis.run import Array, Names, Run

_LAST_STAMP = 2**31 * cdr.SECOND - 1
_SEQUENCES = 2**32


class _Channel(NamedTuple):
    id: int
    messages: TopicMessages


class Recorder:
    """A recording being written; a context manager that closes it.

    Parameters
    ----------
    path
        The file; it must not exist yet.
    axes
        What the columns of the runs to come are named after, or joints that have each their own tendons.
    metadata
        Text by key, kept with the runs: ``instrument`` (the instrument file), ``seed``, ``protocol``, ``time_step``
        and others; axes and versions are added.
    start_time
        Stamp of time 0, ns since the epoch; with 0, equal runs give equal files.
    chunk_seconds
        Recorded time after which rows are sent to the disk, s; a crash loses no more than that.
    overwrite
        Whether to replace a file that exists.

    Raises
    ------
    RecordingError
        By `Recorder` and all it does, when the file cannot be written or a run does not fit.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        axes: Names | Sequence[str],
        metadata: Mapping[str, str] | None = None,
        start_time: int = 0,
        chunk_seconds: float = 0.25,
        overwrite: bool = False,
    ) -> None:
        self.path = Path(path)
        self.names = axes if isinstance(axes, Names) else Names.paired(axes)
        self._start = start_time
        self._chunk_length = max(round(chunk_seconds * cdr.SECOND), 1)
        self._channels: list[_Channel] = []
        self._schemas: dict[str, int] = {}
        self._events_channel: int | None = None
        self._events = 0
        self._events_stamps = (0, 0)
        self._signals: set[str] | None = None
        self._rows = 0
        self._rows_safe = 0
        self._first_stamp: int | None = None
        self._stamp = -1
        self._stamp_safe = 0
        texts = self._texts(metadata or {})
        self._keeper = Keeper(self.path, self.names, texts)
        self._file: IO[bytes] | None = self._opened(overwrite)
        with self._reported():
            self._writer = ChunkedFile(self._file, Profile.ROS2, "tenodesis")
            self._writer.add_metadata(schemas.METADATA, texts)
            self._writer.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def write(self, run: Run) -> None:
        """Append the rows of a run, whose time continues that of the rows before.

        Raises
        ------
        RecordingError
            The file cannot be written, or the run has other axes or signals, other shapes, or time that does not
            increase.
        """
        self._check_open()
        columns = self._columns(run)
        stamps = self._stamps(run.time)
        if not stamps.size:
            return
        if self._first_stamp is None:
            self._first_stamp = int(stamps[0])
        with self._reported():
            if self._signals is None:
                self._register(columns)
                self._signals = set(run.signals())
            chunks = (stamps - self._first_stamp) // self._chunk_length
            bounds = [0, *(np.flatnonzero(np.diff(chunks)) + 1).tolist(), stamps.size]
            for start, stop in pairwise(bounds):
                if self._chunk(self._stamp) != chunks[start]:
                    self._close_chunk()
                self._write_rows(stamps[start:stop], {name: values[start:stop] for name, values in columns.items()})
                self._keeper.add(run, start, stop)

    def event(self, time: float, content: Mapping[str, Any]) -> None:
        """Append an event at a time (s) of the runs: values by name that JSON can express.

        It reaches the disk with the rows around it, or by `flush`.

        Raises
        ------
        RecordingError
            The file cannot be written, the time has no stamp, or JSON cannot express the content.
        """
        self._check_open()
        stamp = self._start + round(time * cdr.SECOND) if math.isfinite(time) else -1
        if not 0 <= stamp <= _LAST_STAMP:
            raise RecordingError(
                f"{self.path}: time of an event = {time!r} s: its stamp must be between 0 and "
                f"{_LAST_STAMP // cdr.SECOND} s.",
                key="time",
                value=time,
                allowed=f"between 0 and {_LAST_STAMP // cdr.SECOND} s",
            )
        try:
            data = schemas.event_message(time, content)
        except (TypeError, ValueError) as problem:
            raise RecordingError(f"{self.path}: an event cannot be written as JSON: {problem}.", key="event") from None
        with self._reported():
            if self._events_channel is None:
                self._events_channel = self._channel(schemas.EVENTS, schemas.STRING, {})
            number = np.array([self._events % _SEQUENCES])
            self._writer.add_rows(np.array([stamp]), number, {self._events_channel: data})
            self._events_stamps = (self._events_stamps[0] if self._events else stamp, stamp)
            self._events += 1

    def flush(self) -> None:
        """Flush everything written so far to the disk, so that a crash does not lose it.

        Raises
        ------
        RecordingError
            The file cannot be written.
        """
        if self._file is not None:
            with self._reported():
                self._close_chunk()

    def close(self) -> None:
        """Close the recording; a second call does nothing.

        Raises
        ------
        RecordingError
            The file cannot be written.
        """
        if self._file is None:
            return
        with self._reported():
            self._close_chunk()
            texts = self._keeper.texts(self._messages())
            if texts:
                self._writer.add_metadata(schemas.SEEN, texts)
            self._writer.finish()
            self._file.close()
        self._file = None

    def _texts(self, metadata: Mapping[str, str]) -> dict[str, str]:
        from tenodesis.version import __version__  # noqa: PLC0415

        for key, text in metadata.items():
            if not isinstance(text, str):
                raise RecordingError(
                    f"{self.path}: metadata {key} = {text!r}: it must be text.", key=key, value=text, allowed="text"
                )
        made_with = {"tenodesis": __version__, "python": platform.python_version(), "numpy": np.__version__}
        return dict(metadata) | schemas.texts_of(self.names) | made_with

    def _opened(self, overwrite: bool) -> IO[bytes]:
        with write_errors(self.path, RecordingError):
            try:
                return self.path.open("wb" if overwrite else "xb")
            except FileExistsError:
                said, allowed = (
                    "exists already; give another path, or overwrite=True",
                    "a path that does not exist, or overwrite=True",
                )
            except FileNotFoundError:
                said = f"cannot be written: there is no folder {self.path.parent}"
                allowed = "in a folder that exists"
        raise RecordingError(f"{self.path} {said}.", key="path", value=self.path, allowed=allowed)

    @contextmanager
    def _reported(self) -> Iterator[None]:
        """Raise an error of the operating system as an error of this package, and abandon the file."""
        try:
            yield
        except OSError as problem:
            if self._file is not None:
                with suppress(OSError):
                    self._file.close()
            self._file = None
            seconds = (self._stamp_safe - self._first_stamp) / cdr.SECOND if self._first_stamp is not None else 0.0
            raise RecordingError(
                f"{self.path} cannot be written: {problem.strerror or problem}; what was written until then remains "
                f"readable: at least {self._rows_safe} rows, {max(seconds, 0.0):.6g} s.",
                key="path",
                value=self.path,
            ) from problem

    def _check_open(self) -> None:
        if self._file is None:
            raise RecordingError(
                f"{self.path} is closed; nothing more can be written to it.", key="path", value=self.path
            )

    def _columns(self, run: Run) -> dict[str, Array]:
        """Return a run's signals and time as arrays with a row per time and a column per joint or tendon."""
        for group, own in run.names._asdict().items():
            wanted = getattr(self.names, group)
            if own != wanted:
                given, wanted = (", ".join(names) or "none" for names in (own, wanted))
                about = group.replace("_", " ")
                raise RecordingError(
                    f"{self.path}: the run's {about} are {given}; they must be {wanted}.",
                    key=about,
                    value=given,
                    allowed=wanted,
                )
        signals = run.signals()
        if self._signals is not None and (changed := self._signals ^ signals.keys()):
            had = "had" if min(changed) in self._signals else "did not have"
            raise RecordingError(
                f"{self.path}: the runs before {had} {min(changed)}; all runs of a recording must have the same "
                "signals.",
                key="signals",
                value=min(changed),
                allowed="the same in all runs",
            )
        for name, values in signals.items():
            expected = run.names.shape(name, len(run))
            if values.shape != expected:
                raise RecordingError(
                    f"{self.path}: {name} has shape {values.shape}; it must have {expected}.",
                    key=name,
                    value=values.shape,
                    allowed=str(expected),
                )
        return schemas.flat_columns(run) if len(run) else {}

    def _stamps(self, time: Array) -> NDArray[np.int64]:
        """Return the stamps (n,), in ns, of times (n,), in s."""
        with np.errstate(invalid="ignore"):
            nanoseconds = self._start + np.rint(time * cdr.SECOND)
        outside = ~((nanoseconds >= 0) & (nanoseconds <= _LAST_STAMP))
        if not outside.any():
            stamps: NDArray[np.int64] = self._start + np.rint(time * cdr.SECOND).astype(np.int64)
            outside = np.diff(stamps, prepend=self._stamp) < 1
        if outside.any():
            row = int(np.argmax(outside))
            raise RecordingError(
                f"{self.path}: time of row {self._rows + row} = {float(time[row])!r} s: it must be finite, at least "
                f"1 ns after the row before, and have its stamp between 0 and {_LAST_STAMP // cdr.SECOND} s.",
                key="time",
                value=float(time[row]),
            )
        return stamps

    def _register(self, columns: Mapping[str, Array]) -> None:
        """Open the channels for these signals."""
        for messages in schemas.messages_of(self.names, columns.keys()):
            # A wrench always has all its numbers; the channel names those that carry a signal.
            about = [schemas.described(signal) for signal in messages.signals.values() if signal != "time"]
            carried = {
                "signals": " ".join(messages.signals.values()),
                "units": " ".join(one.unit for one in about),
                "meanings": "; ".join(one.description for one in about),
            }
            channel = self._channel(messages.topic.name, messages.topic.type, carried)
            self._channels.append(_Channel(channel, messages))

    def _channel(self, topic: str, message_type: str, metadata: dict[str, str]) -> int:
        if message_type not in self._schemas:
            text = schemas.definition(message_type).encode()
            self._schemas[message_type] = self._writer.add_schema(message_type, SchemaEncoding.ROS2, text)
        return self._writer.add_channel(topic, MessageEncoding.CDR, self._schemas[message_type], metadata)

    def _write_rows(self, stamps: NDArray[np.int64], columns: Mapping[str, Array]) -> None:
        sequences = (self._rows + np.arange(stamps.size)) % _SEQUENCES
        blocks = {channel.id: channel.messages.encode(stamps, columns) for channel in self._channels}
        self._writer.add_rows(stamps, sequences, blocks)
        self._rows += stamps.size
        self._stamp = int(stamps[-1])

    def _chunk(self, stamp: int) -> int:
        return (stamp - (self._first_stamp or 0)) // self._chunk_length

    def _messages(self) -> dict[int, tuple[int, int, int]]:
        """Return the number of messages, and the stamps of the first and the last, by channel."""
        rows = (self._rows, self._first_stamp or 0, self._stamp)
        found = {channel.id: rows for channel in self._channels}
        return (
            found
            if self._events_channel is None
            else found | {self._events_channel: (self._events, *self._events_stamps)}
        )

    def _close_chunk(self) -> None:
        self._writer.flush()
        self._rows_safe, self._stamp_safe = self._rows, self._stamp
        self._keeper.end_chunk()
