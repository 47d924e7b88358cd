"""Summaries: the contents of a recording, and the outcome of a run."""

import tomllib
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
from tenodesis.coupled import CoupledRun
from tenodesis.errors import InstrumentError, RecordingError
from tenodesis.instrument import ShortForm
from tenodesis.recording.metadata import CONTROLLER, controller_choices, controller_instrument, in_words
from tenodesis.recording.reader import AnyRecording, CoupledRecording
from tenodesis.recording.schemas import AnyRun, signals_of
from tenodesis.recording.tables import columns
from tenodesis.run import COMMANDS, CONTROL, MEASURED, TENDONS, Array, Run

_RANGED = ({**COMMANDS, **MEASURED, **CONTROL}.keys() | {"wrench", "applied_grip_force", "grip_force"}) - {
    "operating_state",
    "faults",
    "phase",
    "homing_failure",
    "request",
}
"""Signals whose ranges are shown; those of states have no meaning."""

_VERSIONS = ("tenodesis", "python", "numpy")


def describe(recording: AnyRecording) -> Group:
    """Return a recording's contents, for a rich console: its origin, its topics, and the ranges of its signals."""
    parts: list[Text | Table] = []
    if recording.damage is not None:
        parts.append(Text(recording.damage, style="bold red"))
    parts += [_facts(recording), _topics(recording), _ranges(recording.run)]
    return Group(*parts)


def contents(recording: AnyRecording) -> dict[str, Any]:
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


