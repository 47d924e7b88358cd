"""Fig. 15 without compensation: a load applied suddenly to the held instrument, on the twin."""

from typing import NamedTuple

import numpy as np

from tenodesis import simulate, statics, twin
from tenodesis.errors import NoSolutionError, ProtocolError
from tenodesis.instrument import ShortForm
from tenodesis.paper import published
from tenodesis.paper.context import DRAWN, Context, RecordedRun, has_friction, held_angles, shown_force
from tenodesis.report.content import Column, Plot, Section, fixed, named
from tenodesis.report.curves import SteppedRun, step_response
from tenodesis.run import Run
from tenodesis.simulate.command import SMOOTH

BEFORE, AFTER = 10.0, 10.0
"""Time before the load, which in the paper comes near 10 s, and under it, s."""
APPROACH = float(np.radians(20))
"""Highest speed at which the handle is brought to its angle, rad/s."""
_SEED = 15
_TITLE = "A sudden load on the held instrument"
_TOLERANCE = 1e-5  # rad


class State(NamedTuple):
    """A held state: the desired output angle (rad), the handle angle (rad) that reaches it, and the run."""

    desired: float
    handle_angle: float
    recorded: RecordedRun
    before: float
    """Output angle before the load, rad."""
    after: float
    """Output angle at the end, rad."""
    theory: float
    """Output angle under the load without friction, rad."""
    agonist_before: float
    agonist_after: float

    @property
    def run(self) -> Run:
        """The run of the twin."""
        return self.recorded.run


def rigged(inst: ShortForm) -> float | None:
    """Return the force that the weight on the load rig's cable causes at the tip, N; None without a rig."""
    weight, radius = inst.conditions.cable_force, inst.conditions.cable_pulley_radius
    return None if weight is None or radius is None else weight * radius / inst.rig_arm


def approach_time(handle_angle: float) -> float:
    """Return how long the straight handle moves to an angle (rad), s."""
    return SMOOTH.peak * abs(handle_angle) / APPROACH


def protocol(inst: ShortForm, handle_angle: float, force: float) -> simulate.Protocol:
    """Return the protocol at a handle angle (rad), loaded by the weight on the rig's cable or by the force (N)."""
    return simulate.Protocol(
        name=f"step load at {np.degrees(handle_angle):.1f} deg",
        description="Fig. 15: a load applied suddenly while the handle is held, without compensation",
        phases=[
            simulate.StepLoad(
                handle_angle=handle_angle,
                approach=APPROACH,
                delay=BEFORE - approach_time(handle_angle),
                duration=AFTER,
                **({"force": force} if rigged(inst) is None else {"weight": inst.conditions.cable_force}),
            )
        ],
    )


def hold(inst: ShortForm, desired: float, force: float) -> State | None:
    """Find the handle angle that brings the tip to an output angle (rad), as on the bench, and apply the load there.

    None if the handle cannot bring it there, or the joint not hold the load.
    """
    try:
        return _hold(inst, desired, force)
    except (ProtocolError, NoSolutionError):
        return None


def _hold(inst: ShortForm, desired: float, force: float) -> State:
    handle = float(statics.handle_angle(inst, desired))
    gradient = statics.gradient(statics.handle_angle, inst, np.array([desired]), wrt=["output_angle"])
    slope = float(gradient["output_angle"][0])
    for _ in range(20):
        missed = desired - _approached(inst, handle)
        if abs(missed) < _TOLERANCE or abs(handle) >= inst.handle_range:
            break
        handle = float(np.clip(handle + slope * missed, -inst.handle_range, inst.handle_range))
    if abs(missed) >= _TOLERANCE:
        raise NoSolutionError(f"{inst.name} does not reach {np.degrees(desired):.4g} deg.", key="angle", value=desired)
    done = protocol(inst, handle, force)
    run = simulate.execute(twin.Twin(inst, seed=_SEED), done)
    first = int(np.argmax(run["force"] > 0))
    settled = slice(first - 400, first)
    theory = statics.output_angle(inst, np.array([handle]), float(run["force"][-1]))[0]
    return State(
        desired,
        handle,
        RecordedRun(inst, done, _SEED, run),
        float(run["output_angle"][first - 1]),
        float(run["output_angle"][-1]),
        float(theory),
        float(run["measured_tension"][settled, 0].mean()),
        float(run["measured_tension"][-400:, 0].mean()),
    )


