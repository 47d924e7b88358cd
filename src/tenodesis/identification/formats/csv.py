"""Recordings of an instrument as CSV: headings as ``tenodesis export recording`` writes them, or a map beside the file.

The map of ``run.csv`` is ``run.csv.columns.toml``, with one table per column of :data:`COLUMNS` and one for the time::

    time = { column = "t", unit = "ms" }
    handle_angle = { column = "theta_h", unit = "deg", factor = -1 }
    tension_agonist = { column = "F1", unit = "N" }
"""

import csv
import re
import tomllib
from collections.abc import Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pint

from tenodesis.errors import IdentificationError
from tenodesis.identification.formats.instrument_run import COLUMNS, TENDONS, InstrumentRun, checked
from tenodesis.identification.formats.measured import Raw, Unit, checksum
from tenodesis.quantity import in_unit
from tenodesis.signals import Array

MAP_SUFFIX = ".columns.toml"

_TIME = "time"
_UNITS = {_TIME: "s"} | COLUMNS
_HEADING = re.compile(r"\s*(?P<name>[^\[\]]*?)\s*(?:\[\s*(?P<unit>[^\]]*?)\s*\])?\s*")
_SIGNALS = {
    "commanded_handle_angle": "handle_angle",
    **{name: name for name in ("measured_handle_angle", "measured_output_angle", "force", "radial_force")},
    **{f"measured_tension.{tendon}": f"tension_{tendon}" for tendon in TENDONS},
    **{f"measured_spool_angle.{tendon}": f"spool_{tendon}" for tendon in TENDONS},
}
"""Columns by signal of an export, the axis left out."""
_PLAUSIBLE = {
    # Handles and tips turn by some degrees to half a turn, tendons bear some tenths of a newton to some hundred.
    "rad": (Unit("rad", 1.0, 0.03, 2.0), Unit("deg", float(np.pi / 180), 4.0, 200.0)),
    "N": (Unit("N", 1.0, 0.05, 1e3), Unit("mN", 1e-3, 2e3, 1e6)),
}
_CHECKED = ("handle_angle", "measured_handle_angle", "measured_output_angle", "tension_agonist", "tension_antagonist")


class _Place(NamedTuple):
    """Where a column stands in the file, and how many SI units one of its numbers is."""

    at: int
    scale: float


def load(path: Path) -> InstrumentRun:
    """Return a recording from a CSV file, by its headings or by the map beside it.

    Separators are commas, semicolons or tabs, with a decimal comma if they are no commas. An empty cell is a missing
    value. Columns and what becomes of them are those of InstrumentRun.

    Raises
    ------
    IdentificationError
        The file or its map cannot be read, lacks what is needed, or is not usable.
    """
    separator, headings, rows = _read(path)
    beside = path.with_name(path.name + MAP_SUFFIX)
    notes: list[str] = []
    if beside.exists():
        places = _mapped(beside, headings)
        notes.append(f"columns by {beside.name}")
    else:
        places = _recognised(path, headings, notes)
    if "handle_angle" not in places and "measured_handle_angle" in places:
        places["handle_angle"] = places["measured_handle_angle"]
        notes.append("the handle is where its encoder says, for no commanded angle was recorded")
    needed = (_TIME, "handle_angle", *(f"tension_{tendon}" for tendon in TENDONS))
    lacking = [name for name in needed if name not in places]
    if lacking:
        raise IdentificationError(
            f"{path} lacks {', '.join(lacking)}: its headings are {', '.join(map(repr, headings))}; allowed are those "
            f"of tenodesis export recording, or a map {beside.name}."
        )
    table = {
        name: place.scale * np.array([_number(row, place.at, separator) for row in rows])
        for name, place in places.items()
    }
    time = table.pop(_TIME)
    # a column without a number was not recorded
    columns = {name: values for name, values in table.items() if name in needed or np.isfinite(values).any()}
    return checked(path.name, time, _in_si(path, time, columns, notes), notes=notes, checksum=checksum(path))


