"""Claims about the file of events: it does not grow for ever, and nobody loses an event without a notice."""

import errno
import json
import math
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.live import journal as journals
from tenodesis.live import recorder as live
from tenodesis.live.events import FILE, LONGEST_LINE, RuntimeEvent, Tail
from tenodesis.live.journal import Journal
from tenodesis.recording import Recording
from tenodesis.run import Run

from .live_loop import Played

MOST = 20_000


def all_of(tail: Tail) -> list[RuntimeEvent]:
    found = []
    while more := tail.read():
        found += more
    return found


def contents(events: list[RuntimeEvent], event: str, what: str) -> list[Any]:
    return [one.content[what] for one in events if one.content["event"] == event]


@pytest.fixture
def journal(tmp_path: Path) -> Journal:
    return Journal(tmp_path, lambda: 1.5, most=MOST)


def test_the_file_is_bounded_and_who_keeps_up_gets_every_event_once(journal: Journal, tmp_path: Path) -> None:
    tail, late, found = Tail(tmp_path / FILE), Tail(tmp_path / FILE, at_end=True), []
    largest = 0
    for n in range(5000):
        journal.write(("order", "law")[n % 2], "one", n=n)
        largest = max(largest, (tmp_path / FILE).stat().st_size)
        if n % 50 == 0:
            found += all_of(tail)
            assert len(late.read()) > 0
    found += all_of(tail)
    assert [event.content["n"] for event in found] == list(range(5000))
    assert found[0] == RuntimeEvent(1.5, {"event": "order", "origin": "one", "n": 0})
    assert MOST / 2 < largest < MOST + 1000
    assert [path.name for path in tmp_path.iterdir()] == [FILE]


def test_who_comes_late_is_told_what_is_in_force_and_how_many_events_were_left_out(
    journal: Journal, tmp_path: Path
) -> None:
    journal.write("law", "one", law="off")
    for n in range(5000):
        journal.write("order", "one", n=n)
    found = all_of(Tail(tmp_path / FILE))
    assert contents(found, "law", "law") == ["off"]
    orders = contents(found, "order", "n")
    assert orders == list(range(5000 - len(orders), 5000))
    assert contents(found, "events_lost", "events") == [5000 - len(orders)]
    assert found[0].content["event"] == "events_lost"


def test_who_falls_behind_is_told_how_many_events_it_missed(journal: Journal, tmp_path: Path) -> None:
    tail = Tail(tmp_path / FILE)
    journal.write("law", "one", law="off")
    for n in range(30):
        journal.write("order", "one", n=n)
    found = all_of(tail)
    assert contents(found, "order", "n") == list(range(30))
    for n in range(30, 3000):
        journal.write("order", "one", n=n)
    found = all_of(tail)
    orders = contents(found, "order", "n")
    # The rest of the file that it had open, and the file that is there now; the law is not written again.
    assert orders[0] == 30
    assert orders == sorted(set(orders))
    assert orders[-1] == 2999
    (lost,) = contents(found, "events_lost", "events")
    assert lost > 1000
    assert len(orders) + lost == 3000 - 30
    assert contents(found, "law", "law") == []


def test_an_event_that_is_too_long_for_a_line_is_told_with_its_length(journal: Journal, tmp_path: Path) -> None:
    journal.write("play", "one", protocol="x" * LONGEST_LINE)
    journal.write("cancel", "one")
    found = all_of(Tail(tmp_path / FILE))
    assert [event.content["event"] for event in found] == ["play", "cancel"]
    assert found[0].content["origin"] == "one"
    assert found[0].content["too_long"] > LONGEST_LINE
    assert "protocol" not in found[0].content


def test_events_that_cannot_be_written_are_counted_and_leave_no_torn_line(
    journal: Journal, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A disk that fills up within a line."""
    written = []

    def half(file: int, data: bytes) -> int:
        if len(written) % 2:
            written.append(0)
            raise OSError(errno.ENOSPC, "No space left on device")
        written.append(os.write(file, data[: len(data) // 2]))
        return written[-1]

    tail = Tail(tmp_path / FILE)
    journal.write("law", "one")
    with monkeypatch.context() as full:
        full.setattr(journals, "os", SimpleNamespace(**{**vars(os), "write": half}))
        for n in range(3):
            journal.write("order", "one", n=n)
        journal.write_merged("hand", "one")
        journal.flush()
        assert journal.problem is not None
        assert "No space left" in journal.problem
    assert [event.content["event"] for event in all_of(tail)] == ["law"]
    journal.write("order", "one", n=3)
    found = all_of(tail)
    assert [event.content["event"] for event in found] == ["events_missing", "order"]
    assert contents(found, "events_missing", "events") == [4]
    assert journal.problem is None


def test_the_bound_holds_where_the_file_cannot_begin_anew(
    journal: Journal, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(path: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as full:
        full.setattr(journals, "atomic_file", refused)
        for n in range(3000):
            journal.write("order", "one", n=n)
    assert (tmp_path / FILE).stat().st_size <= MOST
    written = contents(all_of(tail := Tail(tmp_path / FILE)), "order", "n")
    assert written == list(range(len(written)))
    journal.write("order", "one", n=3000)
    found = all_of(tail)
    assert contents(found, "events_missing", "events") == [3000 - len(written)]
    assert contents(found, "order", "n") == [3000]
    assert contents(found, "events_lost", "events") == []


def test_a_recording_has_every_event_though_the_file_begins_anew(tmp_path: Path) -> None:
    journal = Journal(tmp_path, lambda: 0.0, most=MOST)
    times = np.arange(1, 401) * 5e-4
    run = Run(times, ("yaw",), force=np.sin(times))

    class Talking(Played):
        count = 0

        def read(self, most: int = 2000) -> tuple[Run, int]:
            for _ in range(100 if self._blocks else 0):
                journal.write("order", "one", n=self.count)
                self.count += 1
            return super().read(most)

    live.record(Talking(run, tn.load("scaled-up"), [10] * 40), tmp_path, tmp_path / "run.mcap")
    recorded = [event.content for event in Recording.open(tmp_path / "run.mcap").events]
    orders = [content["n"] for content in recorded if content["event"] == "order"]
    assert orders == list(range(len(orders)))
    assert len(orders) == 4000
    assert {content["event"] for content in recorded} == {"order", "recording_ended"}
    assert "events_left_out" in (tmp_path / FILE).read_text()
    assert not any("number" in content for content in recorded)


@pytest.mark.parametrize(
    "first",
    [
        {"event": "events_left_out", "until": "x", "kept": []},
        {"event": "events_left_out", "until": 3},
        {"event": "events_left_out", "until": 3, "kept": ["a"], "origin": "one"},
        {"event": "order", "number": math.nan},
    ],
)
def test_a_line_that_makes_no_sense_is_told_and_what_follows_is_read(tmp_path: Path, first: dict[str, Any]) -> None:
    lines = [first, {"event": "law", "origin": "one", "number": 7}]
    (tmp_path / FILE).write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    found = all_of(Tail(tmp_path / FILE))
    assert found[0].content["event"] in {"unreadable", "order"}
    assert found[1].content == {"event": "law", "origin": "one"}