def facts(recording: AnyRecording) -> dict[str, str]:
    """Return a recording's origin in words, by what is said; empty where nothing is recorded."""
    run, metadata = recording.run, recording.metadata
    steps = np.diff(run.time)
    return {
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


def _facts(recording: AnyRecording) -> Table:
    table = Table.grid(padding=(0, 2))
    for name, fact in facts(recording).items():
        table.add_row(name, Text(fact or "not recorded"))
    return table


def _named(run: AnyRun) -> dict[str, str]:
    """Return the axes, or joints and tendons."""
    if not isinstance(run, CoupledRun):
        return {"axes": ", ".join(run.axes)}
    return {
        "joints": ", ".join(run.joints),
        "handle": ", ".join(run.handle_joints) or "no joints",
        "tendons": ", ".join(run.tendons),
    }


def _controller(recording: AnyRecording) -> dict[str, str]:
    """Return the controller's choices and the outcome of the run; empty without a controller."""
    if isinstance(recording, CoupledRecording):
        return _coupled_controller(recording) | coupled_outcome(recording.run)
    try:
        choices = controller_choices(recording)
        inst = recording.instrument()
        controller_inst = controller_instrument(recording)
    except (InstrumentError, RecordingError) as problem:
        return {"controller": str(problem)} if CONTROLLER in recording.metadata else {}
    if choices is None:
        return {}
    names = [str(name) for name in choices.get("faults", [])]
    return {"controller": in_words(choices, controller_inst, inst), **outcome(recording.run, inst, names)}


def _coupled_controller(recording: CoupledRecording) -> dict[str, str]:
    try:
        choices = controller_choices(recording)
    except RecordingError as problem:
        return {"controller": str(problem)}
    if choices is None:
        return {}
    words = ", ".join(f"{choices.get(choice)} {choice}" for choice in ("law", "observer", "actuation"))
    return {"controller": f"{words}, of {' and '.join(recording.run.compensated)}"}


def coupled_outcome(run: CoupledRun) -> dict[str, str]:
    """Return the outcome of a coupled run in words: a controller's state and faults, tensions, and slack."""
    if "operating_state" not in run.signals or not len(run):
        return tension_facts(run)
    state = {"state": _states(run["operating_state"][:, 0], run.time)}
    return state | {"faults": _faults(run["faults"], run.time, FAULTS)} | tension_facts(run)


def _instrument(recording: AnyRecording) -> str:
    try:
        return recording.instrument().name
    except RecordingError:
        return ""
    except InstrumentError as problem:
        return str(problem)


def _protocol_name(protocol: str) -> str:
    """Return a protocol's name, or its first line where it has none."""
    try:
        name = tomllib.loads(protocol).get("name")
    except tomllib.TOMLDecodeError:
        name = None
    return name if isinstance(name, str) else protocol.strip().partition("\n")[0]


def _topics(recording: AnyRecording) -> Table:
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


def _ranges(run: AnyRun) -> Table:
    table = Table("Signal", "Least", "Greatest", "Unit", box=box.SIMPLE_HEAD)
    for name, *ends, unit in _ends(run):
        table.add_row(name, *("" if end is None else f"{end:.4g}" for end in ends), unit)
    return table


def _ends(run: AnyRun) -> Iterator[tuple[str, float | None, float | None, str]]:
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


def tip_error(run: Run, inst: ShortForm) -> Array:
    """Return the tip's angle less that of eq. 18 without load and friction, rad, shape (n, axes).

    Angles that only the encoders have are taken from there.

    Raises
    ------
    KeyError
        The run has no handle angle, or no output angle.
    """
    rows = (len(run), len(run.axes))
    handle, output = (
        (run[name] if name in run.signals() else run[f"measured_{name}"]).reshape(rows)
        for name in ("handle_angle", "output_angle")
    )
    error = np.empty(rows)
    for n, planar in enumerate(inst.planar):
        within = np.clip(handle[:, n], -planar.handle_range, planar.handle_range)
        # Eq. 19 with equal tensions.
        aim = statics.estimate_output_angle(planar, within, planar.pretension, planar.pretension)
        error[:, n] = output[:, n] - aim
    return error


def outcome(run: Run, inst: ShortForm, names: Sequence[str] = FAULTS) -> dict[str, str]:
    """Return the outcome of a run in words: its controller's state and faults, and the tip's deviation.

    Without a controller it is what the load took: the tip's largest and last deviation, tensions, and slack.

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
    if run.operating_state is None or run.faults is None:
        tip = {"tip": _deviation(run, tip_error(run, inst))} if angles else {}
        return tip | tension_facts(run)
    state = run.operating_state.reshape(len(run), -1)[:, 0]
    facts = {"state": _states(state, run.time), "faults": _faults(run.faults, run.time, names)}
    if angles:
        facts["tip"] = _tip(run, tip_error(run, inst), _compensating(run, state))
    return facts | _tip_force(run)


def _compensating(run: Run, state: Array) -> NDArray[np.bool_]:
    """Return the rows (n,) in which the controller was enabled, other than to home."""
    enabled: NDArray[np.bool_] = state == OperatingState.ENABLED
    if run.request is not None:
        for row in np.flatnonzero(run.request.reshape(len(run), -1)[:, 0] == Request.HOME):
            rest = np.flatnonzero(~enabled[row + 1 :])
            enabled[row : row + 1 + rest[0] if rest.size else None] = False
    return enabled


def _tip(run: Run, error: Array, during: NDArray[np.bool_]) -> str:
    parts = []
    for name, off in zip(run.axes, error.T, strict=True):
        rms = f", {degrees(np.sqrt(np.mean(off[during] ** 2))):.2f} deg RMS while enabled" if during.any() else ""
        parts.append(f"{name} {degrees(off[-1]):+.2f} deg off the unloaded angle (eq. 18 of the paper) at the end{rms}")
    return "; ".join(parts)


def _tip_force(run: Run) -> dict[str, str]:
    """Return the observer's last force at the tip; empty where it knows no deviation of it."""
    if run.estimated_force is None or run.estimated_force_std is None:
        return {}
    last = zip(
        run.axes, np.atleast_1d(run.estimated_force[-1]), np.atleast_1d(run.estimated_force_std[-1]), strict=True
    )
    parts = [f"{name} {force:+.2f} ± {2 * std:.2f} N" for name, force, std in last if np.isfinite(std)]
    return {"tip force": f"{', '.join(parts)} at the end, by the observer (two standard deviations)"} if parts else {}


def _deviation(run: Run, error: Array) -> str:
    parts = []
    for name, off in zip(run.axes, error.T, strict=True):
        if np.isnan(off).all():
            continue
        worst = int(np.nanargmax(np.abs(off)))
        parts.append(
            f"{name} {degrees(off[worst]):+.2f} deg off the unloaded angle (eq. 18 of the paper) at most, at "
            f"{run.time[worst]:.4g} s, {degrees(off[-1]):+.2f} deg at the end"
        )
    return "; ".join(parts)


def tension_facts(run: AnyRun) -> dict[str, str]:
    """Return the ranges of the tensions beside the spools, and for how long tendons were slack at the tip."""
    signals = signals_of(run)
    tension = signals.get("tension", signals.get("measured_tension"))
    if tension is None or not len(run):
        return {}
    if isinstance(run, CoupledRun):
        names = list(run.tendons)
    else:
        names = [f"{axis} {tendon}" if len(run.axes) > 1 else tendon for axis in run.axes for tendon in TENDONS]
    rows = tension.reshape(len(run), -1).T
    ranges = (f"{name} {np.nanmin(row):.3g} to {np.nanmax(row):.3g} N" for name, row in zip(names, rows, strict=True))
    facts = {"tensions": ", ".join(ranges)}
    if "distal_tension" in signals:
        step = float(np.median(np.diff(run.time))) if len(run) > 1 else 0.0
        loose = (signals["distal_tension"] <= 0).reshape(len(run), -1).T
        slack = [
            f"{name} for {np.count_nonzero(row) * step:.3g} s, first at {run.time[row.argmax()]:.4g} s"
            for name, row in zip(names, loose, strict=True)
            if row.any()
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
    masks = np.bitwise_or.reduce(np.nan_to_num(faults).astype(np.int64).reshape(time.size, -1), axis=1)
    found = {name: np.flatnonzero(masks >> bit & 1) for bit, name in enumerate(names)}
    first = sorted((int(rows[0]), name) for name, rows in found.items() if rows.size)
    return ", ".join(f"{name} from {time[row]:.6g} s" for row, name in first) or "none"
