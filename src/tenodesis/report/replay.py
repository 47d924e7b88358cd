"""A figure of a replay and its recording."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tenodesis.errors import RecordingError
from tenodesis.files import write_errors
from tenodesis.recording.replay import Replay
from tenodesis.report import style
from tenodesis.run import Names

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
        raise RecordingError(
            f"{path} has the extension {path.suffix!r}; it must be one of {', '.join(FORMATS)}.",
            key="path",
            value=path,
            allowed=f"one of {', '.join(FORMATS)}",
        )
    names, run = replay.compared(), replay.run
    paired = run.names == Names.paired(run.joints)
    axes = run.joints if paired else ("",)
    with style.applied():
        fig = Figure(figsize=(7.0 * len(axes), 0.6 + 2.6 * len(names)), layout="constrained")
        panels = fig.subplots(len(names), len(axes), squeeze=False, sharex=True)
        for row, name in enumerate(names):
            for column, axis in enumerate(axes):
                own = run.axis(axis) if paired else run
                _draw(panels[row, column], replay, name, own.columns(name))
        for column, axis in enumerate(axes):
            panels[0, column].set_title(axis if axes[1:] else replay.inst.name, loc="right")
            panels[-1, column].set_xlabel("Time [s]")
        with write_errors(path, RecordingError):
            fig.savefig(path, dpi=150)


def _draw(panel: Axes, replay: Replay, name: str, columns: Sequence[str]) -> None:
    """Draw columns of a signal: the recording broad and pale, the replay thin on top of it."""
    kind = name.removeprefix("measured_")
    pair = [style.AGONIST, style.ANTAGONIST][: len(columns)] if kind == "tension" else [style.ACCENT]
    colors = pair if len(pair) == len(columns) else style.colors(len(columns))
    thin = slice(None, None, max(1, len(replay.run) // _MOST_POINTS))
    sources = (("recorded", replay.recording.run, 3.0, 0.35), ("replayed", replay.run, 1.0, 1.0))
    for label, run, width, alpha in sources:
        for column, color in zip(columns, colors, strict=True):
            values = run[f"{name}.{column}"]
            shown = np.degrees(values) if kind == "output_angle" else values
            which = f"{column}, " if columns[1:] else ""
            panel.plot(run.time[thin], shown[thin], color=color, lw=width, alpha=alpha, label=f"{which}{label}")
    measured = " by the sensors" if name != kind else ""
    panel.set_ylabel(_LABELS[kind].replace(" [", f"{measured} ["))
    style.legend_above(panel, 2)
