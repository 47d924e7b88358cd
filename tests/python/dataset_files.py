"""Files of the three public data sets as their benches write them, for tests."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tenodesis.identification.datasets.davinci_tool import JAW_COUNTS, SPINDLE_COUNTS
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.run import Array

TIME, SPINDLE, TORQUE, JAW, JAW_TORQUE = 0, 1, 2, 4, 5
SAMPLES = 4000


def table() -> Array:
    """Return rows as the bench writes them: a slow sine of 30 degrees at 1 kHz, in counts."""
    time = 0.001 * np.arange(SAMPLES)
    angle = 30 * np.cos(2 * math.pi * 0.4 * time)
    noise = np.random.default_rng(3)
    rows = np.zeros((SAMPLES, 10))
    rows[:, TIME] = time
    rows[:, SPINDLE] = np.round((30 + angle) / 360 * SPINDLE_COUNTS)
    rows[:, TORQUE] = np.round(1500 + 900 * np.sin(2 * math.pi * 0.4 * time) + noise.normal(0, 8, SAMPLES))
    rows[:, JAW] = np.round((40 - angle) / 360 * JAW_COUNTS)
    rows[:, JAW_TORQUE] = np.round(-1000 + 100 * np.sin(2 * math.pi * 0.4 * time) + noise.normal(0, 8, SAMPLES))
    return rows


def write(folder: Path, rows: Array, *, extra: Sequence[tuple[int, str]] = ()) -> Path:
    """Write rows in the bench's format, with lines of text put in before some of them."""
    lines = [",".join(f"{value:.6g}" if column else f"{value:.6f}" for column, value in enumerate(row)) for row in rows]
    for at, line in sorted(extra, reverse=True):
        lines.insert(at, line)
    path = folder / "run.TXT"
    path.write_text("% a header\n%more of it\n" + "\n".join(lines) + "\n")
    return path


COMMAND, OUTPUT, AGONIST, ANTAGONIST = 1, 3, 4, 5
HELD = 4


def pair(samples: int = 500) -> Array:
    """Return rows as the manipulator writes them: deg and N, each row four times with the clock held."""
    time = 0.025 * np.arange(samples)
    rows = np.zeros((samples, 6))
    rows[:, TIME] = time
    rows[:, COMMAND] = 60 * np.sin(time)
    rows[:, OUTPUT] = 25 * np.sin(time - 0.2)
    rows[:, AGONIST] = 5 + 4 * np.sin(time + 0.3)
    rows[:, ANTAGONIST] = 5 - 4 * np.sin(time + 0.2)
    return np.repeat(rows, HELD, axis=0)


def write_pair(folder: Path, rows: Array, name: str = "60.txt") -> Path:
    path = folder / name
    path.write_text("\n".join(", ".join(f"{value:.7g}" for value in row) + " " for row in rows))
    return path


HEAD = ",Time,layout.dim,layout.data_offset,data_0,data_1,data_2,data_3"


def sheath(samples: int = 1500, peak: float = 10.0) -> Array:
    """Return time, proximal and distal tension in N, with the noise of a load cell."""
    time = 0.012 * np.arange(samples)
    pull = peak * (0.5 - 0.5 * np.cos(1.4 * time)) + np.random.default_rng(5).normal(0, 0.005, samples)
    return np.column_stack([time, pull, 0.5 * pull])


def write_sheath(folder: Path, rows: Array, *, unit: float = 1.0, head: str = HEAD, start: str = "") -> Path:
    path = folder / "pulls.csv"
    lines = [f"{at},{t:.6f},[],0,{one / unit:.7g},0.1,{two / unit:.7g},0.2" for at, (t, one, two) in enumerate(rows)]
    path.write_text(start + "\n".join([head, *lines]), encoding="utf-8")
    return path


def said(measured: MeasuredRun) -> str:
    return "; ".join(measured.notes)
