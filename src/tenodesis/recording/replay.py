"""Feed a recording's commands to a twin again, and compare."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from tenodesis.control import Controller
from tenodesis.errors import RecordingError
from tenodesis.instrument import Instrument
from tenodesis.recording import choices
from tenodesis.recording.reader import Recording
from tenodesis.recording.schemas import TRANSFERRED
from tenodesis.recording.simulation import QUASI_STATIC, without_control
from tenodesis.recording.tables import columns
from tenodesis.run import Array, Run, concatenate
from tenodesis.simulate.execution import with_request
from tenodesis.twin import Twin

_UNEVEN = 0.01
"""Largest share by which a time step may differ from the others."""

_COMPARED = (("output_angle", "measured_output_angle"), ("tension", "measured_tension"))
"""Signals compared: the first of each that both runs have."""


class Difference(NamedTuple):
    """By how much a column of a replay differs from the recording: root mean square and largest, rad or N."""

    rms: float
    largest: float
    unit: str


@dataclass(frozen=True)
class Replay:
    """A recording run again.

    Attributes
    ----------
    recording
        The recording.
    inst
        The instrument whose twin ran it again.
    run
        What that twin did.
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
        """Return the differences of output angles and tensions by column, like ``tension.yaw.agonist``."""
        before, after = columns(self.recording.run), columns(self.run)
        found = {}
        for heading, values in after.items():
            name, unit = heading.removesuffix("]").split(" [")
            if name.partition(".")[0] in self.compared():
                found[name] = _difference(values - before[heading], unit)
        return found


def replay(recording: Recording, inst: Instrument | None = None) -> Replay:
    """Run a recording's commands again on a twin that begins at rest, with the same seed, time step and mode.

    Where the commanded handle angle was not recorded, the measured one takes its place. A controller closes the loop
    again from where it did, with the choices it had and asked what it was asked.

    Parameters
    ----------
    recording
        The recording, whole or damaged.
    inst
        The instrument; the recorded one if not given. The controller's stays what it was.

    Raises
    ------
    RecordingError
        The recording has no instrument, no handle angle, no rows or no even time step, or other axes, what it says
        of its controller makes none, or it was carried over from another instrument.
    NoSolutionError
        The tip was loaded past what it can hold.
    ValueError
        The twin cannot follow a command, or not with this time step.
    """
    recorded, metadata = recording.run, recording.metadata
    if TRANSFERRED in metadata:
        raise RecordingError(
            f"{recording.path} was carried over from {metadata[TRANSFERRED]}; allowed is to replay that, as it was run."
        )
    if inst is None:
        inst = recording.instrument()
    if inst.axes != recorded.axes:
        raise RecordingError(
            f"{recording.path} has the axes {' and '.join(recorded.axes)}, {inst.name} {' and '.join(inst.axes)}; "
            "allowed is an instrument with the same."
        )
    seed = _number(recording, "seed", "0")
    quasi_static = metadata.get("mode") == QUASI_STATIC
    twin = Twin(inst, time_step=_time_step(recording), seed=int(seed), quasi_static=quasi_static)
    handle = (
        recorded.measured_handle_angle if recorded.commanded_handle_angle is None else recorded.commanded_handle_angle
    )
    if handle is None:
        raise RecordingError(
            f"{recording.path} has no handle angle; replaying needs the commanded or the measured one."
        )
    controller = choices.made_again(recording)
    if controller is None:
        run = _open_loop(twin, recorded, handle, slice(None))
    else:
        started = _uncontrolled(recorded)
        runs = []
        if started:
            runs.append(without_control(_open_loop(twin, recorded, handle, slice(started))))
        if started < len(handle):
            runs.append(_closed_loop(twin, controller, recorded, handle, slice(started, None)))
        run = concatenate(runs)
    return Replay(recording, inst, run, _same_bits(recorded, run))


def _open_loop(twin: Twin, recorded: Run, handle: Array, rows: slice) -> Run:
    return twin.run(
        handle[rows],
        _of(recorded.force, rows),
        radial_force=_of(recorded.radial_force, rows),
        spool_velocity=_of(recorded.commanded_spool_velocity, rows),
    )


def _closed_loop(twin: Twin, controller: Controller, recorded: Run, handle: Array, rows: slice) -> Run:
    asked = np.zeros(len(handle)) if recorded.request is None else recorded.request.reshape(len(handle), -1)[:, 0]
    request = np.nan_to_num(asked)
    run = twin.run(
        handle[rows],
        _of(recorded.force, rows),
        radial_force=_of(recorded.radial_force, rows),
        controller=controller,
        request=request[rows].astype(np.uint8),
    )
    return with_request(run, request[rows])


def _uncontrolled(recorded: Run) -> int:
    """Return how many rows there are before the controller runs."""
    if recorded.operating_state is None:
        return 0
    running = ~np.isnan(recorded.operating_state).reshape(len(recorded), -1)[:, 0]
    return int(np.argmax(running)) if running.any() else len(recorded)


def _of(command: Array | None, rows: slice) -> Array | float:
    return 0.0 if command is None else command[rows]


def _number(recording: Recording, key: str, default: str) -> float:
    text = recording.metadata.get(key, default)
    try:
        return int(text) if key == "seed" else float(text)
    except ValueError:
        raise RecordingError(f"{recording.path}: metadata {key} = {text!r}: it must be a number.") from None


def _time_step(recording: Recording) -> float:
    """Return the time step, s: as recorded, or the one between rows."""
    time = recording.run.time
    if not time.size:
        raise RecordingError(f"{recording.path} has no rows; there is nothing to replay.")
    if "time_step" in recording.metadata:
        return _number(recording, "time_step", "")
    steps = np.diff(time)
    usual = float(np.median(steps)) if steps.size else math.nan
    uneven = np.flatnonzero(~(np.abs(steps - usual) <= _UNEVEN * usual))
    if not usual > 0 or uneven.size:
        at = f", {steps[uneven[0]]:.4g} s after row {uneven[0]}" if uneven.size else ""
        raise RecordingError(f"{recording.path} has no even time step{at}; replaying needs one.")
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
