"""The tab of the controller: law, motors, homing, faults to inject, and the loop's timing."""

from math import nan
from typing import Any, NamedTuple

from tenodesis.console.session import PageState, Session, enable, set_properties
from tenodesis.console.status import timing_line
from tenodesis.live.controlled import serves_all

LAWS = {
    "off": "Off: the motors are at rest; the angle lost under load is not restored.",
    "paper": "The paper's law (eq. 22) as a set point: winds by half the difference of the tensions.",
    "paper-feedback": "The paper's law in feedback: the spools wind as long as the tensions differ.",
    "exact": "The stroke of the frictionless theory, slack included.",
    "robust": "Estimates the friction from small strokes, and restores the lost angle in spite of it.",
    "joints": "Estimates all joints from all tendons, and restores what they lose as far as that is certain.",
}
"""Compensation laws, the last where no joint has a pair of tendons of its own."""

ACTUATIONS = {
    "agonist": "One motor winds the agonist tendon.",
    "differential": "Both motors act: one winds the length that the other lets out.",
}
"""Actuation modes."""


class _Fault(NamedTuple):
    """Arguments of the link's fault injection."""

    place: str
    mode: str
    value: float
    seconds: float


_TENSION_FAULTS = {
    "load-cell": ("A load cell's cable breaks", "A load cell freezes"),
    "current": ("A motor's current is lost", "A motor's current freezes"),
}
"""By ``sensors.kind``."""
_LOST, _FROZEN = _Fault("tension.agonist", "set", nan, 0.5), _Fault("tension.agonist", "hold", 0.0, 1.0)
_FAULTS = {
    "The handle's encoder jumps": _Fault("handle_angle", "add", 0.5, 0.5),
    "The controller gets no ticks": _Fault("tick", "hold", 0.0, 0.5),
    "A drive does not move": _Fault("spool_velocity.agonist", "set", 0.0, 1.0),
}


class LawTab:
    """Law, actuation, homing, and fault injection into the twin."""

    def __init__(self, session: Session) -> None:
        self._session = session
        gui: Any = session.client.gui
        status = session.link.status()
        inst = session.link.inst
        kind, all_joints = inst.sensors.kind, serves_all(inst)
        served = not all_joints
        laws = tuple(name for name in LAWS if name == "off" or (name == "joints") == all_joints)
        faults = dict(zip(_TENSION_FAULTS[kind], (_LOST, _FROZEN), strict=True)) | _FAULTS
        self._law = gui.add_dropdown("Law", laws, initial_value=status.law)
        self._law_text = gui.add_markdown("")
        self._actuation = gui.add_dropdown("Motors", tuple(ACTUATIONS), initial_value=status.actuation, visible=served)
        self._actuation_text = gui.add_markdown("", visible=served)
        finds = "learn stiffness and friction" if all_joints else "find the pretension again"
        self._home = gui.add_button(f"Home: {finds}", icon="home")
        tried = served and session.link.capabilities.simulated
        with gui.add_folder("Try a fault", expand_by_default=False, visible=tried):
            self._fault = gui.add_dropdown("Fault", tuple(faults))
            self._inject = gui.add_button("Inject it into the twin", color="orange")
        with gui.add_folder("Timing of the loop", expand_by_default=False):
            self._timing = gui.add_html("")
        session.on(self._law, "law", self._choose)
        session.on(self._actuation, "law", self._choose)
        session.on(self._home, "request", lambda: session.link.request("home"))
        session.on(self._inject, "inject_fault", lambda: session.link.inject_fault(*faults[self._fault.value]))

    def update(self, state: PageState) -> None:
        """Show the choices that are in force."""
        status = state.status
        enable((self._law, self._actuation, self._home, self._fault, self._inject), state.operating)
        if not self._session.just_changed(self._law, self._actuation):
            set_properties(self._law, value=status.law)
            set_properties(self._actuation, value=status.actuation)
        set_properties(self._law_text, content=f"*{LAWS.get(status.law, '')}*")
        set_properties(self._actuation_text, content=f"*{ACTUATIONS.get(status.actuation, '')}*")
        set_properties(self._timing, content=timing_line(status))

    def _choose(self) -> None:
        self._session.link.law(self._law.value, self._actuation.value)