def _read(path: Path) -> tuple[str, list[str], list[list[str]]]:
    try:
        lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    except OSError as problem:
        raise IdentificationError(f"{path} cannot be read: {problem.strerror}.") from None
    lines = [line for line in lines if line.strip() and not line.startswith(("#", "%"))]
    if not lines:
        raise IdentificationError(f"{path} is empty; allowed is a line of headings and rows of numbers.")
    separator = max(",;\t", key=lines[0].count)
    headings, *rows = csv.reader(lines, delimiter=separator)
    return separator, [heading.strip() for heading in headings], rows


def _number(row: Sequence[str], at: int, separator: str) -> float:
    """Return a cell's number, NaN where there is none."""
    text = row[at] if at < len(row) else ""
    try:
        return float(text if separator == "," else text.replace(",", "."))
    except ValueError:
        return float("nan")


def _recognised(path: Path, headings: Sequence[str], notes: list[str]) -> dict[str, _Place]:
    """Return the columns that headings tell: those of an export, of its first axis, or the columns' own names."""
    places: dict[str, _Place] = {}
    axes: dict[str, None] = {}
    for at, heading in enumerate(headings):
        found = _HEADING.fullmatch(heading)
        name, unit = (found["name"], found["unit"]) if found else (heading, None)
        column = name if name in _UNITS else _SIGNALS.get(name)
        if column is None and "." in name:
            signal, axis, *tendon = name.split(".")
            column = _SIGNALS.get(".".join([signal, *tendon]))
            if column is not None:
                axes.setdefault(axis)
        if column is not None and column not in places:
            places[column] = _Place(at, _scale(unit or _UNITS[column], column, str(path)))
    if len(axes) > 1:
        notes.append(f"of the axes {' and '.join(axes)} the first is taken")
    return places


def _mapped(path: Path, headings: Sequence[str]) -> dict[str, _Place]:
    """Return the columns that a map names."""
    try:
        given = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as problem:
        raise IdentificationError(f"{path} cannot be read: {problem.strerror}.") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as problem:
        raise IdentificationError(f"{path} is no TOML: {problem}.") from None
    places = {}
    for name, entry in given.items():
        where = f"{path}: {name}"
        if name not in _UNITS:
            raise IdentificationError(f"{where} is no column; allowed are {', '.join(_UNITS)}.")
        keys = {"column", "unit", "factor"}
        if not isinstance(entry, Mapping) or not {"column", "unit"} <= set(entry) <= keys:
            raise IdentificationError(
                f'{where} is {entry!r}; allowed is a table like {{ column = "t", unit = "{_UNITS[name]}" }}, with a '
                "factor if wanted."
            )
        if entry["column"] not in headings:
            raise IdentificationError(
                f"{where}.column is {entry['column']!r}; allowed are {', '.join(map(repr, headings))}."
            )
        factor = entry.get("factor", 1)
        if isinstance(factor, bool) or not isinstance(factor, int | float) or not isfinite(factor) or not factor:
            raise IdentificationError(f"{where}.factor is {factor!r}; allowed is a finite number other than 0.")
        places[name] = _Place(headings.index(entry["column"]), factor * _scale(str(entry["unit"]), name, str(path)))
    return places


def _scale(unit: str, column: str, place: str) -> float:
    """Return how many SI units of a column one of these units is."""
    try:
        return in_unit(_UNITS[column], unit)
    # pint raises whatever its tokenizer does
    except (pint.PintError, ValueError, TypeError, AttributeError, KeyError, SyntaxError, AssertionError):
        raise IdentificationError(
            f"{place}: the unit of {column} is {unit!r}; allowed is a unit of the dimension of {_UNITS[column]}."
        ) from None


def _in_si(path: Path, time: Array, columns: dict[str, Array], notes: list[str]) -> dict[str, Array]:
    """Return columns with those in another unit than is said, by their magnitude, brought to SI."""
    for name in _CHECKED:
        known = np.isfinite(columns.get(name, np.empty(0)))
        # a tip or a tendon that hardly moves is judged as what it is said to be
        units = _PLAUSIBLE[_UNITS[name]]
        if known.any() and np.ptp(np.quantile(columns[name][known], [0.05, 0.95])) > units[0].most:
            raw = Raw(path.name, time[known], {name: columns[name][known]})
            unit = raw.unit(name, units)
            columns[name] = columns[name] * next(one.scale for one in units if one.name == unit)
            notes += raw.notes
    return columns
