"""What loads take from every joint that is held, and what gives it back (eq. 17, Fig. 11)."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from tenodesis import statics
from tenodesis.instrument import ShortForm
from tenodesis.paper.context import Context, shown_force
from tenodesis.paper.subject import Load, State, Subject, panels
from tenodesis.report import style
from tenodesis.report.content import Chart, Column, Plot, Section, Table, fixed, named
from tenodesis.report.curves import draw_losses, forces, load_name
from tenodesis.statics import chain

_TITLE = "Loss of output angle"
_POINTS = 41

_SEEN = 0.05
"""Difference of two curves that can be seen, deg"""


def section(context: Context) -> Section:
    """Compute the loss of every joint under loads, and the strokes or handle angles that restore it."""
    subject = context.subject
    if subject.plane is not None:
        return _of_plane(context, subject.plane)
    inst, held, applied, names = subject.inst, subject.states, subject.loads, subject.joints
    tables: list[Table] = []
    largest = 0.0
    for state in held:
        key = f"{{joint}}.{state.name}.{{load}}.{{size:.3g}}N"
        restored = "strokes that bring all joints back"
        table = context.table(
            f"Lost at {subject.described(state)}: the unloaded minus the loaded angle; {restored}, largest and by tendon",
            "load",
            *(
                Column(
                    f"{name} [°]",
                    "loss." + key.replace("{joint}", name),
                    "deg",
                    f"Angle that {{size:.3g}} N {{direction}} take from {name}, {state.name}",
                    optional=True,
                )
                for name in names
            ),
            Column(
                "largest stroke [mm]",
                "loss.stroke." + key.removeprefix("{joint}."),
                "mm",
                f"Largest stroke that brings all joints back under {{size:.3g}} N {{direction}}, {state.name}",
                digits=3,
                optional=True,
            ),
            "strokes [mm]",
        )
        for load in applied:
            for sized in load.all:
                lost = statics.loss(inst, state.angles, sized.wrench, sized.grip)
                wound = 1e3 * lost.strokes
                moved = [(t.name, s) for t, s in zip(inst.tendons, wound, strict=True) if abs(s) > 1e-4]
                table.row(
                    sized.text,
                    *np.degrees(lost.lost),
                    float(np.abs(wound).max()),
                    ", ".join(f"{name} {fixed(stroke)}" for name, stroke in moved) or "–",
                    load=load.name,
                    size=sized.size,
                    direction=load.direction,
                )
                if sized.size == load.size and np.isfinite(lost.lost).all():
                    largest = max(largest, float(np.degrees(np.abs(lost.lost)).max()))
        tables.append(table)
    shown = " or ".join(load.text for load in applied)
    context.add("loss.largest", largest, "deg", f"Largest angle that a joint loses under {shown}")
    text = (
        "<p>Handle and motors are held, without friction. Forces act at the tip along its own axes: z along it, x "
        "where positive yaw bends, y where positive pitch does; each is taken against flexion. Grip presses the "
        "jaws apart. Directions that take next to nothing from every joint are left out. A dash: "
        "the tip cannot be held, or motors cannot restore it.</p>"
    )
    return Section("loss", _TITLE, text, [_plot(subject, held, applied)], tables)


def _plot(subject: Subject, held: list[State], applied: list[Load]) -> Plot:
    inst = subject.inst
    chart, axes = panels(len(applied))
    for axis, load in zip(axes, applied, strict=True):
        multiples = np.linspace(0.0, load.multiples[-1], _POINTS)
        forces = chart.keep(f"force {load.direction} [N]", multiples * load.size)
        for state, line in zip(held, ("--", "-")[-len(held) :], strict=True):
            free = chain.output_angles(inst, state.handle, strokes=state.strokes)
            wrench, grip = np.outer(multiples, load.wrench), multiples * load.grip
            angles = chain.output_angles(inst, state.handle, wrench, grip_force=grip, strokes=state.strokes)
            for n, (name, look) in enumerate(subject.looks.items()):
                at = f"{name}, {state.name}, {load.direction} [deg]"
                chart.curve(axis, forces, f"lost by {at}", np.degrees((free - angles)[:, n]), line, **look)
        # At the straight tip a slack tendon may tighten at once, and the rates there hold for no load.
        rates = chain.rates(inst, held[-1].handle, strokes=held[-1].strokes)
        first = -np.degrees(np.outer(multiples, rates.by_wrench @ load.wrench + rates.by_grip * load.grip))
        for (name, color, _), lost in zip(subject.legend, first.T, strict=True):
            chart.curve(axis, forces, f"first order of {name}, {load.direction} [deg]", lost, ":", color=color, lw=1.0)
        axis.set(title=load.direction, xlabel="force [N]", xlim=(0, forces[-1]))
    axes[0].set_ylabel("lost [deg]")
    lines = [("straight", style.MUTED, "--")] * (len(held) > 1) + [("first order", style.MUTED, ":")]
    style.legend_outside(chart.figure, *subject.legend, *lines)
    bent = subject.described(held[-1])
    return chart.plot("loss", f"Loss of every joint over the load, {named(inst)} at {bent} (solid), and first order.")


def _of_plane(context: Context, inst: ShortForm) -> Section:
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
    return Section("loss", f"{_TITLE} and its compensation by hand", text, [plot], [table])


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
