"""Replay: run a recording's commands on a twin again, and compare."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tenodesis.control import Controller
from tenodesis.control.pairs import names_of, pairs
from tenodesis.errors import RecordingError
from tenodesis.instrument import Instrument
from tenodesis.recording.metadata import EVERY, QUASI_STATIC, metadata_of_replay, restored_controller
from tenodesis.recording.reader import Recording
from tenodesis.recording.schemas import TRANSFERRED
from tenodesis.recording.simulation import without_control
from tenodesis.recording.tables import columns
from tenodesis.recording.writer import Recorder
from tenodesis.run import HELD, TISSUE, Array, Names, Run, concatenate
from tenodesis.simulate.execution import with_request
from tenodesis.twin import Contact, Held, Twin

_UNEVEN = 0.01
"""Largest share by which a time step may differ from the others."""

_LOADS = {"force": "force", "radial_force": "radial_force", "wrench": "wrench", "grip_force": "applied_grip_force"}
"""Signal of each load that a twin takes."""

_COMPARED = (("output_angle", "measured_output_angle"), ("tension", "measured_tension"))
"""Signals compared: the first of each that both runs have."""


class Difference(NamedTuple):
    """Difference of a column of a replay from the recording: root mean square and largest, rad or N."""

    rms: float
    largest: float
    unit: str


@dataclass(frozen=True)
class Replay:
    """A recording and its replay.

    Attributes
    ----------
    recording
        The recording.
    inst
        The instrument whose twin ran it again.
    run
        The run of that twin.
    exact
        Whether every signal that was recorded is the same to the last bit.
    """

    recording: Recording
    inst: Instrument
    run: Run = field(repr=False)
    exact: bool

    def compared(self) -> tuple[str, ...]:
        """Return the signals that are compared: the truth, or what was measured where the truth was not recorded."""
        both = self.recording.run.signals().keys() & self.run.signals().keys()
        found = (next((name for name in names if name in both), None) for names in _COMPARED)
        return tuple(name for name in found if name is not None)

    def differences(self) -> Mapping[str, Difference]:
        """Return the differences of output angles and tensions by column, like ``tension.yaw_agonist``."""
        before, after = columns(self.recording.run), columns(self.run)
        found = {}
        for heading, values in after.items():
            name, unit = heading.removesuffix("]").split(" [")
            if name.partition(".")[0] in self.compared():
                found[name] = _difference(values - before[heading], unit)
        return found

    def write(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write the replay as a recording, with the metadata of the original.

        Raises
        ------
        RecordingError
            The file cannot be written, or exists.
        """
        metadata = metadata_of_replay(self.recording, self.inst)
        with Recorder(path, axes=self.run.names, metadata=metadata, overwrite=overwrite) as recorder:
            recorder.write(self.run)


def replay(recording: Recording, inst: Instrument | None = None) -> Replay:
    """Run a recording's commands again on a twin that begins at rest, with the same seed, time step and mode.

    Where the commanded handle angle was not recorded, the measured one takes its place. A controller closes the loop
    from the row where it did, with the choices it had and the requests it got.

    Parameters
    ----------
    recording
        The recording, complete or damaged.
    inst
        The instrument; the recorded one if not given. The controller's stays what it was.

    Raises
    ------
    RecordingError
        The recording has no instrument, no handle angle, no rows or no even time step, or other axes, the choices in
        it make no controller, or it was converted from another instrument.
    NoSolutionError
        The tip was loaded past what it can hold.
    ValueError
        The twin cannot follow a command, or not with this time step.
    """
    recorded, metadata = recording.run, recording.metadata
    if TRANSFERRED in metadata:
        raise RecordingError(
            f"{recording.path} was converted from {metadata[TRANSFERRED]}; replay that recording.",
            key=TRANSFERRED,
            value=metadata[TRANSFERRED],
        )
    if EVERY in metadata:
        raise RecordingError(
            f"{recording.path} holds one of {metadata[EVERY]} rows; replaying needs the commands of all of them.",
            key=EVERY,
            value=metadata[EVERY],
            allowed="a recording of all rows",
        )
    if inst is None:
        inst = recording.instrument()
    for group, own, theirs in zip(Names._fields, names_of(inst), recorded.names, strict=True):
        # Before, a recording named what a controller serves only if it had one.
        if own != theirs and group != "compensated":
            about, has, has_not = group.replace("_", " "), " and ".join(theirs) or "none", " and ".join(own) or "none"
            raise RecordingError(
                f"{recording.path} has the {about} {has}, {inst.name} {has_not}; the instrument must have the same.",
                key=group,
                value=theirs,
                allowed=has_not,
            )
    described = all(name in recorded.signals() for name in HELD)
    if recorded.grip_force is not None and recorded.grip_force.any() and not described:
        raise RecordingError(
            f"{recording.path} has jaws that held something, which it does not describe; it cannot be replayed.",
            key="grip_force",
            allowed="described",
        )
    seed = _number(recording, "seed", "0")
    quasi_static = metadata.get("mode") == QUASI_STATIC
    twin = Twin(inst, time_step=_time_step(recording), seed=int(seed), quasi_static=quasi_static)
    if recorded.commanded_handle_angle is None:
        recorded = replace(recorded, commanded_handle_angle=recorded.measured_handle_angle)
    if recorded.commanded_handle_angle is None:
        raise RecordingError(
            f"{recording.path} has no handle angle; replaying needs the commanded or the measured one.",
            key="handle_angle",
            allowed="recorded",
        )
    controller = restored_controller(recording)
    if controller is None:
        run = _run(twin, recorded)
    else:
        started = _uncontrolled(recorded)
        runs = [without_control(_run(twin, recorded.rows(0, started)))] if started else []
        if started < len(recorded):
            runs.append(_run(twin, recorded.rows(started), controller))
        run = concatenate(runs)
    return Replay(recording, inst, run, _same_bits(recording.run, run))


