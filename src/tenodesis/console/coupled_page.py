"""The page of a coupled instrument: all joints in space, moved by its twin in real time."""

import time
from collections.abc import Mapping
from html import escape
from math import degrees, floor, isfinite
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tenodesis.console.browser import Browser
from tenodesis.console.coupled_loop import Asked, CoupledLoop, spool_radius
from tenodesis.console.page import Page
from tenodesis.console.plots import ESTIMATED, INK, TARGET, TensionColours, add_chart, without_gaps
from tenodesis.console.scene import Drawn, Scene, in_degrees
from tenodesis.console.session import Folders, PageState, PanelSection, Session, as_plain, enable
from tenodesis.console.status import StatusHeader
from tenodesis.console.tab_move import follow, slider_values
from tenodesis.control import estimated_wrench, pairs
from tenodesis.instrument import FullForm, InstrumentLike, expanded
from tenodesis.run import Array, Run
from tenodesis.statics import chain
from tenodesis.twin import Held

_FRAME_RATE = 25.0
"""Frames that are sent to every browser, Hz."""
_LAWS = ("robust", "off")
_LARGEST_FORCE = 0.1
"""Largest force that the page offers, over the pretension."""
_HELP = """
**What you see.** A wrist whose tendons may cross several joints. Tendons have the colour of their tension, grey when
slack. The **green shadow** is where the tip would be without load and friction; the **violet arrow** is the force at
the tip.

**What it is.** The twin of the instrument, in real time: friction at every bend of every tendon, inertia of the links,
and what the jaws hold. If it cannot go on, it stays as it is and says why.

**The motors.** Where a joint has a pair of tendons of its own, *Enable* lets the motors give back what it loses. With
the law *off*, or disabled, they rest and keep what they have wound until *Reset*. Without a handle, the sliders are the
set points of the motors: the angles of the joints if no tendon stretched.
"""


class CoupledShown(NamedTuple):
    """What browsers show of rows of a run."""

    run: Run
    target: Array
    """Angles of the tip's joints without load and friction, rad, (rows, joints)"""
    asked: Asked


def shown_rows(inst: FullForm, signals: Mapping[str, Any]) -> CoupledShown:
    """Return what browsers show of a link's signals."""
    run = signals["run"]
    # Without a handle, the lengths that the motors have wound are what the tip is asked for.
    strokes = 0.0 if inst.handle_joints else run["spool_angle"] * spool_radius(inst)
    target = chain.output_angles(inst, run.by_column("handle_angle"), strokes=strokes)
    return CoupledShown(run, target, signals["asked"])


class CoupledPage(Page):
    """The page while it is served, made by :func:`serve_coupled`; closing it ends the twin, too."""

    def __init__(self, loop: CoupledLoop, *, host: str, port: int, token: str | None) -> None:
        self._loop = loop
        super().__init__(loop.connect, host=host, port=port, token=token, folders=Folders(Path(), ()))

    @property
    def frame_rate(self) -> float:
        """Frames that are sent to every browser, Hz."""
        return _FRAME_RATE

    def close(self) -> None:
        """Stop serving, and the twin."""
        super().close()
        self._loop.close()

    def _browser(self, session: Session) -> Browser:
        return CoupledBrowser(session, self._loop)

    def _shown(self, inst: FullForm, signals: Mapping[str, Any]) -> CoupledShown:
        return shown_rows(inst, signals)


class CoupledBrowser(Browser):
    """Builds what a browser shows, and keeps it up to date."""

    def __init__(self, session: Session, loop: CoupledLoop) -> None:
        self._loop = loop
        super().__init__(session)

    def _fill(self, gui: Any) -> tuple[PanelSection, ...]:
        session, inst = self.session, self._loop.inst
        header = StatusHeader(session, inst)
        tabs = gui.add_tab_group()
        with tabs.add_tab("Move"):
            controls = Controls(session, self._loop)
            self._add_look(gui, ("whole", "tip", "handle") if inst.handle_joints else ("whole", "tip"))
        with tabs.add_tab("Help"):
            gui.add_markdown(f"**{as_plain(inst.name)}** {as_plain(inst.description)}\n{_HELP}")
        curves = CoupledCurves(gui, inst)
        self.plots = curves
        self.scene = Scene(session.client, inst, largest_force(inst), small=session.small)
        return header, controls, curves

    def _drawn(self, shown: CoupledShown) -> Drawn:
        run, inst = shown.run, self._loop.inst
        ends = len(inst.bearing)
        return Drawn(
            handle=run.by_column("handle_angle")[-1],
            output=run.by_column("output_angle")[-1],
            target=shown.target[-1],
            tension=np.stack([run["tension"][-1], run["distal_tension"][-1]], -1),
            # Of several ends each bears an equal share.
            force=np.tile(shown.asked.force / ends, (ends, 1)),
        )

    def _text(self, shown: CoupledShown) -> str:
        lines = ["angle, lost"]
        for j, joint in enumerate(self._loop.inst.tip_joints):
            angle, target = np.degrees(shown.run.by_column("output_angle")[-1, j]), np.degrees(shown.target[-1, j])
            lines.append(f"{joint.name} {in_degrees(angle)}, {in_degrees(target - angle)}")
        return "\n".join(lines)


