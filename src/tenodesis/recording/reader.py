"""Read recordings, complete or damaged."""

from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from mcap.records import Channel

from tenodesis.errors import RecordingError
from tenodesis.instrument import Instrument, parse
from tenodesis.recording import container, lab_map, lab_tables, schemas, tables
from tenodesis.recording.blocks import (
    Event,
    Infos,
    IrregularError,
    Progress,
    RegularBlocks,
    TopicInfo,
    as_events,
    assembled,
    carried,
    joined,
    opened,
)
from tenodesis.recording.container import Contents, Messages
from tenodesis.recording.decode import Decoded, LeftOut, Misfit, decoded
from tenodesis.run import Array, Names, Run

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Recording:
    """A recording; use :meth:`open` to read one.

    Attributes
    ----------
    path
        The file.
    run
        Its signals; :class:`tenodesis.run.Run` gives their shapes.
    metadata
        Text by key: ``instrument``, ``joints``, ``handle_joints``, ``tendons`` and ``compensated``, ``seed``,
        ``protocol``, ``time_step``, versions, and of a run with a controller its choices; empty for a file of another
        program.
    topics
        Every topic of the file, by name.
    left_out
        Why topics that the run could have drawn on are not in it, by name.
    damage
        Up to when the file could be read and why not further; None if it is complete.
    events
        What happened beside the signals, such as commands with their origin and faults; only of this package's files.
    """

    path: Path
    run: Run = field(repr=False)
    metadata: Mapping[str, str] = field(repr=False)
    topics: Mapping[str, TopicInfo] = field(repr=False)
    left_out: Mapping[str, LeftOut]
    damage: str | None
    events: tuple[Event, ...] = field(default=(), repr=False)

    @classmethod
    def open(
        cls,
        path: str | Path,
        *,
        signals: Collection[str] | None = None,
        every: int = 1,
        progress: Progress | None = None,
    ) -> Self:
        """Read a recording, up to the first damage if there is any.

        A table (:mod:`tenodesis.recording.lab_map`) has the signals of one axis, and its columns as topics. An hour at
        2 kHz does not fit into 1 GB as a whole: ask for some signals or rows, or take :class:`Blocks`.

        Parameters
        ----------
        path
            The file.
        signals
            Signals to read by name; all by default.
        every
            Of how many rows one is taken.
        progress
            Called with the bytes that are read, and how many there are.

        Raises
        ------
        RecordingError
            The file cannot be read, is no recording and no table, contains no topic of a recording, or does not fit
            into memory.
        MissingExtraError
            The library that reads the file is not installed.
        """
        path = Path(path)
        if every < 1:
            raise RecordingError(key="every", value=every, allowed="1 or more")
        try:
            if lab_tables.is_table(path):
                return cls._of_table(path)._selected(signals, every)
            try:
                blocks = RegularBlocks(path, signals, every, progress)
                run = joined(iter(blocks))
                if run is not None:
                    return cls(path, run, blocks.metadata, blocks.topics, blocks.left_out, blocks.damage, blocks.events)
            except IrregularError:
                pass
            return cls._as_a_whole(path)._selected(signals, every)
        except MemoryError:
            raise RecordingError(
                f"{path} does not fit into memory as a whole; read some of its signals (signals=[...]), one of so many "
                "rows (every=10), or block by block (tn.recording.Blocks).",
                key="path",
                value=path,
                allowed="read in parts",
            ) from None

    def _selected(self, signals: Collection[str] | None, every: int) -> Self:
        """Return it with some of its signals and one of so many rows."""
        if signals is None and every == 1:
            return self
        dropped: dict[str, Any] = (
            {} if signals is None else dict.fromkeys(self.run.signals().keys() - set(signals), None)
        )
        return replace(self, run=replace(self.run, **dropped).rows(step=every))

    @classmethod
    def _as_a_whole(cls, path: Path) -> Self:
        """Read a file of any program, whose topics may not go together row by row."""
        with opened(path) as (file, size):
            contents = container.contents_of(file, size)
        infos = Infos()
        infos.add(contents.messages)
        metadata = contents.metadata.get(schemas.METADATA, {})
        read = dict(decoded(contents, schemas.JOINT_TOPICS))
        names = schemas.names_in(metadata, {name: topic.joints for name, topic in _fit(read).items()})
        wanted = schemas.TOPICS if names is None else schemas.read_topics(names)
        present = {channel.topic for channel in contents.channels.values()}
        wanted |= {copy for copy, original in schemas.COPIES.items() if original not in present}
        read |= decoded(contents, wanted - schemas.JOINT_TOPICS)
        left_out = {name: found for name, found in read.items() if isinstance(found, LeftOut)}
        names = names or _paired(_fit(read))
        if names is None:
            raise RecordingError(f"{path} contains no topic of a recording: {_found(contents)}.", key="topics")
        run, misfits = assembled(schemas.topics(names), names, _fit(read), carried(contents.channels))
        left_out |= misfits
        if left_out and not any(values.size for values in run.signals().values()):
            reasons = "; ".join(f"{topic}: {reason}" for topic, reason in left_out.items())
            raise RecordingError(
                f"{path} contains no topic of a recording that can be used: {reasons}.", key="topics", value=left_out
            )
        damage = contents.damage
        events: tuple[Event, ...] = ()
        if schemas.METADATA in contents.metadata:
            run, gap = _without_gap(run, contents)
            events, torn = _events(contents)
            damage = gap or damage or torn
        if damage is not None:
            until = f"{run.time[-1]:.6g} s ({len(run)} rows)" if len(run) else "before its first row"
            damage = f"{path} is read up to {until} only: {damage}."
        return cls(path, run, metadata, infos.of(contents), left_out, damage, events)

    @classmethod
    def _of_table(cls, path: Path) -> Self:
        mapped = lab_map.read(path)
        run = lab_map.run_of(mapped)
        used = {part.at: name for name, parts in mapped.places.items() for part in parts}
        span = float(run.time[-1] - run.time[0]) if len(run) > 1 and lab_map.TIME in mapped.places else 0.0
        topics, left_out = {}, {}
        for at, (name, column) in enumerate(zip(mapped.table.headings, mapped.table.columns, strict=True)):
            count = int(np.isfinite(column).sum())
            rate = (count - 1) / span if span > 0 else float("nan")
            topics[name] = TopicInfo(f"column: {used[at]}" if at in used else "column", count, rate)
            if at not in used:
                left_out[name] = LeftOut(Misfit.TYPE, "no heading of a signal, and none in a map")
        metadata = {"kind": mapped.table.kind}
        return cls(path, run, metadata, topics, left_out, None)

    def __repr__(self) -> str:
        damage = ", damaged" if self.damage else ""
        return f"<{type(self).__name__} {str(self.path)!r}: {self.run!r}, {len(self.topics)} topics{damage}>"

    @property
    def duration(self) -> float:
        """Time from the first row to the last, s."""
        return float(self.run.time[-1] - self.run.time[0]) if len(self.run) else 0.0

    def to_numpy(self) -> dict[str, Array]:
        """Return the time and the signals by name, in their shapes."""
        return {"time": self.run.time, **self.run.signals()}

    def to_pandas(self) -> "pd.DataFrame":
        """Return the signals as a DataFrame; see :func:`tenodesis.recording.tables.to_pandas`."""
        return tables.to_pandas(self.run)

    def to_csv(self, path: str | Path) -> None:
        """Write the signals as CSV; see :func:`tenodesis.recording.tables.to_csv`."""
        tables.to_csv(self.run, path)

    def to_parquet(self, path: str | Path) -> None:
        """Write the signals as Parquet; see :func:`tenodesis.recording.tables.to_parquet`."""
        tables.to_parquet(self.run, path)

    def instrument(self) -> Instrument:
        """Return the instrument that was recorded.

        Raises
        ------
        RecordingError
            The file does not contain its instrument.
        InstrumentError
            The instrument it holds is not valid in this version.
        """
        if "instrument" not in self.metadata:
            raise RecordingError(
                f"{self.path} does not contain its instrument; only recordings of this package do.",
                key="instrument",
                allowed="in the recording",
            )
        return parse(self.metadata["instrument"], f"{self.path}: instrument")


