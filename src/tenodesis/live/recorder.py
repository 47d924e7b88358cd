"""The process that records a live instrument: ``python -m tenodesis.live.recorder FOLDER FILE``.

It only reads: nothing that happens to it, not even its death, reaches the loop.
"""

import argparse
import json
import math
import os
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tenodesis.errors import InstrumentError, LiveError, RecordingError
from tenodesis.files import atomic_file
from tenodesis.instrument.text import to_toml
from tenodesis.live import events
from tenodesis.live.events import RuntimeEvent, Tail
from tenodesis.live.shutdown import on_signal
from tenodesis.live.ticks import Reader, RowSource, start_time
from tenodesis.recording import Recorder
from tenodesis.run import Array, Run

STATUS = "recorder.json"
"""Name of the file in the runtime's folder with the progress of the recording."""

_PERIOD = 0.02
"""Time between two readings of the ring, s."""
_FLUSH = 0.25
"""Time after which rows are flushed to the disk, wall time, s."""
_SOON = 1.0
"""Time within which the first rows should come, s."""
_MOST = 2000
"""Largest number of rows read at once."""
_HELD = 16.0
"""Longest time that a ring contains, s."""
_LONGEST_CHUNK = 10.0
"""Longest recorded time in a chunk, s, where simulated time runs fast."""
_APART = 2e-9
"""Time put between rows whose own time does not increase, s; stamps are in integer nanoseconds."""


class RecordingOutcome(NamedTuple):
    """Result of a recording."""

    rows: int
    seconds: float
    """From the first row to the last."""
    lost: int
    """Rows that the ring had overwritten before they were read."""
    corrected: int
    """Rows whose time did not increase."""

    @property
    def complaint(self) -> str | None:
        """The problem of the recording, in a sentence; None if there is none."""
        wrong = []
        if self.lost:
            wrong.append(f"{self.lost} rows are missing, for the recorder was too slow")
        if self.corrected:
            wrong.append(f"{self.corrected} rows came with a time that did not go on")
        return f"{'; '.join(wrong)}." if wrong else None


class _Status:
    """The file with the progress of a recording."""

    def __init__(self, file: Path, recording: Path) -> None:
        self._file = file
        self._identity = {"path": str(recording.absolute()), "pid": os.getpid()}

    def write(self, outcome: RecordingOutcome | None, *, ended: bool = False, problem: str | None = None) -> None:
        """Write its progress, whether it has ended, and why it could not continue."""
        far = {} if outcome is None else outcome._asdict()
        text = json.dumps({**self._identity, **far, "ended": ended, "problem": problem})
        # The recording matters more than its status.
        with suppress(OSError), atomic_file(self._file) as new:
            new.write_text(text, "utf-8")


class _Session:
    """A recording being made."""

    def __init__(self, recorder: Recorder, status: _Status, run: Run, earlier: Mapping[str, RuntimeEvent]) -> None:
        self._recorder, self._status = recorder, status
        self._flushed = time.monotonic()
        known = run.time[np.isfinite(run.time)]
        self._last = float(known[0]) - _APART if known.size else 0.0
        self._first: float | None = None
        self.rows = self.lost = self.corrected = 0
        for happened in earlier.values():
            self._recorder.event(max(self._last, 0.0), {**happened.content, "since": _finite(happened.time)})

    @property
    def outcome(self) -> RecordingOutcome:
        return RecordingOutcome(
            self.rows, self._last - self._first if self._first is not None else 0.0, self.lost, self.corrected
        )

    def add(self, run: Run, lost: int) -> None:
        """Record rows, with an event where rows before them are lost or their time does not increase."""
        if lost:
            self.lost += lost
            self.note("rows_lost", rows=lost, in_all=self.lost)
        if not len(run):
            return
        times, corrected = _going_on(run.time, self._last)
        if corrected:
            self.corrected += corrected
            self.note("time_corrected", rows=corrected, in_all=self.corrected)
            run = replace(run, time=times)
        self._recorder.write(run)
        self._first = float(times[0]) if self._first is None else self._first
        self._last = float(times[-1])
        self.rows += len(run)

    def happened(self, event: RuntimeEvent) -> None:
        """Record an event of the runtime; an event without a time gets the present time."""
        self._recorder.event(event.at(max(self._last, 0.0)), event.content)

    def keep(self) -> None:
        """Flush to the disk when it is time to, and write the status."""
        now = time.monotonic()
        if now - self._flushed >= _FLUSH:
            self._recorder.flush()
            self._status.write(self.outcome)
            self._flushed = now

    def note(self, event: str, **content: Any) -> None:
        """Record an event of the recorder itself."""
        self._recorder.event(max(self._last, 0.0), {"event": event, "origin": "recorder", **content})


def record(
    source: RowSource,
    folder: Path,
    path: Path,
    *,
    device: str = "",
    stop: threading.Event | None = None,
    overwrite: bool = False,
) -> RecordingOutcome:
    """Record a live instrument until its runtime ends, or `stop` is set.

    Parameters
    ----------
    source
        Its rows.
    folder
        The runtime's folder, whose file of events is recorded as well; how far the recording is goes there.
    path
        The recording.
    device
        What it is called, for the metadata.
    stop
        Ends the recording when it is set.
    overwrite
        Whether to replace a file that exists.

    Returns
    -------
    RecordingOutcome
        What was recorded and what is missing.

    Raises
    ------
    RecordingError
        The file cannot be written, or not any longer; what was written remains readable.
    LiveError
        The events cannot be read.
    """
    stop = threading.Event() if stop is None else stop
    with closing(Tail(folder / events.FILE)) as tail:
        return _record_all(source, tail, folder, path, device=device, stop=stop, overwrite=overwrite)


