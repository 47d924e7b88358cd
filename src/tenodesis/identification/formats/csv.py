"""Recordings of an instrument as CSV: headings as ``tenodesis export recording`` writes them, or a map beside the file.

The map of ``run.csv`` is ``run.csv.columns.toml``, or else ``columns.toml``, for all files of the folder that have none
of their own. It has one table per column of :data:`COLUMNS` and one for the time::

    time = { column = "t", unit = "ms" }
    handle_angle = { column = "theta_h", unit = "deg", factor = -1 }
    tension_agonist = { column = "F1", unit = "N" }
"""

import csv
import re
from collections.abc import Mapping, Sequence
from math import inf, isfinite, radians
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pint

from tenodesis.errors import IdentificationError
from tenodesis.files import read_regular
from tenodesis.identification.formats.instrument_run import COLUMNS, LEAST_EXCITATION, InstrumentRun, checked
from tenodesis.identification.formats.measured import GRAM_FORCE, Unit, checksum, spread_of
from tenodesis.run import TENDONS, Array
from tenodesis.toml import parse_toml, read_text
from tenodesis.units import in_unit

_LARGEST = 1_000_000_000
"""Largest file of text, bytes."""
_HEADING = re.compile(r"\s*(?P<name>[^\[\]]*?)\s*(?:\[\s*(?P<unit>[^\]]*?)\s*\])?\s*")


class Heading(NamedTuple):
    """A heading such as ``force [mN]``: the name before the brackets, and the unit within them if present."""

    name: str
    unit: str | None


class TextTable(NamedTuple):
    """Rows of text under headings."""

    headings: list[str]
    rows: list[list[str]]
    separator: str

    def column(self, at: int) -> Array:
        """Return a column's numbers, NaN where there is none; a comma is decimal unless it separates columns."""
        return np.array([self._number(row, at) for row in self.rows])

    def _number(self, row: list[str], at: int) -> float:
        text = row[at] if at < len(row) else ""
        try:
            return float(text if self.separator == "," else text.replace(",", "."))
        except ValueError:
            return np.nan


def read_table(path: Path) -> TextTable:
    """Return a text file with headings, separated by commas, semicolons or tabs; lines of # or % are left out.

    Raises IdentificationError if the file cannot be read, or is empty.
    """
    lines = [line for line in _lines(path) if not line.startswith(("#", "%"))]
    if not lines:
        raise IdentificationError(
            f"{path} is empty; it must hold a line of headings and rows of numbers.", key="path", value=path
        )
    separator = max(",;\t", key=lines[0].count)
    try:
        headings, *rows = csv.reader(lines, delimiter=separator, skipinitialspace=True)
    except csv.Error as problem:
        raise IdentificationError(f"{path} is no table of text: {problem}.", key="path", value=path) from None
    return TextTable([heading.strip() for heading in headings], rows, separator)


def heading(text: str) -> Heading:
    """Return a heading's parts."""
    found = _HEADING.fullmatch(text)
    return Heading(found["name"], found["unit"]) if found else Heading(text, None)


def scale_of(unit: str, si_unit: str, what: str) -> float:
    """Return the factor from a unit to an SI unit.

    Raises IdentificationError if the unit is unknown or of another dimension; `what` names the place and the column.
    """
    try:
        return in_unit(si_unit, unit)
    # pint raises whatever its tokenizer does
    except (pint.PintError, ValueError, TypeError, AttributeError, KeyError, SyntaxError, AssertionError):
        raise IdentificationError(key=what, value=unit, allowed=f"a unit of the dimension of {si_unit}") from None


def read_rows(
    path: Path, width: int, *, delimiter: str | None = ",", comment: str | None = "%", skip: int = 0
) -> Array:
    """Return the numbers of a text file without headings, shape (rows, width); a row that cannot be read is NaN.

    Further columns are not read. Without a delimiter white space separates columns; header lines to `skip` and lines
    that start with a comment are left out. Raises IdentificationError if the file cannot be read, or no row has enough
    columns.
    """
    lines = [line for line in _lines(path)[skip:] if not (comment and line.startswith(comment))]
    if not lines:
        raise IdentificationError(f"{path} has no row of {width} numbers", key="path", value=path)
    try:
        rows = np.loadtxt(lines, delimiter=delimiter, comments=None, usecols=range(width), ndmin=2)
    except ValueError:
        rows = np.array([_numbers(line, width, delimiter) for line in lines]).reshape(-1, width)
    if np.isnan(rows).all(axis=1).all():
        raise IdentificationError(f"{path} has no row of {width} numbers", key="path", value=path)
    return np.asarray(rows, dtype=np.float64)


