"""Recorded motions: columns of a CSV file."""

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tenodesis.errors import ProtocolError
from tenodesis.run import Array


@dataclass(frozen=True, eq=False)
class Recording:
    """Times (s), what was recorded at them, and the lines they are on."""

    times: Array
    values: Array
    lines: tuple[int, ...]


def read(file: Path, time_column: str, value_column: str) -> Recording:
    """Read two columns of a CSV file; see :func:`parse`.

    Raises
    ------
    ProtocolError
        The file cannot be read or is not such a file.
    """
    try:
        # A device would be read without end.
        text = file.read_text("utf-8-sig") if file.is_file() else None
    except UnicodeDecodeError:
        raise ProtocolError(f"file is {str(file)!r}: it is not UTF-8 text; allowed is a CSV file") from None
    except OSError as problem:
        raise ProtocolError(f"file is {str(file)!r}: it cannot be read: {problem.strerror}") from None
    if text is None:
        raise ProtocolError(f"file is {str(file)!r}: there is no such file; allowed is the path of a CSV file")
    return parse(text, str(file), time_column, value_column)


def parse(text: str, source: str, time_column: str, value_column: str) -> Recording:
    """Read two columns of CSV: commas between them, a header of names, comments after # in lines of their own.

    Raises
    ------
    ProtocolError
        The text lacks a column, or has less than two rows, a value that is no finite number, or a time that does not
        increase; the message starts with `source`.
    """
    rows = _rows(text)
    _, header = next(rows, (0, []))
    columns = [_column(source, header, name) for name in (time_column, value_column)]
    numbers, lines = [], []
    for line, row in rows:
        numbers.append([_number(f"{source}: line {line}", header, row, column) for column in columns])
        lines.append(line)
    if len(numbers) < 2:
        raise ProtocolError(f"{source} has {len(numbers)} rows of numbers; allowed are two or more")
    times, values = np.array(numbers).T
    late = np.flatnonzero(np.diff(times) <= 0)
    if late.size:
        at = int(late[0]) + 1
        raise ProtocolError(
            f"{source}: line {lines[at]}: {time_column} is {times[at]:g} after {times[at - 1]:g}; "
            "allowed are times that increase strictly"
        )
    return Recording(times, values, tuple(lines))


def text(recording: Recording, time_column: str, value_column: str) -> str:
    """Return a recording as CSV that :func:`parse` reads back to the last bit."""
    lines = [",".join('"' + name.replace('"', '""') + '"' for name in (time_column, value_column))]
    rows = zip(recording.times.tolist(), recording.values.tolist(), strict=True)
    return "\n".join([*lines, *(f"{time!r},{value!r}" for time, value in rows), ""])


def _rows(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield line number and cells of each line that is neither empty nor a comment."""
    for line, content in enumerate(text.splitlines(), 1):
        if content.strip() and not content.lstrip().startswith("#"):
            yield line, [cell.strip() for cell in next(csv.reader([content]))]


def _column(source: str, header: list[str], name: str) -> int:
    if name not in header:
        raise ProtocolError(f"{source} has no column {name!r}; it has {', '.join(header) or 'none'}")
    return header.index(name)


def _number(place: str, header: list[str], row: list[str], column: int) -> float:
    cell = row[column] if column < len(row) else ""
    try:
        number = float(cell)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise ProtocolError(f"{place}: {header[column]} is {cell!r}; allowed is a finite number")
    return number