class Controls:
    """Sliders of joints and force, the object between the jaws, the law and the reset."""

    def __init__(self, session: Session, loop: CoupledLoop) -> None:
        self._session, self._loop = session, loop
        gui: Any = session.client.gui
        link: Any = session.link
        inst = loop.inst
        self._angles = [
            gui.add_slider(f"{_words(joint.name)}, °", -most, most, 0.1, 0.0)
            for joint in loop.driven
            for most in (floor(10 * degrees(joint.range) + 1e-6) / 10,)
        ]
        most = largest_force(inst)
        self._force = [
            gui.add_slider(f"Force {axis}, N", -most, most, 0.01, 0.0, hint="In the axes of the tip, z along it.")
            for axis in "xyz"
        ]
        self._object: list[Any] = []
        if inst.grip is not None:
            widest = 1e3 * float(np.abs(inst.grip_arms) @ [joint.range for joint in inst.tip_joints])
            self._object = [
                gui.add_checkbox("Object between the jaws", initial_value=False),
                gui.add_number("Opening, mm", 1.0, min=0.0, max=widest, step=0.1, hint="At which the jaws touch it."),
                gui.add_number("Stiffness, N/mm", 5.0, min=0.0, max=1000.0, step=0.1),
            ]
        law = link.status().law
        laws = _LAWS if law in _LAWS else (law, *_LAWS)
        self._law = gui.add_dropdown("Law", laws, initial_value=law, visible=loop.controller is not None)
        if loop.refused is not None and inst.handle_joints:
            gui.add_markdown(as_plain(loop.refused))
        self._reset = gui.add_button("Reset: at rest, without load", color="gray")
        for slider in self._angles:
            session.on(slider, "hand", lambda: link.hand(np.radians(slider_values(self._angles))))
        for slider in self._force:
            session.on(slider, "force", lambda: link.force(slider_values(self._force)))
        for control in self._object:
            session.on(control, "hold", self._hold)
        session.on(self._law, "law", lambda: link.law(self._law.value, link.status().actuation))
        session.on(self._reset, "reset", self._begin_again)
        self._enabled_at = time.monotonic()

    def update(self, state: PageState) -> None:
        """Enable the controls for the operator; otherwise let them follow."""
        shown: Any = state.shown
        asked: Asked = shown.asked
        if not state.operating:
            self._enabled_at = time.monotonic()
        enable((*self._angles, *self._force, *self._object, self._law, self._reset), state.operating)
        for sliders, values in ((self._angles, np.degrees(asked.angles)), (self._force, asked.force)):
            if self._session.changed_at(*sliders) < self._enabled_at:
                follow(sliders, values)
        if self._object and not self._session.just_changed(*self._object):
            held = asked.held is not None
            if self._object[0].value != held:
                self._object[0].value = held
        if self._law.value != state.status.law and not self._session.just_changed(self._law):
            self._law.value = state.status.law

    def _hold(self) -> None:
        there, opening, stiffness = self._object
        link: Any = self._session.link
        given = slider_values([opening, stiffness])
        link.hold(Held(1e-3 * float(given[0]), 1e3 * float(given[1])) if there.value else None)

    def _begin_again(self) -> None:
        link: Any = self._session.link
        link.reset()
        self._enabled_at = time.monotonic()


class CoupledCurves:
    """Curves of the angles in the last seconds, and the readings of now."""

    def __init__(self, gui: Any, inst: FullForm) -> None:
        self._inst, self._colours = inst, TensionColours(inst)
        joints = [joint.name for joint in inst.tip_joints]
        self._compensated = [pair.joint for pair in pairs(inst).values()]
        panel = gui.add_panel()
        with panel.add_tab("Curves"):
            self._charts = [
                add_chart(
                    gui,
                    f"{_words(name)}, deg",
                    {"unloaded": TARGET, "twin": INK, **({"estimated": ESTIMATED} if j in self._compensated else {})},
                    height=112,
                )
                for j, name in enumerate(joints)
            ]
            self._readings = gui.add_html("")
        panel.dock_left()
        panel.set_width(380)

    def show(self, seconds: CoupledShown) -> None:
        """Draw the last seconds."""
        run = seconds.run
        if len(run) < 2:
            return
        estimated = run.by_column("estimated_output_angle") if run.estimated_output_angle is not None else None
        for j, chart in enumerate(self._charts):
            angle, target = np.degrees(run.by_column("output_angle")[:, j]), np.degrees(seconds.target[:, j])
            curves = [without_gaps(target, angle), angle]
            if j in self._compensated:
                known = angle if estimated is None else np.degrees(estimated[:, self._compensated.index(j)])
                curves.append(without_gaps(known, angle))
            chart.data = (run.time, *curves)

    def update(self, state: PageState) -> None:
        """Show the readings of now."""
        shown: Any = state.shown
        content = readings(self._inst, shown, self._colours)
        if self._readings.content != content:
            self._readings.content = content


