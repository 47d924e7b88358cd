"""Summaries: the contents of a recording, and the outcome of a run."""

from collections.abc import Iterator, Sequence
from math import degrees, isnan
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich import box
from rich.console import Group
from rich.table import Column, Table
from rich.text import Text

from tenodesis import statics
from tenodesis.control import FAULTS, OperatingState, Request
from tenodesis.errors import InstrumentError, RecordingError
from tenodesis.instrument import Instrument
from tenodesis.recording.metadata import CONTROLLER, controller_choices, controller_instrument, in_words
from tenodesis.recording.reader import Recording
from tenodesis.recording.tables import columns
from tenodesis.run import COMMANDS, CONTROL, MEASURED, Array, Run
from tenodesis.toml import parse_toml

_RANGED = ({**COMMANDS, **MEASURED, **CONTROL}.keys() | {"grip_force"}) - {
    "operating_state",
    "faults",
    "phase",
    "homing_failure",
    "request",
}
"""Signals whose ranges are shown; those of states have no meaning."""

_VERSIONS = ("tenodesis", "python", "numpy")


def describe(recording: Recording) -> Group:
    """Return a recording's contents, for a rich console: its origin, its topics, and the ranges of its signals."""
    parts: list[Text | Table] = []
    if recording.damage is not None:
        parts.append(Text(recording.damage, style="bold red"))
    parts += [_facts(recording), _topics(recording), _ranges(recording.run)]
    return Group(*parts)


def contents(recording: Recording) -> dict[str, Any]:
    """Return a recording's contents as plain values: origin, topics, ranges of the signals, and number of events."""
    signals = {
        name: {"least": least, "greatest": greatest, "unit": unit}
        for name, least, greatest, unit in _ends(recording.run)
    }
    topics = {
        name: {
            "messages": topic.messages,
            "rate": None if isnan(topic.rate) else topic.rate,
            "type": topic.type,
            "left_out": recording.left_out.get(name),
        }
        for name, topic in recording.topics.items()
    }
    return {
        "origin": facts(recording),
        "duration": recording.duration,
        "rows": len(recording.run),
        "damage": recording.damage,
        "topics": topics,
        "signals": signals,
        "events": len(recording.events),
    }


def facts(recording: Recording) -> dict[str, str]:
    """Return a recording's origin in words, by what is said; empty where nothing is recorded."""
    run, metadata = recording.run, recording.metadata
    steps = np.diff(run.time)
    return {
        **({"file": metadata["kind"]} if "kind" in metadata else {}),
        "instrument": _instrument(recording),
        **_named(run),
        "protocol": _protocol_name(metadata.get("protocol", "")),
        "seed": metadata.get("seed", ""),
        "made with": ", ".join(f"{name} {metadata[name]}" for name in _VERSIONS if name in metadata),
        "duration": f"{recording.duration:.6g} s",
        "rows": f"{len(run)}",
        "rate": f"{1 / np.median(steps):.6g} Hz" if steps.size else "",
        **_controller(recording),
    }


def _facts(recording: Recording) -> Table:
    table = Table.grid(padding=(0, 2))
    for name, fact in facts(recording).items():
        table.add_row(name, Text(fact or "not recorded"))
    return table


def _named(run: Run) -> dict[str, str]:
    return {
        "joints": ", ".join(run.joints),
        "handle": ", ".join(run.handle_joints) or "no joints",
        "tendons": ", ".join(run.tendons),
    }


def _controller(recording: Recording) -> dict[str, str]:
    """Return the controller's choices and the outcome of the run; empty without a controller."""
    try:
        choices = controller_choices(recording)
        inst = recording.instrument()
        assumed = None if choices is None else controller_instrument(recording)
    except (InstrumentError, RecordingError) as problem:
        return {"controller": str(problem)} if CONTROLLER in recording.metadata else {}
    if choices is None or assumed is None:
        return outcome(recording.run, inst)
    names = [str(name) for name in choices.get("faults", [])]
    run = recording.run
    served = f", of {' and '.join(run.compensated)}" if run.compensated != run.joints else ""
    return {"controller": f"{in_words(choices, assumed, inst)}{served}", **outcome(run, inst, names)}


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
        Column("Rate", no_wrap=True),
        Column("Type", overflow="fold"),
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        show_edge=False,
    )
    for name, topic in recording.topics.items():
        reason = recording.left_out.get(name)
        kind = topic.type if reason is None else f"{topic.type}, left out: {reason}"
        rate = "" if isnan(topic.rate) else f"{topic.rate:.6g} Hz"
        table.add_row(Text(name), f"{topic.messages}", rate, Text(kind))
    return table


def _ranges(run: Run) -> Table:
    table = Table("Signal", "Least", "Greatest", "Unit", box=box.SIMPLE_HEAD)
    for name, *ends, unit in _ends(run):
        table.add_row(name, *("" if end is None else f"{end:.4g}" for end in ends), unit)
    return table


def _ends(run: Run) -> Iterator[tuple[str, float | None, float | None, str]]:
    """Yield signals with their smallest and largest value, None without one, and their unit; angles in deg."""
    for heading, values in columns(run).items():
        name, unit = heading.removesuffix("]").split(" [")
        if name.partition(".")[0] not in _RANGED:
            continue
        seen = np.degrees(values) if unit == "rad" else values
        seen, unit = seen[~np.isnan(seen)], "deg" if unit == "rad" else unit
        if seen.size:
            yield name, float(seen.min()), float(seen.max()), unit
        else:
            yield name, None, None, unit