def _lines(path: Path) -> list[str]:
    """Return the lines of a text file that are not blank, without a byte order mark."""
    try:
        text = read_regular(path, _LARGEST).decode("utf-8-sig", errors="replace")
    except OSError as error:
        raise IdentificationError(f"{path} cannot be read: {error.strerror}.", key="path", value=path) from None
    return [line for line in text.splitlines() if line.strip()]


def _numbers(line: str, width: int, delimiter: str | None) -> list[float]:
    try:
        found = [float(part) for part in line.split(delimiter)[:width]]
    except ValueError:
        found = []
    return found if len(found) == width else [np.nan] * width


MAP_SUFFIX = ".columns.toml"
SHARED_MAP = "columns.toml"

_TIME = "time"
_UNITS = {_TIME: "s"} | COLUMNS
_SIGNALS = {
    "commanded_handle_angle": "handle_angle",
    **{name: name for name in ("measured_handle_angle", "measured_output_angle", "force", "radial_force")},
    **{f"measured_tension.{tendon}": f"tension_{tendon}" for tendon in TENDONS},
    **{f"measured_spool_angle.{tendon}": f"spool_{tendon}" for tendon in TENDONS},
}
"""Columns by signal of an export, the axis left out."""
_MOST = {"rad": 3.9, "N": 1e3}
"""Plausible spread of a column by its SI unit: handles turn by little more than half a turn, tendons bear less."""
_UNITS_MISTAKEN = {
    "rad": (Unit("rad", 1.0, LEAST_EXCITATION, _MOST["rad"]), Unit("deg", radians(1), 4, 220)),
    "N": (
        Unit("N", 1.0, 0.05, _MOST["N"]),
        Unit("mN", 1e-3, 200, 1e6),
        Unit("gram-force", GRAM_FORCE, 2 / GRAM_FORCE, 60 / GRAM_FORCE),
    ),
}
"""Units that a column may have when its values cannot be in the stated unit."""
_CHECKED = ("handle_angle", "measured_handle_angle", "measured_output_angle", "tension_agonist", "tension_antagonist")


class CellPlace(NamedTuple):
    """Position of a column in the file, its stated unit, and the factor from its numbers to SI."""

    at: int
    unit: str
    scale: float


def load(path: Path) -> InstrumentRun:
    """Return a recording from a CSV file, by its headings or by the map beside it.

    Separators are commas, semicolons or tabs, with a decimal comma if they are no commas. An empty cell is a missing
    value. Columns and what becomes of them are those of InstrumentRun.

    Raises IdentificationError if the file or its map cannot be read, lacks what is needed, or is not usable.
    """
    read = read_table(path)
    headings = read.headings
    notes: list[str] = []
    beside = map_beside(path)
    if beside is not None:
        places = mapped(beside, headings, _UNITS)
        notes.append(f"columns by {beside.name}")
    else:
        places = _recognised(path, headings, notes)
    if "handle_angle" not in places and "measured_handle_angle" in places:
        places["handle_angle"] = places["measured_handle_angle"]
        notes.append("the handle angle is that of its encoder, for no commanded angle was recorded")
    needed = (_TIME, "handle_angle", *(f"tension_{tendon}" for tendon in TENDONS))
    lacking = [name for name in needed if name not in places]
    if lacking:
        raise IdentificationError(
            f"{path} lacks {', '.join(lacking)}: its headings are {', '.join(map(repr, headings))}; they must be those "
            f"of tenodesis export recording, or be explained by a map {path.name}{MAP_SUFFIX}, or {SHARED_MAP} for all "
            "files of the folder.",
            key="columns",
            value=lacking,
        )
    table = {name: read.column(place.at) for name, place in places.items()}
    # a column without a number was not recorded
    known = {name: values for name, values in table.items() if name in needed or np.isfinite(values).any()}
    columns = {name: _in_si(path, name, values, places[name], notes) for name, values in known.items()}
    time = columns.pop(_TIME)
    return checked(path.name, time, columns, notes=notes, checksum=checksum(path))


