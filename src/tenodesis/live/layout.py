"""The columns of a live instrument's rows: those of its tick, its commands, its signals and its controller."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from tenodesis import _core
from tenodesis.instrument import Instrument
from tenodesis.live.controlled import live_names, serves_all
from tenodesis.live.folder import Columns
from tenodesis.run import SIGNALS, Array, Run
from tenodesis.twin.contact import NO_TISSUE
from tenodesis.twin.rows import CONTROL, columns_by_name, signals_of_commands, with_currents

TICK = tuple(_core.tick_columns())
"""Columns that belong to the tick."""
_CONTROLLED = {name: n for n, name in enumerate(CONTROL) if "." not in name}


class CommandColumns:
    """The columns of a row of commands, by name."""

    def __init__(self, columns: Columns) -> None:
        self.columns = columns_by_name(columns)
        self.width = sum(width for _, width in columns)

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def row(self, values: Mapping[str, Any], count: int) -> Array:
        """Return so many rows, (n, width), with values by name, (n, columns) or (n,); the others are 0.

        Tissue, ``contact``, and what the jaws hold, ``held``, are as :meth:`tenodesis.twin.Twin.run` takes them.
        """
        rows = np.zeros((count, self.width))
        for name, columns in self.columns.items():
            value = values.get(name)
            if name == "contact":
                value = np.ravel([NO_TISSUE if one is None else one.row for one in value or ()])
                value = value if value.size else None
            if value is not None:
                single = columns.stop - columns.start == 1
                rows[:, columns] = np.reshape(value, (-1, 1)) if single else value
        return rows

    def named(self, rows: Array) -> dict[str, Array]:
        """Return the commands in rows (..., width) by name."""
        return {name: rows[..., columns] for name, columns in self.columns.items()}


class RowLayout:
    """The columns of a live instrument's rows.

    Parameters
    ----------
    inst
        The instrument.
    commands, signals
        Columns of its device.
    """

    def __init__(self, inst: Instrument, commands: Columns, signals: Columns) -> None:
        self.inst, self.names = inst, live_names(inst)
        self.commands = CommandColumns(commands)
        self._grips = inst.expanded.grip is not None
        # The twins of planar axes have no jaws.
        seen = SIGNALS.keys() - ({"grip_force"} if inst.short_form is not None else set())
        self._signals = {name: columns for name, columns in columns_by_name(signals).items() if name in seen}
        widths = (len(TICK), self.commands.width, sum(width for _, width in signals))
        self._parts = np.cumsum(widths).tolist()
        # A controller of all joints has its signals among the device's.
        self._axes = 0 if serves_all(inst) else len(self.names.compensated)
        self.width = self._parts[-1] + self._axes * len(CONTROL)

    def run_of(self, rows: Array) -> Run:
        """Return rows as a run like a twin's, without the signals that the device does not have."""
        rows = rows.copy()
        tick, commands, signals, control = np.split(rows, self._parts, axis=1)
        commanded = self.commands.named(commands)
        grip = self._grips and "held" in commanded
        found = signals_of_commands(commanded, tissue="contact" in commanded, grip=grip, tension=True)
        found |= {name: signals[:, columns] for name, columns in self._signals.items()}
        if self._axes:
            by_axis = control.reshape(len(rows), self._axes, len(CONTROL))
            found |= {name: by_axis[:, :, n] for name, n in _CONTROLLED.items()}
        found["request"] = np.repeat(tick[:, [TICK.index("request")]], len(self.names.compensated), axis=1)
        shaped: dict[str, Any] = {
            name: values.reshape(self.names.shape(name, len(rows))) for name, values in found.items()
        }
        return with_currents(Run(tick[:, 0], *self.names, **shaped), self.inst)

    def signals_of(self, row: Array) -> dict[str, Any]:
        """Return a row as signals by name: numbers, or arrays by joint and tendon, with the data of the tick.

        What the device does not have is NaN; ``commands`` has what was commanded, by name.
        """
        run = self.run_of(row[np.newaxis])
        named = self._unknown(1) | run.signals()
        tick = dict(zip(TICK, row[: len(TICK)].tolist(), strict=True))
        first, last = self._parts[:2]
        commands = self.commands.named(row[first:last].copy())
        return {name: values[0] for name, values in named.items()} | tick | {"commands": commands}

    def history_of(self, rows: Array) -> dict[str, Array]:
        """Return rows as signals by name, with ``time`` (s)."""
        run = self.run_of(rows)
        return {"time": run.time, **self._unknown(len(rows)), **run.signals()}

    def _unknown(self, rows: int) -> dict[str, Array]:
        return {name: np.full(self.names.shape(name, rows), np.nan) for name in SIGNALS}