def _paired(topics: Mapping[str, Decoded]) -> Names | None:
    """Return the names of joints with tendons of their own that topics are about."""
    axes = schemas.axes_of({name: topic.joints for name, topic in topics.items()})
    return Names.paired(axes or ("yaw",)) if topics else None


def _found(contents: Contents) -> str:
    if contents.damage is not None:
        return contents.damage
    names = sorted(channel.topic for channel in contents.channels.values())
    return f"its topics are {', '.join(names)}" if names else "it has no topics"


def _fit(topics: Mapping[str, Decoded | LeftOut]) -> dict[str, Decoded]:
    """Return the topics that fit a recording."""
    return {name: found for name, found in topics.items() if isinstance(found, Decoded)}


def _channels(contents: Contents) -> list[tuple[Channel, Messages]]:
    return [
        (contents.channels[number], messages)
        for number, messages in contents.messages.items()
        if number in contents.channels
    ]


def _without_gap(run: Run, contents: Contents) -> tuple[Run, str | None]:
    """Return a run up to its first missing row, and whether a row is missing."""
    for channel, messages in _channels(contents):
        if channel.topic == schemas.EVENTS:
            continue
        sequence = messages.sequences[: len(run)]
        missing = np.flatnonzero(sequence != np.arange(sequence.size) % 2**32)
        if missing.size:
            return run.rows(0, int(missing[0])), "rows are missing after that"
    return run, None


