"""What a browser shows: panel, curves and view."""

import time
from typing import Any

import numpy as np

from tenodesis.console.display import ShownSignals
from tenodesis.console.plots import Plots
from tenodesis.console.scene import Drawn, Scene, in_degrees
from tenodesis.console.session import PageState, PanelSection, Session
from tenodesis.console.status import StatusHeader
from tenodesis.console.tab_files import FilesTab
from tenodesis.console.tab_law import LawTab
from tenodesis.console.tab_move import MoveTab, largest_force
from tenodesis.console.tab_protocols import ProtocolsTab
from tenodesis.console.tab_setup import SetupTab
from tenodesis.instrument import Instrument
from tenodesis.kinematics.chain import bend_side
from tenodesis.live.controlled import controlled

_PANEL_PERIOD = 0.2  # s
_PLOTS_PERIOD = 0.25  # s
_WIDTH = 340  # pixels

_HANDLE = """
**What you see.** An instrument for keyhole surgery. The dark **grip** at the top is in the surgeon's hand, the pale
**disc** is the wall of the patient's body, and the **jaws** at the bottom work inside. The tube between them is drawn
shorter than it is.

**How it works.** Turn the grip, and its joints pull thin **tendons** in the tube, which bend the joints at the other
end.
"""
_DRIVEN = """
**What you see.** The end of an instrument whose motors pull thin **tendons**, which turn its joints.

**How it works.** *Enable* the motors, and move a slider: the motors wind the tendons as far as the joints would need if
no tendon stretched.
"""
_LOST = """
**What goes wrong.** Tendons stretch under load. When tissue pushes on the tip (**violet arrow**), the jaws lose angle:
they are no longer where the hand points them. The **green shadow** shows where they should be.

**What the motors do.** A motor at each tendon winds up the stretch. The controller computes it from {measured}; it
needs no sensor at the tip.

**Try it.**
1. Move a slider of the *Handle*: the jaws follow, and the shadow with them.
2. Put a load on the tip: the jaws leave the shadow. The tendons change colour with their tension.
3. Press *Enable* and choose the law *robust*: the motors bring the jaws back into the shadow. Choose *off*: they leave
   it again.
"""
_STOP = """
**STOP** halts the motors at once, from any browser. The Esc key does the same.
"""
_MEASURED = {"load-cell": "the tendon tensions at the handle", "current": "the currents of the motors"}
"""What the controller measures, by ``sensors.kind``."""


# Phases in which the tip is left behind on purpose.
_HELD_BACK = {4.0: ", restrained", 5.0: ", at the force limit"}


