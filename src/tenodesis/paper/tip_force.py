"""The observer's force at the tip on instruments unlike the controller's model: its error, and its interval."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tenodesis import statics
from tenodesis.control import LawName
from tenodesis.instrument import ShortForm
from tenodesis.paper import step_response
from tenodesis.paper.compensated_step import FRICTION_ERRORS
from tenodesis.paper.context import Context
from tenodesis.paper.step_load import step_force
from tenodesis.paper.step_response import HeldMotion
from tenodesis.paper.unlike_model import PlantDifference, differences, held
from tenodesis.report import style
from tenodesis.report.content import Array, Chart, Plot, ResultColumn, Section, named
from tenodesis.run import Run
from tenodesis.simulate.campaign import Rows, farthest, rms
from tenodesis.twin import TIME_STEP

TITLE = "Force at the tip"
WITHIN = 1.96
"""Standard deviations of an interval of 95 %."""
_KEYS = ("none", "two_vertices", "compliance", "rougher", "gains")
_BEFORE, _AFTER, _SEED = 2.0, 6.5, 19  # s, s
_SETTLED, _LAST = 0.3, 1.0  # s, after the load and at the end
_TINY = 1e-3  # N
_SHOWN = np.radians(67)
_WORK: dict[LawName, str] = {"off": "before a stroke", "robust": "after strokes"}


class Judged(NamedTuple):
    """Errors of estimated forces at the tip, N."""

    error: float
    """RMS"""
    worst: float
    deviation: float
    """RMS of what the observer states"""
    covered: float
    """Share of time within its interval of 95 %"""
    plain: float
    """RMS of eq. 1 with proximal tensions"""


def judge(off: ArrayLike, deviation: ArrayLike, plain: ArrayLike) -> Judged:
    """Judge an estimate by its errors and its standard deviations, beside the errors of eq. 1, all N."""
    error, std = np.asarray(off, float), np.asarray(deviation, float)
    covered = float((np.abs(error) <= WITHIN * std).mean())
    return Judged(rms(error), farthest(error), rms(std), covered, rms(plain))


def by_tensions(inst: ShortForm, output_angle: ArrayLike, tensions: ArrayLike) -> Array:
    """Return the force at the tip, N, (n,), by eq. 1 with measured tensions, (n, 2), at output angles, rad, (n,)."""
    most = 0.99 * min(inst.output_stop, float(statics.output_angle(inst, inst.handle_range)))
    angle = np.clip(np.asarray(output_angle, float), -most, most)
    # Of a frictionless instrument whose tendons are tight, the difference of the tensions is linear in the force.
    none, some = (
        np.subtract(*statics.tensions(inst, statics.handle_angle(inst, angle, force), force)) for force in (0.0, _TINY)
    )
    difference = np.subtract(*np.asarray(tensions, float).T)
    return np.asarray((difference - none) * _TINY / (some - none))


def drawing(time: Array, load: Array, estimate: Array, deviation: Array, plain: Array) -> Chart:
    """Draw loads and estimates of the force at the tip, N, over time, s, all (n,)."""
    chart, (axis,) = Chart.panels(height=2.8)
    chart.keep("time [s]", time)
    width = WITHIN * chart.keep("standard deviation [N]", deviation)
    axis.fill_between(time, estimate - width, estimate + width, color=style.ANTAGONIST, alpha=0.2, lw=0, label="95 %")
    chart.curve(axis, time, "observer [N]", estimate, color=style.ANTAGONIST, label="observer")
    chart.curve(axis, time, "eq. 1 [N]", plain, color=style.ACCENT, label="eq. 1, proximal tensions")
    chart.curve(axis, time, "load [N]", load, color=style.INK, linewidth=1, label="load")
    axis.set(xlabel="time [s]", ylabel="force at the tip [N]", xlim=(time[0], time[-1]))
    style.legend_above(axis, 4)
    return chart


def section(context: Context) -> Section:
    """Compute error and coverage of the observer's force at the tip, by difference, before a stroke and after."""
    inst = context.tested
    if why := step_response.missing(inst, seeds=context.seeds, rough=True):
        return Section.not_run("tip_force", TITLE, why)
    table = context.table(
        f"Force at the tip under {step_force(inst):.3g} N, by what differs from the controller’s model",
        "what differs",
        "motors",
        _column("error", "RMS error of the observer’s force at the tip", "error, RMS [N]"),
        _column("worst", "Largest error of the observer’s force at the tip", "worst [N]"),
        _column("deviation", "Standard deviation that the observer states of it, RMS", "stated [N]"),
        _column("covered", "Share of time that its interval of 95 % contains the load", "covered [%]", "%"),
        _column("plain", "RMS error of eq. 1 with proximal tensions", "eq. 1, RMS [N]"),
    )
    plots: list[Plot] = []
    for difference in differences(inst):
        if difference.key not in _KEYS:
            continue
        for law, words in _WORK.items():
            found = _runs(inst, difference, law)
            if not found:
                continue
            one = _judge(found, law)
            cells = (one.error, one.worst, one.deviation, 100 * one.covered, one.plain)
            key = words.split()[0]
            table.row(difference.name, words, *cells, difference=difference, work=key, words=words)
            if difference.key == "two_vertices" and law == "robust":
                plots = [_plot(inst, min(found, key=lambda held: abs(held["state"] - _SHOWN)))]
    text = (
        "<p>The observer estimates the load from what is measured at the handle’s end, and states an interval. Each "
        "row is over the held states, and over friction assumed 30 % too low, right and 30 % too high. <em>Before a "
        f"stroke</em> the motors have never moved, and it is judged from {_SETTLED:g} s after the load on: friction "
        f"may carry the load, and the interval must say so. <em>After strokes</em> is the last {_LAST:g} s under the "
        "robust law. Beside it is eq. 1, which takes the tensions at the motors for those at the tip and has no "
        "interval; it is given the true output angle.</p>"
    )
    return Section("tip_force", TITLE, text, plots, [table])


