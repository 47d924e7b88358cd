"""All that one browser shows: panel, curves and view."""

import time
from typing import Any

from tenodesis.console.about import ABOUT
from tenodesis.console.tab_law import LawTab
from tenodesis.console.tab_tests import TestsTab
from tenodesis.console.tab_files import FilesTab
from tenodesis.console.status import StatusHeader
from tenodesis.console.tab_setup import SetupTab
from tenodesis.console.tab_move import MoveTab, largest_force
from tenodesis.console.plots import Plots
from tenodesis.console.scene import Scene
from tenodesis.console.session import PageState, PanelSection, Session
from tenodesis.console.display import ShownSignals

ABOUT = """
**What you see.** A surgeon's instrument for keyhole surgery. The dark **grip** at the top is in the surgeon's hand, the
pale **disc** is the wall of the patient's body, and the **jaws** at the bottom work inside. The tube between them is
drawn short.

**How it works.** Turn the grip, and a pair of rolling gears pulls thin **tendons** in the tube; at the other end
another pair bends the jaws. The smaller gears down there bend about twice as far as the hand turns.

**What goes wrong.** Tendons stretch, like hard rubber bands. When tissue pushes the tip (**violet arrow**), it gives
way: the jaws are no longer where the hand wants them. The **green shadow** shows where they should be.

**What the motors do.** A motor at each tendon winds in what the stretch has taken, going by the tension it feels at the
handle's end alone. Nobody has to look at the tip.

**Try it.**
1. Move the slider *Handle yaw*: the jaws follow, and the shadow with them.
2. Put a load on the tip: the jaws fall behind the shadow. The tendons change colour with their tension.
3. Press *Enable* and choose the law *robust*: the motors bring the jaws back into the shadow. Choose *off* and see
   them go.

**STOP** halts the motors at once, for everybody. The Esc key does the same.
"""

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
        session.reset()
        self._inst = inst
        with session.client.atomic():
            self._header = StatusHeader(session, inst)
            tabs = gui.add_tab_group()
            with tabs.add_tab("Move"):
                moving = MoveTab(session, inst)
                look = gui.add_button_group("Look at", ("whole", "tip", "handle"))
            with tabs.add_tab("Law"):
                controlling = LawTab(session)
            with tabs.add_tab("Tests"):
                experiments = TestsTab(session)
            with tabs.add_tab("Files"):
                self._files = FilesTab(session, inst)
            with tabs.add_tab("Setup"):
                setup = SetupTab(session)
            with tabs.add_tab("Help"):
                gui.add_markdown(ABOUT)
            self._parts: tuple[PanelSection, ...] = (self._header, moving, controlling, experiments, self._files, setup)
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

    def tick(self, state: PageState) -> None:
        """Do what was asked for, and show how things stand."""
        session = self.session
        for action in session.requests.take_all():
            action()
        # Whoever starts another instrument operates that a moment later.
        if self.operating and not state.operating and not session.is_busy("load"):
            other = state.status.operator
            session.notify("You watch state." if other is None else f"{other} has taken over; you watch state.", "Control")
        self.operating = state.operating
        seen: ShownSignals = (self._files.replayed() if session.replaying else None) or state.shown
        self.scene.show(seen)
        at = time.monotonic()
        if at - self._told >= _PANEL_EVERY:
            self._told = at
            self.scene.tell(seen, recorded=session.replaying)
            with session.client.atomic():
                for part in self._parts:
                    part.show(state)

    def wants_history(self) -> bool:
        """Return whether the curves are due."""
        return time.monotonic() - self._drawn >= _PLOTS_EVERY

    def draw(self, seconds: ShownSignals) -> None:
        """Draw the curves."""
        self._drawn = time.monotonic()
        with self.session.client.atomic():
            self.plots.show(seconds)
