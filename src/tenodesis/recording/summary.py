"""Summaries: the contents of a recording, and the outcome of a run."""

from collections.abc import Iterator
from itertools import chain
from math import degrees, isnan
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich import box
from rich.console import Group
from rich.table import Column, Table
from rich.text import Text

from tenodesis.errors import InstrumentError, RecordingError
from tenodesis.json_values import json_values
from tenodesis.recording import kept
from tenodesis.recording.blocks import Progress
from tenodesis.recording.metadata import CONTROLLER, controller_choices, controller_instrument, in_words
from tenodesis.recording.outcome import Facts, Outcome, outcome, tip_error
from tenodesis.recording.reader import Blocks, Recording
from tenodesis.run import Run
from tenodesis.toml import parse_toml

__all__ = ["Outcome", "Summary", "contents", "describe", "facts", "of", "outcome", "read", "tip_error"]

_VERSIONS = ("tenodesis", "python", "numpy")


class Summary(NamedTuple):
    """What a recording holds: the recording without its rows, and what is said about them."""

    recording: Recording
    seen: Facts


def read(path: str | Path, progress: Progress | None = None) -> Summary:
    """Return what a recording holds: as its recorder kept it where the file is undamaged, else read block by block.

    Parameters
    ----------
    path
        The file.
    progress
        Called with the bytes that are read, and how many there are.

    Raises
    ------
    RecordingError, MissingExtraError
        As :meth:`Recording.open`.
    """
    known = kept.read(Path(path), progress)
    if known is not None:
        return Summary(*known)
    blocks = Blocks(path, progress=progress)
    runs = iter(blocks)
    first = next(runs)
    seen = kept.seen_of(blocks.recording(first))
    for run in chain([first], runs):
        seen.add(run)
    return Summary(blocks.recording(Run(np.empty(0), *first.names)), seen.done())


def of(about: Recording | Summary) -> Summary:
    """Return what a recording holds; a summary as it is."""
    if isinstance(about, Summary):
        return about
    seen = kept.seen_of(about)
    seen.add(about.run)
    return Summary(about, seen.done())


def describe(about: Recording | Summary) -> Group:
    """Return a recording's contents, for a rich console: its origin, its topics, and the ranges of its signals."""
    summary = of(about)
    recording = summary.recording
    parts: list[Text | Table] = []
    if recording.damage is not None:
        parts.append(Text(recording.damage, style="bold red"))
    parts += [_facts(summary), _topics(recording)]
    parts += [_ranges(summary.seen)] if summary.seen.ranges else []
    return Group(*parts)


def contents(about: Recording | Summary) -> dict[str, Any]:
    """Return a recording's contents as plain values: origin, topics, ranges of the signals, and number of events."""
    summary = of(about)
    recording = summary.recording
    signals = {
        name: {"least": least, "greatest": greatest, "unit": unit}
        for name, least, greatest, unit in _ends(summary.seen)
    }
    topics = {
        name: {
            "messages": topic.messages,
            "rate": topic.rate,
            "type": topic.type,
            "left_out": str(recording.left_out[name]) if name in recording.left_out else None,
        }
        for name, topic in recording.topics.items()
    }
    content: dict[str, Any] = {
        "origin": facts(summary),
        "duration": summary.seen.last - summary.seen.first,
        "rows": summary.seen.rows,
        "damage": recording.damage,
        "topics": topics,
        "signals": signals,
        "events": len(recording.events),
    }
    return dict(json_values(content))


def facts(about: Recording | Summary) -> dict[str, str]:
    """Return a recording's origin in words, by what is said; empty where nothing is recorded."""
    recording, seen = of(about)
    metadata = recording.metadata
    return {
        **({"file": metadata["kind"]} if "kind" in metadata else {}),
        "instrument": _instrument(recording),
        **(_named(recording.run) if seen.ranges else {}),
        "protocol": _protocol_name(metadata.get("protocol", "")),
        "seed": metadata.get("seed", ""),
        "made with": ", ".join(f"{name} {metadata[name]}" for name in _VERSIONS if name in metadata),
        **_duration(recording, seen),
        **_controller(recording, seen),
    }


