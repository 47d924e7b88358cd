"""A recording at a glance."""

import math
import tomllib

import numpy as np
from rich import box
from rich.console import Group
from rich.table import Column, Table
from rich.text import Text

from tenodesis.errors import InstrumentError, RecordingError
from tenodesis.recording import choices
from tenodesis.recording.outcome import outcome
from tenodesis.recording.reader import Recording
from tenodesis.recording.tables import columns
from tenodesis.run import COMMANDS, CONTROL, MEASURED, Run

_RANGED = {**COMMANDS, **MEASURED, **CONTROL}.keys() - {"operating_state", "faults", "phase", "request"}
"""Signals whose ranges are shown; those of states would say nothing."""

_VERSIONS = ("tenodesis", "python", "numpy")


def describe(recording: Recording) -> Group:
    """Return what a recording holds, for a rich console: what made it, its topics, and its signals' ranges."""
    parts: list[Text | Table] = []
    if recording.damage is not None:
        parts.append(Text(recording.damage, style="bold red"))
    parts += [_facts(recording), _topics(recording), _ranges(recording.run)]
    return Group(*parts)


def _facts(recording: Recording) -> Table:
    run, metadata = recording.run, recording.metadata
    steps = np.diff(run.time)
    facts = {
        "instrument": _instrument(recording),
        "axes": ", ".join(run.axes),
        "protocol": _name(metadata.get("protocol", "")),
        "seed": metadata.get("seed", ""),
        "made with": ", ".join(f"{name} {metadata[name]}" for name in _VERSIONS if name in metadata),
        "duration": f"{recording.duration:.6g} s",
        "rows": f"{len(run)}",
        "rate": f"{1 / np.median(steps):.6g} Hz" if steps.size else "",
        **_controller(recording),
    }
    table = Table.grid(padding=(0, 2))
    for name, fact in facts.items():
        table.add_row(name, Text(fact or "not recorded"))
    return table


def _controller(recording: Recording) -> dict[str, str]:
    """Return which controller there was, and what came of it; nothing where there was none."""
    try:
        made = choices.choices_of(recording)
        inst = recording.instrument()
        told = choices.instrument_of(recording)
    except (InstrumentError, RecordingError) as problem:
        return {"controller": str(problem)} if choices.CONTROLLER in recording.metadata else {}
    if made is None:
        return {}
    names = [str(name) for name in made.get("faults", [])]
    return {"controller": choices.in_words(made, told, inst), **outcome(recording.run, inst, names)}


def _instrument(recording: Recording) -> str:
    try:
        return recording.instrument().name
    except RecordingError:
        return ""
    except InstrumentError as problem:
        return str(problem)


def _name(protocol: str) -> str:
    """Return a protocol's name, or its first line where it has none."""
    try:
        name = tomllib.loads(protocol).get("name")
    except tomllib.TOMLDecodeError:
        name = None
    return name if isinstance(name, str) else protocol.strip().partition("\n")[0]


def _topics(recording: Recording) -> Table:
    table = Table(Column("Topic", no_wrap=True), "Messages", "Rate", "Type", box=box.SIMPLE_HEAD)
    for name, topic in recording.topics.items():
        reason = recording.left_out.get(name)
        kind = topic.type if reason is None else f"{topic.type}, left out: {reason}"
        rate = "" if math.isnan(topic.rate) else f"{topic.rate:.6g} Hz"
        table.add_row(Text(name), f"{topic.messages}", rate, Text(kind))
    return table


def _ranges(run: Run) -> Table:
    table = Table("Signal", "Least", "Greatest", "Unit", box=box.SIMPLE_HEAD)
    for heading, values in columns(run).items():
        name, unit = heading.removesuffix("]").split(" [")
        if name.partition(".")[0] not in _RANGED:
            continue
        seen = values[~np.isnan(values)]
        ends = [float(seen.min()), float(seen.max())] if seen.size else []
        if unit == "rad":
            ends, unit = [math.degrees(end) for end in ends], "deg"
        least, greatest = (f"{end:.4g}" for end in ends) if ends else ("", "")
        table.add_row(name, least, greatest, unit)
    return table
