"""The top of the panel: state, faults, who operates, and the way on from here."""

from functools import partial
from typing import Any

from tenodesis.console.colours import TensionColours
from tenodesis.console.session import Now, Session, enable, put
from tenodesis.console.status_line import status_line
from tenodesis.instrument import Instrument
from tenodesis.live.commands import ControllerRequest

_NEXT: dict[str, tuple[tuple[str, ControllerRequest], ...]] = {
    "DISABLED": (("Enable", "enable"),),
    "ENABLED": (("Pause", "pause"), ("Disable", "disable")),
    "PAUSED": (("Resume", "resume"), ("Disable", "disable")),
    "FAULT": (("Clear the fault", "clear"),),
}
"""What can be asked next in each state."""


class Header:
    """State and the next steps."""

    def __init__(self, session: Session, inst: Instrument) -> None:
        self._session = session
        gui: Any = session.client.gui
        self._line = gui.add_html("")
        gui.add_html(f'<div style="padding:.35em .8em .2em">{TensionColours(inst).legend()}</div>')
        self._take = gui.add_button("Take control", color="blue", hint="From then on others watch.")
        self._restart = gui.add_button("Start the instrument again", color="orange", visible=False)
        self._buttons: dict[ControllerRequest, Any] = {
            what: gui.add_button(label, color=_colour(what), visible=False)
            for steps in _NEXT.values()
            for label, what in steps
        }
        session.on(self._take, "operator", self._acquire)
        session.on(self._restart, "restart", lambda: session.work("restart", session.link.restart))
        for what, button in self._buttons.items():
            session.on(button, "request", partial(session.link.request, what))

    def show(self, now: Now) -> None:
        """Show state and the next steps."""
        status = now.status
        starting = self._session.works("load", "restart")
        put(self._line, content=status_line(status, self._session.origin, self._notes(starting=starting)))
        other = status.operator is not None and not now.operating
        put(
            self._take,
            visible=not now.operating and status.state != "GONE",
            label="Take control from whoever operates" if other else "Take control",
        )
        put(self._restart, visible=status.state == "GONE" and not starting)
        offered = {what for _, what in _NEXT.get(status.state, ())}
        for what, button in self._buttons.items():
            put(button, visible=now.operating and what in offered)
        enable(self._buttons.values(), now.operating)

    def _notes(self, *, starting: bool) -> list[str]:
        notes = ["An instrument is being started."] if starting else []
        if self._session.replaying:
            notes.append("The view replays a recording; all else on this page is live.")
        return notes

    def _acquire(self) -> None:
        other = self._session.link.status().operator
        if not self._session.link.acquire(force=other is not None):
            self._session.tell("Somebody else operates now.", "You watch")


def _colour(what: str) -> Any:
    return {"enable": "green", "resume": "green", "clear": "orange"}.get(what, "gray")