def _run(twin: Twin, recorded: Run, controller: Controller | None = None) -> Run:
    """Return the twin's run under recorded commands, with or without a controller in the loop."""
    signals = recorded.signals()
    touched = [name for names in (TISSUE, HELD) if signals.keys() >= set(names) for name in names]
    changes = np.zeros(max(len(recorded) - 1, 0), bool)
    for name in touched:
        column = np.nan_to_num(recorded.by_column(name))
        changes |= (column[1:] != column[:-1]).any(axis=1)
    blocks = pairwise([0, *(np.flatnonzero(changes) + 1).tolist(), len(recorded)])
    return concatenate([_run_in(twin, recorded.rows(first, last), controller) for first, last in blocks])


def _run_in(twin: Twin, recorded: Run, controller: Controller | None) -> Run:
    """Return the twin's run while neither tissue nor what the jaws hold changes."""
    handle, velocity = recorded["commanded_handle_angle"], recorded.commanded_spool_velocity
    signals = recorded.signals()
    commands: dict[str, Any] = {name: signals[signal] for name, signal in _LOADS.items() if signal in signals}
    if signals.keys() >= set(TISSUE):
        tissue = np.nan_to_num([recorded.by_column(name)[0] for name in TISSUE])
        commands["contact"] = [Contact.of_row(*row) for row in tissue.T.tolist()]
    if signals.keys() >= set(HELD):
        held = Held(*(float(recorded.by_column(name)[0, 0]) for name in HELD))
        commands["held"] = held if held.stiffness > 0 else None
    if velocity is not None:
        own = [] if controller is None else [m for pair in pairs(twin.inst).values() for m in pair[2:]]
        commands["spool_velocity"] = np.where(np.isin(np.arange(velocity.shape[1]), own), 0.0, velocity)
    if recorded.commanded_spool_tension is not None:
        commands["spool_tension"] = np.nan_to_num(recorded.by_column("commanded_spool_tension"))
    if controller is None:
        return twin.run(handle, **commands)
    request = np.zeros(len(recorded))
    if recorded.request is not None:
        request = np.nan_to_num(recorded.by_column("request")[:, 0])
    run = twin.run(handle, controller=controller, request=request.astype(np.uint8), **commands)
    return with_request(run, request)


def _uncontrolled(recorded: Run) -> int:
    """Return how many rows there are before the controller runs."""
    if recorded.operating_state is None:
        return 0
    running = ~np.isnan(recorded.operating_state).reshape(len(recorded), -1)[:, 0]
    return int(np.argmax(running)) if running.any() else len(recorded)


def _number(recording: Recording, key: str, default: str) -> float:
    text = recording.metadata.get(key, default)
    try:
        return int(text) if key == "seed" else float(text)
    except ValueError:
        raise RecordingError(
            f"{recording.path}: metadata {key} = {text!r}: it must be a number.",
            key=key,
            value=text,
            allowed="a number",
        ) from None


def _time_step(recording: Recording) -> float:
    """Return the time step, s: as recorded, or the time between rows."""
    time = recording.run.time
    if not time.size:
        raise RecordingError(f"{recording.path} has no rows; there is nothing to replay.", key="rows", value=0)
    if "time_step" in recording.metadata:
        return _number(recording, "time_step", "")
    steps = np.diff(time)
    usual = float(np.median(steps)) if steps.size else math.nan
    uneven = np.flatnonzero(~(np.abs(steps - usual) <= _UNEVEN * usual))
    if not usual > 0 or uneven.size:
        at = f", {steps[uneven[0]]:.4g} s after row {uneven[0]}" if uneven.size else ""
        raise RecordingError(f"{recording.path} has no even time step{at}; replaying needs one.", key="time_step")
    return usual


def _same_bits(recorded: Run, run: Run) -> bool:
    again = {"time": run.time, **run.signals()}
    before = {"time": recorded.time, **recorded.signals()}
    return all(name in again and values.tobytes() == again[name].tobytes() for name, values in before.items())


def _difference(off: Array, unit: str) -> Difference:
    known = off[np.isfinite(off)]
    if not known.size:
        return Difference(math.nan, math.nan, unit)
    return Difference(math.sqrt(float(np.mean(known**2))), float(np.abs(known).max()), unit)