def tip_error(run: Run, inst: Instrument) -> Array:
    """Return the tip's angles less its unloaded ones (:func:`tenodesis.statics.targets`), rad, shape (n, joints).

    Angles that only the encoders have are taken from there.

    Raises
    ------
    KeyError
        The run has no handle angle, or no output angle.
    """
    handle, output = (
        run.by_column(name if name in run.signals() else f"measured_{name}")
        for name in ("handle_angle", "output_angle")
    )
    return output - statics.targets(inst, handle)


def outcome(run: Run, inst: Instrument, names: Sequence[str] = FAULTS) -> dict[str, str]:
    """Return the outcome of a run in words: its controller's state and faults, the tip's deviation, and tensions.

    Parameters
    ----------
    run
        The run.
    inst
        The instrument that ran.
    names
        Names of the faults, in the order of their bits.
    """
    if not len(run):
        return {}
    signals = run.signals().keys()
    angles = {"handle_angle", "measured_handle_angle"} & signals and {"output_angle", "measured_output_angle"} & signals
    error = tip_error(run, inst) if angles and inst.handle_joints else None
    if run.operating_state is None or run.faults is None:
        tip = {} if error is None else {"tip": _deviation(run, error)}
        return tip | _tensions(run)
    state = run.by_column("operating_state")[:, 0]
    facts = {"state": _states(state, run.time), "faults": _faults(run.by_column("faults"), run.time, names)}
    if error is not None:
        facts["tip"] = _tip(run, error, _compensating(run, state))
    return facts | _tip_force(run) | _tensions(run)


def _compensating(run: Run, state: Array) -> NDArray[np.bool_]:
    """Return the rows (n,) in which the controller was enabled, other than to home."""
    enabled: NDArray[np.bool_] = state == OperatingState.ENABLED
    if run.request is not None:
        for row in np.flatnonzero(run.by_column("request")[:, 0] == Request.HOME):
            rest = np.flatnonzero(~enabled[row + 1 :])
            enabled[row : row + 1 + rest[0] if rest.size else None] = False
    return enabled


def _tip(run: Run, error: Array, during: NDArray[np.bool_]) -> str:
    parts = []
    for name, off in zip(run.joints, error.T, strict=True):
        rms = f", {degrees(np.sqrt(np.mean(off[during] ** 2))):.2f} deg RMS while enabled" if during.any() else ""
        parts.append(f"{name} {degrees(off[-1]):+.2f} deg off the unloaded angle at the end{rms}")
    return "; ".join(parts)


def _tip_force(run: Run) -> dict[str, str]:
    """Return the observer's last force at the tip; empty where it knows no deviation of it."""
    if run.estimated_force is None or run.estimated_force_std is None:
        return {}
    forces = (run.by_column(name)[-1] for name in ("estimated_force", "estimated_force_std"))
    last = zip(run.compensated, *forces, strict=True)
    parts = [f"{name} {force:+.2f} ± {2 * std:.2f} N" for name, force, std in last if np.isfinite(std)]
    return {"tip force": f"{', '.join(parts)} at the end, by the observer (two standard deviations)"} if parts else {}


def _deviation(run: Run, error: Array) -> str:
    parts = []
    for name, off in zip(run.joints, error.T, strict=True):
        if np.isnan(off).all():
            continue
        worst = int(np.nanargmax(np.abs(off)))
        parts.append(
            f"{name} {degrees(off[worst]):+.2f} deg off the unloaded angle at most, at "
            f"{run.time[worst]:.4g} s, {degrees(off[-1]):+.2f} deg at the end"
        )
    return "; ".join(parts)


def _tensions(run: Run) -> dict[str, str]:
    """Return the ranges of the tensions beside the spools, and for how long tendons were slack at the tip."""
    tension = run.measured_tension if run.tension is None else run.tension
    if tension is None:
        return {}
    columns = zip(run.tendons, tension.T, strict=True)
    facts = {"tensions": ", ".join(f"{name} {np.nanmin(one):.3g} to {np.nanmax(one):.3g} N" for name, one in columns)}
    if run.distal_tension is not None:
        step = float(np.median(np.diff(run.time))) if len(run) > 1 else 0.0
        slack = [
            f"{name} for {np.count_nonzero(loose) * step:.3g} s, first at {run.time[loose.argmax()]:.4g} s"
            for name, loose in zip(run.tendons, run.distal_tension.T <= 0, strict=True)
            if loose.any()
        ]
        facts["slack"] = ", ".join(slack) or "no tendon"
    return facts


def _states(state: Array, time: Array) -> str:
    """Return the state at the end and how long each state lasted, in order of their first rows."""
    step = float(np.median(np.diff(time))) if time.size > 1 else 0.0
    known = state[~np.isnan(state)]
    seen = dict.fromkeys(known.tolist())
    lasted = ", ".join(f"{_state_name(value)} {np.count_nonzero(known == value) * step:.3g} s" for value in seen)
    end = _state_name(state[-1]) if known.size else "not running"
    return f"{end} at the end" + (f" ({lasted})" if len(seen) > 1 else "")


def _state_name(state: float) -> str:
    return OperatingState(int(state)).name if state in set(OperatingState) else f"state {state:g}"


def _faults(faults: Array, time: Array, names: Sequence[str]) -> str:
    """Return the faults, and when each came first."""
    masks = np.bitwise_or.reduce(np.nan_to_num(faults).astype(np.int64), axis=1)
    found = {name: np.flatnonzero(masks >> bit & 1) for bit, name in enumerate(names)}
    first = sorted((int(rows[0]), name) for name, rows in found.items() if rows.size)
    return ", ".join(f"{name} from {time[row]:.6g} s" for row, name in first) or "none"
