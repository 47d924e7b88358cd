"""A load that comes suddenly on the held instrument, on the twin: what every joint loses (Fig. 15, dotted lines)."""

from typing import NamedTuple

import numpy as np

from tenodesis import simulate, statics, twin
from tenodesis.control import Controller
from tenodesis.errors import NoSolutionError
from tenodesis.instrument import ShortForm
from tenodesis.paper import published
from tenodesis.paper.context import DRAWN, Context, RecordedRun, has_friction, held_angles, shown_force
from tenodesis.paper.subject import HeldState, Load, Subject, panels
from tenodesis.report import style
from tenodesis.report.content import Array, Plot, ResultColumn, ResultTable, Section, fixed, named
from tenodesis.report.curves import SteppedCurve, step_response
from tenodesis.run import Run
from tenodesis.simulate.command import SMOOTH

BEFORE, AFTER = 10.0, 10.0
"""Time before the load, which in the paper comes near 10 s, and under it, s."""
APPROACH = float(np.radians(20))
"""Highest speed at which a planar instrument's handle is brought to its angle, rad/s."""
REACHED, RESTED, LOADED = 3.0, 1.0, 3.0
"""Time in which several joints reach their state, rest before the load, and time under it, s."""
RISE = 0.05
"""Time in which the load comes on several joints, s."""
_SEED = 15
_TITLE = "A sudden load on the held instrument"
_TOLERANCE = 1e-5  # rad
_SETTLED = 400  # samples
_SHOWN = 0.5
"""Time that is shown before the load on several joints, s."""


