"""Fig. 15 without compensation: a load applied suddenly to the held instrument, on the twin."""

from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tenodesis import simulate, statics, twin
from tenodesis.errors import NoSolutionError, ProtocolError
from tenodesis.instrument import Instrument
from tenodesis.paper import published
from tenodesis.paper.context import Context, Session
from tenodesis.paper.loss import shown_force
from tenodesis.report import style
from tenodesis.report.content import Plot, Section, Table, fixed, named
from tenodesis.run import Run

Array = NDArray[np.float64]

BEFORE, AFTER = 10.0, 10.0
"""Time before the load, which in the paper comes near 10 s, and under it, s."""
APPROACH = float(np.radians(20))
"""Highest speed at which the handle is brought to its angle, rad/s."""
_SEED = 15
_TITLE = "A sudden load on the held instrument"
_KEPT = 20
_NEAR = 1e-5  # rad


class State(NamedTuple):
    """One state held: where the tip was wanted (rad), the handle angle (rad) that brings it there, and the run."""

    wanted: float
    handle_angle: float
    run: Run
    before: float
    """Output angle before the load, rad."""
    after: float
    """Output angle at the end, rad."""
    theory: float
    """Output angle under the load without friction, rad."""
    agonist_before: float
    agonist_after: float

    @property
    def lost(self) -> float:
        """Output angle that the load takes, rad."""
        return self.before - self.after


def rigged(inst: Instrument) -> float | None:
    """Return the force that the weight on the load rig's cable makes at the tip, N; None without a rig."""
    weight, radius = inst.conditions.cable_force, inst.conditions.cable_pulley_radius
    return None if weight is None or radius is None else weight * radius / inst.rig_arm


def protocol(inst: Instrument, handle_angle: float, force: float) -> simulate.Protocol:
    """Return what is done on the bench at one handle angle (rad): the weight on the rig's cable, or the force (N)."""
    moving = abs(handle_angle) / APPROACH * 15 / 8
    return simulate.Protocol(
        name=f"step load at {np.degrees(handle_angle):.1f} deg",
        description="Fig. 15: a load applied suddenly while the handle is held, without compensation",
        phases=[
            simulate.StepLoad(
                handle_angle=handle_angle,
                approach=APPROACH,
                delay=BEFORE - moving,
                duration=AFTER,
                **({"force": force} if rigged(inst) is None else {"weight": inst.conditions.cable_force}),
            )
        ],
    )


def hold(inst: Instrument, wanted: float, force: float) -> State | None:
    """Find the handle angle that brings the tip where it is wanted (rad), as on the bench, and apply the load there.

    None if the handle cannot bring it there, or the joint not hold the load.
    """
    try:
        return _hold(inst, wanted, force)
    except (ProtocolError, NoSolutionError):
        return None


def _hold(inst: Instrument, wanted: float, force: float) -> State:
    handle = float(statics.handle_angle(inst, wanted))
    slope = float(
        statics.gradient(statics.handle_angle, inst, np.array([wanted]), wrt=["output_angle"])["output_angle"][0]
    )
    for _ in range(20):
        missed = wanted - _approached(inst, handle)
        if abs(missed) < _NEAR or abs(handle) >= inst.handle_range:
            break
        handle = float(np.clip(handle + slope * missed, -inst.handle_range, inst.handle_range))
    if abs(missed) >= _NEAR:
        raise NoSolutionError(f"{inst.name} does not reach {np.degrees(wanted):.4g} deg.")
    run = simulate.execute(twin.Twin(inst, seed=_SEED), protocol(inst, handle, force))
    first = int(np.argmax(run["force"] > 0))
    settled = slice(first - 400, first)
    theory = statics.output_angle(inst, np.array([handle]), float(run["force"][-1]))[0]
    return State(
        wanted,
        handle,
        run,
        float(run["output_angle"][first - 1]),
        float(run["output_angle"][-1]),
        float(theory),
        float(run["measured_tension"][settled, 0].mean()),
        float(run["measured_tension"][-400:, 0].mean()),
    )


def _approached(inst: Instrument, handle: float) -> float:
    """Return where the tip comes to rest when the straight handle is moved to an angle, rad."""
    steps = max(2, int(np.ceil(abs(handle) / np.radians(0.1))))
    run = twin.Twin(inst, quasi_static=True).run(np.linspace(0.0, handle, steps + 1))
    return float(run["output_angle"][-1])