def _column(what: str, description: str, heading: str, unit: str = "N") -> ResultColumn:
    key = f"tip_force.{{difference.key}}.{{work}}.{what}"
    return ResultColumn(heading, key, unit, f"{description}, {{words}}; differs from the model: {{difference.name}}")


def _runs(inst: ShortForm, difference: PlantDifference, law: LawName) -> Rows:
    """Return rows of runs, with their motions and the force by eq. 1."""

    def measure(run: Callable[..., Run], motion: HeldMotion, model: ShortForm) -> dict[str, Any]:
        done = run()
        plain = by_tensions(model, done["output_angle"], done["measured_tension"])
        return {"run": done, "motion": motion, "plain": plain}

    times = _BEFORE, _AFTER if law == "robust" else _LAST
    return held(inst, difference, {law: FRICTION_ERRORS}, times, measure, seeds=(_SEED,))


def _judge(found: Rows, law: LawName) -> Judged:
    motion = found[0]["motion"]
    last, settled = -round(_LAST / TIME_STEP), motion.loaded + round(_SETTLED / TIME_STEP)
    shown = slice(last if law == "robust" else settled, None)
    load = motion.force[-1]
    estimate, deviation = (
        np.array([row["run"][name][shown] for row in found]) for name in ("estimated_force", "estimated_force_std")
    )
    return judge(estimate - load, deviation, np.array([row["plain"][shown] for row in found]) - load)


def _plot(inst: ShortForm, row: dict[str, Any]) -> Plot:
    shown = slice(round(_BEFORE / TIME_STEP) // 2, None, 20)
    run, motion = row["run"], row["motion"]
    signals = [run[name] for name in ("estimated_force", "estimated_force_std")]
    chart = drawing(*(values[shown] for values in (run.time, motion.force, *signals, row["plain"])))
    return chart.plot(
        "tip_force_over_time",
        f"Force at the tip over time, {named(inst)} with two vertices a joint, at {np.degrees(row['state']):.0f}° "
        "under the robust law, with the interval of 95 % and by eq. 1.",
    )
