"""The hand and the tissue: handle angles, recorded motions, and the load at the tip."""

from math import degrees, floor, isfinite
from typing import Any

import numpy as np

from tenodesis import protocols
from tenodesis.console.link import running
from tenodesis.console.motion_file import motion_protocol
from tenodesis.console.session import Now, Session, enable, put
from tenodesis.errors import LiveError
from tenodesis.instrument import Instrument
from tenodesis.signals import Array

_ON, _OFF = "Put the load on at once", "Take the load off at once"
_MADE_UP = "wrist, made up"


class Moving:
    """Sliders of handle and load, and what plays recorded motions."""

    def __init__(self, session: Session, inst: Instrument) -> None:
        self._session = session
        gui: Any = session.client.gui
        self._simulated = session.link.capabilities.simulated
        self._motions = {_MADE_UP: protocols.load("wrist")}
        self._reach = reach = floor(10 * degrees(inst.handle_range) + 1e-6) / 10
        self._most = most = largest_force(inst)
        self._hand: list[Any] = [
            gui.add_slider(f"Handle {axis}, °", min=-reach, max=reach, step=0.1, initial_value=0.0)
            for axis in inst.axes
        ]
        self._force: list[Any] = [
            gui.add_slider(
                f"Load {axis}, N",
                min=-most,
                max=most,
                step=round(most / 100, 6),
                initial_value=0.0,
                hint="Tangential force at the tip; positive against positive flexion.",
            )
            for axis in inst.axes
        ]
        self._axis = gui.add_dropdown("Step on", inst.axes, visible=len(inst.axes) > 1)
        self._size = gui.add_number("Step, N", initial_value=_usual_force(inst, most), min=-most, max=most, step=0.05)
        self._step = gui.add_button(_ON, color="violet", hint="A step, as when the tip hits something.")
        if not self._simulated:
            gui.add_markdown("*The hand moves the handle here, and the load hangs on the tip: these only show both.*")
        with gui.add_folder("Recorded motion", expand_by_default=False, visible=self._simulated):
            self._motion = gui.add_dropdown("Motion", tuple(self._motions))
            self._play = gui.add_button("Move the handle so", icon="player-play")
            self._upload = gui.add_upload_button(
                "Motion from a CSV file",
                mime_type=".csv,text/csv",
                hint="With columns of time in s and angle, named such as time_s and angle_deg.",
            )
        for slider in self._hand:
            session.on(slider, "hand", self._move)
        for slider in self._force:
            session.on(slider, "force", self._load)
        session.on(self._step, "force", self._load_at_once)
        session.on(self._play, "play", lambda: session.link.play(self._motions[self._motion.value]))
        session.on(self._upload, "upload motion", self._add_motion)

    def show(self, now: Now) -> None:
        """Let the operator move what no protocol moves; all others see where it is."""
        free = now.operating and self._simulated and not running(now.status)
        enable((*self._hand, *self._force, self._axis, self._size, self._step, self._play), free)
        loaded = self._force[self._axis.options.index(self._axis.value)].value
        put(self._step, label=_OFF if loaded else _ON)
        if not free:
            for slider, angle in zip(self._hand, np.degrees(now.view.handle), strict=True):
                _follow(slider, angle)
            for slider, force in zip(self._force, now.view.force, strict=True):
                _follow(slider, force)

    def _move(self) -> None:
        self._session.link.hand(np.radians(_values(self._hand, self._reach)))

    def _load(self) -> None:
        self._session.link.force(_values(self._force, self._most))

    def _load_at_once(self) -> None:
        slider = self._force[self._axis.options.index(self._axis.value)]
        slider.value = 0.0 if slider.value else self._size.value
        self._load()

    def _add_motion(self) -> None:
        file = self._upload.value
        self._motions[file.name] = motion_protocol(file.content, file.name)
        self._motion.options = tuple(self._motions)
        self._motion.value = file.name
        self._session.tell(file.name, "Motion read", good=True)


def largest_force(inst: Instrument) -> float:
    """Return the largest load that the page offers, N: the largest that the instrument is tested with."""
    return round(max(inst.conditions.forces, default=inst.pretension / 30), 3)


def _usual_force(inst: Instrument, most: float) -> float:
    forces = sorted(inst.conditions.forces)
    return round(forces[(len(forces) - 1) // 2], 3) if forces else most / 2


def _values(sliders: list[Any], most: float) -> Array:
    """Return what sliders say, within what the page offers: a browser may send anything."""
    values = np.array([float(slider.value) for slider in sliders])
    if not np.isfinite(values).all():
        raise LiveError(f"a slider is at {values.tolist()}; allowed are finite numbers.")
    return values.clip(-most, most)


def _follow(slider: Any, value: float) -> None:
    if isfinite(value):
        shown = round(float(np.clip(value, slider.min, slider.max)), 1)
        if abs(slider.value - shown) > 0.05:
            slider.value = shown
