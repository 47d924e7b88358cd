"""Runs as tables: pandas, CSV and Parquet."""

import csv
import math
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
    table = {TIME: run.time, **columns(run)}
    with (
        write_errors(Path(path), RecordingError),
        atomic_file(Path(path)) as new,
        new.open("w", newline="", encoding="utf-8") as file,
    ):
        writer = csv.writer(file)
        writer.writerow(table)
        for row in np.column_stack([*table.values()]).tolist():
            writer.writerow("" if math.isnan(value) else value for value in row)


def to_parquet(run: Run, path: str | Path) -> None:
    """Write a run as Parquet, with the columns of :func:`to_pandas`.

    Raises
    ------
    MissingExtraError
        pandas or pyarrow is not installed.
    RecordingError
        The file cannot be written; an existing file stays as it was.
    """
    require("pyarrow", "tables")
    with write_errors(Path(path), RecordingError), atomic_file(Path(path)) as new:
        to_pandas(run).to_parquet(new)
