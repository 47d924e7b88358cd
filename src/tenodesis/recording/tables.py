"""Runs as tables: pandas, CSV and Parquet."""

import csv
import math
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tenodesis.errors import RecordingError
from tenodesis.extras import require
from tenodesis.files import atomic_file, write_errors
from tenodesis.recording.schemas import described
from tenodesis.run import Array, Run

if TYPE_CHECKING:
    import pandas as pd

_ROW_GROUP = 50_000
"""Rows of a group in a Parquet file: of a few thousand it is a third larger."""
TIME = "time [s]"
"""Heading of the time."""


def columns(run: Run) -> dict[str, Array]:
    """Return a run's signals (n,) by heading: ``measured_tension.yaw.agonist [N]``, ``wrench.fx [N]``."""
    table: dict[str, Array] = {}
    for name in run.signals():
        for heading in run.names.headings(name):
            table[f"{heading} [{described(heading).unit}]"] = run[heading]
    return table


def to_pandas(run: Run) -> "pd.DataFrame":
    """Return a run as a DataFrame, a column per signal and axis, joint or tendon, over the time in s.

    Raises
    ------
    MissingExtraError
        pandas is not installed.
    """
    pandas = require("pandas", "tables")
    table: pd.DataFrame = pandas.DataFrame(columns(run), index=pandas.Index(run.time, name=TIME))
    return table


def to_csv(run: Run, path: str | Path) -> None:
    """Write a run as CSV, numbers to the last bit and NaN as an empty cell.

    Raises
    ------
    RecordingError
        The file cannot be written; an existing file stays as it was.
    """
    write_csv([run], path)


def write_csv(runs: Iterable[Run], path: str | Path) -> int:
    """Write consecutive runs as :func:`to_csv`, one at a time; return the number of rows."""
    rows = 0
    with (
        write_errors(Path(path), RecordingError),
        atomic_file(Path(path)) as new,
        new.open("w", newline="", encoding="utf-8") as file,
    ):
        writer = csv.writer(file)
        for run in runs:
            table = {TIME: run.time, **columns(run)}
            if file.tell() == 0:
                writer.writerow(table)
            values = np.column_stack([*table.values()])
            if np.isnan(values).any():
                writer.writerows(["" if math.isnan(value) else value for value in row] for row in values.tolist())
            else:
                writer.writerows(values.tolist())
            rows += len(run)
    return rows


def to_parquet(run: Run, path: str | Path) -> None:
    """Write a run as Parquet, with the columns of :func:`to_pandas`.

    Raises
    ------
    MissingExtraError
        pandas or pyarrow is not installed.
    RecordingError
        The file cannot be written; an existing file stays as it was.
    """
    write_parquet([run], path)


def write_parquet(runs: Iterable[Run], path: str | Path) -> int:
    """Write consecutive runs as :func:`to_parquet`, one at a time; return the number of rows."""
    pyarrow, parquet = require("pyarrow", "tables"), require("pyarrow.parquet", "tables")
    rows = 0
    with write_errors(Path(path), RecordingError), atomic_file(Path(path)) as new, ExitStack() as stack:
        writer = None
        for gathered in _gathered(runs):
            table = pyarrow.concat_tables(pyarrow.Table.from_pandas(to_pandas(run)) for run in gathered)
            if writer is None:
                writer = stack.enter_context(parquet.ParquetWriter(new, table.schema))
            writer.write_table(table)
            rows += len(table)
    return rows


def _gathered(runs: Iterable[Run]) -> Iterator[list[Run]]:
    """Yield runs in lists of the rows of a group, or more."""
    found: list[Run] = []
    for run in runs:
        found.append(run)
        if sum(map(len, found)) >= _ROW_GROUP:
            yield found
            found = []
    if found:
        yield found
