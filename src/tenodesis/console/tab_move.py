"""The tab of the motion: handle angles, recorded motions, and the load at the tip."""

import time
from math import copysign, degrees, floor, log10
from typing import Any, Literal

import numpy as np

from tenodesis import simulate
from tenodesis.console.more_sliders import MoreSliders, follow, slider_values
from tenodesis.console.session import PageState, Session, enable, set_properties
from tenodesis.errors import ProtocolError
from tenodesis.files import as_text
from tenodesis.instrument import Instrument
from tenodesis.live.controlled import serves_all
from tenodesis.live.status import RuntimeState
from tenodesis.simulate import Motion, Protocol
from tenodesis.simulate.places import Places

_APPLY, _REMOVE = "Apply the load as a step", "Remove the load as a step"
_SYNTHETIC = "wrist, synthetic"
_MOST_MOTIONS = 10
"""Motions of a browser that are kept."""
_ANGLE_UNITS: tuple[Literal["deg", "rad"], ...] = ("deg", "rad")
_MOVED = 0.02
"""Handle angle above which the handle counts as moved, rad."""
_HINTS = {
    (RuntimeState.DISABLED, True): "**3.** Press *Enable*: the motors bring the jaws back into the shadow.",
    (RuntimeState.PAUSED, True): "**3.** Press *Resume*: the motors bring the jaws back into the shadow.",
    (RuntimeState.ENABLED, True): "**4.** The motors restore the lost angle. Under *Law* choose *off* to see the loss.",
    (RuntimeState.DISABLED, False): "**3.** Press *Enable*, and under *Law* choose *{law}*: the jaws come back.",
    (RuntimeState.PAUSED, False): "**3.** Press *Resume*, and under *Law* choose *{law}*: the jaws come back.",
    (RuntimeState.ENABLED, False): "**4.** The angle is lost. Under *Law* choose *{law}*: the motors restore it.",
}
"""What to try next once the tip is loaded, by the state and whether the compensation is on."""


class MoveTab:
    """Sliders of handle angle and load, and recorded motions of the hand."""

    def __init__(self, session: Session, inst: Instrument) -> None:
        self._session, self._inst = session, inst
        gui: Any = session.client.gui
        self._simulated = session.link.capabilities.simulated
        self._motions = {_SYNTHETIC: simulate.load("wrist")}
        self._next = gui.add_markdown("", visible=False)
        most = largest_force(inst)
        fine = 10.0 ** floor(log10(most / 50))
        self._hand: list[Any] = []
        limits = {joint.name: joint.limits for joint in inst.handle_joints}
        for name, ends in (limits or dict(zip(inst.bends, inst.bend_limits.tolist(), strict=True))).items():
            low, high = (copysign(floor(10 * degrees(abs(end)) + 1e-6) / 10, end) for end in ends)
            label = f"{name.replace('_', ' ').capitalize()}, °"
            self._hand.append(gui.add_slider(label, min=low, max=high, step=0.1, initial_value=0.0))
        places = Places.of(inst)
        self._by_axis = places.takes_forces
        named = tuple(places.axes) if self._by_axis else tuple("xyz")
        hint = "Tangential force at the tip; a positive force opposes positive flexion."
        self._force: list[Any] = [
            gui.add_slider(
                f"Load {name}, N",
                min=-most,
                max=most,
                step=fine,
                initial_value=0.0,
                hint=hint if self._by_axis else "In the axes of the tip, z along it.",
            )
            for name in named
        ]
        self._axis = gui.add_dropdown("Step on", named, visible=len(named) > 1)
        self._size = gui.add_number("Step, N", initial_value=_usual_force(inst, most), min=-most, max=most, step=fine)
        self._step = gui.add_button(_APPLY, color="violet", hint="A sudden load, as when the tip hits tissue.")
        if not self._simulated:
            gui.add_markdown("*Here a hand moves the handle and weights load the tip; the sliders only show both.*")
        self._more = MoreSliders(session, inst, most)
        moved = self._simulated and bool(places.axes)
        with gui.add_folder("Recorded motion", expand_by_default=False, visible=moved):
            self._motion = gui.add_dropdown("Motion", tuple(self._motions))
            self._play = gui.add_button("Play the motion", icon="player-play")
            self._upload = gui.add_upload_button(
                "Motion from a CSV file",
                mime_type=".csv,text/csv",
                hint="With columns of time and angle, such as time_s and angle_deg.",
            )
        for slider in self._hand:
            session.on(slider, "hand", self._move)
        for slider in self._force:
            session.on(slider, "force", self._load)
        session.on(self._step, "force", self._toggle_load)
        for slider in self._more.moments:
            session.on(slider, "force", self._load)
        # Reading and planning a long motion takes seconds.
        session.on(self._play, "play", lambda: session.run_in_background("play", self._play_motion))
        session.on(self._upload, "upload motion", lambda: session.run_in_background("motion", self._add_motion))
        self._enabled_at = time.monotonic()
        """Time at which the sliders were enabled last, s."""

    def update(self, state: PageState) -> None:
        """Enable the sliders for the operator while no protocol runs; otherwise let them follow the instrument."""
        simulated = self._simulated or not self._inst.handle_joints
        free = state.operating and simulated and not state.status.protocol_runs
        loads = free and self._simulated
        enable(self._hand, free)
        enable((*self._force, self._axis, self._size, self._step, self._play), loads)
        set_properties(self._step, label=_REMOVE if self._step_slider.value else _APPLY)
        hint = next_to_try(state, self._inst) if loads else ""
        set_properties(self._next, content=hint, visible=bool(hint))
        if not free:
            self._enabled_at = time.monotonic()
        shown = state.shown
        # They follow until the browser moves one: the other's value is sent with it.
        if self._session.changed_at(*self._hand) < self._enabled_at:
            follow(self._hand, np.degrees(shown.handle if self._inst.handle_joints else shown.target))
        if self._session.changed_at(*self._force, *self._more.moments, self._step) < self._enabled_at:
            follow(self._force, shown.force if self._by_axis else shown.wrench[:3])
            follow(self._more.moments, 1e3 * shown.wrench[3 : 3 + len(self._more.moments)])
        self._more.update(state, self._enabled_at, free=free)

    @property
    def _step_slider(self) -> Any:
        """The slider of the load that is applied as a step."""
        return self._force[self._axis.options.index(self._axis.value)]

    def _move(self) -> None:
        self._session.link.hand(np.radians(slider_values(self._hand)))

    def _load(self) -> None:
        forces = slider_values(self._force)
        if self._by_axis:
            self._session.link.force(forces)
        else:
            self._session.link.wrench([*forces, *1e-3 * slider_values(self._more.moments)])

    def _toggle_load(self) -> None:
        self._step_slider.value = 0.0 if self._step_slider.value else self._size.value
        self._load()

    def _play_motion(self) -> None:
        self._session.link.play(self._motions[self._motion.value])

    def _add_motion(self) -> None:
        file = self._upload.value
        self._motions.pop(file.name, None)
        self._motions[file.name] = motion_protocol(file.content, file.name)
        for oldest in list(self._motions)[1:-_MOST_MOTIONS]:
            del self._motions[oldest]
        with self._session.client.atomic():
            self._motion.options = tuple(self._motions)
            self._motion.value = file.name
        self._session.notify(file.name, "Motion read", good=True)


