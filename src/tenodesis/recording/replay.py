"""Replay: run a recording's commands on a twin again, and compare."""

import math
import warnings
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from itertools import chain, pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tenodesis.control import Controller, JointController, OperatingState
from tenodesis.control.pairs import names_of, served_motors
from tenodesis.errors import FaultWarning, RecordingError
from tenodesis.instrument import Instrument
from tenodesis.recording.blocks import Progress, Thinned
from tenodesis.recording.metadata import EVERY, QUASI_STATIC, metadata_of_replay, restored_controller
from tenodesis.recording.outcome import Outcome
from tenodesis.recording.reader import Blocks, Recording
from tenodesis.recording.schemas import TRANSFERRED
from tenodesis.recording.tables import columns
from tenodesis.recording.writer import Recorder
from tenodesis.run import HELD, TISSUE, Array, Names, Run, concatenate
from tenodesis.simulate.execution import with_request, without_control
from tenodesis.twin import Contact, Held, Twin

_UNEVEN = 0.01
"""Largest share by which a time step may differ from the others."""

_MOST_POINTS = 40_000
"""Rows of a replay that are kept for a figure."""

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
        found = {}
        for name, (off, unit) in self._off().items():
            found[name] = _Sum(unit)
            found[name].add(off)
        return {name: one.difference for name, one in found.items()}

    def _off(self) -> dict[str, tuple[Array, str]]:
        """Return the replay less the recording, (n,), and its unit, by column."""
        before, after = columns(self.recording.run), columns(self.run)
        found = {}
        for heading, values in after.items():
            name, unit = heading.removesuffix("]").split(" [")
            if name.partition(".")[0] in self.compared():
                found[name] = (values - before[heading], unit)
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
    again = _Again(recording, inst)
    run = again.run(recording.run)
    return Replay(recording, again.inst, run, _same_bits(recording.run, run))


class Replayed(NamedTuple):
    """What came of a replay that ran block by block.

    Attributes
    ----------
    replay
        The replay with at most 40,000 of its rows, for a figure.
    differences
        Of all rows, as :meth:`Replay.differences`.
    outcome
        Of the replay, in words.
    rows, time
        How many rows there were, and the time of the last, s.
    """

    replay: Replay
    differences: Mapping[str, Difference]
    outcome: Mapping[str, str]
    rows: int
    time: float


