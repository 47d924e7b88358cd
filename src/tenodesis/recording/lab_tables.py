"""Tables of numbers from the files that laboratories write, each read by its library; the content shows the kind."""

import csv
import re
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from math import prod
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from tenodesis.errors import Error, RecordingError
from tenodesis.extras import require
from tenodesis.files import read_regular
from tenodesis.recording import lab_bags
from tenodesis.recording.tables import TIME
from tenodesis.run import Array

_LARGEST = 1_000_000_000
"""Largest file, and largest content that one may expand to, bytes."""
_COMPRESSED, _PART = 15, 1 << 20
"""Kind of a compressed variable of a MATLAB file, and bytes that are unpacked at once."""
_MOST_COLUMNS = 1_000
_LVM, _LVM_HEADER = "LabVIEW Measurement", "***End_of_Header***"
_COMMENTS = ("#", "%")
_MCAP = b"\x89MCAP0\r\n"
_NUMBERS = ("double", "float", "int64", "int32", "int16", "int8", "uint64", "uint32", "uint16", "uint8")
"""Types of Parquet that are read."""
_HDF5 = b"\x89HDF\r\n\x1a\n"
MAP_SUFFIX = ".columns.toml"


class LabTable(NamedTuple):
    """Columns of numbers (n,) under headings, NaN where there is none."""

    kind: str
    headings: list[str]
    columns: list[Array]

    def column(self, at: int) -> Array:
        """Return a column by its number."""
        return self.columns[at]


def read_table(path: Path) -> LabTable:
    """Return the table in a file of a laboratory.

    It is text, LabVIEW (.lvm, .tdms), MATLAB (.mat), HDF5, Parquet, NumPy (.npz), Excel (.xlsx), or a bag of ROS.
    Text is separated by commas, semicolons or tabs, with a decimal comma if they are no commas; lines of # or % are
    left out. An array of several columns has a heading for each, ``F[1]`` and on.

    Raises
    ------
    RecordingError
        The file cannot be read, or holds no table.
    MissingExtraError
        The library that reads it is not installed.
    """
    try:
        if lab_bags.is_bag(path):
            return _whole(path, _bag(path))
        start = _start(path)
        reader = next((read for known, read in _READERS if known(start)), None)
        if reader is None:
            return _text(path)
        return _whole(path, reader(path))
    except IsADirectoryError:
        raise lab_bags.no_bag(path) from None
    except OSError as problem:
        reason = problem.strerror or str(problem)
        raise RecordingError(f"{path} cannot be read: {reason}.", key="path", value=path) from None
    except Error:
        raise
    except MemoryError:
        raise RecordingError(f"{path} does not fit into memory.", key="path", value=path) from None
    # A damaged file makes a library raise whatever its reader runs into.
    except Exception as problem:
        reason = str(problem).strip().partition("\n")[0].rstrip(".") or type(problem).__name__
        raise RecordingError(f"{path} cannot be read: {reason}.", key="path", value=path) from problem


def is_table(path: Path) -> bool:
    """Return whether a file can hold a table: text, or what a library reads; False where it cannot be read.

    An MCAP file is a recording, unless a map explains its topics.
    """
    if lab_bags.is_bag(path):
        return True
    try:
        start = _start(path)
    except OSError:
        return False
    if start.startswith(_MCAP):
        return path.with_name(path.name + MAP_SUFFIX).exists()
    return any(known(start) for known, _ in _READERS) or not (b"\0" in start or start.startswith(b"\x89"))


def has_headings(path: Path) -> bool:
    """Return whether a file names what it holds: any but text that begins with a number; False if it cannot be read."""
    if path.is_dir():
        return lab_bags.is_bag(path)
    try:
        start = _start(path)
    except OSError:
        return False
    if start.startswith(_MCAP) or any(known(start) for known, _ in _READERS):
        return True
    lines = (line for line in start.decode("utf-8-sig", "replace").splitlines() if not line.startswith(_COMMENTS))
    first = next((line for line in lines if line.strip()), "0")
    return _number(re.split(r"[,;\s]", first.strip())[0]) is None