def _duration(recording: Recording, seen: Facts) -> dict[str, str]:
    """Return duration, rows and rate; of a table without a known time its rows, and what tells its columns."""
    if "kind" in recording.metadata and all(one.type != "column: time" for one in recording.topics.values()):
        return {
            "rows": f"{seen.rows}",
            "duration": f"no heading is known as the time; tenodesis map {recording.path} writes a map of columns",
        }
    return {
        "duration": f"{seen.last - seen.first:.6g} s",
        "rows": f"{seen.rows}",
        "rate": f"{1 / seen.step:.6g} Hz" if seen.step > 0 else "",
    }


def _facts(summary: Summary) -> Table:
    table = Table.grid(padding=(0, 2))
    for name, fact in facts(summary).items():
        table.add_row(name, Text(fact or "not recorded"))
    return table


def _named(run: Run) -> dict[str, str]:
    return {
        "joints": ", ".join(run.joints),
        "handle": ", ".join(run.handle_joints) or "no joints",
        "tendons": ", ".join(run.tendons),
    }


def _controller(recording: Recording, seen: Facts) -> dict[str, str]:
    """Return the controller's choices and the outcome of the run; empty without a controller."""
    try:
        choices = controller_choices(recording)
        inst = recording.instrument()
        assumed = None if choices is None else controller_instrument(recording)
    except (InstrumentError, RecordingError) as problem:
        return {"controller": str(problem)} if CONTROLLER in recording.metadata else {}
    if choices is None or assumed is None:
        return seen.outcome
    run = recording.run
    served = f", of {' and '.join(run.compensated)}" if run.compensated != run.joints else ""
    return {"controller": f"{in_words(choices, assumed, inst)}{served}", **seen.outcome}


def _instrument(recording: Recording) -> str:
    try:
        return recording.instrument().name
    except RecordingError:
        return ""
    except InstrumentError as problem:
        return str(problem)


def _protocol_name(protocol: str) -> str:
    """Return a protocol's name, or its first line where it has none."""
    try:
        name = parse_toml(protocol, RecordingError, "protocol").get("name")
    except RecordingError:
        name = None
    return name if isinstance(name, str) else protocol.strip().partition("\n")[0]


def _topics(recording: Recording) -> Table:
    # On 80 columns nothing is cut off.
    table = Table(
        Column("Topic", no_wrap=True),
        Column("Messages", no_wrap=True),
        Column("Hz", no_wrap=True),
        Column("Type", overflow="fold"),
        box=box.SIMPLE_HEAD,
        padding=0,
        show_edge=False,
    )
    for name, topic in recording.topics.items():
        reason = recording.left_out.get(name)
        kind = topic.type if reason is None else f"{topic.type}, left out: {reason}"
        rate = "" if isnan(topic.rate) else f"{topic.rate:.6g}"
        table.add_row(Text(name), f"{topic.messages}", rate, Text(kind))
    return table


def _ranges(seen: Facts) -> Table:
    table = Table("Signal", "Least", "Greatest", "Unit", box=box.SIMPLE_HEAD)
    for name, *ends, unit in _ends(seen):
        table.add_row(name, *("" if end is None else f"{end:.4g}" for end in ends), unit)
    return table


def _ends(seen: Facts) -> Iterator[tuple[str, float | None, float | None, str]]:
    """Yield signals with their smallest and largest value, None without one, and their unit; angles in deg."""
    for heading, ends in seen.ranges.items():
        name, unit = heading.removesuffix("]").split(" [")
        shown = "deg" if unit == "rad" else unit
        if ends is None:
            yield name, None, None, shown
        else:
            least, greatest = map(degrees, ends) if unit == "rad" else ends
            yield name, least, greatest, shown
