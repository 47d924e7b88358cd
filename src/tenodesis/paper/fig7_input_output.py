"""Fig. 7: the input-output relationship under load."""

import numpy as np

from tenodesis import statics
from tenodesis.instrument import ShortForm
from tenodesis.paper.context import Context
from tenodesis.report import curves
from tenodesis.report.content import Column, Section, fixed, named, number
from tenodesis.report.curves import forces, load_name


def slack_range(inst: ShortForm, force: float, onset: float) -> str:
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
        curves.linear_ratio(inst),
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

    slackens = False
    for force in loads:
        output = np.degrees(statics.output_angle(inst, np.array([0.0, end]), force))
        straight, flexed = (float(angle) for angle in output)
        slack = slack_range(inst, force, curves.slack_onset(inst, force)[0])
        slackens |= slack != "nowhere"
        table.row(load_name(force), straight, flexed, unloaded - flexed, slack, force=force)
    chart = curves.input_output(inst, loads)
    plot = chart.plot(
        context.file_name("fig7", "input_output"),
        f"Input–output relationship under load, {named(inst)}, T<sub>o</sub> = {inst.pretension:g} N"
        f"{context.figure_of('Fig. 7')}.",
    )
    return Section(
        "input_output", "Input and output under load", _text(inst, ratio, end, gap, slackens=slackens), [plot], [table]
    )


def _text(inst: ShortForm, ratio: float, end: float, gap: float, *, slackens: bool) -> str:
    if inst.joint_type != "tendon-gear":
        steeper = ", and more steeply once the antagonist is slack and only one tendon resists" if slackens else ""
        return (
            f"<p>The unloaded tip turns {number(ratio, 4)} times as far as the handle. A load reduces the output "
            f"angle{steeper}.</p>"
        )
    return (
        f"<p>The unloaded tip follows the exact geometry, not the ratio {number(ratio, 3)}: at a handle angle of "
        f"{fixed(np.degrees(end), 1)}° the linear rule is {fixed(abs(gap), 1)}° off. A load reduces the output angle, "
        "and more steeply once the antagonist is slack and only one tendon resists: there the curve changes from "
        "convex to concave.</p>"
    )
