"""The ticks of a live runtime, read from its ring."""

import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from tenodesis import _core
from tenodesis.errors import LiveError
from tenodesis.instrument import ShortForm
from tenodesis.live import folder as folders
from tenodesis.run import TISSUE, TRUTH, Array, Run
from tenodesis.twin import as_run
from tenodesis.twin.rows import with_currents

TICK = tuple(_core.tick_columns())
"""Columns of a record that belong to the tick, not to an axis."""
_BENCH = len(_core.bench_columns())
_SIGNALS = len(_core.twin_signals())
_CONTROL = len(_core.control_signals())
_AXIS = _BENCH + _SIGNALS + _CONTROL
_SILENT = 2.0
"""Time without a tick after which a runtime counts as ended, s."""


class Source(Protocol):
    """A source of the rows of a live instrument, such as a :class:`Reader`."""

    @property
    def inst(self) -> ShortForm:
        """The instrument."""
        ...

    @property
    def axes(self) -> tuple[str, ...]:
        """Its axes."""
        ...

    @property
    def time_step(self) -> float:
        """Between rows, s."""
        ...

    @property
    def alive(self) -> bool:
        """Whether rows may still come."""
        ...

    def read(self, most: int = 2000) -> tuple[Run, int]:
        """Return the new rows, at most `most`, and how many were lost since the last call."""
        ...


class Reader:
    """Reads every new tick of a runtime once.

    Parameters
    ----------
    folder
        The runtime's folder.

    Raises
    ------
    LiveError
        There is no runtime's ring in the folder.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self.about = folders.read(self.folder)
        try:
            self._ring = _core.RingReader(str(self.folder / folders.RING))
        except (OSError, ValueError, RuntimeError) as problem:
            raise LiveError(f"the ticks of {self.folder} cannot be read: {problem}.") from None
        if self._ring.columns != len(TICK) + len(self.axes) * _AXIS:
            raise LiveError(f"{self.folder} is of another version of tenodesis; start it again.")
        self._cursor = self._ring.written
        self._rows = np.empty((0, self._ring.columns))

    @property
    def inst(self) -> ShortForm:
        """The instrument."""
        return self.about.inst

    @property
    def axes(self) -> tuple[str, ...]:
        """Its axes."""
        return self.about.inst.axes

    @property
    def time_step(self) -> float:
        """Between ticks, s."""
        return self.about.period

    @property
    def silence(self) -> float:
        """Time since the loop last turned, s."""
        return self._ring.silence

    @property
    def alive(self) -> bool:
        """Whether the runtime still runs."""
        return self.silence < _SILENT

    @property
    def columns(self) -> int:
        """Columns of a row."""
        return self._ring.columns

    @property
    def written(self) -> int:
        """Number of ticks so far."""
        return self._ring.written

    def read(self, most: int = 2000) -> tuple[Run, int]:
        """Return the next ticks, at most `most`, and how many were lost since the last call."""
        rows, lost = self.rows(most)
        return run_of(rows, self.inst, simulated=self.about.simulated, distal=self.about.distal_encoder), lost

    def rows(self, most: int = 2000) -> tuple[Array, int]:
        """Return the next ticks as rows of the ring's columns; valid until the next call."""
        if len(self._rows) < most:
            self._rows = np.empty((most, self._ring.columns))
        count, self._cursor, lost = self._ring.read(self._cursor, self._rows[:most])
        return self._rows[:count], lost

    def newest(self) -> Array | None:
        """Return the row of the newest tick, or None before the first."""
        row = np.empty((1, self._ring.columns))
        for _ in range(8):
            written = self._ring.written
            if written and self._ring.read(written - 1, row)[0]:
                newest: Array = row[0]
                return newest
        return None


def run_of(rows: Array, inst: ShortForm, *, simulated: bool, distal: bool) -> Run:
    """Return rows of a ring as a run like a twin's, without the signals that a device does not have."""
    axes = inst.axes
    blocks = _blocks(rows, axes).copy()
    bench, outs, controls = np.split(blocks, (_BENCH, _BENCH + _SIGNALS), axis=2)

    def by_axis(values: Array) -> Array:
        return values[:, 0] if len(axes) == 1 else values

    run = as_run(
        rows[:, 0].copy(),
        axes,
        {name: by_axis(bench[:, :, column]) for column, name in enumerate(_core.bench_columns())},
        list(outs.swapaxes(0, 1)),
        list(controls.swapaxes(0, 1)),
    )
    request = np.repeat(rows[:, TICK.index("request")][:, np.newaxis], len(axes), axis=1)
    unknown: list[str] = []
    if not simulated:
        unknown = [*TRUTH, *TISSUE, "commanded_handle_angle", "force", "radial_force"]
        unknown += [] if distal else ["measured_output_angle"]
    missing: Mapping[str, Any] = dict.fromkeys(unknown)
    run = replace(run, request=by_axis(request), **missing)
    return with_currents(run, inst, inst.drives.spool_radius)


def signals_of(row: Array, inst: ShortForm) -> dict[str, Any]:
    """Return a row as signals by name: numbers, or arrays by axis and tendon, with the data of the tick."""
    run = run_of(row[np.newaxis], inst, simulated=True, distal=True)
    named: dict[str, Any] = {name: values[0] for name, values in run.signals().items()}
    return dict(zip(TICK, row[: len(TICK)].tolist(), strict=True)) | named


def _blocks(rows: Array, axes: tuple[str, ...]) -> Array:
    """Return the columns of each axis in rows, shape (n, axes, columns of an axis)."""
    return rows[:, len(TICK) :].reshape(len(rows), len(axes), _AXIS)


def start_time(run: Run) -> int:
    """Return when the clock of new rows was 0, ns since the epoch; the present time if none has a time."""
    known = run.time[np.isfinite(run.time)]
    return time.time_ns() - (round(float(known[-1]) * 1e9) if known.size else 0)
