"""The tab of the recordings: open, replay, repeat and compare them."""

import stat
import time
from collections.abc import Mapping
from contextlib import suppress
from math import ceil, degrees
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tenodesis.console.display import ShownSignals, shown_signals
from tenodesis.console.plots import AGONIST, INK, TARGET, add_chart, series, without_gaps
from tenodesis.console.session import PageState, Session, as_plain, enable, set_properties
from tenodesis.control.pairs import names_of
from tenodesis.errors import RecordingError
from tenodesis.instrument import Instrument
from tenodesis.magnitude import rms
from tenodesis.recording import Recording
from tenodesis.run import Array
from tenodesis.simulate import Motion, Protocol
from tenodesis.simulate.motion import csv_text

_NONE = "none yet"
_ROWS = 1500
"""Rows with which a recording is drawn and replayed."""
_LISTED = 200
_LIST_PERIOD = 1.0  # s
_REPEAT_RATE = 100  # Hz
_OPENED = {"target": TARGET, "tip": INK}
_COMPARED = {"second": AGONIST, "first": INK}
"""Colours of curves by name; the last is in front."""


class _Opened(NamedTuple):
    """A recording that has been read."""

    recording: Recording
    inst: Instrument
    shown: ShownSignals


class FilesTab:
    """The recordings of a folder, and the recording that is open."""

    def __init__(self, session: Session, inst: Instrument) -> None:
        self._session, self._inst = session, inst
        self._opened: _Opened | None = None
        self._started: float | None = None
        self._listed_at = 0.0
        self._newest = (_NONE, _NONE)
        gui: Any = session.client.gui
        self._name = gui.add_dropdown("Recording", (_NONE,))
        self._open = gui.add_button("Open", icon="folder-open")
        self._facts = gui.add_markdown(f"Recordings are in {as_plain(session.folders.recordings.absolute())}.")
        self._axis = gui.add_dropdown("Axis of the curves", _joints(inst), visible=len(_joints(inst)) > 1)
        self._chart = add_chart(gui, "Tip angle, deg", _OPENED, height=170)
        self._chart.visible = False
        self._replay = gui.add_button("Replay in the view", icon="player-play", disabled=True)
        self._at = gui.add_slider("At, s", min=0.0, max=1.0, step=0.01, initial_value=0.0, visible=False)
        self._live = gui.add_button("Back to the live instrument", color="green", visible=False)
        self._again = gui.add_button("Repeat this motion of the handle", icon="repeat", disabled=True)
        self._other = gui.add_dropdown("Compare with", (_NONE,))
        self._compare = gui.add_button("Compare the tip angles", icon="arrows-diff")
        self._difference = gui.add_markdown("")
        session.on(self._open, "open", lambda: session.run_in_background("open", self._read))
        session.on(self._replay, "replay", self._start)
        session.on(self._live, "replay", self._end)
        session.on(self._at, "replay at", self._seek)
        session.on(self._again, "play", self._repeat)
        session.on(self._axis, "axis", self._draw_opened)
        session.on(self._compare, "compare", lambda: session.run_in_background("compare", self._compare_tips))

    def update(self, state: PageState) -> None:
        """List the recordings of the folder."""
        free = state.operating and self._session.link.capabilities.simulated and not state.status.protocol_runs
        enable((self._again,), free and self._opened is not None)
        if time.monotonic() - self._listed_at < _LIST_PERIOD:
            return
        self._listed_at = time.monotonic()
        names = tuple(_recordings(self._session.folders.recordings)) or (_NONE,)
        if self._name.options != names:
            # Until the browser chooses, the newest recording and the one before it.
            newest = (names[0], names[min(1, len(names) - 1)])
            for dropdown, before, newest_name in zip((self._name, self._other), self._newest, newest, strict=True):
                chosen = dropdown.value
                dropdown.options = names
                dropdown.value = chosen if chosen in names and chosen != before else newest_name
            self._newest = newest

    def replayed(self) -> ShownSignals | None:
        """Return the instant of the recording that is replayed; None if the view is live."""
        if self._opened is None or self._started is None:
            return None
        shown = self._opened.shown
        since = shown.time - shown.time[0]
        at = time.monotonic() - self._started
        if at > since[-1]:
            at = float(since[-1])
        self._show_time(at)
        row = int(np.searchsorted(since, at, side="right")) - 1
        return ShownSignals(*(values[max(row, 0)] for values in shown))

    def _recording(self, name: str) -> tuple[Recording, Instrument]:
        """Open a recording of the list, which may have changed."""
        if name not in _recordings(self._session.folders.recordings):
            raise RecordingError(
                f"{name} is not among the recordings of {self._session.folders.recordings}.",
                key="recording",
                value=name,
            )
        recording = Recording.open(self._session.folders.recordings / name)
        inst = recording.instrument() if "instrument" in recording.metadata else self._inst
        if recording.run.joints != _joints(inst):
            raise RecordingError(
                f"{name} has {' and '.join(recording.run.joints)} and does not contain its instrument; it must have "
                f"{' and '.join(_joints(inst))}, as {inst.name} has.",
                key="joints",
                value=recording.run.joints,
                allowed=" and ".join(_joints(inst)),
            )
        return recording, inst

    def _read(self) -> None:
        name = self._name.value
        if name == _NONE:
            return
        set_properties(self._facts, content=f"Opening {as_plain(name)}.")
        try:
            recording, inst = self._recording(name)
            shown = _thinned(recording, inst)
        except Exception:
            set_properties(self._facts, content=f"{as_plain(name)} could not be opened.")
            raise
        self._end()
        self._opened = _Opened(recording, inst, shown)
        lasts = float(shown.time[-1] - shown.time[0]) if shown.time.size else 0.0
        with self._session.client.atomic():
            set_properties(self._facts, content=_facts(recording, inst, self._inst))
            set_properties(self._difference, content="")
            set_properties(self._axis, options=_joints(inst), visible=len(_joints(inst)) > 1)
            self._draw_opened()
            # The scene is that of the live instrument.
            enable((self._replay,), lasts > 0 and names_of(inst)[:3] == names_of(self._inst)[:3])
            self._at.max = ceil(100 * max(lasts, 0.02)) / 100

    def _draw_opened(self) -> None:
        """Draw the recording that is open."""
        if self._opened is None or self._opened.shown.time.size < 2:
            return
        _, inst, shown = self._opened
        axis = _joints(inst).index(self._axis.value)
        self._draw(_OPENED, shown.time - shown.time[0], shown.target[:, axis], shown.output[:, axis])

    def _draw(self, curves: Mapping[str, str], time: Array, *angles: Array) -> None:
        """Draw angles, rad, as curves of these names and colours."""
        with self._session.client.atomic():
            self._chart.visible = True
            self._chart.series = series(curves)
            self._chart.data = (time, *(without_gaps(np.degrees(angle), 0.0) for angle in angles))

    def _start(self) -> None:
        self._started = time.monotonic()
        self._session.replaying = True
        set_properties(self._live, visible=True)
        set_properties(self._at, visible=True)

    def _end(self) -> None:
        self._started = None
        self._session.replaying = False
        set_properties(self._live, visible=False)
        set_properties(self._at, visible=False)

    def _seek(self) -> None:
        if self._started is not None:
            self._started = time.monotonic() - float(self._at.value)

    def _show_time(self, at: float) -> None:
        if abs(self._at.value - at) > 0.2:
            self._at.value = round(at, 2)

    def _repeat(self) -> None:
        if self._opened is not None:
            self._session.link.play(repeated(self._opened.recording))

    def _compare_tips(self) -> None:
        names = (self._name.value, self._other.value)
        if _NONE in names:
            return
        found = compare(self._tip_angle(names[0], self._axis.value), self._tip_angle(names[1], self._axis.value))
        rows = np.linspace(0, found.time.size - 1, min(_ROWS, found.time.size)).astype(int)
        with self._session.client.atomic():
            set_properties(
                self._difference,
                content=f"Over {found.time[-1]:.1f} s they differ by **{degrees(found.rms):.2f}° RMS**, "
                f"{degrees(found.largest):.2f}° at most. First: {as_plain(names[0])}, second: {as_plain(names[1])}.",
            )
            self._draw(_COMPARED, found.time[rows], found.second[rows], found.first[rows])

    def _tip_angle(self, name: str, axis: str) -> tuple[Array, Array]:
        """Return times (s) and tip angles (rad) of a recording's axis."""
        recording, inst = self._recording(name)
        if axis not in _joints(inst):
            raise RecordingError(key=f"joints of {name}", value=_joints(inst), allowed=f"with {axis}")
        shown = shown_signals(inst, recording.to_numpy())
        return shown.time, shown.output[:, _joints(inst).index(axis)]