class LoadResponse(NamedTuple):
    """A run with a step load in a state, and what it took from every joint, (joints,), rad."""

    state: HeldState
    load: Load
    recorded: RecordedRun
    came: int
    """First step under the load"""
    before: Array
    """Angles before the load"""
    after: Array
    """Angles at the end"""
    expected: Array
    """What the load takes by statics without friction"""
    theory: Array
    """Angles under the load by statics without friction"""

    @property
    def run(self) -> Run:
        """The run of the twin."""
        return self.recorded.run

    @property
    def shown(self) -> Run:
        """The run from shortly before the load on, thinned."""
        first = int(np.searchsorted(self.run.time, self.run.time[self.came] - _SHOWN))
        return self.run.rows(first, None, DRAWN.step // 2)


def rigged(inst: ShortForm) -> float | None:
    """Return the force that the weight on the load rig's cable causes at the tip, N; None without a rig."""
    weight, radius = inst.conditions.cable_force, inst.conditions.cable_pulley_radius
    return None if weight is None or radius is None else weight * radius / inst.rig_arm


def step_force(inst: ShortForm) -> float:
    """Return the force that the step load makes at the tip, N."""
    return rigged(inst) or shown_force(inst)


def approach_time(handle_angle: float) -> float:
    """Return how long the straight handle moves to an angle (rad), s."""
    return SMOOTH.peak * abs(handle_angle) / APPROACH


def protocol(subject: Subject, state: HeldState, load: Load, after: float = LOADED) -> simulate.Protocol:
    """Return the protocol: to a state by handle and motors, and a load that comes; on several joints for a time (s)."""
    if (inst := subject.plane) is not None:
        handle = float(state.handle[0])
        name, given = f"at {np.degrees(handle):.1f} deg", load.keys()
        if rigged(inst) is not None:
            given = {"weight": inst.conditions.cable_force}
        delay = BEFORE - approach_time(handle)
        phase = simulate.StepLoad(handle_angle=handle, approach=APPROACH, delay=delay, duration=AFTER, **given)
        phases: list[simulate.AnyPhase] = [phase]
    else:
        name, come = load.name, simulate.StepLoad(rise=RISE, duration=after, **load.keys())
        phases = [*subject.moved(state.handle, state.strokes, REACHED), simulate.Hold(duration=RESTED), come]
    return simulate.Protocol(
        name=f"step load {name}", description=f"{load.text} applied suddenly to the held instrument", phases=phases
    )


def respond(
    subject: Subject, state: HeldState, load: Load, *, controller: Controller | None = None, after: float = LOADED
) -> LoadResponse | None:
    """Run a step load on the twin; None if the joints cannot hold it."""
    recorded = RecordedRun.of(subject.given, protocol(subject, state, load, after), _SEED, controller)
    if recorded is None:
        return None
    run = recorded.run
    applied = [run.by_column(name) for name in ("force", "wrench", "applied_grip_force") if name in run.signals()]
    came = int(np.argmax(np.any(np.hstack(applied) != 0, axis=1)))
    held, last = run.rows(came - 1, came), run.rows(-1)
    theory = subject.target(held, load)[0]
    expected = subject.target(held)[0] - theory
    before, at_end = (subject.turned(rows)[0] for rows in (held, last))
    return LoadResponse(state, load, recorded, came, before, at_end, expected, theory)


def reached(inst: ShortForm, desired: float) -> HeldState | None:
    """Return the state in which the handle, as on the bench, brings the tip to an angle (rad); None if it cannot."""
    try:
        handle = float(statics.handle_angle(inst, desired))
    except NoSolutionError:
        return None
    slope = float(statics.gradient(statics.handle_angle, inst, desired, wrt=["output_angle"])["output_angle"])
    missed = np.inf
    for _ in range(20):
        missed = desired - _approached(inst, handle)
        if abs(missed) < _TOLERANCE or abs(handle) >= inst.handle_range:
            break
        handle = float(np.clip(handle + slope * missed, -inst.handle_range, inst.handle_range))
    name = f"{np.degrees(desired):.4g}deg"
    return HeldState(name, np.array([desired]), np.array([handle]), np.zeros(2)) if abs(missed) < _TOLERANCE else None


def _approached(inst: ShortForm, handle: float) -> float:
    """Return the angle, rad, at which the tip comes to rest after the straight handle is moved to an angle."""
    steps = max(2, int(np.ceil(abs(handle) / np.radians(0.1))))
    run = twin.Twin(inst, quasi_static=True).run(np.linspace(0.0, handle, steps + 1))
    return float(run["output_angle"][-1])


def section(context: Context) -> Section:
    """Compute the step loads: in the held states of the conditions, or in every direction on the bent instrument."""
    subject = context.bench
    if (inst := subject.plane) is not None:
        states = [state for angle in held_angles(inst) if (state := reached(inst, angle)) is not None]
        cases = [(state, subject.loads[0].times(step_force(inst))) for state in states]
    else:
        cases = [(subject.states[-1], load) for load in subject.loads]
    found = [done for done in (respond(subject, *case) for case in cases) if done is not None]
    if not found:
        why = f"in none of the states does {named(subject.given)} reach its angle and hold the load"
        return Section.not_run("step_load", _TITLE, why)
    for done in found:
        name = done.load.name if inst is None else done.state.name
        context.recordings[context.file_name("fig15", "step_load_" * context.is_own + name)] = done.recorded
    rough = has_friction(subject.given)
    text = "<p>As on the bench, the handle is moved until the tip reaches the desired angle" * (inst is not None) or (
        f"<p>Handle and motors bring the tip to {subject.described(found[0].state)} and hold it there; then the load "
        f"comes in {1e3 * RISE:.0f} ms and stays"
    )
    if rough:
        text += (
            ", which with friction takes more handle angle than without. “Above theory” is how far it is then above "
            "the angle that theory without friction gives under the load: less than what is lost without friction, "
            "since friction has already held the tip back"
            if inst is not None
            else ". With friction a joint may lose less than without: it was held back already, or it does not give "
            "way until its tendons slip"
        )
    text += "."
    if inst is not None and context.has_chapter("compensated-step-load"):
        text += (
            ' For the same loads with the controller enabled see <a href="#compensated">Compensation on the bench</a>.'
        )
    plot = _plot(subject, found) if inst is None else _traces(context, inst, found)
    return Section("step_load", _TITLE, text + "</p>", [plot], [_table(context, subject, found, rough=rough)])


def _rig(inst: ShortForm, load: Load) -> str:
    cable = "" if rigged(inst) is None else f"{inst.conditions.cable_force:g} N on the load rig's cable, "
    return f"{cable}{load.size:.3g} N at the tip"


def _table(context: Context, subject: Subject, found: list[LoadResponse], *, rough: bool) -> ResultTable:
    if (inst := subject.plane) is None:
        about = "Angle that a step load of {words} takes from"
        table = context.table(
            "Angle that the load takes from each joint on the twin, and by statics without friction",
            "load",
            *(
                each
                for name in subject.joints
                for each in (
                    ResultColumn(
                        f"{name} [°]", f"step_load.lost.{name}.{{load}}", "deg", f"{about} {name} on the twin"
                    ),
                    f"{name}, statics [°]",
                )
            ),
        )
        for done in found:
            angles = np.degrees(np.column_stack([done.before - done.after, done.expected])).ravel()
            table.row(done.load.text, *map(float, angles), load=done.load.name, words=done.load.text)
        return table
    load, papers = found[0].load, int(context.is_paper)
    about = f"Output angle that the step load of {load.size:.3g} N takes on the twin, held at {{words}}"
    table = context.table(
        f"The held states under {_rig(inst, load)}",
        "state",
        ResultColumn(
            "handle [°]", "step_load.handle_at_{state}", "deg", "Handle angle that brings the twin's tip to {words}", 1
        ),
        *["published handle [°]"] * papers,
        "output before [°]",
        "after [°]",
        ResultColumn("lost [°]", "step_load.lost_at_{state}", "deg", about),
        *["above theory [°]"] * rough,
        ResultColumn("agonist before [N]", digits=1),
        ResultColumn("after [N]", digits=1),
    )
    printed = {output.value: handle for handle, output in published.STATES} if context.is_paper else {}
    for done in found:
        handle = printed.get(round(float(np.degrees(done.state.angles[0])), 6))
        before, after, theory = (float(np.degrees(each[0])) for each in (done.before, done.after, done.theory))
        agonist = done.run["measured_tension"][:, 0]
        table.row(
            done.state.name.replace("deg", "°"),
            (float(np.degrees(done.state.handle[0])), handle),
            *["–" if handle is None else fixed(handle.value, 0)] * papers,
            *(before, after, before - after),
            *[before - theory] * rough,
            float(agonist[done.came - _SETTLED : done.came].mean()),
            float(agonist[-_SETTLED:].mean()),
            state=done.state.name,
            words=done.state.name.replace("deg", " deg"),
        )
    return table


def _traces(context: Context, inst: ShortForm, found: list[LoadResponse]) -> Plot:
    steps = [
        SteppedCurve(done.state.name.replace("deg", " deg"), done.run[DRAWN], BEFORE, float(done.theory[0]))
        for done in found
    ]
    return step_response(steps).plot(
        context.file_name("fig15", "step_load"),
        f"Output angle and agonist tension when a load, {_rig(inst, found[0].load)}, is applied suddenly while the "
        f"handle is held, {named(inst)}, T<sub>o</sub> = {inst.pretension:g} N, no "
        f"compensation{context.figure_of('Fig. 15', ', dotted lines')}.",
    )


def _plot(subject: Subject, found: list[LoadResponse]) -> Plot:
    chart, axes = panels(len(found), 2.6, 3.5)
    for axis, done in zip(axes, found, strict=True):
        time = chart.keep(f"time, {done.load.name} [s]", done.shown.time - done.shown.time[0] - _SHOWN)
        changes = np.degrees(subject.turned(done.shown) - done.before)
        for (name, look), change, lost in zip(subject.looks.items(), changes.T, np.degrees(done.expected), strict=True):
            chart.curve(axis, time, f"{name}, {done.load.name} [deg]", change, **look)
            axis.plot(time[time >= 0], np.full((time >= 0).sum(), -lost), ":", color=look["color"], lw=1.1)
        axis.set(title=done.load.text, xlabel="time [s]", xlim=(time[0], time[-1]))
    axes[0].set_ylabel("change of angle [deg]")
    style.legend_outside(chart.figure, *subject.legend, ("statics, no friction", style.MUTED, ":"))
    return chart.plot(
        "step_load", f"Change of every joint's angle when a load comes, {named(subject.given)} on the twin."
    )
