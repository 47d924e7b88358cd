"""Recordings: listed, opened, replayed and compared."""

import time
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np

from tenodesis.console.comparison import compare
from tenodesis.console.link import running
from tenodesis.console.motion_file import repeated
from tenodesis.console.plots import AGONIST, INK, WANTED, known
from tenodesis.console.session import Now, Session, enable, put
from tenodesis.console.view import View, view
from tenodesis.errors import RecordingError
from tenodesis.instrument import Instrument
from tenodesis.recording import Recording
from tenodesis.signals import Array

_NONE = "none yet"
_ROWS = 1500
"""Rows that a recording is drawn and replayed with."""
_LISTED = 200
_LOOK_EVERY = 1.0


class Files:
    """The recordings of a folder, and one of them opened."""

    def __init__(self, session: Session, inst: Instrument) -> None:
        from viser import uplot  # noqa: PLC0415 - takes half a second

        self._session, self._inst = session, inst
        self._opened: tuple[Recording, Instrument, View] | None = None
        self._started: float | None = None
        self._looked = 0.0
        gui: Any = session.client.gui
        self._name = gui.add_dropdown("Recording", (_NONE,))
        self._open = gui.add_button("Open", icon="folder-open")
        self._facts = gui.add_markdown(f"Recordings are in `{session.folder}`.")
        self._chart = gui.add_uplot(
            data=(np.array([0.0, 1.0]), *(np.zeros(2) for _ in range(3))),
            series=(
                uplot.Series(label="s"),
                *(
                    uplot.Series(label=name, stroke=colour, width=1.5, points={"show": False})
                    for name, colour in (("the other", AGONIST), ("hand asks", WANTED), ("is", INK))
                ),
            ),
            title="Tip angle, deg",
            scales={"x": uplot.Scale(time=False)},
            axes=(uplot.Axis(label="time, s", labelSize=18, labelGap=0, size=24, gap=2), uplot.Axis(size=48)),
            legend=uplot.Legend(show=True, live=False),
            cursor=uplot.Cursor(show=False),
            height=170,
            padding=(6, 12, 0, 0),
        )
        self._replay = gui.add_button("Replay in the view", icon="player-play", disabled=True)
        self._at = gui.add_slider("At, s", min=0.0, max=1.0, step=0.01, initial_value=0.0, visible=False)
        self._live = gui.add_button("Back to the live instrument", color="green", visible=False)
        self._again = gui.add_button("Move the handle like this again", icon="repeat", disabled=True)
        self._other = gui.add_dropdown("Compare with", (_NONE,))
        self._compare = gui.add_button("Compare the tip angles", icon="arrows-diff", disabled=True)
        self._verdict = gui.add_markdown("")
        session.on(self._open, "open", lambda: session.work("open", self._read))
        session.on(self._replay, "replay", self._start)
        session.on(self._live, "replay", self._end)
        session.on(self._at, "replay at", self._seek)
        session.on(self._again, "play", self._repeat)
        session.on(self._compare, "compare", lambda: session.work("compare", self._put_beside))

    def show(self, now: Now) -> None:
        """List what is there."""
        enable((self._again,), now.operating and self._opened is not None and not running(now.status))
        if time.monotonic() - self._looked < _LOOK_EVERY:
            return
        self._looked = time.monotonic()
        names = tuple(_recordings(self._session.folder)) or (_NONE,)
        if self._name.options != names:
            for dropdown in (self._name, self._other):
                chosen = dropdown.value
                dropdown.options = names
                dropdown.value = chosen if chosen in names else names[0]

    def replayed(self) -> View | None:
        """Return the instant of the recording that the view is to show; None if it is to show what is live."""
        if self._opened is None or self._started is None:
            return None
        _, _, drawn = self._opened
        since = drawn.time - drawn.time[0]
        at = time.monotonic() - self._started
        if at > since[-1]:
            at = float(since[-1])
        self._show_time(at)
        row = int(np.searchsorted(since, at, side="right")) - 1
        return View(*(values[max(row, 0)] for values in drawn))

    def _recording(self, name: str) -> tuple[Recording, Instrument]:
        """Open a recording of the list; a browser may send other names."""
        if name not in _recordings(self._session.folder):
            raise RecordingError(f"{name} is not among the recordings of {self._session.folder}.")
        recording = Recording.open(self._session.folder / name)
        return recording, recording.instrument() if "instrument" in recording.metadata else self._inst

    def _read(self) -> None:
        if self._name.value == _NONE:
            return
        recording, inst = self._recording(self._name.value)
        drawn = _thinned(recording, inst)
        self._end()
        self._opened = (recording, inst, drawn)
        lasts = float(drawn.time[-1] - drawn.time[0]) if drawn.time.size else 0.0
        since = drawn.time - drawn.time[:1].sum()
        with self._session.client.atomic():
            put(self._facts, content=_facts(recording, inst))
            put(self._verdict, content="")
            if lasts > 0:
                self._draw(since, drawn.output[:, 0], drawn.wanted[:, 0], drawn.output[:, 0])
            # Another instrument would be drawn wrong.
            enable((self._replay,), lasts > 0 and inst.axes == self._inst.axes)
            enable((self._compare,), lasts > 0)
            self._at.max = max(lasts, 0.02)

    def _draw(self, time: Array, other: Array, wanted: Array, output: Array) -> None:
        """Draw angles, rad: another recording's, what the hand asks for, and the tip's, which hides equal ones."""
        self._chart.data = (time, *(known(np.degrees(angles), 0.0) for angles in (other, wanted, output)))

    def _start(self) -> None:
        self._started = time.monotonic()
        self._session.replaying = True
        put(self._live, visible=True)
        put(self._at, visible=True)

    def _end(self) -> None:
        self._started = None
        self._session.replaying = False
        put(self._live, visible=False)
        put(self._at, visible=False)

    def _seek(self) -> None:
        if self._started is not None:
            self._started = time.monotonic() - float(self._at.value)

    def _show_time(self, at: float) -> None:
        if abs(self._at.value - at) > 0.2:
            self._at.value = round(at, 2)

    def _repeat(self) -> None:
        if self._opened is not None:
            self._session.link.play(repeated(self._opened[0]))

    def _put_beside(self) -> None:
        names = (self._name.value, self._other.value)
        if _NONE in names:
            return
        both = []
        for name in names:
            recording, inst = self._recording(name)
            seen = view(inst, recording.to_numpy())
            both.append((seen.time, seen.output[:, 0]))
        found = compare(both[0], both[1])
        rows = np.linspace(0, found.time.size - 1, min(_ROWS, found.time.size)).astype(int)
        with self._session.client.atomic():
            put(
                self._verdict,
                content=f"Over {found.time[-1]:.1f} s they differ by **{degrees(found.rms):.2f}° RMS**, "
                f"{degrees(found.largest):.2f}° at most. First: `{names[0]}`, second: `{names[1]}`.",
            )
            self._draw(found.time[rows], found.second[rows], found.first[rows], found.first[rows])


def _recordings(folder: Path) -> list[str]:
    """Return the names of a folder's recordings, the newest first."""
    found = []
    for path in folder.glob("*.mcap"):
        try:
            found.append((path.stat().st_mtime, path.name))
        except OSError:
            continue
    return [name for _, name in sorted(found, reverse=True)[:_LISTED]]


def _thinned(recording: Recording, inst: Instrument) -> View:
    signals = recording.to_numpy()
    count = signals["time"].size
    rows = np.unique(np.linspace(0, max(count - 1, 0), min(_ROWS, count)).astype(int))
    return view(inst, {name: values[rows] for name, values in signals.items()})


def _facts(recording: Recording, inst: Instrument) -> str:
    rows = len(recording.run)
    lines = [
        f"**{recording.path.name}**: {recording.duration:.1f} s, {rows} rows, {inst.name}, {' and '.join(inst.axes)}.",
    ]
    if recording.damage is not None:
        lines.append(recording.damage)
    return "\n\n".join(lines)
