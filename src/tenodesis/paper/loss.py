"""Fig. 11: the loss of output angle and the handle angle that makes up for it."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from tenodesis import statics
from tenodesis.instrument import Instrument
from tenodesis.paper.context import Context
from tenodesis.paper.input_output import forces
from tenodesis.report import style
from tenodesis.report.content import Plot, Section, Table, fixed, named

Array = NDArray[np.float64]


def shown_force(inst: Instrument) -> float:
    """Return the load that single-load figures are drawn for, N."""
    loads = forces(inst)[1:]
    return loads[min(1, len(loads) - 1)]


def section(context: Context) -> Section:
    """Compute the loss by the full model and by eq. 17, and the compensation angle."""
    inst = context.inst
    force = shown_force(inst)
    fig, (left, right) = style.figure(2, width=8.6, height=4.0)
    curves: dict[str, Array] = {}
    _construction(context, left, force, curves)
    _losses(inst, right, curves)
    states = np.array([0.0, 0.5, 1.0]) * inst.output_range
    handles = statics.handle_angle(inst, states)
    rows = []
    for load in forces(inst)[1:]:
        lost = np.degrees(states - statics.output_angle(inst, handles, load))
        first_order = np.degrees(statics.loss_of_dexterity(inst, states, load))
        more = np.degrees(statics.handle_angle(inst, states, load) - handles)
        rows.append([f"{load:g} N", *(fixed(value) for value in (*lost, *first_order, *more))])
        for state, value, linear, compensation in zip(np.degrees(states), lost, first_order, more, strict=True):
            context.add(
                f"loss.theta.at_{state:.4g}deg.{load:g}N",
                linear,
                "deg",
                f"Loss of dexterity (eq. 17) at {state:.4g} deg of output under {load:g} N",
            )
            context.add(
                f"loss.at_{state:.4g}deg.{load:g}N",
                value,
                "deg",
                f"Loss at {state:.4g} deg of output under {load:g} N",
            )
            context.add(
                f"loss.compensation_angle.at_{state:.4g}deg.{load:g}N",
                compensation,
                "deg",
                f"Handle angle to be added to hold {state:.4g} deg of output under {load:g} N",
            )
    labels = [f"{np.degrees(state):.4g}°" for state in states]
    table = Table(
        "Loss by the full model, loss of dexterity Θ (eq. 17) and compensation angle (eq. 20), by unloaded output "
        "angle [°]; a dash: out of the handle's range",
        ["force", *(f"loss {label}" for label in labels), *(f"Θ {label}" for label in labels)]
        + [f"θ_h* − θ_h {label}" for label in labels],
        rows,
    )
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
    text = (
        f"<p>The loss is what tissue takes: θ<sub>e</sub>* − θ<sub>e</sub>. Held by a joint of "
        f"{fixed(stiffness, 3)} N·m/rad, it is Θ to first order. The full model departs from Θ where "
        + ("" if inst.joint_type == "tendon-pulley" else "the load's lever changes as the tip gives way, and where ")
        + "a slack tendon leaves the other to resist alone.</p>"
    )
    plot = Plot(
        "fig11_loss",
        f"Left: loss and compensation angle at {force:g} N, {named(inst)} ({context.figure_of('Fig. 11')}). "
        "Right: the loss by the full model (solid) and by eq. 17 (dotted).",
        fig,
        curves,
    )
    return Section("loss", "Loss of output angle and its compensation by hand", text, [plot], [table])


def _construction(context: Context, axis: Axes, force: float, curves: dict[str, Array]) -> None:
    """Draw the reference and the loaded curve, and between them the loss and the compensation angle."""
    inst = context.inst
    desired = inst.output_range / 2
    held = float(statics.handle_angle(inst, desired))
    handle = np.linspace(0.0, min(inst.handle_range, 1.25 * statics.reach(inst)), 241)
    free, loaded = (np.degrees(statics.output_angle(inst, handle, load)) for load in (0.0, force))
    curves |= {
        "handle_angle [deg]": np.degrees(handle),
        "reference [deg]": free,
        f"at {force:g} N [deg]": loaded,
    }
    axis.plot(np.degrees(handle), free, color=style.INK, label="reference, no load (eq. 18)")
    axis.plot(np.degrees(handle), loaded, color=style.LOADS[0], label=f"under {force:g} N")
    kept = float(np.degrees(statics.output_angle(inst, np.array([held]), force)[0]))
    needed = float(np.degrees(statics.handle_angle(inst, np.array([desired]), force)[0]))
    x, y = np.degrees(held), np.degrees(desired)
    arrow = {"arrowstyle": "->", "color": style.ACCENT, "lw": 1.5}
    axis.annotate("", (x, kept), (x, y), arrowprops=arrow)
    told: dict[str, Any] = {"textcoords": "offset points", "color": style.ACCENT}
    axis.annotate(f"loss {y - kept:.1f}°", (x, kept), (8, -14), **told)
    if np.isfinite(needed):
        axis.annotate("", (needed, y), (x, y), arrowprops=arrow)
        axis.annotate(f"compensation {needed - x:.1f}°", (x, y), (-6, 5), ha="right", **told)
    axis.set(
        xlabel="handle angle $\\theta_h$ [deg]",
        ylabel="output angle $\\theta_e$ [deg]",
        xlim=(0, np.degrees(handle[-1])),
    )
    style.legend_above(axis, 2)


def _losses(inst: Instrument, axis: Axes, curves: dict[str, Array]) -> None:
    """Draw the loss against the unloaded output angle, by the full model and by eq. 17."""
    output = np.linspace(0.0, inst.output_range, 241)
    handle = statics.handle_angle(inst, output)
    curves["unloaded_output_angle [deg]"] = np.degrees(output)
    loads = forces(inst)
    for force, color in zip(loads[1:], style.colors(len(loads))[1:], strict=True):
        lost = np.degrees(output - statics.output_angle(inst, handle, force))
        first_order = np.degrees(statics.loss_of_dexterity(inst, output, force))
        curves |= {f"loss at {force:g} N [deg]": lost, f"eq. 17 at {force:g} N [deg]": first_order}
        axis.plot(np.degrees(output), lost, color=color, label=f"{force:g} N")
        axis.plot(np.degrees(output), first_order, ":", color=color, lw=1.4)
    axis.set(
        xlabel="unloaded output angle $\\theta_e^*$ [deg]",
        ylabel="loss of output angle [deg]",
        ylim=(0, None),
    )
    style.legend_above(axis, 4)