def lines_of(path: Path) -> list[str]:
    """Return the lines of a text file that are not blank, without a byte order mark; raises OSError.

    What is no UTF-8 is taken for the code page of western Windows.
    """
    found = read_regular(path, _LARGEST)
    try:
        text = found.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = found.decode("cp1252", errors="replace")
    return [line for line in text.splitlines() if line.strip()]


def _start(path: Path) -> bytes:
    if not path.is_file():
        read_regular(path, 0)  # raises what is wrong with it
    if path.stat().st_size > _LARGEST:
        read_regular(path, _LARGEST)
    with path.open("rb") as file:
        return file.read(4096)


def _text(path: Path) -> LabTable:
    lines = lines_of(path)
    if not lines:
        raise RecordingError(
            f"{path} is empty; it must hold a line of headings and rows of numbers.",
            key="path",
            value=path,
            allowed="an MCAP file, or a table of numbers under headings",
        )
    if lines[0].startswith(_LVM):
        return _lvm(path, lines)
    lines = [line for line in lines if not line.startswith(_COMMENTS)]
    if not lines:
        raise RecordingError(f"{path} holds nothing but comments.", key="path", value=path)
    separator = _separator(lines)
    return _rows(path, "text", lines, separator, decimal="." if separator == "," else ",")


def _separator(lines: Sequence[str]) -> str:
    """Return what separates as many headings as values of the first row, most of them numbers; else most headings."""

    def fits(separator: str) -> tuple[bool, float, int]:
        headings, first = (line.rstrip(separator).split(separator) for line in (lines[0], lines[:2][-1]))
        numbers = [_number(cell.replace(",", ".")) for cell in first]
        share = 1 - numbers.count(None) / len(numbers)
        return 1 < len(headings) == len(first), share, len(headings)

    return max(",;\t", key=fits)


def _lvm(path: Path, lines: Sequence[str]) -> LabTable:
    """Return the channels of a LabVIEW measurement, of which a header says how numbers are written."""
    ends = [at for at, line in enumerate(lines) if line.startswith(_LVM_HEADER)][:2]
    if not ends:
        raise RecordingError(f"{path} has no end of its header, {_LVM_HEADER}.", key="path", value=path)
    separator = "," if any(line.split()[:2] == ["Separator", "Comma"] for line in lines[: ends[0]]) else "\t"
    stated = [line.replace(separator, "\t").split("\t") for line in lines[: ends[-1]]]
    header = {parts[0]: parts[1:] for parts in stated}
    table = _rows(
        path, "LabVIEW measurement", lines[ends[-1] + 1 :], separator, "".join(header.get("Decimal_Separator", ["."]))
    )
    if table.headings[0] != "X_Value" or np.isfinite(table.columns[0]).any():
        return table
    begin, step = (
        float(header[key][0].replace(",", ".")) if header.get(key, [""])[0] else np.nan for key in ("X0", "Delta_X")
    )
    rows = np.arange(table.columns[0].size)
    return table._replace(columns=[(begin + step * rows).astype(np.float64), *table.columns[1:]])


