"""Recordings of commanded and measured joint angles without tensions, of any instrument: tables and MCAP files.

A heading names what it is and its joint, in any order: ``setpoint_js.yaw [rad]``, ``yaw_measured [deg]``,
``measured_output_angle.yaw [rad]``. Angles without a unit are in rad.
"""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tenodesis.errors import IdentificationError
from tenodesis.identification.formats.csv import as_identification, read_table, scale_of
from tenodesis.identification.formats.mcap import first_rows
from tenodesis.identification.formats.measured import MeasuredRun, spread_of
from tenodesis.identification.kinematic.model import COMMAND, EFFORT, LAWS, MEASURED, Kinematic, recorded
from tenodesis.identification.registry import Format
from tenodesis.instrument import ShortForm
from tenodesis.recording import lab_map, lab_tables
from tenodesis.recording.blocks import Progress
from tenodesis.run import Array, Run

_WORDS = {
    EFFORT: {"effort", "torque", "current"},
    COMMAND: {"commanded", "command", "cmd", "desired", "setpoint", "goal", "reference", "target", "handle"},
    MEASURED: {"measured", "actual", "encoder", "tracked", "camera"},
}
"""Words of a heading by what they say, the first that is found counts."""
_BESIDE = {"angle", "joint", "jp", "js", "position", "q", "output", "state", "motor", "drive"}
"""Words that say neither what it is nor the joint."""
_OTHERS = {"force", "tension", "velocity", "spool", "estimated", "torsion", "contact", "std"}
_USED = ("commanded_handle_angle", "measured_handle_angle", "measured_output_angle")
"""Signals that are read of a recording."""
_MOST = 4 * np.pi
"""Spread of a joint's angle from which it is in degrees, rad: rolls turn by up to three quarters of a turn each way."""
_CLOCKS = ("time", "t", "stamp", "timestamp")


def load(path: Path, progress: Progress | None = None) -> MeasuredRun:
    """Return a recording of joints; raises IdentificationError if it cannot be read, or has no joint with both."""
    if lab_tables.is_table(path):
        return _of_table(path)
    with as_identification():
        recording, notes = first_rows(path, _USED, progress)
    return of_run(recording.run, name=path.name, notes=notes)


def of_run(run: Run, *, name: str = "run", notes: Sequence[str] = ()) -> MeasuredRun:
    """Return a run's angles of the handle, commanded if known, and the measured ones of its tip; raises as `load`."""
    signals = run.signals()
    handle = "commanded_handle_angle" if "commanded_handle_angle" in signals else "measured_handle_angle"
    of_tip = [one.removeprefix("handle_") for one in run.handle_joints]
    angles = [
        dict(zip(joints, run.by_column(signal).T, strict=True)) if signal in signals else {}
        for signal, joints in ((handle, of_tip), ("measured_output_angle", run.joints))
    ]
    return recorded(run.time, *angles, name=name, notes=notes)


def _of_table(path: Path) -> MeasuredRun:
    table = read_table(path)
    groups: dict[str, dict[str, Array]] = {COMMAND: {}, MEASURED: {}, EFFORT: {}}
    encoders: dict[str, Array] = {}
    clock: Array | None = None
    notes: list[str] = []
    for at, text in enumerate(table.headings):
        name, unit = lab_map.heading(text)
        if clock is None and name.lower() in _CLOCKS:
            clock = table.column(at) * scale_of(unit or "s", "s", f"{path.name}: the unit of {name}")
            continue
        kind, joint = _meaning(name)
        values = table.column(at)
        if joint in _CLOCKS:
            raise IdentificationError(
                f"{path.name} has a second clock, {name}; commands and angles must be at the times of one.",
                key="time",
                value=name,
            )
        if kind is None or not joint or not np.isfinite(values).any():
            continue
        if kind != EFFORT:
            values = values * _scale(values, unit, name, path.name, notes)
        is_encoder = kind == COMMAND and "commanded" not in name.lower() and "handle" in name.lower()
        (encoders if is_encoder else groups[kind]).setdefault(joint, values)
    if clock is None:
        raise IdentificationError(
            f"{path.name} has no column of the time; its headings are {', '.join(map(repr, table.headings))}.",
            key="time",
            allowed=f"a heading of {', '.join(_CLOCKS)}, with its unit in brackets",
        )
    notes += [f"{joint}: the command is the angle of the handle" for joint in encoders if joint not in groups[COMMAND]]
    return recorded(
        clock,
        encoders | groups[COMMAND],
        groups[MEASURED],
        effort=groups[EFFORT],
        name=path.name,
        notes=notes,
    )


def _scale(values: Array, unit: str | None, name: str, file: str, notes: list[str]) -> float:
    """Return the factor from an angle's unit to rad; that of degrees, and a note, where it moves too far for rad."""
    scale = scale_of(unit or "rad", "rad", f"{file}: the unit of {name}")
    turned = scale * spread_of(values[np.isfinite(values)])
    if scale != 1 or turned < _MOST:
        return scale
    notes.append(f"{name} taken as deg, not {unit or 'rad, which it is without a unit'}: it moves by {turned:.4g}")
    return float(np.radians(1))


def _meaning(heading: str) -> tuple[str | None, str]:
    """Return what a heading says that a column is, None if nothing, and the joint."""
    words = [word for word in re.split(r"[^a-z0-9]+", heading.lower()) if word]
    # a joint's number belongs to its name: jaw_1
    if set(words) & _OTHERS or {"handle", "torque"} <= set(words):
        return None, ""
    said = [kind for kind, known in _WORDS.items() if set(words) & known]
    known = set().union(*_WORDS.values()) | _BESIDE
    return (said[0] if said else None), "_".join(word for word in words if word not in known)


def problem(
    train: Sequence[MeasuredRun], test: Sequence[MeasuredRun], *, law: str, instrument: ShortForm | None
) -> Kinematic:
    """Return the model with its recordings, those of train first; raises as `Kinematic`."""
    return Kinematic(train, test, law=law)


FORMAT = Format(load, problem, LAWS, LAWS[0], shows_progress=True)
