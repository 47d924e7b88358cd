"""The controller's choices, homing, and faults to try."""

from math import nan
from typing import Any, NamedTuple

from tenodesis.console.laws import ACTUATIONS, LAWS
from tenodesis.console.session import PageState, Session, enable, set_properties
from tenodesis.console.status import timing_line


LAWS = {
    "off": "Off: the motors stand still; what the load takes is lost.",
    "paper": "The paper's law (eq. 22) as a set point: winds by half the difference of the tensions.",
    "paper-feedback": "The paper's law in feedback: the difference of the tensions winds the spools on and on.",
    "exact": "The whole stroke that theory without friction asks for, slack included.",
    "robust": "Learns the friction from small strokes, and gives the angle back through it.",
}
"""Compensation laws."""

ACTUATIONS = {
    "agonist": "One motor winds the agonist tendon.",
    "differential": "Both motors work: one winds what the other lets out.",
}
"""Actuation modes."""


class _Fault(NamedTuple):
    place: str
    mode: str
    value: float
    seconds: float


_FAULTS = {
    "A load cell's cable breaks": _Fault("tension.agonist", "set", nan, 0.5),
    "A load cell freezes": _Fault("tension.agonist", "hold", 0.0, 1.0),
    "The handle's encoder jumps": _Fault("handle_angle", "add", 0.5, 0.5),
    "The controller gets no ticks": _Fault("tick", "hold", 0.0, 0.5),
    "A drive does not move": _Fault("spool_velocity.agonist", "set", 0.0, 1.0),
}


class LawTab:
    """Law, actuation, homing, and faults to try on the twin."""

    def __init__(self, session: Session) -> None:
        self._session = session
        gui: Any = session.client.gui
        status = session.link.status()
        self._law = gui.add_dropdown("Law", tuple(LAWS), initial_value=status.law)
        self._law_words = gui.add_markdown("")
        self._actuation = gui.add_dropdown("Motors", tuple(ACTUATIONS), initial_value=status.actuation)
        self._actuation_words = gui.add_markdown("")
        self._home = gui.add_button("Home: find the pretension again", icon="home")
        with gui.add_folder("Try a fault", expand_by_default=False, visible=session.link.capabilities.simulated):
            self._fault = gui.add_dropdown("Fault", tuple(_FAULTS))
            self._spoil = gui.add_button("Let it happen on the twin", color="orange")
        with gui.add_folder("How the loop keeps time", expand_by_default=False):
            self._timing = gui.add_html("")
        session.on(self._law, "law", self._choose)
        session.on(self._actuation, "law", self._choose)
        session.on(self._home, "request", lambda: session.link.request("home"))
        session.on(self._spoil, "tamper", lambda: session.link.tamper(*_FAULTS[self._fault.value]))

    def update(self, state: PageState) -> None:
        """Show what is chosen."""
        status = state.status
        enable((self._law, self._actuation, self._home, self._fault, self._spoil), state.operating)
        if not self._session.just_changed(self._law, self._actuation):
            set_properties(self._law, value=status.law)
            set_properties(self._actuation, value=status.actuation)
        set_properties(self._law_words, content=_small(LAWS.get(status.law, "")))
        set_properties(self._actuation_words, content=_small(ACTUATIONS.get(status.actuation, "")))
        set_properties(self._timing, content=timing_line(status))

    def _choose(self) -> None:
        self._session.link.law(self._law.value, self._actuation.value)


def _small(words: str) -> str:
    return f"*{words}*"