class Browser:
    """Builds what a browser shows for the instrument that runs, and keeps it up to date."""

    plots: Plots
    scene: Scene

    def __init__(self, session: Session) -> None:
        self.session = session
        self._panel_updated = self._plots_drawn = 0.0
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
            self._sections = self._fill(gui)
            self.scene.look("whole")
            gui.main_panel.dock_right()
            gui.main_panel.set_width(_WIDTH)

    def _fill(self, gui: Any) -> tuple[PanelSection, ...]:
        """Add panel, curves and view, and return the sections of the panel."""
        session, inst = self.session, self._inst
        header = StatusHeader(session, inst)
        tabs = gui.add_tab_group()
        with tabs.add_tab("Move"):
            move = MoveTab(session, inst)
            self._add_look(gui, ("whole", "tip", "handle") if inst.handle_joints else ("whole", "tip"))
        with tabs.add_tab("Law"):
            law = LawTab(session)
        with tabs.add_tab("Tests"):
            protocols = ProtocolsTab(session)
        with tabs.add_tab("Files"):
            self._files = FilesTab(session, inst)
        with tabs.add_tab("Setup"):
            setup = SetupTab(session)
        with tabs.add_tab("Help"):
            gui.add_markdown(_help(inst))
        known = session.link.capabilities
        self.plots = Plots(gui, inst, measured=known.distal_encoder, simulated=known.simulated)
        parts = session.folders.parts
        self.scene = Scene(session.client, inst, largest_force(inst), parts=parts, small=session.small)
        return header, move, law, protocols, self._files, setup

    def _add_look(self, gui: Any, names: tuple[str, ...]) -> None:
        look = gui.add_button_group("Look at", names)
        self.session.on(look, "look", lambda: self.scene.look(look.value))

    def operate(self) -> None:
        """Become the operator if there is none."""
        self.operating = self.session.link.acquire()

    @property
    def outdated(self) -> bool:
        """Whether the instrument that runs is not the one shown."""
        return self.session.link.inst != self._inst

    def tick(self, state: PageState) -> None:
        """Run the browser's requests, and show the state."""
        session = self.session
        for action in session.requests.take_all():
            action()
        # A browser that starts another instrument becomes its operator a moment later.
        if self.operating and not state.operating and not session.is_busy("load"):
            other = state.status.operator
            session.notify("You watch now." if other is None else f"{other} has taken over; you watch now.", "Control")
        self.operating = state.operating
        shown = (self._files.replayed() if session.replaying else None) or state.shown
        self.scene.show(self._drawn(shown))
        now = time.monotonic()
        if now - self._panel_updated >= _PANEL_PERIOD:
            self._panel_updated = now
            text = self._text(shown)
            self.scene.write(f"recorded:\n{text}" if session.replaying else text)
            with session.client.atomic():
                for section in self._sections:
                    section.update(state)

    def _drawn(self, shown: ShownSignals) -> Drawn:
        """Return what the view shows."""
        ends = len(self._inst.bearing)
        push = np.nan_to_num(shown.wrench[:3])
        for joint, force in zip(
            self._inst.tip_joints, np.nan_to_num([shown.force, shown.contact_force]).sum(0), strict=True
        ):
            # It pushes on the tip against positive flexion, and turns with the tip.
            push = push - force * bend_side(joint.axis_vector)
        tension = np.stack([shown.tension, shown.distal_tension], -1)
        # Of several ends each bears an equal share.
        return Drawn(shown.handle, shown.output, shown.target, tension, np.tile(push / ends, (ends, 1)))

    def _text(self, shown: ShownSignals) -> str:
        """Return what is written at the tip: its angles and targets."""
        bends = self._inst.bends
        rows = [
            (name, np.degrees(shown.output[of].sum()), np.degrees(shown.target[of].sum()), shown.phase[of[0]])
            for name, of in bends.items()
        ]
        deviation = 2 * shown.force_deviation
        forces = [(name, shown.estimated_force[of[0]], deviation[of[0]]) for name, of in bends.items()]
        angles = [
            (joint, in_degrees(output), in_degrees(target) + _HELD_BACK.get(phase, ""))
            for joint, output, target, phase in rows
        ]
        if len(angles) == 1:
            lines = [f"{joint} {output}\ntarget {target}" for joint, output, target in angles]
        else:
            lines = ["tip, target", *(f"{joint} {output}, {target}" for joint, output, target in angles)]
        lines += [f"{joint} force {force:+.1f} ± {width:.1f} N" for joint, force, width in forces if np.isfinite(width)]
        return "\n".join(lines)

    def needs_history(self) -> bool:
        """Return whether the curves are to be drawn again."""
        return time.monotonic() - self._plots_drawn >= _PLOTS_PERIOD

    def draw(self, history: ShownSignals) -> None:
        """Draw the curves."""
        self._plots_drawn = time.monotonic()
        with self.session.client.atomic():
            self.plots.show(history)


def _help(inst: Instrument) -> str:
    """Return in Markdown what a newcomer may want to know."""
    seen = _HANDLE if inst.handle_joints else _DRIVEN
    served = controlled(inst)[0] is not None
    return seen + (_LOST.format(measured=_MEASURED[inst.sensors.kind]) if served else "") + _STOP