def _rows(path: Path, kind: str, lines: Sequence[str], separator: str, decimal: str) -> LabTable:
    """Return lines of text, of which the first has the headings."""
    try:
        headings = [one.strip() for one in next(csv.reader(lines[:1], delimiter=separator, skipinitialspace=True))]
    except (csv.Error, StopIteration) as problem:
        raise RecordingError(f"{path} is no table of text: {problem}.", key="path", value=path) from None
    if len(headings) > _MOST_COLUMNS:
        raise RecordingError(f"{path} has more than {_MOST_COLUMNS} columns.", key="path", value=path)
    comma = decimal == "," and separator != ","
    rows = [line.replace(",", ".") for line in lines[1:]] if comma else lines[1:]
    columns = [np.full(len(rows), np.nan) for _ in headings]
    first = next(csv.reader(rows[:1], delimiter=separator, skipinitialspace=True), [])
    if first[len(headings) :] and all(_number(cell) is not None for cell in first):
        raise RecordingError(
            f"{path} has rows of {len(first)} values under {len(headings)} headings; decimal commas need semicolons or "
            "tabs between the values.",
            key="columns",
            value=len(first),
            allowed=f"{len(headings)} values in a row",
        )
    used = [at for at, cell in enumerate(first[: len(headings)]) if _number(cell) is not None]
    numbers = np.empty((0, 0))
    if used:
        with suppress(ValueError):
            numbers = np.loadtxt(rows, delimiter=separator, comments=None, usecols=used, ndmin=2, quotechar='"')
    if used and numbers.shape == (len(rows), len(used)):
        for at, values in zip(used, numbers.T, strict=True):
            columns[at] = values.copy()
        if len(used) == len(headings):
            return LabTable(kind, headings, columns)
    else:
        used = []
    try:
        for row, cells in enumerate(csv.reader(rows, delimiter=separator, skipinitialspace=True)):
            for at, cell in enumerate(cells[: len(headings)]):
                if at not in used and (number := _number(cell)) is not None:
                    columns[at][row] = number
    except (csv.Error, IndexError) as problem:
        raise RecordingError(f"{path} is no table of text: {problem}.", key="path", value=path) from None
    return LabTable(kind, headings, columns)


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None


def _tdms(path: Path) -> LabTable:
    found: dict[str, Any] = {}
    clock: Array | None = None
    library = require("nptdms", "formats").TdmsFile
    described = library.read_metadata(path)
    _check_expanded(path, (8 * len(channel) for group in described.groups() for channel in group.channels()))
    for group in library.read(path).groups():
        for channel in group.channels():
            if not np.issubdtype(channel.dtype, np.number):
                continue
            unit = channel.properties.get("unit_string", "")
            name = channel.name if channel.name not in found else f"{group.name}/{channel.name}"
            found[f"{name} [{unit}]" if unit else name] = channel[:]
            if clock is None and channel.properties.get("wf_increment", 0) > 0:
                clock = channel.time_track()
    return _table("LabVIEW TDMS", found if clock is None else {TIME: clock, **found})


def _mat(path: Path) -> LabTable:
    from scipy.io import loadmat  # noqa: PLC0415 - slow to load

    _check_expanded(path, _mat_sizes(path))
    read = loadmat(path, simplify_cells=True)
    return _table("MATLAB", {name: values for name, values in read.items() if not name.startswith("__")})


def _mat_sizes(path: Path) -> Iterator[int]:
    """Yield the sizes of a MATLAB file's variables, of a compressed one in parts as it is unpacked, bytes."""
    with path.open("rb") as file:
        order: Literal["big", "little"] = "big" if file.read(128)[126:128] == b"MI" else "little"
        while len(tag := file.read(8)) == 8:
            kind, size = (int.from_bytes(part, order) for part in (tag[:4], tag[4:]))
            if kind != _COMPRESSED:
                yield size
                file.seek(size, 1)
                continue
            unpack, packed = zlib.decompressobj(), file.read(size)
            while packed and not unpack.eof:
                yield len(unpack.decompress(packed, _PART))
                packed = unpack.unconsumed_tail


def _check_expanded(path: Path, sizes: Iterable[int]) -> None:
    """Check how much a file's content takes before it is read; a reader of it would take all the memory there is."""
    total = 0
    for size in sizes:
        total += size
        if total > _LARGEST:
            raise RecordingError(f"{path} holds more than {_LARGEST / 1e6:g} MB of numbers.", key="path", value=path)


def _hdf5(path: Path) -> LabTable:
    h5py = require("h5py", "formats")
    found: dict[str, Array] = {}
    taken: list[int] = []

    def take(name: str, one: Any) -> None:
        plain = isinstance(one, h5py.Dataset) and one.dtype.kind in "fiu" and not name.startswith("#")
        if plain:
            taken.append(one.size * one.dtype.itemsize)
            _check_expanded(path, taken)
            # MATLAB's order of dimensions is the other one
            found[name.replace("/", ".")] = np.asarray(one).T

    with h5py.File(path) as file:
        file.visititems(take)
    return _table("MATLAB 7.3, HDF5", found)


