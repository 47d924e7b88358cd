"""Summary of the events of a live recording: commands with their origins, faults, and losses."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich import box
from rich.console import Group
from rich.table import Column, Table
from rich.text import Text

from tenodesis.live.events import LIVE
from tenodesis.recording.blocks import Event
from tenodesis.recording.summary import Summary

_SHOWN = 5
"""Times of a kind that are listed."""


def describe(summary: Summary) -> Group | None:
    """Return the events of a recording, for a rich console; None if it is not live and has no events."""
    recording = summary.recording
    if not recording.events and recording.metadata.get("mode") != LIVE:
        return None
    before = [event for event in recording.events if "since" in event.content]
    events = [event for event in recording.events if "since" not in event.content]
    facts = {
        "in force": ", ".join(f"{_kind(event)} by {_origin(event)}" for event in before) or "unknown",
        "faults": _faults(summary.seen.rises, recording.events),
        "lost rows": _missing(events, "rows_lost", "rows", "after"),
        "given up": _missing(events, "ticks_missed", "ticks", "until"),
        "lost events": _missing(recording.events, "events_lost", "events", "until"),
        "unwritten": _missing(recording.events, "events_missing", "events", "until"),
        "corrected": _missing(events, "time_corrected", "rows", "after"),
        "ended": _end(events),
    }
    table = Table.grid(padding=(0, 2))
    for name, fact in facts.items():
        table.add_row(name, Text(fact))
    return Group(table, _by_kind(events)) if events else Group(table)


def _faults(came: Mapping[str, tuple[float, int]], events: Sequence[Event]) -> str:
    """List the faults in the rows with their counts, and those only in events, whose rows are missing."""
    announced: dict[str, list[float]] = {}
    for event in events:
        names = event.content.get("faults")
        for name in names if isinstance(names, list | tuple) else ():
            announced.setdefault(str(name), []).append(event.time)
    found = {name: (times[0], 1) for name, times in announced.items()} | dict(came)
    return (
        ", ".join(
            f"{name} from {first:.6g} s" + (f" ({count} times)" if count > 1 else "")
            for name, (first, count) in sorted(found.items(), key=lambda item: item[1])
        )
        or "none"
    )


def _missing(events: Sequence[Event], kind: str, what: str, place: str) -> str:
    """Describe how many items of a kind are missing according to the events, and when: after or until each."""
    counted = [(_count(event, what), event.time) for event in events if _kind(event) == kind]
    if not counted:
        return "none"
    parts = [f"{count} {place} {time:.6g} s" for count, time in counted]
    if parts[_SHOWN:]:
        parts = [*parts[: _SHOWN - 1], f"{len(parts) - _SHOWN} times more", parts[-1]]
    return f"{sum(count for count, _ in counted)}: {', '.join(parts)}"


def _end(events: Sequence[Event]) -> str:
    for event in reversed(events):
        if _kind(event) == "recording_ended":
            return f"{event.content.get('why', '')}, at {event.time:.6g} s"
    return "unknown: the recording was broken off"


def _by_kind(events: Sequence[Event]) -> Table:
    """Return the number of events by kind and origin, merged events counted individually."""
    rows: dict[tuple[str, str], tuple[int, float, float]] = {}
    for event in events:
        key = _kind(event), _origin(event)
        number, first, last = rows.get(key, (0, event.time, event.time))
        rows[key] = number + _count(event, "times", 1), min(first, event.time), max(last, event.time)
    numbers = ("Number", "First", "Last")
    table = Table("Event", "Origin", *(Column(name, justify="right") for name in numbers), box=box.SIMPLE_HEAD)
    for (kind, origin), (number, first, last) in rows.items():
        table.add_row(Text(kind), Text(origin), f"{number}", f"{first:.6g} s", f"{last:.6g} s")
    return table


def _kind(event: Event) -> str:
    return _text(event.content.get("event"))


def _origin(event: Event) -> str:
    return _text(event.content.get("origin"))


def _text(value: Any) -> str:
    return "unknown" if value is None else str(value)


def _count(event: Event, what: str, otherwise: int = 0) -> int:
    count = event.content.get(what)
    return count if isinstance(count, int) and count >= 0 else otherwise
