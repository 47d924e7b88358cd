"""Text files of numbers: with headings, or without."""

import csv
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pint

from tenodesis.errors import IdentificationError
from tenodesis.files import read_regular
from tenodesis.run import Array
from tenodesis.units import in_unit

_LARGEST = 1_000_000_000
"""Largest file of text, bytes."""
_HEADING = re.compile(r"\s*(?P<name>[^\[\]]*?)\s*(?:\[\s*(?P<unit>[^\]]*?)\s*\])?\s*")


class Heading(NamedTuple):
    """A heading such as ``force [mN]``: the name before the brackets, and the unit within them if present."""

    name: str
    unit: str | None


class Table(NamedTuple):
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


def read_table(path: Path) -> Table:
    """Return a text file with headings, separated by commas, semicolons or tabs; lines of # or % are left out.

    Raises IdentificationError if the file cannot be read, or is empty.
    """
    lines = [line for line in _lines(path) if not line.startswith(("#", "%"))]
    if not lines:
        raise IdentificationError(f"{path} is empty; it must hold a line of headings and rows of numbers.")
    separator = max(",;\t", key=lines[0].count)
    try:
        headings, *rows = csv.reader(lines, delimiter=separator, skipinitialspace=True)
    except csv.Error as problem:
        raise IdentificationError(f"{path} is no table of text: {problem}.") from None
    return Table([heading.strip() for heading in headings], rows, separator)


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
        raise IdentificationError(f"{path} has no row of {width} numbers")
    try:
        rows = np.loadtxt(lines, delimiter=delimiter, comments=None, usecols=range(width), ndmin=2)
    except ValueError:
        rows = np.array([_numbers(line, width, delimiter) for line in lines]).reshape(-1, width)
    if np.isnan(rows).all(axis=1).all():
        raise IdentificationError(f"{path} has no row of {width} numbers")
    return np.asarray(rows, dtype=np.float64)


def _lines(path: Path) -> list[str]:
    """Return the lines of a text file that are not blank, without a byte order mark."""
    try:
        text = read_regular(path, _LARGEST).decode("utf-8-sig", errors="replace")
    except OSError as error:
        raise IdentificationError(f"{path} cannot be read: {error.strerror}.") from None
    return [line for line in text.splitlines() if line.strip()]


def _numbers(line: str, width: int, delimiter: str | None) -> list[float]:
    try:
        found = [float(part) for part in line.split(delimiter)[:width]]
    except ValueError:
        found = []
    return found if len(found) == width else [np.nan] * width