def _xlsx(path: Path) -> LabTable:
    openpyxl = require("openpyxl", "formats")
    with zipfile.ZipFile(path) as packed:
        _check_expanded(path, (one.file_size for one in packed.infolist()))
    book = openpyxl.load_workbook(path, read_only=True, data_only=True)
    try:
        rows = book.worksheets[0].iter_rows(values_only=True)
        headings = [("" if cell is None else str(cell)).strip() for cell in next(rows, ())]
        values = [[cell if isinstance(cell, int | float) else np.nan for cell in row] for row in rows]
    finally:
        book.close()
    numbers = np.array(values, np.float64).reshape(len(values), -1)
    return LabTable("Excel", headings, [column.copy() for column in numbers.T[: len(headings)]])


def _parquet(path: Path) -> LabTable:
    file = require("pyarrow.parquet", "tables").ParquetFile(path)
    groups = (file.metadata.row_group(at) for at in range(file.num_row_groups))
    _check_expanded(path, (max(one.total_byte_size, 8 * one.num_rows * one.num_columns) for one in groups))
    read = file.read()
    kept = [name for name, kind in zip(read.column_names, read.schema.types, strict=True) if str(kind) in _NUMBERS]
    return _table("Parquet", {name: read[name].to_numpy() for name in kept})


def _npz(path: Path) -> LabTable:
    with zipfile.ZipFile(path) as packed:
        _check_expanded(path, (one.file_size for one in packed.infolist()))
    with np.load(path, allow_pickle=False) as read:
        return _table("NumPy", dict(read))


def _zip(path: Path) -> LabTable:
    """Return a sheet of Excel or the arrays of NumPy, which both are archives."""
    with zipfile.ZipFile(path) as packed:
        return (_npz if any(name.endswith(".npy") for name in packed.namelist()) else _xlsx)(path)


def _bag(path: Path) -> LabTable:
    time, found = lab_bags.columns(path)
    return LabTable("bag of ROS", [TIME, *found], [time, *found.values()])


def _table(kind: str, found: Mapping[str, Any]) -> LabTable:
    """Return arrays as columns: of those with the length that most values have."""
    named = list(_named(found))
    lengths = [values.size for _, values in named]
    rows = max(set(lengths), key=lambda length: (lengths.count(length) * (length > 1), length), default=0)
    kept = [(name, values) for name, values in named if values.size == rows > 1]
    return LabTable(kind, [name for name, _ in kept], [values for _, values in kept])


def _named(found: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Array]]:
    """Yield the columns of arrays and, by names with a dot, of structures."""
    for name, one in found.items():
        if isinstance(one, Mapping):
            yield from _named(one, f"{before}{name}.")
            continue
        values = np.asarray(one)
        if values.dtype.kind not in "fiu" or not values.size or values.ndim > 2:
            continue
        if values.size == max(values.shape, default=0):
            yield before + name, values.ravel().astype(np.float64)
        elif values.ndim == 2 and values.shape[1] < min(values.shape[0], _MOST_COLUMNS):
            for at, column in enumerate(values.T.astype(np.float64), 1):
                yield f"{before}{name}[{at}]", column


def _whole(path: Path, table: LabTable) -> LabTable:
    if not table.headings or not prod(column.size for column in table.columns):
        raise RecordingError(
            f"{path} ({table.kind}) holds no columns of numbers under headings.", key="path", value=path
        )
    return table


_READERS: list[tuple[Callable[[bytes], bool], Callable[[Path], LabTable]]] = [
    (lambda start: start.startswith(b"TDSm"), _tdms),
    (lambda start: start.startswith(b"MATLAB 5.0 MAT"), _mat),
    (lambda start: start.startswith((b"MATLAB 7.3 MAT", _HDF5)), _hdf5),
    (lambda start: start.startswith(b"PK\x03\x04"), _zip),
    (lambda start: start.startswith(b"PAR1"), _parquet),
    (lambda start: start.startswith((lab_bags.ROS1, lab_bags.SQLITE, _MCAP)), _bag),
]
"""Readers of binary files by how these begin."""
