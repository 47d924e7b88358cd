"""A figure of a replay and its recording."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tenodesis.errors import RecordingError
from tenodesis.recording.replay import Replay
from tenodesis.report import style
from tenodesis.run import TENDONS

FORMATS = (".png", ".svg", ".pdf")
"""File type of a figure, by the file's extension."""

_LABELS = {"output_angle": "Output angle [deg]", "tension": "Tendon tension [N]"}
_MOST_POINTS = 20_000


def plot(replay: Replay, path: str | Path) -> None:
    """Draw output angles and tensions, recorded and replayed, with a column for each axis of the instrument.

    Raises RecordingError if the extension is unknown, or the file cannot be written.
    """
    path = Path(path)
    if path.suffix not in FORMATS:
        raise RecordingError(f"{path} has the extension {path.suffix!r}; it must be one of {', '.join(FORMATS)}.")
    names, axes = replay.compared(), replay.run.axes
    with style.applied():
        fig = Figure(figsize=(7.0 * len(axes), 0.6 + 2.6 * len(names)), layout="constrained")
        panels = fig.subplots(len(names), len(axes), squeeze=False, sharex=True)
        for row, name in enumerate(names):
            for column, axis in enumerate(axes):
                _draw(panels[row, column], replay, name, axis)
        for column, axis in enumerate(axes):
            panels[0, column].set_title(axis if axes[1:] else replay.inst.name, loc="right")
            panels[-1, column].set_xlabel("Time [s]")
        try:
            fig.savefig(path, dpi=150)
        except OSError as problem:
            raise RecordingError(f"{path} cannot be written: {problem.strerror or problem}.") from None


def _draw(panel: Axes, replay: Replay, name: str, axis: str) -> None:
    """Draw a signal of an axis: the recording broad and pale, the replay thin on top of it."""
    kind = name.removeprefix("measured_")
    colors = {f"{name}.{axis}": style.ACCENT}
    if kind == "tension":
        colors = {f"{name}.{axis}_{TENDONS[0]}": style.AGONIST, f"{name}.{axis}_{TENDONS[1]}": style.ANTAGONIST}
    thin = slice(None, None, max(1, len(replay.run) // _MOST_POINTS))
    sources = (("recorded", replay.recording.run, 3.0, 0.35), ("replayed", replay.run, 1.0, 1.0))
    for label, run, width, alpha in sources:
        for key, color in colors.items():
            values = np.degrees(run[key]) if kind == "output_angle" else run[key]
            tendon = f"{key.rpartition('_')[2]}, " if kind == "tension" else ""
            panel.plot(run.time[thin], values[thin], color=color, lw=width, alpha=alpha, label=f"{tendon}{label}")
    measured = " by the sensors" if name != kind else ""
    panel.set_ylabel(_LABELS[kind].replace(" [", f"{measured} ["))
    style.legend_above(panel, 2)
