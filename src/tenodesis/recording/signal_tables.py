"""Tables of instruments of joints and tendons: columns by signal and name, ``measured_tension.pitch_wound [N]``.

Names are those of an export, also of planar axes (``measured_tension.yaw.agonist [N]``), or of a map beside the file,
which ``tenodesis map FILE --instrument NAME`` writes.
"""

import re
from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np

from tenodesis.errors import RecordingError
from tenodesis.instrument import FullForm
from tenodesis.recording import lab_map
from tenodesis.recording.lab_guess import Guess, clean
from tenodesis.recording.lab_tables import LabTable
from tenodesis.run import ACROSS, SIGNALS, TENDONS, Array, Names
from tenodesis.toml import parse_toml, read_text

POSE = {"measured_position": "m", "measured_direction": "1"}
"""Of the tip, in the stem's axes from the stem's end, as a camera sees it: components x, y, z."""
GRIP = ("applied_grip_force", "grip_force")
"""What presses the jaws apart, as it is applied and as what they hold does; the sum turns joints."""
_READ = (
    *("commanded_handle_angle", "measured_handle_angle", "commanded_spool_velocity", "measured_spool_angle"),
    *("measured_tension", "measured_output_angle", "wrench", *GRIP),
)
SIGNS = "a spool's positive angle and velocity wind up its tendon, and joints bend as the instrument's axes say;"
_TENDON_WORDS, _HANDLE_WORDS = {"spool", "motor", "winch", "disk", "drive"}, {"handle", "master", "command", "setpoint"}


def unit_of(column: str) -> str | None:
    """Return the SI unit of a column by its name, None if it is no signal that is read."""
    signal, _, name = column.partition(".")
    if signal == "wrench":
        return "N" if name.startswith("f") else "N*m"
    return POSE.get(signal) or (SIGNALS[signal].unit if signal in _READ else None)


def read(path: Path) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Return the columns of a table in SI by name, and notes; raises RecordingError if file or map cannot be read."""
    table = lab_map.numbers_in(path)
    beside = lab_map.map_beside(path)
    places: dict[str, list[lab_map.SourceColumn]] = {}
    notes: tuple[str, ...] = ()
    if beside is not None:
        text = read_text(beside, RecordingError)
        given = parse_toml(text, RecordingError, str(beside))
        units = lab_map.UNITS | {name: unit for name in given if (unit := unit_of(name))}
        places, notes = lab_map.mapped(text, str(beside), table.headings, units), (f"columns by {beside.name}",)
    else:
        planar = _of_planar(table)
        for at, text in enumerate(table.headings):
            heading, unit = lab_map.heading(text)
            name, factor = planar.get(heading, (heading, 1))
            si = lab_map.UNITS[lab_map.TIME] if name == lab_map.TIME else unit_of(name)
            if si is not None:
                scale = lab_map.scale_of(unit or si, si, f"{path}: the unit of {heading}")
                places[name] = [lab_map.SourceColumn(at, unit or si, factor * scale)]
    found = lab_map.Mapped(table, places, notes, "")
    return {name: found.values(name) for name in places}, notes


def gripped(columns: Mapping[str, Array]) -> dict[str, Array]:
    """Return columns with all that presses the jaws apart as grip_force, if any of it is there."""
    parts = [columns[name] for name in GRIP if name in columns]
    return {**columns, GRIP[1]: np.sum(parts, axis=0)} if parts else {**columns}


def guess(table: LabTable, inst: FullForm) -> dict[str, Guess]:
    """Return what each column of an instrument most likely is: by units, then by tendons, joints or numbers named."""
    found: dict[str, Guess] = {}
    tendons, joints, handle = (
        [one.name for one in many] for many in (inst.tendons, inst.as_given("joints"), inst.handle_joints)
    )
    joints = [name for name in joints if name not in handle]
    planar, parts_of = _of_planar(table), [clean(text) for text in table.headings]
    is_export = any(unit_of(name) for name, _ in parts_of)
    for text, (given, unit) in zip(table.headings, parts_of, strict=True):
        name, factor = planar.get(given, (given, 1))
        words = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
        parts = set(words.split("_"))
        if unit_of(name) is not None:
            column: str | None = name
        elif is_export and name.partition(".")[0] in SIGNALS:
            column = None  # the simulation's truth is no measurement
        elif words in {"time", "t", "timestamp", "seconds"}:
            column = lab_map.TIME
        elif unit in {"N", "mN", "gf", "kgf", "lbf"}:
            column = (
                f"wrench.{words[-2:]}" if words[-2:] in {"fx", "fy", "fz"} else _of("measured_tension", words, tendons)
            )
        elif unit in {"rad/s", "deg/s", "rpm"}:
            column = _of("commanded_spool_velocity", words, tendons)
        elif unit in {"rad", "mrad", "deg", "°"}:
            if parts & _TENDON_WORDS or any(one in words for one in tendons):
                column = _of("measured_spool_angle", words, tendons)
            elif handle and parts & _HANDLE_WORDS:
                column = _of("commanded_handle_angle", words, handle)
            else:
                column = _of("measured_output_angle", words, joints)
        else:
            column = None
        if column is not None and column not in found:
            found[column] = Guess((text,), (unit or unit_of(column) or "s",), factor)
    return found


def lacking(inst: FullForm, guesses: Collection[str]) -> list[str]:
    """Return the columns that an identification of an instrument needs and no heading was taken for."""
    needed = [lab_map.TIME, *(f"commanded_handle_angle.{one.name}" for one in inst.handle_joints)]
    if not inst.handle_joints:
        needed += [f"measured_spool_angle.{one.name}" for one in inst.tendons]
    moved = {f"commanded_spool_velocity.{one.name}" for one in inst.tendons} <= {*guesses}
    return [one for one in needed if one not in guesses and not (moved and one.startswith("measured_spool"))]


def units(guesses: Mapping[str, Guess]) -> dict[str, str]:
    """Return the SI unit of each column that was found."""
    return {name: unit_of(name) or lab_map.UNITS[lab_map.TIME] for name in guesses}


def _of_planar(table: LabTable) -> dict[str, tuple[str, int]]:
    """Return column and factor by name of an export of planar axes, whose forces oppose flexion."""
    parts = [lab_map.heading(text).name.split(".") for text in table.headings]
    names = Names.paired([*dict.fromkeys(one[1] for one in parts if one[2:] and one[2] in TENDONS)])
    found = {
        heading: (f"{signal}.{column}", 1)
        for signal in _READ
        for heading, column in zip(names.headings(signal), names.columns(signal), strict=False)
    }
    found |= {f"force.{axis}": (f"wrench.{ACROSS[axis]}", -1) for axis in names.joints if axis in ACROSS}
    return found | {f"radial_force.{axis}": ("wrench.fz", 1) for axis in names.joints[:1]}


def _of(signal: str, words: str, names: list[str]) -> str | None:
    """Return a signal's column by the longest name within the words, or by a number at their end, from 1."""
    within = max((one for one in names if one.lower() in words), key=len, default=None)
    if within is None and (number := re.search(r"(\d+)$", words)) and 0 < int(number[1]) <= len(names):
        within = names[int(number[1]) - 1]
    return None if within is None else f"{signal}.{within}"
