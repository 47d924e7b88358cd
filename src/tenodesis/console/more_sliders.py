"""What only some instruments have in the tab of the motion: moments, an object between jaws, motors by tendon."""

from math import isfinite
from typing import Any

import numpy as np

from tenodesis.console.session import PageState, Session, enable, set_properties
from tenodesis.errors import LiveError
from tenodesis.instrument import Instrument
from tenodesis.live.controlled import free_motors
from tenodesis.run import Array
from tenodesis.simulate.places import Places


class MoreSliders:
    """Moments on the tip, what the jaws hold, and motors that no controller commands.

    Parameters
    ----------
    session
        The browser's session.
    inst
        The instrument.
    largest_force
        That the page offers, N; the largest moment is that of half of it at the end-effector's length.
    """

    def __init__(self, session: Session, inst: Instrument, largest_force: float) -> None:
        self._session = session
        gui: Any = session.client.gui
        simulated = session.link.capabilities.simulated
        self.moments: list[Any] = []
        """Sliders, mN m."""
        if not Places.of(inst).takes_forces:
            length = max(inst.tip_joints[end].end_effector_length or 0.0 for end in inst.bearing)
            most = float(f"{500 * largest_force * length:.2g}")
            with gui.add_folder("Moment on the tip", expand_by_default=False, visible=simulated):
                self.moments = [gui.add_slider(f"Moment {axis}, mN·m", -most, most, most / 100, 0.0) for axis in "xyz"]
        self._object: list[Any] = []
        if inst.grip is not None:
            widest = 1e3 * float(np.abs(inst.grip_arms) @ [joint.range for joint in inst.tip_joints])
            self._object = [
                gui.add_checkbox("Object between the jaws", initial_value=False, visible=simulated),
                gui.add_number("Opening, mm", 1.0, min=0.0, max=widest, step=0.1, hint="At which the jaws touch it."),
                gui.add_number("Stiffness, N/mm", 5.0, min=0.01, max=1000.0, step=0.01),
            ]
        self._radius = inst.own_drives.spool_radius
        self._tendons = free_motors(inst)
        self._motors: list[Any] = []
        if self._tendons:
            ways = np.abs(inst.tendon_arms("tip")) @ [joint.range for joint in inst.tip_joints] / self._radius
            most = float(np.ceil(np.degrees(ways.max()) / 10) * 10)
            with gui.add_folder("Motors by tendon", expand_by_default=False):
                gui.add_markdown("*These follow the sliders while the motors are enabled; no law commands them.*")
                self._motors = [
                    gui.add_slider(f"Spool {inst.tendons[n].name}, °", -most, most, 0.1, 0.0, hint="Positive winds.")
                    for n in self._tendons
                ]
        for control in self._object:
            session.on(control, "hold", self._hold)
        for slider in self._motors:
            session.on(slider, "motors", lambda: session.link.motors(np.radians(slider_values(self._motors))))

    def update(self, state: PageState, enabled_at: float, *, free: bool) -> None:
        """Enable the controls for the operator; until one is moved they follow."""
        enable((*self.moments, *self._object, *self._motors), free)
        if self._motors and self._session.changed_at(*self._motors) < enabled_at:
            follow(self._motors, np.degrees(state.shown.stroke[self._tendons] / self._radius))

        if self._object and not self._session.just_changed(*self._object):
            held = self._session.link.latest().get("commands", {}).get("held")
            set_properties(self._object[0], value=held is not None and bool(held[1]))

    def _hold(self) -> None:
        there, *numbers = self._object
        opening, stiffness = slider_values(numbers)
        self._session.link.hold(1e-3 * float(opening), 1e3 * float(stiffness) if there.value else 0.0)


def slider_values(sliders: list[Any]) -> Array:
    """Return the values of sliders, clipped to their ranges: a browser may send anything."""
    values = np.array([float(slider.value) for slider in sliders])
    if not np.isfinite(values).all():
        raise LiveError(key="slider", value=values.tolist(), allowed="finite")
    return values.clip([slider.min for slider in sliders], [slider.max for slider in sliders])


def follow(sliders: list[Any], values: Array) -> None:
    """Set sliders to values, rounded to their steps; unknown values are left out."""
    for slider, value in zip(sliders, values, strict=True):
        if isfinite(value):
            shown = round(float(np.clip(value, slider.min, slider.max)) / slider.step) * slider.step
            if abs(slider.value - shown) > slider.step / 2:
                slider.value = round(shown, 9)
