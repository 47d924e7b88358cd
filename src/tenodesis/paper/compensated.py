"""Fig. 15 with compensation: a sudden load on the held instrument, by the paper's law and by the robust one."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tenodesis.control import LawName
from tenodesis.paper import compensated_readings
from tenodesis.paper import compensated_run as bench
from tenodesis.paper.context import Context
from tenodesis.paper.step_load import AFTER, BEFORE
from tenodesis.report import style
from tenodesis.report.content import Plot, Section, Table, fixed, named
from tenodesis.run import Run

Array = NDArray[np.float64]

TITLE = "Compensation on the bench"
FRICTION_ERRORS = (-0.3, 0.0, 0.3)
"""Of the friction that the controller is told, as shares of the true one."""

_KEPT = 20
_FROM, _UNTIL = BEFORE - 1, BEFORE + 6  # s
_LAWS: tuple[LawName, ...] = ("off", "paper", "exact")
_DRAWN = {
    "off": ("no compensation", style.MUTED, ":"),
    "paper": ("eq. 22, both motors", style.ANTAGONIST, "-"),
    "robust": ("robust law", style.AGONIST, "-"),
}


class _Case(NamedTuple):
    state: float
    law: LawName
    friction: float


def section(context: Context) -> Section:
    """Compute the held states under the step load without compensation, by the paper's law and by the robust one."""
    inst = context.tested
    problem = bench.refusal(inst)
    if problem is not None:
        return Section("compensated", TITLE, f"<p>Not run: {named(inst)} cannot be compensated.</p>")
    force = bench.load(inst)
    cases = [
        _Case(state, law, error)
        for state in bench.states(inst)
        for law, errors in (*((law, (0.0,)) for law in _LAWS), ("robust", FRICTION_ERRORS))
        for error in errors
    ]

    def work(case: _Case) -> tuple[bench.Outcome, Run | None]:
        motion = bench.held(inst, case.state, force, BEFORE, AFTER)
        run = bench.apply(inst, bench.known(inst, 1 + case.friction), motion, case.law)
        drawn = case.law in _DRAWN and not case.friction
        return bench.outcome(run, motion), run if drawn else None

    found = {case: one for case, one in zip(cases, bench.together(work, cases), strict=True) if one is not None}
    held = [state for state in bench.states(inst) if all(case in found for case in cases if case.state == state)]
    if not held:
        text = f"<p>Not run: in none of the states does {named(inst)} hold the load of {force:.3g} N.</p>"
        return Section("compensated", TITLE, text)
    outcomes = {case: one for case, (one, _) in found.items() if case.state in held}
    runs: dict[tuple[float, str], Run] = {
        (case.state, case.law): run for case, (_, run) in found.items() if run is not None
    }
    _add(context, outcomes)
    plot = Plot(
        "fig15_compensated",
        f"Output angle and agonist tension when {force:.3g} N at the tip come on suddenly while the handle is held, "
        f"{named(inst)}, T<sub>o</sub> = {inst.pretension:g} N ({context.figure_of('Fig. 15(a)–(d)')}). The same "
        "twin and seed three times; dashed: the angle of eq. 18.",
        _draw(held, runs),
        _curves(held, runs),
    )
    text = (
        "<p>The handle is moved to the angle that by eq. 18 bends the tip as wanted, with the controller at work from "
        "the start, and held; the load comes at 10 s. Errors count from eq. 18, so that what friction takes before the "
        "load counts as well. The controller knows the tendons’ identified stiffness and, where the table says so, a "
        "wrong friction; the laws that come from theory without friction do not ask for it. Without a slack tendon the "
        "exact law with both motors is eq. 22.</p>"
    )
    text += bench.caveat(inst)
    tables = [_table(held, outcomes)]
    if context.is_paper:
        more, table = compensated_readings.readings(context, inst, held, force)
        text += more
        tables.append(table)
    return Section("compensated", TITLE, text, [plot], tables)


def _label(case: _Case) -> str:
    if case.law != "robust":
        return {"off": "no compensation", "paper": "eq. 22, both motors", "exact": "exact, both motors"}[case.law]
    told = "right" if not case.friction else f"{100 * case.friction:+.0f} %".replace("-", "−")
    return f"robust, friction {told}"


def _add(context: Context, outcomes: dict[_Case, bench.Outcome]) -> None:
    for case, one in outcomes.items():
        at = f"at_{np.degrees(case.state):.4g}deg"
        told = "" if not case.friction else f".friction_{100 * case.friction:+.0f}"
        context.add(
            f"compensated.{case.law}{told}.final_error_{at}",
            one.final,
            "deg",
            f"Tip error against eq. 18, 10 s after the step load, {_label(case)}, {np.degrees(case.state):.4g} deg",
        )


def _table(held: Sequence[float], outcomes: dict[_Case, bench.Outcome]) -> Table:
    rows: dict[str, list[str]] = {}
    for case, one in outcomes.items():
        rows.setdefault(_label(case), []).append(fixed(one.final) + (" (fault)" if one.faulted else ""))
    return Table(
        "Tip error against eq. 18 after 10 s under the load [°], by state, law and the friction the controller is told",
        ["law", *(f"{np.degrees(state):.4g}°" for state in held)],
        [[label, *cells] for label, cells in rows.items()],
    )


def _draw(held: Sequence[float], runs: dict[tuple[float, str], Run]) -> Figure:
    fig = Figure(figsize=(2.5 * len(held) + 0.8, 4.8), layout="constrained")
    axes = fig.subplots(2, len(held), squeeze=False, sharex=True, sharey="row")
    for (tip, tension), state in zip(axes.T, held, strict=True):
        for law, (_, color, line) in _DRAWN.items():
            run = runs[state, law]
            shown = (run.time >= _FROM) & (run.time <= _UNTIL)
            time = run.time[shown][::_KEPT]
            error = np.degrees(run["output_angle"] - state)[shown][::_KEPT]
            tip.plot(time, error, line, color=color, lw=1.3)
            tension.plot(time, run["measured_tension"][shown, 0][::_KEPT], line, color=color, lw=1.1)
        tip.axhline(0, color=style.INK, ls="--", lw=0.8)
        tip.set(title=f"{np.degrees(state):.4g}°")
        tension.set(xlabel="time [s]", xlim=(_FROM, _UNTIL))
    axes[0, 0].set_ylabel("output angle − eq. 18 [deg]")
    axes[1, 0].set_ylabel("agonist tension [N]")
    handles = [axes[0, 0].plot([], [], line, color=color, label=name)[0] for name, color, line in _DRAWN.values()]
    fig.legend(handles=handles, loc="outside upper left", ncols=3)
    return fig


def _curves(held: Sequence[float], runs: dict[tuple[float, str], Run]) -> dict[str, Array]:
    curves: dict[str, Array] = {}
    for state in held:
        label = f"at {np.degrees(state):.4g} deg"
        curves[f"time {label} [s]"] = runs[state, "off"].time[::_KEPT]
        for law in _DRAWN:
            run = runs[state, law]
            curves[f"output_angle {law} {label} [deg]"] = np.degrees(run["output_angle"][::_KEPT])
            curves[f"agonist {law} {label} [N]"] = run["measured_tension"][::_KEPT, 0]
    return curves
