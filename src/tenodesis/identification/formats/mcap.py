"""Recordings of an instrument: MCAP files with ROS 2 messages, as ``tenodesis record`` and a bench write them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tenodesis.errors import IdentificationError, InstrumentError, RecordingError
from tenodesis.identification.formats.measured import Measured, Raw, checksum
from tenodesis.instrument import Instrument
from tenodesis.recording import Recording
from tenodesis.signals import Array

TENDONS = ("agonist", "antagonist")
_NEEDED = ("measured_tension",)
_LEAST_EXCITATION = float(np.radians(2))
_JUMP = 0.5
"""Share of the spread that a load cell cannot leave its neighbours by in one sample."""


@dataclass(frozen=True)
class InstrumentRun(Measured):
    """One axis of a recording, with the instrument that it says it was made on."""

    instrument: Instrument | None = None


def load(path: Path) -> InstrumentRun:
    """Return the first axis of a recording.

    Columns: handle_angle (commanded, where the recording has it, otherwise measured), measured_handle_angle,
    measured_output_angle (rad), tension_agonist, tension_antagonist, force (N), spool_agonist, spool_antagonist (rad).
    What was not recorded is left out; without a force the tip is taken to be free.

    Raises
    ------
    IdentificationError
        The file is no recording, or lacks what is needed, or is not usable.
    """
    try:
        recording = Recording.open(path)
    except RecordingError as problem:
        raise IdentificationError(str(problem)) from None
    signals = recording.run.signals()
    missing = [name for name in _NEEDED if name not in signals]
    handle = next((name for name in ("commanded_handle_angle", "measured_handle_angle") if name in signals), None)
    if missing or handle is None:
        lacking = ", ".join([*missing, *([] if handle else ["measured_handle_angle"])])
        raise IdentificationError(f"{path} lacks {lacking}; it has {', '.join(signals) or 'no signals'}.")
    inst = _instrument(recording)
    # A hand that gives way is not where it was told to be.
    if inst is not None and inst.dynamics.hand_stiffness and "measured_handle_angle" in signals:
        handle = "measured_handle_angle"
    raw = Raw(path.name, recording.run.time, _columns(signals, handle, len(recording.run.axes)))
    if recording.damage is not None:
        raw.note(recording.damage)
    if recording.run.axes[1:]:
        raw.note(f"of the axes {' and '.join(recording.run.axes)} the first is taken")
    if handle == "measured_handle_angle":
        raw.note("the handle is where its encoder says, for the recording has no commanded angle that it follows")
    if "force" not in signals:
        raw.note("no force was recorded: the tip is taken to be free")
    raw.finite()
    raw.clock()
    for tendon in TENDONS:
        column = f"tension_{tendon}"
        raw.saturated(column)
        raw.outliers(column, _JUMP * max(float(np.ptp(raw.columns[column])), 1.0))
    raw.gaps()
    raw.enough()
    raw.excited("handle_angle", _LEAST_EXCITATION, "rad")
    done = raw.done(checksum=checksum(path))
    return InstrumentRun(done.name, done.time, done.columns, done.notes, None, done.checksum, inst)


def _columns(signals: dict[str, Array], handle: str, axes: int) -> dict[str, Array]:
    def first(name: str) -> Array:
        return signals[name][:, 0] if axes > 1 else signals[name]

    columns = {"handle_angle": first(handle)}
    for name in ("measured_handle_angle", "measured_output_angle", "force"):
        if name in signals and np.isfinite(signals[name]).any():
            columns[name] = first(name)
    for name, column in (("measured_tension", "tension"), ("measured_spool_angle", "spool")):
        if name in signals:
            columns |= {f"{column}_{tendon}": first(name)[:, n] for n, tendon in enumerate(TENDONS)}
    return columns


def _instrument(recording: Recording) -> Instrument | None:
    try:
        inst = recording.instrument()
    except (InstrumentError, RecordingError):
        return None
    return inst.axis(inst.axes[0]) if inst.axes[1:] else inst
