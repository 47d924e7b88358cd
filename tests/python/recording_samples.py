"""Runs of any bits, and recordings of them, for tests."""

from pathlib import Path
from typing import Any

import numpy as np

from tenodesis.recording import Recorder
from tenodesis.run import SIGNALS, Names, Run


def a_run(rows: int, axes: tuple[str, ...] = ("yaw",), start: int = 0, names: Any = SIGNALS) -> Run:
    """Any bits at all, so that NaN of every kind is among them."""
    rng = np.random.default_rng(rows + start)
    signals = {}
    for name in names:
        size = Names.paired(axes).shape(name, rows)
        values = rng.integers(0, 2**64, size, np.uint64).view(np.float64)
        values[rng.random(size) < 0.2] = np.nan
        signals[name] = values
    return Run((start + np.arange(rows)) * 0.0005, axes, **signals)


def bits(run: Run, rows: int | None = None) -> dict[str, tuple[tuple[int, ...], bytes]]:
    arrays = {"time": run.time[:rows]} | run.rows(0, rows).signals()
    return {name: (values.shape, values.tobytes()) for name, values in arrays.items()}


def recorded(path: Path, *runs: Run, **options: Any) -> Path:
    with Recorder(path, axes=runs[0].names, **options) as recorder:
        for run in runs:
            recorder.write(run)
    return path
