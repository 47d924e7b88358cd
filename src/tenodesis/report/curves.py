"""The curves of the report: an instrument's statics under loads, and runs on the twin or the bench."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes

from tenodesis import statics
from tenodesis.control.parameters import slack_tension
from tenodesis.instrument import ShortForm
from tenodesis.report import style
from tenodesis.report.content import Array, Chart, unit_text
from tenodesis.run import SIGNALS, Names, Run
from tenodesis.units import in_unit

_SHOWN = (
    ("commanded_handle_angle", "measured_output_angle", "output_angle", "estimated_output_angle"),
    ("measured_tension",),
    ("force", "contact_force", "estimated_force"),
)
"""Signals of one joint that are drawn together, a panel each, if nothing else is wanted."""
_SHOWN_OF_SEVERAL = ("commanded_handle_angle", "output_angle", "tension", "wrench", "grip_force")
"""Signals of several joints that are drawn, a panel each, where they are not zero throughout."""
_QUANTITIES = {"N, N*m": "load", "rad": "angle", "rad/s": "speed", "N": "force", "N*m": "moment"}
_READABLE = {"rad": "deg", "rad/s": "deg/s"}
_MOST_POINTS = 20_000
_BEFORE_STEP, _AFTER_STEP = 2.0, 6.0
"""Time that is shown before and after a step load, s."""
_ANGLES_SHOWN, _TENSIONS_SHOWN = 12.0, 15.0
"""Half of what is shown about the middle between before and after, deg and N."""
_AVERAGED = 0.2  # s
_LARGEST = 0.999
"""Share of a run's largest load from which on its theory is drawn."""
_SEEN = 0.05
"""Difference of two curves that can be seen, deg"""
_NARROWEST = 7.0
"""Width, inches, that a legend above the panels needs."""


def forces(inst: ShortForm) -> list[float]:
    """Return the loads of the curves, N: zero, and those of the instrument's conditions."""
    by_text = {f"{force:g}": force for force in inst.conditions.forces or (0.5, 1.0, 1.5)}
    return [0.0, *sorted(by_text.values())]


def load_name(force: float) -> str:
    """Return a load (N) as tables and legends name it."""
    return "no load" if force == 0 else f"{force:g} N"


def slack_onset(inst: ShortForm, force: float) -> tuple[float, float]:
    """Return output and handle angle, rad, from which the antagonist is slack; NaN if never in the working range."""
    output = np.linspace(0.0, inst.output_range, 4001)
    margin = statics.slack_force(inst, output) - force
    crossing = np.flatnonzero((margin[:-1] > 0) & (margin[1:] <= 0))
    if not crossing.size:
        return np.nan, np.nan
    at = int(crossing[0])
    share = margin[at] / (margin[at] - margin[at + 1])
    angle = float(output[at] + share * (output[at + 1] - output[at]))
    handle = statics.handle_angle(inst, np.array([angle]), force)
    return angle, float(handle[0])


def input_output(inst: ShortForm, loads: Sequence[float]) -> Chart:
    """Draw the output angle over the handle angle under loads (N), with where the antagonist goes slack (Fig. 7)."""
    chart, (axis,) = Chart.panels()
    angles = np.linspace(0.0, min(inst.handle_range, 1.3 * statics.reach(inst)), 301)
    handle = chart.keep("handle_angle [deg]", np.degrees(angles))
    ratio = linear_ratio(inst)
    line = chart.keep("gear ratio line [deg]", ratio * handle)
    inside = line <= np.degrees(inst.output_range)
    if np.abs(np.degrees(statics.output_angle(inst, angles)) - line)[inside].max() > _SEEN:
        label = f"ratio {ratio:.3g} (linear)"
        axis.plot(handle[inside], line[inside], "--", color=style.REFERENCE, lw=1.3, label=label)
    slackens = False
    for force, color in zip(loads, style.colors(len(loads)), strict=True):
        output = np.degrees(statics.output_angle(inst, angles, force))
        output[output > np.degrees(inst.output_range) + 1e-9] = np.nan
        heading = f"output_angle at {force:g} N [deg]"
        chart.curve(axis, handle, heading, output, color=color, label=load_name(force))
        onset, onset_handle = slack_onset(inst, force)
        if np.isfinite(onset_handle):
            axis.plot(np.degrees(onset_handle), np.degrees(onset), "o", color=color, ms=5.5, mec="white")
            slackens = True
    if slackens:
        axis.plot([], [], "o", color=style.MUTED, mec="white", label="antagonist goes slack")
    axis.set(xlabel="handle angle $\\theta_h$ [deg]", ylabel="output angle $\\theta_e$ [deg]", xlim=(0, handle[-1]))
    style.legend_above(axis, 4)
    return chart


