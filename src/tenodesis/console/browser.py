"""All that one browser shows: panel, curves and view."""

import time
from typing import Any

from tenodesis.console.about import ABOUT
from tenodesis.console.controlling import Controlling
from tenodesis.console.experiments import Experiments
from tenodesis.console.files import Files
from tenodesis.console.header import Header
from tenodesis.console.instrument_file import InstrumentFile
from tenodesis.console.moving import Moving, largest_force
from tenodesis.console.plots import Plots
from tenodesis.console.scene import Scene
from tenodesis.console.session import Now, Part, Session
from tenodesis.console.view import View

_PANEL_EVERY = 0.2
_PLOTS_EVERY = 0.25
_WIDTH = 340


class Browser:
    """Builds what a browser shows for the instrument that runs, and keeps it up to date."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self._told = self._drawn = 0.0
        self.operating = False
        self.build()

    def build(self) -> None:
        """Build everything, for the first time or for another instrument."""
        session, inst = self.session, self.session.link.inst
        gui: Any = session.client.gui
        gui.reset()
        session.begin()
        self._inst = inst
        with session.client.atomic():
            self._header = Header(session, inst)
            tabs = gui.add_tab_group()
            with tabs.add_tab("Move"):
                moving = Moving(session, inst)
                look = gui.add_button_group("Look at", ("whole", "tip", "handle"))
            with tabs.add_tab("Law"):
                controlling = Controlling(session)
            with tabs.add_tab("Tests"):
                experiments = Experiments(session)
            with tabs.add_tab("Files"):
                self._files = Files(session, inst)
            with tabs.add_tab("Setup"):
                setup = InstrumentFile(session)
            with tabs.add_tab("Help"):
                gui.add_markdown(ABOUT)
            self._parts: tuple[Part, ...] = (self._header, moving, controlling, experiments, self._files, setup)
            self.plots = Plots(gui, inst, measured=session.link.capabilities.distal_encoder)
            self.scene = Scene(session.client, inst, largest_force(inst), small=session.small)
            self.scene.look("whole")
            gui.main_panel.dock_right()
            gui.main_panel.set_width(_WIDTH)
        session.on(look, "look", lambda: self.scene.look(look.value))

    def operate(self) -> None:
        """Become the operator if nobody is."""
        self.operating = self.session.link.acquire()

    @property
    def outdated(self) -> bool:
        """Whether another instrument runs than the one that is shown."""
        return self.session.link.inst != self._inst

    def tick(self, now: Now) -> None:
        """Do what was asked for, and show how things stand."""
        session = self.session
        for action in session.inbox.take():
            action()
        # Whoever starts another instrument operates that a moment later.
        if self.operating and not now.operating and not session.works("load"):
            other = now.status.operator
            session.tell("You watch now." if other is None else f"{other} has taken over; you watch now.", "Control")
        self.operating = now.operating
        seen: View = (self._files.replayed() if session.replaying else None) or now.view
        self.scene.show(seen)
        at = time.monotonic()
        if at - self._told >= _PANEL_EVERY:
            self._told = at
            self.scene.tell(seen, recorded=session.replaying)
            with session.client.atomic():
                for part in self._parts:
                    part.show(now)

    def wants_history(self) -> bool:
        """Return whether the curves are due."""
        return time.monotonic() - self._drawn >= _PLOTS_EVERY

    def draw(self, seconds: View) -> None:
        """Draw the curves."""
        self._drawn = time.monotonic()
        with self.session.client.atomic():
            self.plots.show(seconds)
