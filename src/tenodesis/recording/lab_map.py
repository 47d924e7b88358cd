"""Which columns of a laboratory's table are which signals: by their headings, or by a map beside the file.

The map of ``run.lvm`` is ``run.lvm.columns.toml``, or else ``columns.toml``, for all files of the folder that have none
of their own. It has one table per column of :data:`COLUMNS` and one for the time::

    time = { column = ["sec", "nanosec"], unit = ["s", "ns"] }
    handle_angle = { column = "theta_h", unit = "deg", factor = -1 }
    tension_agonist = { column = "F1", unit = "N" }

Of several columns the sum is taken. ``tenodesis map`` writes one.
"""

import re
from collections.abc import Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tenodesis.errors import RecordingError
from tenodesis.recording.lab_tables import MAP_SUFFIX, LabTable, read_table
from tenodesis.run import TENDONS, Array, Names, Run
from tenodesis.toml import parse_toml, read_text
from tenodesis.units import in_unit

COLUMNS = {
    "handle_angle": "rad",
    "measured_handle_angle": "rad",
    "measured_output_angle": "rad",
    "tension_agonist": "N",
    "tension_antagonist": "N",
    "force": "N",
    "radial_force": "N",
    "spool_agonist": "rad",
    "spool_antagonist": "rad",
}
"""Every column that an axis may have, with its SI unit."""
TIME = "time"
UNITS = {TIME: "s"} | COLUMNS
_LEAST_ROWS = 0.5
"""Share of the rows that have a number, below which a text is no table."""
SHARED_MAP = "columns.toml"

_SIGNALS = {
    "commanded_handle_angle": "handle_angle",
    **{name: name for name in ("measured_handle_angle", "measured_output_angle", "force", "radial_force")},
    **{f"measured_tension.{tendon}": f"tension_{tendon}" for tendon in TENDONS},
    **{f"measured_spool_angle.{tendon}": f"spool_{tendon}" for tendon in TENDONS},
}
"""Columns by signal of an export, the axis left out."""
_HEADING = re.compile(r"\s*(?P<name>[^\[\]]*?)\s*(?:\[\s*(?P<unit>[^\]]*?)\s*\])?\s*")


class ColumnHeading(NamedTuple):
    """A heading such as ``force [mN]``: the name before the brackets, and the unit within them if present."""

    name: str
    unit: str | None


class SourceColumn(NamedTuple):
    """A column of the table, its stated unit, and the factor from its numbers to SI."""

    at: int
    unit: str
    scale: float


class Mapped(NamedTuple):
    """A table with what its columns are: of each of :data:`COLUMNS` the parts whose sum it is."""

    table: LabTable
    places: dict[str, list[SourceColumn]]
    notes: tuple[str, ...]
    axis: str

    def values(self, name: str) -> Array:
        """Return a column in SI, (n,); the time of several parts from its first row on, which keeps its digits."""
        parts = self.places[name]
        columns = [self.table.column(part.at) for part in parts]
        if name == TIME and parts[1:]:
            columns = [column - column[:1] for column in columns]
        return np.asarray(sum(part.scale * column for part, column in zip(parts, columns, strict=True)), np.float64)


def read(path: Path) -> Mapped:
    """Return the table in a file, its columns by the map beside it if there is one, or else by their headings.

    Raises RecordingError if file or map cannot be read, or if the map is wrong.
    """
    table = numbers_in(path)
    beside = map_beside(path)
    if beside is not None:
        return by_map(table, read_text(beside, RecordingError), str(beside))
    places, axes = recognised(str(path), table.headings)
    notes = [f"of the axes {' and '.join(axes)} the first is taken"] if axes[1:] else []
    return Mapped(table, places, tuple(notes), axes[0] if axes else "yaw")


def numbers_in(path: Path) -> LabTable:
    """Return the table in a file; raises RecordingError if that cannot be read, or holds no rows of numbers."""
    table = read_table(path)
    known = np.logical_or.reduce([np.isfinite(column) for column in table.columns])
    if not known.size and table.headings[1:]:
        raise RecordingError(f"{path} holds headings, and no row below them.", key="path", value=path)
    if not known.size or known.mean() < _LEAST_ROWS:
        raise RecordingError(
            f"{path} is no MCAP file: it begins with {table.headings[0][:8]!r}, and holds no rows of numbers.",
            key="path",
            value=path,
            allowed="a recording: an MCAP file, or a table of numbers under headings",
        )
    return table


def by_map(table: LabTable, text: str, source: str) -> Mapped:
    """Return a table with its columns by the text of a map, named `source`; raises RecordingError if it is wrong."""
    return Mapped(table, mapped(text, source, table.headings, UNITS), (f"columns by {Path(source).name}",), "yaw")


