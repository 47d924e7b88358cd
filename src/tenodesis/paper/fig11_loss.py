"""Fig. 11: the loss of output angle and the handle angle that restores it."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from tenodesis import statics
from tenodesis.instrument import ShortForm
from tenodesis.paper.context import Context, shown_force
from tenodesis.report import style
from tenodesis.report.content import Chart, Column, Section, fixed, named
from tenodesis.report.curves import draw_losses, forces, load_name

_SEEN = 0.05
"""Difference of two curves that can be seen, deg"""


def section(context: Context) -> Section:
    """Compute the loss by the full model and by eq. 17, and the compensation angle."""
    inst = context.inst
    force = shown_force(inst)
    states = np.array([0.0, 0.5, 1.0]) * inst.output_range
    handles = statics.handle_angle(inst, states)
    table = context.table(
        "Loss by the full model, loss of dexterity Θ (eq. 17) and compensation angle (eq. 20), by unloaded output "
        "angle [°]; a dash: out of the handle's range",
        "force",
        *(
            Column(f"{heading} {angle}°", f"{key}.at_{angle}deg.{{force:g}}N", "deg", about.format(angle=angle))
            for heading, key, about in (
                ("loss", "loss", "Loss at {angle} deg of output under {{force:g}} N"),
                ("Θ", "loss.theta", "Loss of dexterity (eq. 17) at {angle} deg of output under {{force:g}} N"),
                (
                    "θ_h* − θ_h",
                    "loss.compensation_angle",
                    "Handle angle to be added to hold {angle} deg of output under {{force:g}} N",
                ),
            )
            for angle in (f"{np.degrees(state):.4g}" for state in states)
        ),
    )
    apart = 0.0
    for load in forces(inst)[1:]:
        lost = states - statics.output_angle(inst, handles, load)
        first_order = statics.loss_of_dexterity(inst, states, load)
        compensation = statics.handle_angle(inst, states, load) - handles
        apart = max(apart, float(np.nanmax(np.abs(np.degrees(lost - first_order)), initial=0.0)))
        table.row(load_name(load), *np.degrees([*lost, *first_order, *compensation]), force=load)
    stiffness = context.add(
        "loss.flexural_stiffness.straight",
        statics.flexural_stiffness(inst, 0.0),
        "N·m/rad",
        "Flexural stiffness of the straight distal joint (eq. 16)",
    )
    context.add(
        "loss.flexural_stiffness.flexed",
        statics.flexural_stiffness(inst, inst.output_range),
        "N·m/rad",
        "Flexural stiffness of the distal joint at the end of its working range (eq. 16)",
    )
    chart, (left, right) = Chart.panels(2, width=8.6, height=4.0)
    _construction(chart, left, inst, force)
    draw_losses(chart, right, inst, forces(inst)[1:])
    plot = chart.plot(
        context.file_name("fig11", "loss"),
        f"Left: loss and compensation angle at {force:g} N, {named(inst)}{context.figure_of('Fig. 11')}. "
        "Right: the loss by the full model (solid) and to first order (eq. 17, dotted)"
        f"{', which coincide here' if apart < _SEEN else ''}.",
    )
    text = (
        "<p>The loss is the output angle that a load at the tip takes: θ<sub>e</sub>* − θ<sub>e</sub>. To first order "
        f"it is Θ, with a joint stiffness of {fixed(stiffness, 3)} N·m/rad. The full model departs from Θ where "
        + ("" if inst.joint_type == "tendon-pulley" else "the load's lever changes as the tip gives way, and where ")
        + "a slack tendon leaves the other to resist alone.</p>"
    )
    return Section("loss", "Loss of output angle and its compensation by hand", text, [plot], [table])


def _construction(chart: Chart, axis: Axes, inst: ShortForm, force: float) -> None:
    """Draw the reference and the loaded curve, and between them the loss and the compensation angle."""
    desired = inst.output_range / 2
    held = float(statics.handle_angle(inst, desired))
    angles = np.linspace(0.0, min(inst.handle_range, 1.25 * statics.reach(inst)), 241)
    handle = chart.keep("handle_angle [deg]", np.degrees(angles))
    for heading, load, label, color in (
        ("reference [deg]", 0.0, "reference, no load (eq. 18)", style.INK),
        (f"at {force:g} N [deg]", force, f"under {force:g} N", style.LOADS[0]),
    ):
        output = np.degrees(statics.output_angle(inst, angles, load))
        chart.curve(axis, handle, heading, output, color=color, label=label)
    kept = float(np.degrees(statics.output_angle(inst, np.array([held]), force)[0]))
    needed = float(np.degrees(statics.handle_angle(inst, np.array([desired]), force)[0]))
    x, y = np.degrees(held), np.degrees(desired)
    arrow = {"arrowstyle": "->", "color": style.ACCENT, "lw": 1.5}
    note: dict[str, Any] = {"textcoords": "offset points", "color": style.ACCENT}
    axis.annotate("", (x, kept), (x, y), arrowprops=arrow)
    axis.annotate(f"loss {y - kept:.1f}°", (x, kept), (8, -14), **note)
    if np.isfinite(needed):
        axis.annotate("", (needed, y), (x, y), arrowprops=arrow)
        axis.annotate(f"compensation {needed - x:.1f}°", (x, y), (-6, 5), ha="right", **note)
    axis.set(xlabel="handle angle $\\theta_h$ [deg]", ylabel="output angle $\\theta_e$ [deg]", xlim=(0, handle[-1]))
    style.legend_above(axis, 2)