def replay_file(
    path: str | Path,
    inst: Instrument | None = None,
    out: str | Path | None = None,
    *,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Replayed:
    """Run the commands of a recording again block by block, in memory that does not grow with its length.

    Parameters
    ----------
    path
        The recording.
    inst
        As for :func:`replay`, and errors alike.
    out
        The replay's own recording, as :meth:`Replay.write` writes it; None for none.
    overwrite
        Whether to replace a file that exists.
    progress
        Called with the bytes that are read, and how many there are.
    """
    blocks = Blocks(path, progress=progress)
    runs = iter(blocks)
    first = next(runs)
    recording = blocks.recording(first)
    if "time_step" not in recording.metadata:
        # the time step is that of all rows
        recording = Recording.open(path)
        runs, first = iter(()), recording.run
    again = _Again(recording, inst)
    before, after = Thinned(_MOST_POINTS), Thinned(_MOST_POINTS)
    outcome = Outcome(again.inst)
    sums: dict[str, _Sum] = {}
    exact, rows, run = True, 0, first
    with ExitStack() as stack:
        recorder = None
        for block in chain([first], runs):
            run = again.run(block)
            exact = exact and _same_bits(block, run)
            for heading, (off, unit) in Replay(replace(recording, run=block), again.inst, run, exact)._off().items():
                sums.setdefault(heading, _Sum(unit)).add(off)
            before.add(block)
            after.add(run)
            outcome.add(run)
            rows += len(run)
            if out is not None:
                if recorder is None:
                    metadata = metadata_of_replay(recording, again.inst)
                    recorder = stack.enter_context(
                        Recorder(out, axes=run.names, metadata=metadata, overwrite=overwrite)
                    )
                recorder.write(run)
    if blocks.topics:
        recording = blocks.recording(before.run)
    found = Replay(replace(recording, run=before.run), again.inst, after.run, exact)
    differences = {heading: one.difference for heading, one in sums.items()}
    return Replayed(found, differences, outcome.facts(), rows, float(run.time[-1]))


class _Sum:
    """A difference of which the rows come one after another."""

    def __init__(self, unit: str) -> None:
        self._unit = unit
        self._squares, self._count, self._largest = 0.0, 0, 0.0

    def add(self, off: Array) -> None:
        """Take the next rows, (n,)."""
        known = off[np.isfinite(off)]
        if known.size:
            self._squares, self._count = self._squares + float(known @ known), self._count + known.size
            self._largest = max(self._largest, float(np.abs(known).max()))

    @property
    def difference(self) -> Difference:
        """The difference of all rows."""
        if not self._count:
            return Difference(math.nan, math.nan, self._unit)
        return Difference(math.sqrt(self._squares / self._count), self._largest, self._unit)


class _Again:
    """A twin that runs a recording's commands again, from its first row on; parameters and errors of :func:`replay`."""

    def __init__(self, recording: Recording, inst: Instrument | None) -> None:
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
                about, has, has_not = (
                    group.replace("_", " "),
                    " and ".join(theirs) or "none",
                    " and ".join(own) or "none",
                )
                raise RecordingError(
                    f"{recording.path} has the {about} {has}, {inst.name} {has_not}; the instrument must have the "
                    "same.",
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
        if recorded.commanded_handle_angle is None and recorded.measured_handle_angle is None:
            raise RecordingError(
                f"{recording.path} has no handle angle; replaying needs the commanded or the measured one.",
                key="handle_angle",
                allowed="recorded",
            )
        self.inst = inst
        self._twin = twin
        self._controller = restored_controller(recording)
        self._running = self._controller is None
        self._faulted = False

    def run(self, recorded: Run) -> Run:
        """Return the twin's run under the next rows of the recording."""
        if recorded.commanded_handle_angle is None:
            recorded = replace(recorded, commanded_handle_angle=recorded.measured_handle_angle)
        runs = []
        if not self._running:
            started = _uncontrolled(recorded)
            self._running = started < len(recorded)
            if started:
                runs.append(without_control(_run(self._twin, recorded.rows(0, started)), self._controller))
                if isinstance(self._controller, JointController):
                    self._controller.count_from(runs[-1].by_column("measured_spool_angle")[-1])
            recorded = recorded.rows(started)
        if len(recorded):
            with warnings.catch_warnings():
                if self._faulted:
                    warnings.simplefilter("ignore", FaultWarning)
                runs.append(_run(self._twin, recorded, self._controller))
            if self._controller is not None:
                self._faulted = self._faulted or bool(
                    (runs[-1].by_column("operating_state") == OperatingState.FAULT).any()
                )
        return concatenate(runs)


def _run(twin: Twin, recorded: Run, controller: Controller | JointController | None = None) -> Run:
    """Return the twin's run under recorded commands, with or without a controller in the loop."""
    signals = recorded.signals()
    touched = [name for names in (TISSUE, HELD) if signals.keys() >= set(names) for name in names]
    changes = np.zeros(max(len(recorded) - 1, 0), bool)
    for name in touched:
        column = np.nan_to_num(recorded.by_column(name))
        changes |= (column[1:] != column[:-1]).any(axis=1)
    blocks = pairwise([0, *(np.flatnonzero(changes) + 1).tolist(), len(recorded)])
    return concatenate([_run_in(twin, recorded.rows(first, last), controller) for first, last in blocks])


def _run_in(twin: Twin, recorded: Run, controller: Controller | JointController | None) -> Run:
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
        joints = isinstance(controller, JointController)
        own = [] if controller is None else served_motors(twin.inst, all_joints=joints)
        commands["spool_velocity"] = np.where(np.isin(np.arange(velocity.shape[1]), own), 0.0, velocity)
    if recorded.commanded_spool_tension is not None:
        commands["spool_tension"] = np.nan_to_num(recorded.by_column("commanded_spool_tension"))
    if controller is None:
        return twin.run(handle, **commands)
    request = np.zeros(len(recorded))
    if recorded.request is not None:
        request = np.nan_to_num(recorded.by_column("request")[:, 0])
    if recorded.commanded_output_angle is not None:
        commands["target"] = recorded.by_column("commanded_output_angle")
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
