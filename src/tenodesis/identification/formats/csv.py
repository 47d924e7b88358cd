"""Recordings of an instrument as tables: text, LabVIEW, MATLAB, Excel, by :mod:`tenodesis.recording.lab_map`."""

from collections.abc import Iterator
from contextlib import contextmanager
from math import inf, radians
from pathlib import Path

import numpy as np

from tenodesis.errors import IdentificationError, RecordingError
from tenodesis.identification.formats.instrument_run import LEAST_EXCITATION, InstrumentRun, checked
from tenodesis.identification.formats.measured import GRAM_FORCE, Unit, spread_of
from tenodesis.recording import lab_map, lab_tables
from tenodesis.run import TENDONS, Array

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


@contextmanager
def as_identification() -> Iterator[None]:
    """Raise an error about a file as one about what is to be identified."""
    try:
        yield
    except RecordingError as problem:
        raise IdentificationError(str(problem), key=problem.key, value=problem.value, allowed=problem.allowed) from None


def read_table(path: Path) -> lab_tables.LabTable:
    """Return the table in a file; raises IdentificationError if it cannot be read, or holds none."""
    with as_identification():
        return lab_tables.read_table(path)


def scale_of(unit: str, si_unit: str, what: str) -> float:
    """Return the factor from a unit to an SI unit; raises IdentificationError if there is none."""
    with as_identification():
        return lab_map.scale_of(unit, si_unit, what)


def read_rows(
    path: Path, width: int, *, delimiter: str | None = ",", comment: str | None = "%", skip: int = 0
) -> Array:
    """Return the numbers of a text file without headings, shape (rows, width); a row that cannot be read is NaN.

    Further columns are not read. Without a delimiter white space separates columns; header lines to `skip` and lines
    that start with a comment are left out. Raises IdentificationError if the file cannot be read, or no row has enough
    columns.
    """
    try:
        read = lab_tables.lines_of(path)
    except OSError as error:
        raise IdentificationError(f"{path} cannot be read: {error.strerror}.", key="path", value=path) from None
    lines = [line for line in read[skip:] if not (comment and line.startswith(comment))]
    if not lines:
        raise IdentificationError(f"{path} has no row of {width} numbers", key="path", value=path)
    try:
        rows = np.loadtxt(lines, delimiter=delimiter, comments=None, usecols=range(width), ndmin=2)
    except ValueError:
        rows = np.array([_numbers(line, width, delimiter) for line in lines]).reshape(-1, width)
    if np.isnan(rows).all(axis=1).all():
        raise IdentificationError(f"{path} has no row of {width} numbers", key="path", value=path)
    return np.asarray(rows, dtype=np.float64)


def _numbers(line: str, width: int, delimiter: str | None) -> list[float]:
    try:
        found = [float(part) for part in line.split(delimiter)[:width]]
    except ValueError:
        found = []
    return found if len(found) == width else [np.nan] * width


def load(path: Path) -> InstrumentRun:
    """Return a recording from a table, by its headings or by the map beside it.

    An empty cell is a missing value. Columns and what becomes of them are those of InstrumentRun.

    Raises IdentificationError if the file or its map cannot be read, lacks what is needed, or is not usable.
    """
    with as_identification():
        mapped = lab_map.read(path)
    notes, places = list(mapped.notes), mapped.places
    if "handle_angle" not in places and "measured_handle_angle" in places:
        places["handle_angle"] = places["measured_handle_angle"]
        notes.append("the handle angle is that of its encoder, for no commanded angle was recorded")
    needed = (lab_map.TIME, "handle_angle", *(f"tension_{tendon}" for tendon in TENDONS))
    lacking = [name for name in needed if name not in places]
    if lacking:
        raise IdentificationError(
            f"{path} lacks {', '.join(lacking)}: its headings are {', '.join(map(repr, mapped.table.headings))}; "
            f"{lab_map.explained(path)}.",
            key="columns",
            value=lacking,
        )
    stated = {name: mapped.values(name) for name in places}
    # a column without a number was not recorded
    known = {name: values for name, values in stated.items() if name in needed or np.isfinite(values).any()}
    columns = {name: _in_si(path, name, values, places[name], notes) for name, values in known.items()}
    if "handle_angle" in known and not np.array_equal(columns["handle_angle"], known["handle_angle"], equal_nan=True):
        _as_the_handle(columns, known, places, notes)
    time = columns.pop(lab_map.TIME)
    return checked(path.name, time, columns, notes=notes)


def _in_si(path: Path, name: str, stated_values: Array, parts: list[lab_map.SourceColumn], notes: list[str]) -> Array:
    """Return a column in SI by its stated unit, or, if that is impossible, by the unit that its magnitude shows."""
    spread = spread_of(stated_values[np.isfinite(stated_values)])
    kind, place = lab_map.UNITS[name], parts[0]
    # a tip or a tendon that hardly moves may be in the stated unit; a handle that does not move is of no use
    small, large = name == "handle_angle" and spread < LEAST_EXCITATION, spread > _MOST.get(kind, inf)
    if name not in _CHECKED or parts[1:] or not (small or large):
        return stated_values
    stated = scale_of(place.unit, kind, f"{path.name}: the unit of {name}")
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


def _as_the_handle(
    columns: dict[str, Array], stated: dict[str, Array], places: dict[str, list[lab_map.SourceColumn]], notes: list[str]
) -> None:
    """Convert angles under the handle's heading as its angle was, if its numbers were too small for the stated unit.

    Too large ones show in every column by themselves.
    """
    known = np.isfinite(stated["handle_angle"]) & (stated["handle_angle"] != 0)
    factor = float(np.median(columns["handle_angle"][known] / stated["handle_angle"][known]))
    for name in ("measured_handle_angle", "measured_output_angle") if factor > 1 else ():
        if name not in columns or places[name][0].unit != places["handle_angle"][0].unit or places[name][1:]:
            continue
        spread = spread_of(stated[name][np.isfinite(stated[name])])
        if np.array_equal(columns[name], stated[name], equal_nan=True) and factor * spread <= _MOST["rad"]:
            columns[name] = factor * stated[name]
            notes.append(f"{name} taken in the unit of handle_angle, not {places[name][0].unit} as its heading says")