def _joints(inst: Instrument) -> tuple[str, ...]:
    """Return the names of the tip's joints."""
    return tuple(joint.name for joint in inst.tip_joints)


def _recordings(folder: Path) -> list[str]:
    """Return the names of a folder's recordings, the newest first."""
    found = []
    for path in folder.glob("*.mcap"):
        with suppress(OSError):
            status = path.stat()
            if stat.S_ISREG(status.st_mode):
                found.append((status.st_mtime, path.name))
    return [name for _, name in sorted(found, reverse=True)[:_LISTED]]


def _thinned(recording: Recording, inst: Instrument) -> ShownSignals:
    signals = recording.to_numpy()
    count = signals["time"].size
    rows = np.unique(np.linspace(0, max(count - 1, 0), min(_ROWS, count)).astype(int))
    return shown_signals(inst, {name: values[rows] for name, values in signals.items()})


def _facts(recording: Recording, inst: Instrument, live: Instrument) -> str:
    """Return as Markdown what a recording holds."""
    rows, axes = len(recording.run), " and ".join(_joints(inst))
    lines = [
        f"**{as_plain(recording.path.name)}**: {recording.duration:.1f} s, {rows} rows, {as_plain(inst.name)}, {axes}."
    ]
    if _joints(inst) != _joints(live):
        lines.append(f"To replay it, run an instrument with {axes} first, under *Setup*.")
    elif inst.name != live.name:
        lines.append(f"The view replays its angles on the live instrument, {as_plain(live.name)}.")
    if recording.damage is not None:
        lines.append(as_plain(recording.damage))
    return "\n\n".join(lines)


