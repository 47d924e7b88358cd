"""Load at the tip and angles of all joints from recordings of the drive end alone, by the observer of all joints."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from tenodesis.control import JointController
from tenodesis.errors import IdentificationError
from tenodesis.identification.force.model import WIDTH
from tenodesis.identification.formats.csv import as_identification
from tenodesis.identification.formats.mcap import first_rows
from tenodesis.identification.report import write_files
from tenodesis.identification.routing import by_name
from tenodesis.instrument import FullForm, expanded
from tenodesis.magnitude import rms
from tenodesis.recording import lab_map, lab_tables, signal_tables
from tenodesis.report import page, style
from tenodesis.run import COMPONENTS, Array
from tenodesis.units import in_unit

SHOWN = {"rad": "deg", "N": "N"}
"""Units on screen and in figures."""

TABLE, FIGURE = "force.csv", "force.svg"
"""What estimates are written as."""
_DRIVE_END = ("measured_tension", "measured_spool_angle", "measured_handle_angle")
_RECORDED = (*_DRIVE_END, "wrench", "force", "radial_force", *signal_tables.GRIP, "measured_output_angle")
_MOST_SHOWN = 2000
"""Rows that are drawn."""


class Channel(NamedTuple):
    """An estimate over a recording: in SI, with its standard deviation; what was recorded of it is NaN if nothing."""

    name: str
    unit: str
    value: Array
    std: Array
    recorded: Array

    @property
    def rmse(self) -> float:
        """Root mean square of recorded minus estimated."""
        return rms(self.recorded - self.value)

    @property
    def covered(self) -> float:
        """Share of rows within the 95 % interval."""
        return float(np.mean(np.abs(self.recorded - self.value) <= WIDTH * self.std))


class Observed(NamedTuple):
    """What the drive end of an instrument shows in a recording."""

    name: str
    time: Array
    """Of the observer's ticks, s"""
    channels: list[Channel]
    notes: Sequence[str]


def observed(path: Path, inst: FullForm | None = None) -> Observed:
    """Return what the observer finds in a recording, from tensions, spools and handle, of a force without a moment.

    Tendons tell moments about joints; these cannot tell a force at the tip from a moment on it. Raises
    IdentificationError if the instrument is not known, or a signal of it is not there.
    """
    with as_identification():
        if lab_tables.is_table(path):
            columns, found = signal_tables.read(path)
            notes = [*found]
        else:
            recording, notes = first_rows(path, _RECORDED)
            columns = by_name(recording.run, _RECORDED) | {lab_map.TIME: recording.run.time}
            if inst is None and "instrument" in recording.metadata:
                inst = expanded(recording.instrument())
    if inst is None:
        raise IdentificationError(
            f"{path.name} does not say of what instrument it is; give --instrument.", key="instrument"
        )
    tendons, handles = ([one.name for one in parts] for parts in (inst.tendons, inst.handle_joints))
    of = [
        [f"{signal}.{one}" for one in parts]
        for signal, parts in zip(_DRIVE_END, (tendons, tendons, handles), strict=True)
    ]
    missing = [name for group in ([lab_map.TIME], *of) for name in group if name not in columns]
    if missing:
        raise IdentificationError(
            f"{path.name} lacks {', '.join(missing)} of {inst.name}; of a table, tenodesis map {path.name} "
            "--instrument FILE says which column is which.",
            key="signals",
            value=missing,
        )
    time = columns[lab_map.TIME]
    every = max(1, round(1 / inst.sensors.sampling_rate / float(np.median(np.diff(time)))))
    rows = {name: row[::every] for name, row in signal_tables.gripped(columns).items() if row.size}
    tension, spool, handle = (
        np.array([rows[name] for name in group]).reshape(-1, len(time[::every])).T for group in of
    )
    period = float(np.median(np.diff(rows[lab_map.TIME])))
    estimate = JointController(inst, "off", enabled=False, period=period, pure_force=True).observe(
        tension, spool, handle
    )
    names = [
        *(f"measured_output_angle.{joint.name}" for joint in inst.tip_joints),
        *(f"wrench.{component}" for component in COMPONENTS[:3]),
        *(["grip_force"] if inst.grip is not None else []),
    ]
    units = ["rad"] * len(inst.tip_joints) + ["N"] * 4
    places = [0, 1, 2, 6]
    values = [*estimate.angle.T, *estimate.load.T[places]]
    stds = [*estimate.angle_std.T, *estimate.load_std.T[places]]
    absent = np.full(len(tension), np.nan)
    channels = [
        Channel(name.removeprefix("measured_"), unit, value, std, rows.get(name, absent))
        for name, unit, value, std in zip(names, units, values, stds, strict=False)
    ]
    return Observed(path.name, rows[lab_map.TIME], channels, notes)


def figure(found: Observed) -> Figure:
    """Return what was estimated over time, with the 95 % interval, and what was recorded of it."""
    shown = slice(None, None, max(1, len(found.time) // _MOST_SHOWN))
    columns = 3
    fig = Figure(figsize=(3.2 * columns + 0.8, 1.9 * math.ceil(len(found.channels) / columns)), layout="constrained")
    axes = fig.subplots(math.ceil(len(found.channels) / columns), columns, squeeze=False, sharex=True).ravel()
    for axis, one in zip(axes, found.channels, strict=False):
        scale, time = in_unit(SHOWN[one.unit], one.unit), found.time[shown]
        value, width = scale * one.value[shown], scale * WIDTH * one.std[shown]
        axis.fill_between(time, value - width, value + width, color=style.ACCENT, alpha=0.2, lw=0, label="95 %")
        axis.plot(time, scale * one.recorded[shown], color=style.INK, lw=1.2, label="recorded")
        axis.plot(time, value, color=style.ACCENT, lw=1.0, label="estimated")
        axis.set_ylabel(f"{one.name.rpartition('.')[2]} [{SHOWN[one.unit]}]")
    for axis in axes[len(found.channels) :]:
        axis.remove()
    for axis in axes[max(0, len(found.channels) - columns) : len(found.channels)]:
        axis.set_xlabel("time [s]")
        axis.tick_params(labelbottom=True)
    style.legend_above(axes[0], 3)
    return fig


def write(found: Observed, out: Path) -> None:
    """Write force.csv, in SI, and force.svg into a folder; raises IdentificationError if it cannot be written."""
    names = ["time [s]", *(f"{one.name}{of} [{one.unit}]" for one in found.channels for of in ("", "_std"))]
    rows = np.column_stack([found.time, *(row for one in found.channels for row in (one.value, one.std))])
    lines = [",".join(names), *(",".join(map(repr, row)) for row in rows.tolist())]
    with style.applied():
        drawn = page.svg_text(figure(found))
    write_files(out, {FIGURE: drawn, TABLE: "\n".join(lines) + "\n"}, last=TABLE)
