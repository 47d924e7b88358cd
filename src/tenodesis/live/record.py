"""The ticks of a live runtime, read from its ring by whoever watches."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tenodesis import _core
from tenodesis.errors import LiveError
from tenodesis.instrument import Instrument
from tenodesis.live import folder as folders
from tenodesis.run import TRUTH, Array, Run
from tenodesis.twin import as_run

TICK = tuple(_core.tick_columns())
"""Columns of a record that are the tick's, not an axis's."""
_BENCH = len(_core.bench_columns())
_SIGNALS = len(_core.twin_signals())
_CONTROL = len(_core.control_signals())
_AXIS = _BENCH + _SIGNALS + _CONTROL
_SENT = [n for n, name in enumerate(_core.control_signals()) if name.startswith("commanded_spool_velocity.")]
_SILENT = 2.0
"""Time after which a runtime that says nothing is taken for dead, s."""


class Reader:
    """Reads every tick of a runtime from now on, once.

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
            raise LiveError(f"{self.folder} is of another version of tenodesis; start it anew.")
        self._cursor = self._ring.written
        self._rows = np.empty((0, self._ring.columns))

    @property
    def inst(self) -> Instrument:
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
    def alive(self) -> bool:
        """Whether the runtime still runs."""
        return self._ring.silence < _SILENT

    @property
    def columns(self) -> int:
        """Columns of a row."""
        return self._ring.columns

    @property
    def written(self) -> int:
        """Ticks there have been."""
        return self._ring.written

    def read(self, most: int = 2000) -> tuple[Run, int]:
        """Return the next ticks, `most` of them at once, and how many were lost since the last call."""
        rows, lost = self.rows(most)
        return run_of(rows, self.axes, simulated=self.about.simulated, distal=self.about.distal_encoder), lost

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


def run_of(rows: Array, axes: tuple[str, ...], *, simulated: bool, distal: bool) -> Run:
    """Return rows of a ring as a run, as a twin's would be; without what nobody knows of a device."""
    count = len(rows)
    commands, outs, controls = [], [], []
    for axis in _blocks(rows, len(axes)):
        command = np.zeros((count, len(_core.twin_commands())))
        command[:, 0], command[:, 2] = axis[:, 0], axis[:, 1]
        commands.append(command)
        outs.append(axis[:, _BENCH : _BENCH + _SIGNALS].copy())
        controls.append(axis[:, _BENCH + _SIGNALS :].copy())
    request = rows[:, TICK.index("request")].copy()
    run = as_run(rows[:, 0].copy(), axes, commands, outs, controls)
    run = replace(run, request=request if len(axes) == 1 else np.stack([request] * len(axes), -1))
    unknown: list[str] = []
    if not simulated:
        unknown = [*TRUTH, "commanded_handle_angle", "force", "radial_force"]
        unknown += [] if distal else ["measured_output_angle"]
    missing: Mapping[str, Any] = dict.fromkeys(unknown)
    return replace(run, **missing)


def signals_of(row: Array, axes: tuple[str, ...]) -> dict[str, Any]:
    """Return one row as signals by name: numbers, or arrays by axis and tendon; with what the tick says of itself."""
    run = run_of(row[np.newaxis], axes, simulated=True, distal=True)
    named: dict[str, Any] = {name: values[0] for name, values in run.signals().items()}
    return dict(zip(TICK, row[: len(TICK)].tolist(), strict=True)) | named


def sent(row: Array, axes: int) -> Array:
    """Return the spool velocities that a row says were sent, rad/s, shape (axes, 2)."""
    return np.array([block[0, [_BENCH + _SIGNALS + n for n in _SENT]] for block in _blocks(row[np.newaxis], axes)])


def _blocks(rows: Array, axes: int) -> Iterator[Array]:
    for n in range(axes):
        start = len(TICK) + n * _AXIS
        yield rows[:, start : start + _AXIS]
