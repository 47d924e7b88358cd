"""Tip poses as CSV, with headings such as ``tension.left [N]``, or a map beside the file as of recordings.

Columns: ``x``, ``y``, ``z`` (m); of the direction one of ``qw``, ``qx``, ``qy``, ``qz``, of ``rx``, ``ry``, ``rz`` (a
rotation vector, rad), of ``angle`` (rad), or nothing; of what acts ``tension.TENDON`` (N) or ``stroke.TENDON`` (m) of
all tendons, ``handle_angle.JOINT`` (rad) of all joints of the handle, ``fx`` to ``fz`` (N), ``mx`` to ``mz`` (N m), and
``grip_force`` (N). What is left out is zero. A heading without a unit is in the SI unit.
"""

from collections.abc import Mapping
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tenodesis.errors import IdentificationError, RecordingError
from tenodesis.identification.formats import csv
from tenodesis.instrument import FullForm
from tenodesis.recording import lab_map, lab_tables
from tenodesis.recording.lab_tables import LabTable
from tenodesis.run import COMPONENTS, Array
from tenodesis.toml import read_text

_POSITION = ("x", "y", "z")
_DIRECTIONS = {"quaternion": ("qw", "qx", "qy", "qz"), "rotation": ("rx", "ry", "rz"), "angle": ("angle",)}
_UNIT_LENGTH = 1e-3
"""By how much the length of a quaternion may differ from one."""


class ReferencePoses(NamedTuple):
    """What acts on an instrument and where its tip is by another solver, a row each; SI."""

    name: str
    position: Array
    """Of the tip from the stem's end, in the stem's axes, (n, 3), m"""
    quaternion: Array | None = None
    """Of the tip, w, x, y, z, (n, 4)"""
    angle: Array | None = None
    """From the stem's axis to the tip's, (n,), rad: signed where the instrument bends in one plane"""
    tensions: Array | None = None
    """(n, tendons), N"""
    strokes: Array | None = None
    """(n, tendons), m"""
    handle_angles: Array | None = None
    """(n, handle joints), rad"""
    wrench: Array | None = None
    """(n, 6), N and N m"""
    grip_force: Array | None = None
    """(n,), N"""

    @property
    def driven(self) -> str:
        """What is given of the tendons: tension, stroke, or nothing."""
        return "tension" if self.tensions is not None else "stroke" if self.strokes is not None else ""


def load(path: Path | str, inst: FullForm) -> ReferencePoses:
    """Return the poses of a file.

    Parameters
    ----------
    path
        A CSV file, see above.
    inst
        The instrument whose tendons and joints the columns are named after.

    Raises
    ------
    IdentificationError
        The file or its map cannot be read, lacks a column, or has a cell that is no number.
    """
    path = Path(path)
    groups = _groups(inst)
    units = {name: unit for columns in groups.values() for name, unit in columns.items()}
    table = csv.read_table(path)
    beside = lab_map.map_beside(path)
    with csv.as_identification():
        if beside is None:
            places = _recognised(path, table.headings, units)
        else:
            places = lab_map.mapped(read_text(beside, RecordingError), str(beside), table.headings, units)
    given = {key: _complete(path, key, columns, places) for key, columns in groups.items()}
    if not given["position"]:
        raise _lacking(path, "position", _POSITION, places)
    for either, other in (("tension", "stroke"), *combinations(_DIRECTIONS, 2)):
        if given[either] and given[other]:
            raise IdentificationError(
                f"{path} has columns of {either} and of {other}; it must have one of both.", key=either, value=other
            )
    count = table.columns[0].size
    if not count:
        raise IdentificationError(f"{path} has no row; it must have a row for each pose.", key="rows", value=0)
    values = {key: _numbers(path, table, columns, places) for key, columns in groups.items() if given[key]}
    wrench = values.get("force")
    if "moment" in values:
        wrench = np.hstack([np.zeros((count, 3)) if wrench is None else wrench, values["moment"]])
    elif wrench is not None:
        wrench = np.hstack([wrench, np.zeros_like(wrench)])
    negative = np.argwhere(values.get("tension", np.zeros((1, 1))) < 0)
    if negative.size:
        row, column = negative[0]
        raise IdentificationError(
            key=f"{path}: row {row + 1}: {list(groups['tension'])[column]}",
            value=float(values["tension"][row, column]),
            allowed="at least 0 N, for a tendon cannot push",
        )
    return ReferencePoses(
        path.name,
        values["position"],
        _turns(path, values),
        values["angle"][:, 0] if "angle" in values else None,
        values.get("tension"),
        values.get("stroke"),
        values.get("handle_angle"),
        wrench,
        values["grip_force"][:, 0] if "grip_force" in values else None,
    )