def section(context: Context) -> Section:
    """Compute the held states of the instrument's conditions under the step load."""
    inst = context.tested
    force = shown_force(inst)
    wanted = inst.conditions.output_angles or tuple(np.linspace(0.0, 0.9 * inst.output_range, 4))
    tried = [hold(inst, angle, force) for angle in wanted]
    states = [state for state in tried if state is not None]
    if not states:
        text = f"<p>Not run: in none of the states does {named(inst)} reach its angle and hold the load.</p>"
        return Section("step_load", _TITLE, text)
    applied = float(states[0].run["force"][-1])
    rows = []
    printed = {output.value: handle for handle, output in published.STATES}
    for state in states:
        label = f"{np.degrees(state.wanted):.4g}"
        handle = printed.get(round(float(np.degrees(state.wanted)), 6)) if context.is_paper else None
        context.recordings[f"fig15_{label}deg"] = Session(inst, protocol(inst, state.handle_angle, force), _SEED)
        context.add(
            f"step_load.lost_at_{label}deg",
            np.degrees(state.lost),
            "deg",
            f"Output angle that the step load of {applied:.3g} N takes on the twin, held at {label} deg",
        )
        context.add(
            f"step_load.handle_at_{label}deg",
            np.degrees(state.handle_angle),
            "deg",
            f"Handle angle that brings the twin's tip to {label} deg",
            handle,
        )
        rows.append(
            [
                f"{label}°",
                fixed(float(np.degrees(state.handle_angle)), 1),
                "–" if handle is None else fixed(handle.value, 0),
                fixed(float(np.degrees(state.before))),
                fixed(float(np.degrees(state.after))),
                fixed(float(np.degrees(state.lost))),
                fixed(float(np.degrees(state.before - state.theory))),
                fixed(state.agonist_before, 1),
                fixed(state.agonist_after, 1),
            ]
        )
    rig = (
        f"{inst.conditions.cable_force:g} N on the load rig's cable, {applied:.3g} N at the tip"
        if rigged(inst) is not None
        else f"{applied:.3g} N at the tip"
    )
    plot = Plot(
        "fig15_step_load",
        f"Output angle and agonist tension when {rig}, comes on suddenly while the handle is held, {named(inst)}, "
        f"T<sub>o</sub> = {inst.pretension:g} N, no compensation ({context.figure_of('Fig. 15')}, dotted lines).",
        _draw(states),
        _curves(states),
    )
    table = Table(
        f"The held states under {rig}",
        [
            "state",
            "handle [°]",
            "published handle [°]",
            "output before [°]",
            "after [°]",
            "lost [°]",
            "lost without friction [°]",
            "agonist before [N]",
            "after [N]",
        ],
        rows,
    )
    text = (
        "<p>As on the bench, the handle is moved until the tip stands at the wanted angle, which with friction takes "
        "more handle angle than theory says. “Without friction” counts from there to the theory's angle under the "
        'load. The same loads with the controller at work: <a href="#compensated">Compensation on the bench</a>.</p>'
    )
    return Section("step_load", _TITLE, text, [plot], [table])


def _draw(states: list[State]) -> Figure:
    fig, axes = style.figure(len(states), width=2.5 * len(states) + 0.8, height=3.4)
    for n, (axis, state) in enumerate(zip(axes, states, strict=True)):
        run = state.run
        time = run.time[::_KEPT]
        free = np.degrees(np.where(time < BEFORE, np.nan, state.theory))
        axis.plot(time, free, ":", color=style.INK, lw=1.3)
        axis.plot(time, np.degrees(run["output_angle"])[::_KEPT], color=style.AGONIST, lw=1.3)
        middle = np.degrees(state.before + state.after) / 2
        axis.set(
            title=f"{np.degrees(state.wanted):.4g}°",
            xlabel="time [s]",
            xlim=(BEFORE - 2, BEFORE + 6),
            ylim=(middle - 12, middle + 12),
        )
        other = axis.twinx()
        other.grid(visible=False)
        other.plot(time, run["measured_tension"][::_KEPT, 0], color=style.ANTAGONIST, lw=1.0)
        tension = (state.agonist_before + state.agonist_after) / 2
        other.set_ylim(tension - 15, tension + 15)
        other.spines["right"].set_visible(True)
        if n == 0:
            axis.set_ylabel("output angle $\\theta_e$ [deg]")
        if n == len(states) - 1:
            other.set_ylabel("agonist tension [N]")
    handles = [
        axes[0].plot([], [], color=color, label=name)[0]
        for name, color in (("output angle (left)", style.AGONIST), ("agonist tension (right)", style.ANTAGONIST))
    ]
    handles.append(axes[0].plot([], [], ":", color=style.INK, label="output angle, theory without friction")[0])
    fig.legend(handles=handles, loc="outside upper left", ncols=3)
    return fig


def _curves(states: list[State]) -> dict[str, Array]:
    curves: dict[str, Array] = {}
    for state in states:
        label = f"at {np.degrees(state.wanted):.4g} deg"
        curves[f"time {label} [s]"] = state.run.time[::_KEPT]
        curves[f"output_angle {label} [deg]"] = np.degrees(state.run["output_angle"][::_KEPT])
        curves[f"agonist {label} [N]"] = state.run["measured_tension"][::_KEPT, 0]
    return curves
