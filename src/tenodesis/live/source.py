"""Where the rows of a live instrument come from, for whoever only listens."""

import time
from typing import Protocol

import numpy as np

from tenodesis.instrument import Instrument
from tenodesis.run import Run


class Source(Protocol):
    """What :class:`tenodesis.live.record.Reader` is to a listener."""

    @property
    def inst(self) -> Instrument:
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
        """Return the rows that are new, `most` of them, and how many were lost since the last time."""
        ...


def start_time(run: Run) -> int:
    """Return when the clock of rows that have just come was 0, ns since the epoch; if none tells a time, now."""
    known = run.time[np.isfinite(run.time)]
    return time.time_ns() - (round(float(known[-1]) * 1e9) if known.size else 0)
