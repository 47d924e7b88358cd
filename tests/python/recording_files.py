"""Recordings of an instrument read, compared and written as tables, for tests."""

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tenodesis.identification import FORMATS
from tenodesis.identification.formats.instrument_run import InstrumentRun
from tenodesis.run import Array
from tenodesis.simulate import Cycles, Protocol

PROTOCOL = Protocol(
    name="formats",
    phases=(Cycles(amplitude=np.radians(20), symmetric=True, speed=np.radians(120), count=1, force=0.5),),
)


def read(path: Path, kind: str | None = None) -> InstrumentRun:
    loaded = FORMATS[kind or ("csv" if path.suffix == ".csv" else "mcap")].load(path)
    assert isinstance(loaded, InstrumentRun)
    return loaded


def same(one: InstrumentRun, other: InstrumentRun, tolerance: float = 0.0) -> bool:
    assert set(one.columns) == set(other.columns)
    columns = [(one.time, other.time), *((one[name], other[name]) for name in one.columns)]
    return all(np.allclose(a, b, rtol=0, atol=tolerance) for a, b in columns)


def table(path: Path, columns: dict[str, Array], separator: str = ",", cell: Callable[[float], str] = repr) -> Path:
    with path.open("w", newline="") as file:
        writer = csv.writer(file, delimiter=separator)
        writer.writerow(columns)
        for row in np.column_stack([*columns.values()]).tolist():
            writer.writerow("" if np.isnan(value) else cell(value) for value in row)
    return path


def headed(run: InstrumentRun, **changes: Array | None) -> dict[str, Array]:
    """Return a run under its columns' own names."""
    found: dict[str, Array | None] = {"time": run.time, **run.columns} | changes
    return {name: values for name, values in found.items() if values is not None}
