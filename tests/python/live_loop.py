"""A live instrument for tests: rows that come block by block, and the loop itself, tick by tick as it is asked."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tenodesis import _core
from tenodesis.control import Controller, Request
from tenodesis.control.pairs import names_of, pairs
from tenodesis.instrument import Instrument
from tenodesis.instrument.text import to_toml
from tenodesis.live import folder as folders
from tenodesis.live.layout import RowLayout
from tenodesis.live.loop import ORDERS
from tenodesis.run import Run, concatenate
from tenodesis.twin import Twin

TURN = 40
"""Ticks between two turns of a protocol: 20 ms."""


class Played:
    """The rows of a run, block by block; before a block so many rows may be lost."""

    def __init__(self, run: Run, inst: Instrument, blocks: Sequence[int | tuple[int, int]]) -> None:
        self.inst, self.names, self.time_step = inst, names_of(inst), float(run.time[1] - run.time[0])
        self._run = run
        self._blocks = [block if isinstance(block, tuple) else (0, block) for block in blocks]
        self._row = 0

    @property
    def alive(self) -> bool:
        return bool(self._blocks)

    def read(self, most: int = 2000) -> tuple[Run, int]:
        lost, rows = self._blocks.pop(0) if self._blocks else (0, 0)
        assert rows <= most
        start = self._row + lost
        self._row = start + rows
        return self._run.rows(start, self._row), lost


class LiveLoop:
    """The runtime on a twin, without its thread: ticks are taken on request."""

    def __init__(
        self,
        folder: Path,
        inst: Instrument,
        *,
        homed: bool = True,
        loosened: float = 0.0,
        ring: str = "loop-ring",
        capacity: int = 1 << 16,
    ) -> None:
        self.folder, self.inst = folder, inst
        self.twin = Twin(inst)
        if loosened:
            self.twin.loosen(loosened)
        controller = Controller(inst, homed=homed)
        self.time_step = self.twin.time_step
        self._device = device = self.twin.live_device
        self.layout = RowLayout(inst, device.commands, device.signals)
        path = str(folder / ring)
        ranges = [1.5] * len(inst.axes)
        axes = [tuple(pair[1:]) for pair in pairs(inst).values()]
        self._runtime = _core.Runtime(
            device, controller.core, axes, [], path, capacity, ranges, self.time_step, 0.0, 1.0, 1.0, 1e3, False
        )
        self._ring = _core.RingReader(path)
        self._controller = controller
        self._cursor = 0
        self._row = np.empty(0)
        self.asked: list[str] = []
        self.runs: list[Run] = []

    def ticks(self, count: int) -> None:
        """Take ticks, in pieces that the ring holds."""
        pieces = []
        for start in range(0, count, 500):
            pieces.append(self._piece(min(500, count - start)))
        self.runs.append(concatenate(pieces))

    def _piece(self, count: int) -> Run:
        self._runtime.run_ticks(count)
        rows = np.empty((count, self._ring.columns))
        taken, self._cursor, _ = self._ring.read(self._cursor, rows)
        assert taken == count
        self._row = rows[-1]
        return self.layout.run_of(rows)

    @property
    def playing(self) -> dict[str, Any]:
        """What a player needs to know of the loop."""
        return {"inst": self.inst, "assumed": self.inst, "columns": self.layout.commands, "time_step": self.time_step}

    def describe_folder(self) -> None:
        """Write the files that describe the folder."""
        (self.folder / folders.INSTRUMENT).write_text(to_toml(self.inst))
        folders.write(
            self.folder,
            folders.About(
                self.inst, "twin", self.time_step, True, True, "", 0, self._device.commands, self._device.signals
            ),
        )

    def latest(self) -> dict[str, Any]:
        return self.layout.signals_of(self._row)

    def ask(self, request: str) -> None:
        self.asked.append(request)
        self._runtime.order(ORDERS.index("request"), int(Request[request.upper()]))

    def load(self, force: float) -> None:
        self._runtime.order(ORDERS.index("load"), at=self.layout.commands.columns["force"].start, value=force)

    def hand(self, angle: float) -> None:
        self._runtime.order(ORDERS.index("hand"), value=angle)

    def inject_fault(self, point: int, mode: int, value: float, ticks: int) -> None:
        self._runtime.order(ORDERS.index("inject_fault"), point, mode, 0, value, ticks)

    def stop(self) -> None:
        self._runtime.stop()

    @property
    def pending(self) -> int:
        return int(self._runtime.pending_rows)

    def push(self, rows: Any) -> int:
        return int(self._runtime.play(np.ascontiguousarray(rows)))

    def drop(self) -> None:
        self._runtime.order(ORDERS.index("drop"))