def _approached(inst: ShortForm, handle: float) -> float:
    """Return the angle, rad, at which the tip comes to rest after the straight handle is moved to an angle."""
    steps = max(2, int(np.ceil(abs(handle) / np.radians(0.1))))
    run = twin.Twin(inst, quasi_static=True).run(np.linspace(0.0, handle, steps + 1))
    return float(run["output_angle"][-1])


def section(context: Context) -> Section:
    """Compute the held states of the instrument's conditions under the step load."""
    inst = context.tested
    force = shown_force(inst)
    states = [state for state in (hold(inst, angle, force) for angle in held_angles(inst)) if state is not None]
    if not states:
        text = f"<p>Not run: in none of the states does {named(inst)} reach its angle and hold the load.</p>"
        return Section("step_load", _TITLE, text)
    applied = float(states[0].run["force"][-1])
    rig = (
        f"{inst.conditions.cable_force:g} N on the load rig's cable, {applied:.3g} N at the tip"
        if rigged(inst) is not None
        else f"{applied:.3g} N at the tip"
    )
    rough = has_friction(inst)
    table = context.table(
        f"The held states under {rig}",
        "state",
        Column(
            "handle [°]",
            "step_load.handle_at_{angle}deg",
            "deg",
            "Handle angle that brings the twin's tip to {angle} deg",
            digits=1,
        ),
        *(["published handle [°]"] if context.is_paper else []),
        "output before [°]",
        "after [°]",
        Column(
            "lost [°]",
            "step_load.lost_at_{angle}deg",
            "deg",
            f"Output angle that the step load of {applied:.3g} N takes on the twin, held at {{angle}} deg",
        ),
        *(["above theory [°]"] if rough else []),
        Column("agonist before [N]", digits=1),
        Column("after [N]", digits=1),
    )
    printed = {output.value: handle for handle, output in published.STATES} if context.is_paper else {}
    for state in states:
        angle = f"{np.degrees(state.desired):.4g}"
        context.recordings[context.file_name("fig15", "step_load_" * context.is_own + f"{angle}deg")] = state.recorded
        handle = printed.get(round(float(np.degrees(state.desired)), 6))
        table.row(
            f"{angle}°",
            (np.degrees(state.handle_angle), handle),
            *(["–" if handle is None else fixed(handle.value, 0)] if context.is_paper else []),
            *np.degrees([state.before, state.after, state.before - state.after]),
            *([float(np.degrees(state.before - state.theory))] if rough else []),
            state.agonist_before,
            state.agonist_after,
            angle=angle,
        )
    text = "<p>As on the bench, the handle is moved until the tip reaches the desired angle"
    if rough:
        text += (
            ", which with friction takes more handle angle than without. “Above theory” is how far it is then above "
            "the angle that theory without friction gives under the load: less than what is lost without friction, "
            "since friction has already held the tip back"
        )
    text += "."
    if context.has_chapter("compensated-step-load"):
        text += (
            ' For the same loads with the controller enabled see <a href="#compensated">Compensation on the bench</a>.'
        )
    text += "</p>"
    return Section("step_load", _TITLE, text, [_plot(context, states, rig)], [table])


def _plot(context: Context, states: list[State], rig: str) -> Plot:
    inst = context.tested
    chart = step_response(
        [SteppedRun(f"{np.degrees(state.desired):.4g} deg", state.run[DRAWN], BEFORE, state.theory) for state in states]
    )
    return chart.plot(
        context.file_name("fig15", "step_load"),
        f"Output angle and agonist tension when a load, {rig}, is applied suddenly while the handle is held, "
        f"{named(inst)}, T<sub>o</sub> = {inst.pretension:g} N, no "
        f"compensation{context.figure_of('Fig. 15', ', dotted lines')}.",
    )