def readings(inst: FullForm, shown: CoupledShown, colours: TensionColours) -> str:
    """Return as HTML angles with what they have lost, tensions, grip force and, from the law, its estimates."""
    run = shown.run
    angles, target = np.degrees(run.by_column("output_angle")[-1]), np.degrees(shown.target[-1])
    known = dict(zip(run.compensated, _last(run, "estimated_output_angle"), strict=False))
    rows: list[tuple[str, ...]] = [("joint", "angle", "unloaded", "lost", "estimated")]
    for j, joint in enumerate(inst.tip_joints):
        lost = in_degrees(target[j] - angles[j], 2)
        estimated = in_degrees(degrees(known[joint.name]), 2) if isfinite(known.get(joint.name, np.nan)) else "–"
        rows.append((joint.name, in_degrees(angles[j], 2), in_degrees(target[j], 2), lost, estimated))
    text = [_table(rows)]
    tension = run["tension"][-1]
    swatches = [f'<span style="color:rgb{tuple(map(int, colour))}">&#9632;</span>' for colour in colours(tension)]
    cells = [
        f"{swatch} {tendon.name} {value:.1f} N{'' if value > colours.slack else ' <b>slack</b>'}"
        for swatch, tendon, value in zip(swatches, inst.tendons, tension, strict=True)
    ]
    text.append(f"<div>{' &nbsp;'.join(cells)}</div>")
    if inst.grip is not None:
        text.append(f"<div>Grip force on the object: {float(run['grip_force'][-1]):.2f} N</div>")
    if run.compensated and np.isfinite(_last(run, "estimated_force")).any():
        wrench = estimated_wrench(inst, run)
        deviations = np.sqrt(np.diagonal(wrench.covariance[-1]))
        forces = (
            f"{axis} {force:+.2f} ± {deviation:.2f} N"
            for axis, force, deviation in zip("xyz", wrench.wrench[-1], deviations, strict=False)
        )
        text.append(f"<div>Force at the tip by the law's estimate: {', '.join(forces)}</div>")
    return f'<div style="font-size:.75rem;line-height:1.45;color:#1b2733;padding:.2em .8em">{"".join(text)}</div>'


def serve_coupled(
    inst: InstrumentLike,
    host: str = "127.0.0.1",
    port: int = 8080,
    token: str | None = None,
    *,
    law: str = "robust",
    actuation: str = "differential",
    seed: int = 0,
) -> CoupledPage:
    """Serve the page of a coupled instrument, moved by its twin in real time.

    Parameters
    ----------
    inst
        The instrument, or its name or path.
    host, port, token
        As of :func:`serve`.
    law, actuation
        Of the controller, where joints have a pair of tendons of their own; its motors are off at first.
    seed
        Seed of the twin's sensor noise.

    Raises
    ------
    InstrumentError
        There is no such instrument, or it is not valid.
    ArgumentError
        The token is too short, or law or actuation is unknown.
    LiveError
        This machine does not have the address.
    """
    loop = CoupledLoop(expanded(inst), law=law, actuation=actuation, seed=seed)
    try:
        return CoupledPage(loop, host=host, port=port, token=token)
    except BaseException:
        loop.close()
        raise


def largest_force(inst: FullForm) -> float:
    """Return the largest force that the page offers, N."""
    return round(_LARGEST_FORCE * inst.pretension, 2)


def _last(run: Run, name: str) -> Array:
    return run.by_column(name)[-1] if name in run.signals() else np.zeros(0)


def _words(name: str) -> str:
    return name.replace("_", " ").capitalize()


def _table(rows: list[tuple[str, ...]]) -> str:
    lines = [
        "".join(
            f'<td style="padding-right:1em;text-align:{"right" if n else "left"}">{escape(cell)}</td>'
            for n, cell in enumerate(row)
        )
        for row in rows
    ]
    return f"<table>{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"
