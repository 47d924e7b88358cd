"""What loads take from every joint that is held, and what gives it back (eq. 17, Fig. 11)."""

from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from tenodesis import statics
from tenodesis.instrument import ShortForm
from tenodesis.paper.context import Context, shown_force
from tenodesis.paper.subject import HeldState, Load, Subject, panels
from tenodesis.report import style
from tenodesis.report.content import Array, Cell, Chart, Plot, ResultColumn, Section, fixed, named
from tenodesis.report.curves import draw_losses, forces
from tenodesis.statics import chain

_TITLE = "Loss of output angle"
_POINTS = 41

_SEEN = 0.05
"""Difference of two curves that can be seen, deg"""


class Lost(NamedTuple):
    """What a load takes in a state, and what gives it back: (joints,) or (handle joints,), rad, and (tendons,), m."""

    lost: Array
    first_order: Array
    by_hand: Array
    strokes: Array


def lost(subject: Subject, state: HeldState, load: Load) -> Lost:
    """Return what a load takes from the joints in a state; NaN where the tip cannot be held, or not be brought back."""
    if (inst := subject.plane) is not None:
        angles = state.angles - statics.output_angle(inst, state.handle, load.size)
        by_hand = statics.handle_angle(inst, state.angles, load.size) - state.handle
        return Lost(angles, statics.loss_of_dexterity(inst, state.angles, load.size), by_hand, np.zeros(2))
    found = statics.loss(subject.inst, state.angles, load.wrench, load.grip)
    rates = subject.rates(state.handle, state.strokes)
    first_order = -(rates.by_wrench @ load.wrench + rates.by_grip * load.grip)
    return Lost(subject.bends.summed(found.lost), first_order, found.handle_corrections, found.strokes)


def section(context: Context) -> Section:
    """Compute the loss of every joint under loads, and the strokes or handle angles that restore it."""
    subject, planar = context.subject, context.subject.plane is not None
    table = context.table(
        "The unloaded minus the loaded angle, "
        + ("loss of dexterity Θ (eq. 17) and compensation angle θ_h* − θ_h (eq. 20)" if planar else "")
        + "what the handle or the motors have to move to bring all joints back" * (not planar)
        + "; a dash: the tip cannot be held, or not be brought back",
        "held at",
        "load",
        *(
            _column(f"{joint} lost [°]", "loss", label, f"Loss{' of ' * bool(label)}{label} at {{at}} under {{words}}")
            for joint, label in zip(subject.joints, subject.labels, strict=True)
        ),
        *[_column("Θ [°]", "loss.theta", "", "Loss of dexterity (eq. 17) at {at} under {words}")] * planar,
        *(
            _column(
                "θ_h* − θ_h [°]" if planar else f"by {joint} [°]",
                "loss.compensation_angle",
                joint,
                f"{'Angle of ' + joint if joint else 'Handle angle'} to be added to hold {{at}} under {{words}}",
            )
            for joint in subject.handles
        ),
        *[_column("largest stroke [mm]", "loss.stroke", "", "Largest stroke to hold {at} under {words}", "mm")]
        * (not planar),
        *["strokes [mm]"] * (not planar),
    )
    apart = largest = 0.0
    for state in subject.held:
        for load in (sized for direction in subject.loads for sized in direction.all):
            found = lost(subject, state, load)
            angles = np.degrees(found.lost)
            strokes: list[Cell] = []
            if not planar:
                wound = dict(zip((tendon.name for tendon in subject.inst.tendons), 1e3 * found.strokes, strict=True))
                moved = ", ".join(f"{name} {fixed(stroke)}" for name, stroke in wound.items() if abs(stroke) > 1e-4)
                strokes = [float(np.abs(found.strokes).max()) * 1e3, moved or "–"]
            apart = max(apart, float(np.nanmax(np.abs(angles - np.degrees(found.first_order)), initial=0.0)))
            if load.size in {one.size for one in subject.loads} and np.isfinite(angles).all():
                largest = max(largest, float(np.abs(angles).max()))
            table.row(
                subject.described(state),
                load.text,
                *angles,
                *np.degrees(found.first_order)[: int(planar)],
                *np.degrees(found.by_hand)[: len(subject.handles)],
                *strokes,
                state=state.name,
                at=f"{state.name.removeprefix('at_').replace('deg', ' deg')} of output"
                if planar
                else f"the {state.name} state",
                load="" if planar else f".{load.name}",
                size=f"{load.size:g}" if planar else f"{load.size:.3g}",
                words=load.text,
            )
    if subject.plane is not None:
        return Section(
            "loss", f"{_TITLE} and its compensation by hand", *_of_plane(context, subject.plane, apart), [table]
        )
    shown = " or ".join(load.text for load in subject.loads)
    context.add("loss.largest", largest, "deg", f"Largest angle that a joint loses under {shown}")
    text = (
        "<p>Handle and motors are held, without friction. Forces act at the tip along its own axes: z along it, x "
        "where positive yaw bends, y where positive pitch does; each is taken against flexion. Grip presses the "
        "jaws apart. Directions that take next to nothing from every joint are left out.</p>"
    )
    return Section("loss", _TITLE, text, [_plot(subject, subject.states, subject.loads)], [table])


def _column(heading: str, name: str, label: str, about: str, unit: str = "deg") -> ResultColumn:
    key = f"{name}{'.' * bool(label)}{label}.{{state}}{{load}}.{{size}}N"
    return ResultColumn(heading, key, unit, about, optional=unit == "mm")


def _plot(subject: Subject, held: list[HeldState], applied: list[Load]) -> Plot:
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
        rates = subject.rates(held[-1].handle, held[-1].strokes)
        first = -np.degrees(np.outer(multiples, rates.by_wrench @ load.wrench + rates.by_grip * load.grip))
        for (name, color, _), lost in zip(subject.legend, first.T, strict=True):
            chart.curve(axis, forces, f"first order of {name}, {load.direction} [deg]", lost, ":", color=color, lw=1.0)
        axis.set(title=load.direction, xlabel="force [N]", xlim=(0, forces[-1]))
    axes[0].set_ylabel("lost [deg]")
    lines = [("straight", style.MUTED, "--")] * (len(held) > 1) + [("first order", style.MUTED, ":")]
    style.legend_outside(chart.figure, *subject.legend, *lines)
    bent = subject.described(held[-1])
    return chart.plot("loss", f"Loss of every joint over the load, {named(inst)} at {bent} (solid), and first order.")


def _of_plane(context: Context, inst: ShortForm, apart: float) -> tuple[str, list[Plot]]:
    """Return the text of a planar instrument and the figure, given how far the loss is from first order, deg."""
    force = shown_force(inst)
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
    return text, [plot]


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
