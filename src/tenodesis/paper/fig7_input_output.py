"""Fig. 7: the input-output relationship under load."""

import numpy as np

from tenodesis import statics
from tenodesis.instrument import Instrument
from tenodesis.paper.context import Context, forces, load_name
from tenodesis.report import style
from tenodesis.report.content import Chart, Column, Section, fixed, named, number


def slack_onset(inst: Instrument, force: float) -> tuple[float, float]:
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


def slack_range(inst: Instrument, force: float, onset: float) -> str:
    """Return in words where in the working range the antagonist is slack under a force (N), given the onset (rad)."""
    slack = statics.slack_force(inst, np.linspace(0.0, inst.output_range, 401)) <= force
    if slack.all() or not slack.any():
        return "everywhere" if slack.all() else "nowhere"
    return f"θ_e ≥ {fixed(np.degrees(onset), 1)}°" if np.isfinite(onset) else "near the straight tip"


def section(context: Context) -> Section:
    """Compute the input-output curves and the output angle lost under load."""
    inst = context.inst
    loads = forces(inst)
    end = statics.reach(inst)
    unloaded = float(np.degrees(statics.output_angle(inst, end)))
    ratio = context.add(
        "input_output.linear_ratio",
        float(statics.gradient(statics.output_angle, inst, 0.0, wrt=["handle_angle"])["handle_angle"]),
        "1",
        "Ratio of output to handle angle near zero, no load",
    )
    gap = context.add(
        "input_output.linear_ratio_error",
        unloaded - float(np.degrees(ratio * end)),
        "deg",
        "Unloaded output angle minus the linear ratio's at the end of the working range",
    )
    table = context.table(
        f"Output angle and loss, handle at {fixed(np.degrees(end), 1)}°",
        "force at the tip",
        Column(
            "output at handle 0° [°]",
            "input_output.straight_handle.at_{force:g}N",
            "deg",
            "Output angle at a straight handle under {force:g} N",
        ),
        Column(
            "output [°]",
            "input_output.output_angle.at_{force:g}N",
            "deg",
            f"Output angle at a handle angle of {np.degrees(end):.1f} deg under {{force:g}} N",
        ),
        "lost [°]",
        "antagonist slack",
    )

    chart, (axis,) = Chart.panels()
    angles = np.linspace(0.0, min(inst.handle_range, 1.3 * end), 301)
    handle = chart.keep("handle_angle [deg]", np.degrees(angles))
    line = chart.keep("gear ratio line [deg]", ratio * handle)
    inside = line <= np.degrees(inst.output_range)
    axis.plot(handle[inside], line[inside], "--", color=style.REFERENCE, lw=1.3, label=f"ratio {ratio:.3g} (linear)")
    for force, color in zip(loads, style.colors(len(loads)), strict=True):
        output = np.degrees(statics.output_angle(inst, angles, force))
        output[output > np.degrees(inst.output_range) + 1e-9] = np.nan
        heading = f"output_angle at {force:g} N [deg]"
        chart.curve(axis, handle, heading, output, color=color, label=load_name(force))
        onset, onset_handle = slack_onset(inst, force)
        if np.isfinite(onset_handle):
            axis.plot(np.degrees(onset_handle), np.degrees(onset), "o", color=color, ms=5.5, mec="white")
        flexed = float(np.degrees(statics.output_angle(inst, np.array([end]), force)[0]))
        slack = slack_range(inst, force, onset)
        table.row(load_name(force), float(output[0]), flexed, unloaded - flexed, slack, force=force)
    axis.plot([], [], "o", color=style.MUTED, mec="white", label="antagonist goes slack")
    axis.set(xlabel="handle angle $\\theta_h$ [deg]", ylabel="output angle $\\theta_e$ [deg]", xlim=(0, handle[-1]))
    style.legend_above(axis, 4)
    plot = chart.plot(
        "fig7_input_output",
        f"Input–output relationship under load, {named(inst)}, T<sub>o</sub> = {inst.pretension:g} N"
        f"{context.figure_of('Fig. 7')}. The dashed line is linear.",
    )
    return Section("input_output", "Input and output under load", _text(inst, ratio, end, gap), [plot], [table])


def _text(inst: Instrument, ratio: float, end: float, gap: float) -> str:
    if inst.joint_type != "tendon-gear":
        return (
            f"<p>The unloaded tip turns {number(ratio, 4)} times as far as the handle. A load reduces the output "
            "angle, and more steeply once the antagonist is slack and only one tendon resists.</p>"
        )
    return (
        f"<p>The unloaded tip follows the exact geometry, not the ratio {number(ratio, 3)}: at a handle angle of "
        f"{fixed(np.degrees(end), 1)}° the linear rule is {fixed(abs(gap), 1)}° off. A load reduces the output angle, "
        "and more steeply once the antagonist is slack and only one tendon resists: there the curve changes from "
        "convex to concave.</p>"
    )