def repeated(recording: Recording) -> Protocol:
    """Return a protocol that moves the handle as in a recording of the bench, axis after axis.

    Raises
    ------
    RecordingError
        It has no handle angle, or not two rows.
    """
    run = recording.run
    names = [name for name in ("measured_handle_angle", "handle_angle") if name in run.signals()]
    if not names or len(run) < 2 or not run.handle_joints:
        raise RecordingError(
            f"{recording.path} has no motion of the handle.",
            key="path",
            value=recording.path,
            allowed="a recording with a motion of the handle",
        )
    angles = run[names[0]].reshape(len(run), -1)
    rows = np.unique(np.linspace(0, len(run) - 1, max(2, int(recording.duration * _REPEAT_RATE))).astype(int))
    phases = tuple(
        Motion(
            joint=joint,
            data=csv_text(run.time[rows], angles[rows, n], "time_s", "angle_rad"),
            time_column="time_s",
            angle_column="angle_rad",
            angle_unit="rad",
            limit=True,
        )
        for n, joint in enumerate(run.handle_joints)
    )
    return Protocol(
        name=f"as {recording.path.stem}"[:60], description="The handle's motion of a recording", phases=phases
    )


class AngleComparison(NamedTuple):
    """The tip angles of two recordings at common times."""

    time: Array
    """From the start of either, s, shape (n,)"""
    first: Array
    """rad, shape (n,)"""
    second: Array
    rms: float
    """Root mean square of their difference, rad"""
    largest: float
    """Largest difference, rad"""


def compare(first: tuple[Array, Array], second: tuple[Array, Array], rows: int = 4000) -> AngleComparison:
    """Compare two tip angles, rad, at times, s, counted from the start of each, over their common duration.

    Raises
    ------
    RecordingError
        One has less than two rows, or no tip angle.
    """
    (time, angle), (other_time, other_angle) = first, second
    if time.size < 2 or other_time.size < 2:
        raise RecordingError(key="rows", value=min(time.size, other_time.size), allowed="at least two")
    since, other_since = time - time[0], other_time - other_time[0]
    common = np.linspace(0, min(since[-1], other_since[-1]), min(rows, max(time.size, other_time.size)))
    first_angle, second_angle = np.interp(common, since, angle), np.interp(common, other_since, other_angle)
    finite = np.isfinite(first_angle - second_angle)
    if not finite.any():
        raise RecordingError(key="tip_angle", allowed="in both recordings")
    difference = (first_angle - second_angle)[finite]
    return AngleComparison(common, first_angle, second_angle, rms(difference), float(np.abs(difference).max()))
