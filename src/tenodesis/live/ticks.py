"""The ticks of a live runtime, read from its ring."""

import time
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from tenodesis import _core
from tenodesis.errors import LiveError
from tenodesis.instrument import Instrument
from tenodesis.live import folder as folders
from tenodesis.live.layout import RowLayout
from tenodesis.run import Array, Names, Run

_SILENT = 2.0
"""Time without a tick after which a runtime counts as ended, s."""


class RowSource(Protocol):
    """A source of the rows of a live instrument, such as a :class:`Reader`."""

    @property
    def inst(self) -> Instrument:
        """The instrument."""
        ...

    @property
    def names(self) -> Names:
        """What the columns of its rows are named after."""
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
            raise LiveError(
                f"the ticks of {self.folder} cannot be read: {problem}.", key="folder", value=self.folder
            ) from None
        self.layout = RowLayout(self.about.inst, self.about.commands, self.about.signals)
        if self._ring.columns != self.layout.width:
            raise LiveError(
                f"{self.folder} is of another version of tenodesis; start it again.", key="folder", value=self.folder
            )
        self._cursor = self._ring.written
        self._rows = np.empty((0, self._ring.columns))

    @property
    def inst(self) -> Instrument:
        """The instrument."""
        return self.about.inst

    @property
    def names(self) -> Names:
        """What the columns of its rows are named after."""
        return self.layout.names

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
        return self.layout.run_of(rows), lost

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

    def signals(self) -> dict[str, Any]:
        """Return the newest tick's signals by name, scalars or arrays by joint and tendon; empty before the first."""
        row = self.newest()
        return {} if row is None else self.layout.signals_of(row)


def start_time(run: Run) -> int:
    """Return when the clock of new rows was 0, ns since the epoch; the present time if none has a time."""
    known = run.time[np.isfinite(run.time)]
    return time.time_ns() - (round(float(known[-1]) * 1e9) if known.size else 0)