def linear_ratio(inst: ShortForm) -> float:
    """Return the ratio of output to handle angle near zero, without load."""
    return float(statics.gradient(statics.output_angle, inst, 0.0, wrt=["handle_angle"])["handle_angle"])


class TensionVariation(NamedTuple):
    """Variation of both tensions (N) over the output angle (deg), (n,) each; NaN beyond the working range."""

    output_angle: Array
    agonist: Array
    antagonist: Array


def tension_variation(inst: ShortForm, force: float) -> TensionVariation:
    """Return how the tensions vary under a force (N) while the handle moves to its end."""
    state = statics.equilibrium(inst, handle_angles(inst), force)
    inside = np.abs(state.output_angle) <= inst.output_range
    agonist, antagonist = (
        np.where(inside, tension - inst.pretension, np.nan) for tension in (state.agonist, state.antagonist)
    )
    return TensionVariation(np.where(inside, np.degrees(state.output_angle), np.nan), agonist, antagonist)


def tension(inst: ShortForm, loads: Sequence[float]) -> Chart:
    """Draw how both tensions vary with the output angle under loads (N), and where slack is (Fig. 8)."""
    chart, (axis,) = Chart.panels()
    chart.keep("handle_angle [deg]", np.degrees(handle_angles(inst)))
    colors = style.colors(len(loads) + (0.0 not in loads))[-len(loads) :]
    for force, color in zip(loads, colors, strict=True):
        varied = tension_variation(inst, force)
        output = chart.keep(f"output_angle at {force:g} N [deg]", varied.output_angle)
        chart.curve(axis, output, f"agonist at {force:g} N [N]", varied.agonist, color=color, label=load_name(force))
        chart.curve(axis, output, f"antagonist at {force:g} N [N]", varied.antagonist, "--", color=color)
    axis.axhline(-inst.pretension, color=style.ACCENT, lw=1.1)
    axis.annotate(
        f"antagonist slack: variation −T$_o$ = −{inst.pretension:g} N",
        (0.99, -inst.pretension),
        xycoords=("axes fraction", "data"),
        xytext=(0, -4),
        textcoords="offset points",
        ha="right",
        va="top",
        color=style.ACCENT,
        fontsize=8.5,
    )
    axis.plot([], [], color=style.MUTED, label="agonist")
    axis.plot([], [], "--", color=style.MUTED, label="antagonist")
    axis.set(xlabel="output angle $\\theta_e$ [deg]", ylabel="tension variation T − T$_o$ [N]")
    axis.margins(y=0.1)
    style.legend_above(axis, 6)
    return chart


def transmissibility(inst: ShortForm, loads: Sequence[float]) -> Chart:
    """Draw the torque transmissibility over the output angle under loads, N (Fig. 9)."""
    chart, (axis,) = Chart.panels(height=3.7)
    handle = handle_angles(inst)
    chart.keep("handle_angle [deg]", np.degrees(handle))
    for force, color in zip(loads, style.colors(len(loads)), strict=True):
        output = statics.output_angle(inst, handle, force)
        ratio = statics.torque_transmissibility(inst, handle, force)
        inside = (np.abs(output) <= inst.output_range) & (output >= -1e-12)
        shown = chart.keep(f"output_angle at {force:g} N [deg]", np.where(inside, np.degrees(output), np.nan))
        heading = f"transmissibility at {force:g} N"
        chart.curve(axis, shown, heading, np.where(inside, ratio, np.nan), color=color, label=load_name(force))
    axis.set(xlabel="output angle $\\theta_e$ [deg]", ylabel="torque transmissibility ξ")
    style.legend_above(axis, 6)
    return chart


