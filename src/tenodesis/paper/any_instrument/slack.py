"""How loads change the tensions of an instrument that is held, and from which load on a tendon is slack."""

import numpy as np

from tenodesis import statics
from tenodesis.paper.any_instrument.held import Load, State, described, loads, panels, states
from tenodesis.paper.context import Context
from tenodesis.report import style
from tenodesis.report.content import Column, Plot, Section, named
from tenodesis.report.routing import tendon_colours
from tenodesis.statics import chain

_POINTS = 61
_FARTHEST = 20.0
"""How far curves go, over the shown load."""


def section(context: Context) -> Section:
    """Compute the load in each direction at which the first tendon goes slack, and the tensions on the way."""
    inst = context.whole
    held, applied = states(inst), loads(inst)
    table = context.table(
        "Load at which the first tendon goes slack, handle and motors held",
        "state",
        "direction",
        Column(
            "slack from [N]",
            "slack.{state}.{load}",
            "N",
            "Load {direction} at which the first tendon goes slack, {state}",
            optional=True,
        ),
        "tendon",
    )
    least: list[float] = []
    found: dict[tuple[str, str], float] = {}
    for state in held:
        for load in applied:
            lost = statics.loss(inst, state.angles, load.wrench, load.grip)
            force = lost.slack_factor * load.size
            found[state.name, load.name] = lost.slack_factor
            least += [force] if force > 0 else []
            labels = {"state": state.name, "load": load.name, "direction": load.direction}
            table.row(state.name, load.direction, force, lost.slack_tendon or "–", **labels)
    text = "<p>Handle and motors are held, without friction, and a force grows at the tip or between the jaws."
    if least:
        context.add("slack.least", min(least), "N", "Least load at which a tendon goes slack, none before")
        text += f" The least load of all, where none is slack before, is {min(least):.3g} N."
    if 0.0 in found.values():
        text += " Zero: that tendon is slack without a load."
    bent = held[-1]
    plot = _plot(context, bent, applied, [found[bent.name, load.name] for load in applied])
    return Section("tension", "Tension and slack", text + "</p>", [plot], [table])


def _plot(context: Context, state: State, applied: list[Load], slack: list[float]) -> Plot:
    inst = context.whole
    colors = tendon_colours(len(inst.tendons))
    chart, axes = panels(len(applied), 2.6, 3.8)
    for axis, load, factor in zip(axes, applied, slack, strict=True):
        last = load.multiples[-1]
        end = np.clip(1.25 * factor, last, max(last, _FARTHEST)) if np.isfinite(factor) else last
        multiples = np.linspace(0.0, float(end), _POINTS)
        forces = chart.keep(f"force {load.direction} [N]", multiples * load.size)
        wrench, grip = np.outer(multiples, load.wrench), multiples * load.grip
        tensions = chain.tensions(inst, state.handle, wrench, grip_force=grip, strokes=state.strokes)
        for n, (tendon, color) in enumerate(zip(inst.tendons, colors, strict=True)):
            chart.curve(
                axis,
                forces,
                f"{tendon.name}, {load.direction} [N]",
                tensions[:, n],
                color=color,
                lw=max(2.8 - 0.4 * n, 1.0),
            )
        if 0 < factor <= end:
            axis.axvline(factor * load.size, color=style.ACCENT, lw=1.1, ls=":")
        axis.set(title=load.direction, xlabel="force [N]", xlim=(0, forces[-1]), ylim=(0, None))
    axes[0].set_ylabel("tension [N]")
    lines = [(tendon.name, color, "-") for tendon, color in zip(inst.tendons, colors, strict=True)]
    style.legend_outside(chart.figure, *lines, ("first tendon slack", style.ACCENT, ":"), columns=4)
    where = described(inst, state)
    return chart.plot("tension", f"Tensions of all tendons over the load, {named(inst)} at {where}.")
