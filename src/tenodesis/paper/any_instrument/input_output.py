"""What each joint of the handle, or each set of motors, turns at the tip: the joint meant, and its neighbours."""

import numpy as np

from tenodesis.paper.any_instrument.held import Load, legend, looks, most_taking, panels
from tenodesis.paper.any_instrument.motions import Motion, motions
from tenodesis.paper.context import Context
from tenodesis.report import style
from tenodesis.report.content import Array, Column, Plot, Section, named
from tenodesis.statics import chain

_TITLE = "Input and output"


def section(context: Context) -> Section:
    """Compute the angles of all joints over each motion, without and with a load."""
    inst = context.whole
    found = motions(inst)
    if not found:
        return Section("input_output", _TITLE, f"<p>Neither handle nor motors of {named(inst)} turn a joint.</p>")
    by = "moves" if inst.handle_joints else "is bent by motors"
    table = context.table(
        "Coupling: how far each joint turns over a motion from the straight instrument, without load [°]",
        "motion",
        "far end",
        *(
            Column(
                f"{joint.name} [°]",
                f"coupling.{{motion}}.{joint.name}",
                "deg",
                f"Angle by which {joint.name} turns while {{motion}} {by} through its range, without load",
                digits=1,
            )
            for joint in inst.tip_joints
        ),
    )
    for motion in found:
        table.row(motion.name, _far_end(motion), *np.degrees(motion.angles[-1] - motion.angles[0]), motion=motion.name)
    what = "a joint of the handle moves" if inst.handle_joints else "the motors bend a joint, the others held"
    text = (
        f"<p>Each panel: the angles of all joints at the tip while {what}, without friction. Solid without a load, "
        "dashed under the load that takes most from the joint that turns most. What else turns is coupling: by tendons "
        "that pass other joints, or by a joint that gives way to a neighbour’s moment.</p>"
    )
    return Section("input_output", _TITLE, text, [_plot(context, found)], [table])


def _far_end(motion: Motion) -> str:
    """Return where a motion ends: the handle's angle, or the largest stroke."""
    if motion.handle.any():
        return f"{np.degrees(motion.handle[np.argmax(np.abs(motion.handle))]):.3g}° of the handle"
    return f"{1e3 * np.abs(motion.strokes).max():.3g} mm of stroke"


def driven(motion: Motion) -> tuple[Array, str]:
    """Return what is moved over a motion, (n,), in the unit of its axis, and the axis's label."""
    if motion.handle.any():
        at = int(np.argmax(np.abs(motion.handle)))
        return np.degrees(motion.shares * motion.handle[at]), f"{motion.name} [deg]"
    return 1e3 * motion.shares * np.abs(motion.strokes).max(), f"stroke for {motion.name} [mm]"


def _plot(context: Context, found: list[Motion]) -> Plot:
    inst = context.whole
    chart, axes = panels(len(found), 3.2)
    for axis, motion in zip(axes, found, strict=True):
        load = most_taking(inst, motion.follows)
        moved, label = driven(motion)
        chart.keep(label, moved)
        under = np.degrees(loaded(context, motion, load))
        for n, (name, look) in enumerate(looks(inst).items()):
            chart.curve(axis, moved, f"{name} by {motion.name} [deg]", np.degrees(motion.angles[:, n]), **look)
            heading = f"{name} by {motion.name}, {load.text()} [deg]"
            chart.curve(axis, moved, heading, under[:, n], "--", **look)
        axis.set(title=load.text(), xlabel=label)
    axes[0].set_ylabel("angle at the tip [deg]")
    style.legend_outside(chart.figure, *legend(inst), ("under the load", style.MUTED, "--"))
    return chart.plot("input_output", f"Angles of all joints at the tip over each motion, {named(inst)}.")


def loaded(context: Context, motion: Motion, load: Load) -> Array:
    """Return the angles of the tip's joints over a motion under a load, without friction, (n, joints), rad."""
    handle, strokes = (np.outer(motion.shares, end) for end in (motion.handle, motion.strokes))
    return chain.output_angles(context.whole, handle, load.wrench, grip_force=load.grip, strokes=strokes)