def next_to_try(state: PageState, inst: Instrument) -> str:
    """Return as Markdown what a newcomer may try next."""
    shown, status = state.shown, state.status
    if not inst.handle_joints:
        if status.state in (RuntimeState.DISABLED, RuntimeState.PAUSED):
            way = "Enable" if status.state == RuntimeState.DISABLED else "Resume"
            return f"**1.** Press *{way}*, and move a slider: the motors turn the joints."
    elif not np.abs(shown.handle).max() > _MOVED:
        return "**1.** Move the handle: the jaws follow. The green shadow is where they should be."
    if not np.nanmax(np.abs([*shown.force, *shown.wrench]), initial=0.0) > 0:
        return "**2.** Apply the load: tissue pushes on the tip, and the jaws leave the shadow."
    hint = _HINTS.get((status.state, status.law != "off"), "")
    return hint.format(law="joints" if serves_all(inst) else "robust")


def largest_force(inst: Instrument) -> float:
    """Return the largest load that the page offers, N: the largest test force of the instrument file."""
    share = 30 if Places.of(inst).takes_forces else 10
    return round(max(inst.conditions.forces, default=inst.pretension / share), 3)


def _usual_force(inst: Instrument, most: float) -> float:
    forces = sorted(inst.conditions.forces)
    return round(forces[(len(forces) - 1) // 2], 3) if forces else most / 2


def motion_protocol(content: bytes, name: str) -> Protocol:
    """Return a protocol that moves the first axis as recorded in a CSV file.

    The time's column is the first whose name begins with time, the angle's the first that ends with deg or rad.

    Raises
    ------
    ProtocolError
        It is not UTF-8, or has no such columns, or they are no motion.
    """
    data = as_text(content, name, ProtocolError, "a CSV file")
    lines = (line for line in data.splitlines() if line.strip() and not line.lstrip().startswith("#"))
    header = [cell.strip().strip('"') for cell in next(lines, "").split(",")]
    times = [column for column in header if column.lower().startswith("time")]
    angles = [
        (column, unit) for column in header for unit in _ANGLE_UNITS if column.lower().rstrip("])").endswith(unit)
    ]
    if not times or not angles:
        raise ProtocolError(
            f"{name} has the columns {', '.join(header) or 'none'}; it must have one whose name begins with time, in "
            "s, and one whose name ends with deg or rad.",
            key="columns",
            value=header,
        )
    column, unit = angles[0]
    try:
        motion = Motion(data=data, time_column=times[0], angle_column=column, angle_unit=unit, limit=True)
    except ValueError as problem:
        raise ProtocolError(f"{name}: {problem}") from None
    return Protocol(name=name[:60], description="A recorded motion", phases=(motion,))