def _groups(inst: FullForm) -> dict[str, dict[str, str]]:
    """Return the columns that belong together, with their SI units."""
    return {
        "position": dict.fromkeys(_POSITION, "m"),
        "quaternion": dict.fromkeys(_DIRECTIONS["quaternion"], "1"),
        "rotation": dict.fromkeys(_DIRECTIONS["rotation"], "rad"),
        "angle": {"angle": "rad"},
        "tension": {f"tension.{tendon.name}": "N" for tendon in inst.tendons},
        "stroke": {f"stroke.{tendon.name}": "m" for tendon in inst.tendons},
        "handle_angle": {f"handle_angle.{joint.name}": "rad" for joint in inst.handle_joints},
        "force": dict.fromkeys(COMPONENTS[:3], "N"),
        "moment": dict.fromkeys(COMPONENTS[3:], "N*m"),
        "grip_force": {"grip_force": "N"} if inst.grip is not None else {},
    }


def _recognised(path: Path, headings: list[str], units: Mapping[str, str]) -> dict[str, list[lab_map.SourceColumn]]:
    """Return the columns that headings name.

    Raises IdentificationError for a tendon or joint that the instrument has not.
    """
    places: dict[str, list[lab_map.SourceColumn]] = {}
    for at, text in enumerate(headings):
        name, unit = lab_map.heading(text)
        if name in units:
            if name in places:
                raise IdentificationError(f"{path} has two columns {name}; it must have one.", key=name, value=text)
            unit = unit or units[name]
            scale = lab_map.scale_of(unit, units[name], f"{path}: the unit of {name}")
            places[name] = [lab_map.SourceColumn(at, unit, scale)]
            continue
        kind, dot, _ = name.partition(".")
        own = [one for one in units if one.startswith(f"{kind}.")]
        if dot and kind in {"tension", "stroke", "handle_angle"}:
            allowed = f"one of {', '.join(own)}" if own else "left out, for the instrument has no joints at the handle"
            raise IdentificationError(key=f"{path}: a heading", value=name, allowed=allowed)
    return places


def _complete(
    path: Path, key: str, columns: Mapping[str, str], places: Mapping[str, list[lab_map.SourceColumn]]
) -> bool:
    """Return whether a file has columns that belong together, which must be all or none."""
    there = [name for name in columns if name in places]
    if there and len(there) < len(columns):
        raise _lacking(path, key, [name for name in columns if name not in places], places)
    return bool(there)


def _lacking(
    path: Path, key: str, names: object, places: Mapping[str, list[lab_map.SourceColumn]]
) -> IdentificationError:
    lacking = ", ".join(map(str, names))  # type: ignore[call-overload]
    return IdentificationError(
        f"{path} lacks {lacking} of the {key}; it must have all, by headings such as 'x [mm]' or by a map "
        f"{path.name}{lab_tables.MAP_SUFFIX} (found: {', '.join(places) or 'none'}).",
        key=key,
        value=lacking,
    )


def _numbers(
    path: Path, table: LabTable, columns: Mapping[str, str], places: Mapping[str, list[lab_map.SourceColumn]]
) -> Array:
    """Return columns in SI, (n, columns); raises IdentificationError for a cell that is no finite number."""
    found = np.stack([sum(part.scale * table.column(part.at) for part in places[name]) for name in columns], axis=1)
    wrong = np.argwhere(~np.isfinite(found))
    if wrong.size:
        row, name = int(wrong[0, 0]), list(columns)[wrong[0, 1]]
        raise IdentificationError(
            key=f"{path}: row {row + 1}: {name}", value=float(found[row, wrong[0, 1]]), allowed="a finite number"
        )
    return found


def _turns(path: Path, values: Mapping[str, Array]) -> Array | None:
    """Return unit quaternions of what a file gives of directions, (n, 4)."""
    if "rotation" in values:
        vector = values["rotation"]
        turn = np.linalg.norm(vector, axis=1, keepdims=True)
        return np.hstack([np.cos(turn / 2), vector * np.sinc(turn / (2 * np.pi)) / 2])
    if "quaternion" not in values:
        return None
    lengths = np.linalg.norm(values["quaternion"], axis=1)
    if (off := np.abs(lengths - 1)).max() > _UNIT_LENGTH:
        worst = int(off.argmax())
        raise IdentificationError(
            f"{path}: row {worst + 1}: the quaternion has length {lengths[worst]:.4g}; it must be 1.",
            key="quaternion",
            value=float(lengths[worst]),
            allowed="of length 1",
        )
    return np.asarray(values["quaternion"] / lengths[:, np.newaxis])