def map_beside(path: Path) -> Path | None:
    """Return the map of a file: its own, or that of its folder."""
    found = (path.with_name(path.name + MAP_SUFFIX), path.with_name(SHARED_MAP))
    return next((one for one in found if one.exists()), None)


def explained(path: Path) -> str:
    """Return what columns must be, as the end of a sentence."""
    if (beside := map_beside(path)) is not None:
        return f"the map beside it, {beside}, must name a column for each"
    return (
        f"they must be those of tenodesis export recording, or be explained by a map {path.name}{MAP_SUFFIX}, which "
        f"tenodesis map {path} writes, or {SHARED_MAP} for all files of the folder"
    )


def run_of(mapped: Mapped) -> Run:
    """Return the run of one axis, without what has no number; its time counts rows where no column is the time."""
    rows = mapped.table.columns[0].size
    time = mapped.values(TIME) if TIME in mapped.places else np.arange(rows, dtype=np.float64)
    names = Names.paired([mapped.axis])
    signals: dict[str, Any] = {}
    for signal, column in _SIGNALS.items():
        name, _, tendon = signal.partition(".")
        if column not in mapped.places:
            continue
        values = mapped.values(column)
        if tendon:
            both = signals.setdefault(name, np.full((rows, 2), np.nan))
            both[:, TENDONS.index(tendon)] = values
        elif np.isfinite(values).any():
            signals[name] = values
    return Run(time, *names, **signals)


def heading(text: str) -> ColumnHeading:
    """Return a heading's parts."""
    found = _HEADING.fullmatch(text)
    return ColumnHeading(found["name"], found["unit"]) if found else ColumnHeading(text, None)


def scale_of(unit: str, si_unit: str, what: str) -> float:
    """Return the factor from a unit to an SI unit.

    Raises RecordingError if the unit is unknown or of another dimension; `what` names the place and the column.
    """
    try:
        return in_unit(si_unit, unit)
    except Exception:  # pint raises whatever its tokenizer does
        force = {"g": "gf", "kg": "kgf"}.get(unit) if si_unit == "N" else None
        hint = "" if force is None else f": {unit} is a mass, and its weight is {force}"
        raise RecordingError(key=what, value=unit, allowed=f"a unit of the dimension of {si_unit}{hint}") from None


def recognised(source: str, headings: Sequence[str]) -> tuple[dict[str, list[SourceColumn]], list[str]]:
    """Return the columns that headings name (those of an export, or the columns' own names), and the export's axes."""
    places: dict[str, list[SourceColumn]] = {}
    axes: dict[str, None] = {}
    for at, text in enumerate(headings):
        name, unit = heading(text)
        column = name if name in UNITS else _SIGNALS.get(name)
        if column is None and "." in name:
            signal, axis, *tendon = name.split(".")
            column = _SIGNALS.get(".".join([signal, *tendon]))
            if column is not None:
                axes.setdefault(axis)
        if column is not None and column not in places:
            unit = unit or UNITS[column]
            scale = scale_of(unit, UNITS[column], f"{source}: the unit of {column}")
            places[column] = [SourceColumn(at, unit, scale)]
    return places, list(axes)


def mapped(text: str, path: str, headings: Sequence[str], units: Mapping[str, str]) -> dict[str, list[SourceColumn]]:
    """Return the columns that a map names, of those that there may be, with their SI units.

    Raises RecordingError if the map names what is not there.
    """
    given = parse_toml(text, RecordingError, path)
    places = {}
    for name, entry in given.items():
        where = f"{path}: {name}"
        if name not in units:
            raise RecordingError(f"{where} is no column; it must be one of {', '.join(units)}.", key=name)
        keys = {"column", "unit", "factor"}
        if not isinstance(entry, Mapping) or not {"column", "unit"} <= set(entry) <= keys:
            raise RecordingError(
                key=where,
                value=entry,
                allowed=f'a table like {{ column = "t", unit = "{units[name]}" }}, with a factor if wanted',
            )
        columns, given_in = (one if isinstance(one, list) else [one] for one in (entry["column"], entry["unit"]))
        if len(columns) != len(given_in) or not columns:
            raise RecordingError(key=f"{where}.unit", value=entry["unit"], allowed="one unit for each column")
        for column in columns:
            if column not in headings:
                allowed = f"one of {', '.join(map(repr, headings))}"
                raise RecordingError(key=f"{where}.column", value=column, allowed=allowed)
        factor = entry.get("factor", 1)
        if isinstance(factor, bool) or not isinstance(factor, int | float) or not isfinite(factor) or not factor:
            raise RecordingError(key=f"{where}.factor", value=factor, allowed="a finite number other than 0")
        places[name] = [
            SourceColumn(
                headings.index(column),
                str(unit),
                factor * scale_of(str(unit), units[name], f"{path}: the unit of {name}"),
            )
            for column, unit in zip(columns, given_in, strict=True)
        ]
    return places