def draw_losses(chart: Chart, axis: Axes, inst: ShortForm, loads: Sequence[float]) -> None:
    """Draw the loss over the unloaded output angle under loads (N), by the full model and by eq. 17 (Fig. 11)."""
    angles = np.linspace(0.0, inst.output_range, 241)
    output = chart.keep("unloaded_output_angle [deg]", np.degrees(angles))
    handle = statics.handle_angle(inst, angles)
    colors = style.colors(len(loads) + (0.0 not in loads))[-len(loads) :]
    for force, color in zip(loads, colors, strict=True):
        lost = np.degrees(angles - statics.output_angle(inst, handle, force))
        first_order = np.degrees(statics.loss_of_dexterity(inst, angles, force))
        chart.curve(axis, output, f"loss at {force:g} N [deg]", lost, color=color, label=load_name(force))
        chart.curve(axis, output, f"eq. 17 at {force:g} N [deg]", first_order, ":", color=color, lw=1.4)
    axis.set(xlabel="unloaded output angle $\\theta_e^*$ [deg]", ylabel="loss of output angle [deg]", ylim=(0, None))
    style.legend_above(axis, 4)


class Loop(NamedTuple):
    """Flexion and extension in a run, and the output angle (rad) that eq. 19 estimates from it, shape (n,)."""

    heading: str
    run: Run
    estimate: Array


def estimated_output_angle(inst: ShortForm, run: Run) -> Array:
    """Return the output angle (rad) that eq. 19 gives from the measured signals of a run."""
    handle = np.clip(run["measured_handle_angle"], -inst.handle_range, inst.handle_range)
    tensions = run["measured_tension"].T
    return np.asarray(statics.estimate_output_angle(inst, handle, *tensions, slack_below=slack_tension(inst)))


def hysteresis(inst: ShortForm, loops: Sequence[Loop], measured_by: str = "measured") -> Chart:
    """Draw the output angle over the handle angle of runs, beside theory and estimate (Fig. 14a).

    The theory is that of each run's largest load; of an estimate, what comes from one tendon alone is drawn apart.
    """
    slack_anywhere = False
    chart, axes = loop_panels(loops, "output angle $\\theta_e$ [deg]")
    grid = np.linspace(0, statics.reach(inst), 101)
    unloaded = np.degrees(statics.output_angle(inst, grid))
    for axis, (heading, run, estimate) in zip(axes, loops, strict=True):
        at, angles = f"at {heading} [deg]", run["measured_handle_angle"]
        handle = chart.keep(f"handle_angle {at}", np.degrees(angles))
        measured = chart.keep(f"measured_output_angle {at}", np.degrees(run["measured_output_angle"]))
        axis.plot(np.degrees(grid), unloaded, ":", color=style.MUTED, lw=1.3)
        angle = chart.keep(f"estimate {at}", np.degrees(estimate))
        slack = run["measured_tension"].min(axis=1) <= slack_tension(inst)
        slack_anywhere |= bool(slack.any())
        axis.plot(handle, np.where(slack, np.nan, angle), color=style.ANTAGONIST, lw=1.0)
        axis.plot(handle, np.where(slack, angle, np.nan), color=style.LOADS[0], lw=1.0)
        axis.plot(handle, measured, color=style.AGONIST, lw=1.0)
        within = np.clip(angles, -inst.handle_range, inst.handle_range)
        theory = chart.keep(f"theory {at}", np.degrees(statics.output_angle(inst, within, run["force"])))
        loads = np.abs(run["force"])
        order = np.argsort(handle)
        order = order[loads[order] >= _LARGEST * loads.max()]
        axis.plot(handle[order], theory[order], "--", color=style.INK, lw=1.3)
    style.legend_outside(
        chart.figure,
        (measured_by, style.AGONIST, "-"),
        ("estimate from the tensions (eq. 19)", style.ANTAGONIST, "-"),
        *[("estimate from one tension, the other tendon slack", style.LOADS[0], "-")] * slack_anywhere,
        ("theory, no load", style.MUTED, ":"),
        ("theory", style.INK, "--"),
        columns=3 if slack_anywhere else None,
    )
    return chart