def _record_all(
    source: RowSource, tail: Tail, folder: Path, path: Path, *, device: str, stop: threading.Event, overwrite: bool
) -> RecordingOutcome:
    earlier = _earlier(tail)
    run, lost = _first(source, stop)
    began = start_time(run)
    metadata = {
        "instrument": to_toml(source.inst),
        "mode": events.LIVE,
        "device": device,
        "time_step": repr(float(source.time_step)),
        "rate": f"{1 / source.time_step:.9g} Hz",
        "start_time": datetime.fromtimestamp(began / 1e9, UTC).isoformat(timespec="microseconds"),
    }
    status = _Status(folder / STATUS, path)
    try:
        with Recorder(
            path,
            axes=source.names,
            metadata=metadata,
            start_time=began,
            chunk_seconds=_LONGEST_CHUNK,
            overwrite=overwrite,
        ) as recorder:
            session = _Session(recorder, status, run, earlier)
            session.add(run, lost)
            why = _follow(source, tail, session, stop)
            session.note("recording_ended", why=why, rows=session.rows, lost=session.lost)
    except (RecordingError, LiveError) as problem:
        status.write(None, ended=True, problem=str(problem))
        raise
    status.write(session.outcome, ended=True)
    return session.outcome


def main(arguments: Sequence[str] | None = None) -> int:
    """Record from the command line; SIGTERM and Ctrl-C close the recording."""
    parser = argparse.ArgumentParser(prog="python -m tenodesis.live.recorder", description="Record a live instrument.")
    parser.add_argument("folder", type=Path, help="folder of the runtime")
    parser.add_argument("file", type=Path, help="the recording")
    parser.add_argument("--overwrite", action="store_true", help="replace a file that exists")
    given = parser.parse_args(arguments)
    return supervise(lambda stop: _record(given.folder, given.file, stop, overwrite=given.overwrite))


def supervise(work: Callable[[threading.Event], RecordingOutcome]) -> int:
    """Make a recording that SIGTERM and Ctrl-C end, report its problem, and return the exit code."""
    stop = threading.Event()
    try:
        with on_signal(stop.set):
            outcome = work(stop)
    except (InstrumentError, LiveError, RecordingError) as problem:
        print(f"tenodesis: {problem}", file=sys.stderr)
        return 1
    if outcome.complaint is not None:
        print(f"tenodesis: {outcome.complaint}", file=sys.stderr)
    return 0


def _record(folder: Path, path: Path, stop: threading.Event, *, overwrite: bool) -> RecordingOutcome:
    reader = Reader(folder)
    return record(reader, folder, path, device=reader.about.device, stop=stop, overwrite=overwrite)


def _first(source: RowSource, stop: threading.Event) -> tuple[Run, int]:
    """Return the first rows, or none if none come soon, so that an unwritable file is reported in any case."""
    until = time.monotonic() + _SOON
    lost = 0
    while True:
        run, before = source.read(_MOST)
        lost += before
        if len(run) or stop.is_set() or not source.alive or time.monotonic() > until:
            return run, lost
        stop.wait(_PERIOD)


def _follow(source: RowSource, tail: Tail, session: _Session, stop: threading.Event) -> str:
    """Record all rows that come, and return why they ended."""
    # Where simulated time has no end, rows that come after the stop must not keep it from ending.
    turns = 2 + round(_HELD / source.time_step / _MOST)
    while True:
        ending, alive = stop.is_set(), source.alive
        run, lost = source.read(_MOST)
        happened = _read(tail)
        session.add(run, lost)
        for event in happened:
            session.happened(event)
        session.keep()
        more = len(run) == _MOST or bool(happened)
        # Rows that were there at the stop are still taken.
        turns -= ending
        if ending and (not more or turns == 0):
            return "on request"
        if not alive and not len(run) and not happened:
            return "the runtime has ended"
        if len(run) < _MOST:
            stop.wait(_PERIOD)


def _earlier(tail: Tail) -> dict[str, RuntimeEvent]:
    """Return the last event of each kind before the recording: the law that is in force, the operator."""
    found: dict[str, RuntimeEvent] = {}
    while happened := _read(tail):
        found.update({str(event.content.get("event", "")): event for event in happened})
    return found


def _read(tail: Tail) -> list[RuntimeEvent]:
    try:
        return tail.read()
    except OSError as problem:
        raise LiveError(
            f"the events cannot be read: {problem.filename}: {problem.strerror}.", key="path", value=problem.filename
        ) from None


def _going_on(times: Array, last: float) -> tuple[Array, int]:
    """Return strictly increasing times (n,), s, all after the last, and how many had to be changed."""
    known = np.where(np.isfinite(times), times, -np.inf)
    before = np.maximum.accumulate(np.concatenate([[last], known]))[:-1]
    if (known > before).all():
        return times, 0
    going, corrected = times.copy(), 0
    for row, own in enumerate(known):
        if not own > last:
            going[row] = last + _APART
            corrected += 1
        last = float(going[row])
    return going, corrected


def _finite(seconds: float) -> float | None:
    return seconds if math.isfinite(seconds) else None


if __name__ == "__main__":
    sys.exit(main())
