"""What each joint of the handle, or each set of motors, turns at the tip: what is meant, and neighbours (Fig. 7)."""

import numpy as np

from tenodesis import statics
from tenodesis.instrument import ShortForm
from tenodesis.paper.context import Context
from tenodesis.paper.subject import Subject, panels
from tenodesis.report import curves, style
from tenodesis.report.content import Plot, ResultColumn, ResultTable, Section, fixed, named, number
from tenodesis.report.curves import forces, load_name

_TITLE = "Input and output"


def slack_range(inst: ShortForm, force: float, onset: float) -> str:
    """Return in words where in the working range the antagonist is slack under a force (N), given the onset (rad)."""
    slack = statics.slack_force(inst, np.linspace(0.0, inst.output_range, 401)) <= force
    if slack.all() or not slack.any():
        return "everywhere" if slack.all() else "nowhere"
    return f"θ_e ≥ {fixed(np.degrees(onset), 1)}°" if np.isfinite(onset) else "near the straight tip"


def section(context: Context) -> Section:
    """Compute the angles of all joints over each motion, without and with loads."""
    subject = context.subject
    if subject.plane is not None:
        return _over_loads(context, subject.plane)
    what = "a joint of the handle moves" if subject.inst.handle_joints else "the motors bend a joint, the others held"
    text = (
        f"<p>Each panel: the angles of all joints at the tip while {what}, without friction. Solid without a load, "
        "dashed under the load that takes most from the joint that turns most. What else turns is coupling: by tendons "
        "that pass other joints, or by a joint that gives way to a neighbour’s moment.</p>"
    )
    if not subject.motions:
        text = f"<p>Neither handle nor motors of {named(subject.inst)} turn a joint.</p>"
        return Section("input_output", _TITLE, text)
    return Section("input_output", _TITLE, text, [_plot(subject)], [_coupling(context, subject)])


def _coupling(context: Context, subject: Subject) -> ResultTable:
    by = "moves" if subject.inst.handle_joints else "is bent by motors"
    table = context.table(
        "Coupling: how far each joint turns over a motion from the straight instrument, without load [°]",
        "motion",
        "far end",
        *(
            ResultColumn(
                f"{joint} [°]",
                f"coupling.{{motion}}.{joint}",
                "deg",
                f"Angle by which {joint} turns while {{motion}} {by} through its range, without load",
                digits=1,
            )
            for joint in subject.joints
        ),
    )
    for motion in subject.motions:
        name, _, end = motion.driven
        far = (
            f"{np.degrees(end):.3g}° of the handle" if name == "handle_angle" else f"{1e3 * abs(end):.3g} mm of stroke"
        )
        table.row(motion.name, far, *np.degrees(motion.angles[-1] - motion.angles[0]), motion=motion.name)
    return table


def _plot(subject: Subject) -> Plot:
    chart, axes = panels(len(subject.motions), 3.2)
    for axis, motion in zip(axes, subject.motions, strict=True):
        load, (name, _, end) = subject.most_taking(motion.follows), motion.driven
        by_handle = name == "handle_angle"
        label = f"{motion.name} [deg]" if by_handle else f"stroke for {motion.name} [mm]"
        moved = chart.keep(label, motion.shares * (np.degrees(end) if by_handle else 1e3 * abs(end)))
        free, under = np.degrees(motion.angles), np.degrees(subject.way(motion, motion.shares, load))
        for n, (joint, look) in enumerate(subject.looks.items()):
            chart.curve(axis, moved, f"{joint} by {motion.name} [deg]", free[:, n], **look)
            chart.curve(axis, moved, f"{joint} by {motion.name}, {load.text} [deg]", under[:, n], "--", **look)
        axis.set(title=load.text, xlabel=label)
    axes[0].set_ylabel("angle at the tip [deg]")
    style.legend_outside(chart.figure, *subject.legend, ("under the load", style.MUTED, "--"))
    return chart.plot("input_output", f"Angles of all joints at the tip over each motion, {named(subject.inst)}.")


def _over_loads(context: Context, inst: ShortForm) -> Section:
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
        ResultColumn(
            "output at handle 0° [°]",
            "input_output.straight_handle.at_{force:g}N",
            "deg",
            "Output angle at a straight handle under {force:g} N",
        ),
        ResultColumn(
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
        "input_output", f"{_TITLE} under load", _text(inst, ratio, end, gap, slackens=slackens), [plot], [table]
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