def _recognised(path: Path, headings: Sequence[str], notes: list[str]) -> dict[str, CellPlace]:
    """Return the columns that headings name: those of an export, of its first axis, or the columns' own names."""
    places: dict[str, CellPlace] = {}
    axes: dict[str, None] = {}
    for at, text in enumerate(headings):
        name, unit = heading(text)
        column = name if name in _UNITS else _SIGNALS.get(name)
        if column is None and "." in name:
            signal, axis, *tendon = name.split(".")
            column = _SIGNALS.get(".".join([signal, *tendon]))
            if column is not None:
                axes.setdefault(axis)
        if column is not None and column not in places:
            unit = unit or _UNITS[column]
            places[column] = CellPlace(at, unit, _scale(unit, column, str(path)))
    if len(axes) > 1:
        notes.append(f"of the axes {' and '.join(axes)} the first is taken")
    return places


def map_beside(path: Path) -> Path | None:
    """Return the map of a file's columns: its own, or that of its folder; None if there is none."""
    beside = (path.with_name(path.name + MAP_SUFFIX), path.with_name(SHARED_MAP))
    return next((one for one in beside if one.exists()), None)


def mapped(path: Path, headings: Sequence[str], units: Mapping[str, str]) -> dict[str, CellPlace]:
    """Return the columns that a map names, of those that there may be, with their SI units.

    Raises IdentificationError if the map cannot be read, or names what is not there.
    """
    given = parse_toml(read_text(path, IdentificationError), IdentificationError, str(path))
    places = {}
    for name, entry in given.items():
        where = f"{path}: {name}"
        if name not in units:
            raise IdentificationError(f"{where} is no column; it must be one of {', '.join(units)}.", key=name)
        keys = {"column", "unit", "factor"}
        if not isinstance(entry, Mapping) or not {"column", "unit"} <= set(entry) <= keys:
            raise IdentificationError(
                key=where,
                value=entry,
                allowed=f'a table like {{ column = "t", unit = "{units[name]}" }}, with a factor if wanted',
            )
        if entry["column"] not in headings:
            raise IdentificationError(
                key=f"{where}.column", value=entry["column"], allowed=f"one of {', '.join(map(repr, headings))}"
            )
        factor = entry.get("factor", 1)
        if isinstance(factor, bool) or not isinstance(factor, int | float) or not isfinite(factor) or not factor:
            raise IdentificationError(key=f"{where}.factor", value=factor, allowed="a finite number other than 0")
        unit = str(entry["unit"])
        places[name] = CellPlace(
            headings.index(entry["column"]), unit, factor * scale_of(unit, units[name], f"{path}: the unit of {name}")
        )
    return places


def _scale(unit: str, column: str, place: str) -> float:
    """Return the factor from a unit to the SI unit of a column."""
    return scale_of(unit, _UNITS[column], f"{place}: the unit of {column}")


def _in_si(path: Path, name: str, values: Array, place: CellPlace, notes: list[str]) -> Array:
    """Return a column in SI by its stated unit, or, if that is impossible, by the unit that its magnitude shows."""
    stated_values = place.scale * values
    spread = spread_of(stated_values[np.isfinite(stated_values)])
    kind = _UNITS[name]
    # a tip or a tendon that hardly moves may be in the stated unit; a handle that does not move is of no use
    small, large = name == "handle_angle" and spread < LEAST_EXCITATION, spread > _MOST.get(kind, inf)
    if name not in _CHECKED or not (small or large):
        return stated_values
    stated = _scale(place.unit, name, path.name)
    number = spread / stated
    fits = [one for one in _UNITS_MISTAKEN[kind] if one.scale != stated and one.least <= number <= one.most]
    if len(fits) == 1:
        notes.append(f"{name} taken as {fits[0].name}, not {place.unit}: its values have a spread of {number:.4g}")
        return stated_values * (fits[0].scale / stated)
    if small:
        return stated_values
    problem = "may be " + " or ".join(one.name for one in fits) if fits else "fits no unit"
    raise IdentificationError(
        f"{path.name}: {name} (spread of {number:.4g}) cannot be in {place.unit} and {problem}; it must have a "
        f"spread of up to {_MOST[kind]:g} {kind}, with the unit in the heading, such as '{name} [{kind}]'",
        key=name,
        value=place.unit,
    )