def loop_panels(loops: Sequence[Loop], ylabel: str) -> tuple[Chart, Sequence[Axes]]:
    """Return a chart with a panel for each run, over its handle angle."""
    chart, axes = Chart.panels(len(loops), width=max(_NARROWEST, 3.1 * len(loops) + 0.6), height=3.6)
    for axis, loop in zip(axes, loops, strict=True):
        axis.set(title=loop.heading, xlabel="handle angle $\\theta_h$ [deg]")
    axes[0].set_ylabel(ylabel)
    return chart, axes


class SteppedCurve(NamedTuple):
    """A run with a step load, when it comes (s), and the angle (rad) that it leaves without friction."""

    heading: str
    run: Run
    loaded: float
    theory: float


def step_response(steps: Sequence[SteppedCurve]) -> Chart:
    """Draw output angle and agonist tension over time around a step load (Fig. 15)."""
    chart, axes = Chart.panels(len(steps), width=max(_NARROWEST, 2.5 * len(steps) + 0.8), height=3.4)
    for axis, (heading, run, loaded, without_friction) in zip(axes, steps, strict=True):
        at = f"at {heading}"
        time = chart.keep(f"time {at} [s]", run.time)
        theory = np.degrees(np.where(time < loaded, np.nan, without_friction))
        axis.plot(time, theory, ":", color=style.INK, lw=1.3)
        output = np.degrees(output_of(run))
        chart.curve(axis, time, f"output_angle {at} [deg]", output, color=style.AGONIST, lw=1.3)
        before, after = _around(time, loaded)
        middle = (output[before][-1] + output[-1]) / 2
        axis.set(
            title=heading.replace(" deg", "°"),
            xlabel="time [s]",
            xlim=(max(loaded - _BEFORE_STEP, time[0]), min(loaded + _AFTER_STEP, time[-1])),
            ylim=(middle - _ANGLES_SHOWN, middle + _ANGLES_SHOWN),
        )
        right = axis.twinx()
        right.grid(visible=False)
        agonist = chart.keep(f"agonist {at} [N]", run["measured_tension"][:, 0])
        right.plot(time, agonist, color=style.ANTAGONIST, lw=1.0)
        middle = (float(agonist[before].mean()) + float(agonist[after].mean())) / 2
        # in the lower half, where it does not run over the angle
        right.set_ylim(middle - _TENSIONS_SHOWN / 2, middle + 3 * _TENSIONS_SHOWN / 2)
        right.spines["right"].set_visible(True)
    axes[0].set_ylabel("output angle $\\theta_e$ [deg]")
    right.set_ylabel("agonist tension [N]")
    style.legend_outside(
        chart.figure,
        ("output angle (left)", style.AGONIST, "-"),
        ("agonist tension (right)", style.ANTAGONIST, "-"),
        ("output angle, theory without friction", style.INK, ":"),
    )
    return chart