def _events(contents: Contents) -> tuple[tuple[Event, ...], str | None]:
    """Return the events up to the first that is missing, and what is wrong with one that cannot be read."""
    own = [messages for channel, messages in _channels(contents) if channel.topic == schemas.EVENTS]
    return as_events(Messages(part for messages in own for part in messages.parts))


class Blocks(RegularBlocks):
    """The rows of a recording as runs, block by block, so that an hour needs no more memory than a minute.

    A file whose topics do not go together row by row, as those of other programs, is read as a whole, and so is a
    table. Parameters as for :meth:`Recording.open`; `metadata` is known with the first block, `topics`, `left_out`,
    `damage` and `events` with the last.

    Raises
    ------
    RecordingError, MissingExtraError
        As :meth:`Recording.open`, and if topics part later on.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        signals: Collection[str] | None = None,
        every: int = 1,
        progress: Progress | None = None,
    ) -> None:
        super().__init__(Path(path), signals, every, progress)
        self._given = (signals, every)

    def __iter__(self) -> Iterator[Run]:
        runs = super().__iter__()
        first, time = None, 0.0
        if not lab_tables.is_table(self.path):
            with suppress(IrregularError):
                first = next(runs, None)
        if first is None:
            whole = Recording.open(self.path, signals=self._given[0], every=self._given[1])
            for name in ("metadata", "topics", "left_out", "damage", "events"):
                setattr(self, name, getattr(whole, name))
            yield whole.run
            return
        try:
            for run in chain([first], runs):
                time = float(run.time[-1]) if len(run) else time
                yield run
        except IrregularError as problem:
            raise RecordingError(
                f"{self.path} cannot be read in parts: {problem}, after {time:.6g} s. "
                "tn.recording.Recording.open reads it as a whole.",
                key="path",
                value=self.path,
            ) from None

    def recording(self, run: Run) -> Recording:
        """Return a recording with some of the rows, and what is known so far."""
        return Recording(self.path, run, self.metadata, self.topics, self.left_out, self.damage, self.events)