def signals(run: Run, names: Sequence[str] = ()) -> Chart:
    """Draw signals of a run over time, a panel each: those named, or angles, tensions and loads.

    Joints that have each their own tendons get a column of panels each, whose curves are few; else a panel has a curve
    per joint, tendon or component. Raises KeyError if a signal is unknown or was not recorded.
    """
    recorded = {name: run[name] for name in names}
    paired = run.names == Names.paired(run.joints)
    panels = [[name] for name in recorded]
    if not panels and paired:
        panels = [kept for kept in (_recorded(run, kind) for kind in _SHOWN) if kept]
    elif not panels:
        panels = [[name] for name in _SHOWN_OF_SEVERAL if _moves(run, name)]
    thin = run[:: max(1, len(run) // _MOST_POINTS)]
    alone = paired and not any("." in name for name in recorded)
    parts = [thin.axis(joint) for joint in run.joints] if alone else [thin]
    figure = style.drawing(width=7.0 * len(parts), height=0.6 + (1.9 if alone else 2.2) * len(panels))
    chart = Chart(figure)
    axes = figure.subplots(len(panels), len(parts), squeeze=False, sharex=True)
    time = chart.keep("time [s]", thin.time)
    for column, part in enumerate(parts):
        for panel, shown in zip(axes[:, column], panels, strict=True):
            _draw_signals(chart, panel, part, shown)
        axes[0, column].set_title(part.joints[0] if parts[1:] else "", loc="right")
        axes[-1, column].set_xlabel("time [s]")
        axes[-1, column].set_xlim(time[0], time[-1]) if len(time) > 1 else None
    figure.align_ylabels()
    return chart


def _moves(run: Run, name: str) -> bool:
    """Return whether a run has a signal, or a column of one, that is not zero throughout."""
    return name.partition(".")[0] in run.signals() and bool(np.nan_to_num(run[name]).any())


def _recorded(run: Run, names: Sequence[str]) -> list[str]:
    """Return the signals that a run has; of those after the first, only what is not zero throughout."""
    there = [name for name in names if name in run.signals() and np.isfinite(run[name]).any()]
    return there[:1] + [name for name in there[1:] if run[name].any()]


def _draw_signals(chart: Chart, panel: Axes, run: Run, names: Sequence[str]) -> None:
    """Draw signals of one unit into a panel, with a legend above it."""
    first = names[0].partition(".")[0]
    unit = SIGNALS[first].unit
    shown = _READABLE.get(unit, unit)
    factor = in_unit(shown, unit) if shown != unit else 1.0
    curves = [heading for name in names for heading in _headings(run, name)]
    pair = [style.AGONIST, style.ANTAGONIST] if SIGNALS[first].per_tendon and len(run.joints) == 1 else []
    colors = pair if len(pair) == len(curves) else style.colors(len(curves))
    for heading, color in zip(curves, colors, strict=True):
        signal, _, column = heading.partition(".")
        words = signal.replace("_", " ")
        if len(run.joints) > 1:
            label = column or words
        else:
            label = f"{words}, {column.removeprefix(f'{run.joints[0]}_')}" if SIGNALS[signal].per_tendon else words
        chart.curve(panel, run.time, f"{heading} [{shown}]", factor * run[heading], color=color, lw=1.2, label=label)
    quantity = "tension" if first.endswith("tension") else _QUANTITIES.get(unit, "")
    about = f"{first.replace('_', ' ')}\n" if len(run.joints) > 1 else f"{quantity} "
    panel.set_ylabel(f"{about}[{unit_text(shown)}]".strip() if unit != "1" else "")
    style.legend_above(panel, 3 if len(run.joints) == 1 else 4)


def _headings(run: Run, name: str) -> list[str]:
    """Return the columns of a signal that are not zero throughout, or its first; or the signal if it has one alone."""
    headings = [f"{name}.{column}" for column in run.columns(name)] if "." not in name else []
    if len(run.joints) == 1:
        return headings or [name]
    return [heading for heading in headings if _moves(run, heading)] or headings[:1] or [name]


def output_of(run: Run) -> Array:
    """Return the output angle of a run, rad: the true one of a twin, else that of a bench's distal encoder."""
    return run["measured_output_angle" if run.output_angle is None else "output_angle"]


def _around(time: Array, loaded: float) -> tuple[slice, slice]:
    """Return the last fifth of a second before a time (s), and that at the end."""
    first = max(1, int(np.searchsorted(time, loaded)))
    settled = int(np.searchsorted(time, loaded - _AVERAGED))
    return slice(min(settled, first - 1), first), slice(int(np.searchsorted(time, time[-1] - _AVERAGED)), None)


def handle_angles(inst: ShortForm) -> Array:
    """Return the handle angles (rad) of curves over the output angle, which go beyond the working range."""
    return np.linspace(0.0, min(inst.handle_range, 1.6 * statics.reach(inst)), 321)
