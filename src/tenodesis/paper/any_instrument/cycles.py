"""Hysteresis: every joint of the handle, or the motors, there and back on the twin, and the joint that follows."""

from typing import NamedTuple

import numpy as np

from tenodesis import simulate
from tenodesis.instrument import FullForm
from tenodesis.paper.any_instrument.held import Load, most_taking, panels
from tenodesis.paper.any_instrument.motions import SPEED, Motion, motions
from tenodesis.paper.context import DRAWN, WAYS, Context, RecordedRun, has_friction
from tenodesis.report import style
from tenodesis.report.content import Array, Column, Plot, ResultTable, Section, fixed, named
from tenodesis.run import Run
from tenodesis.statics import chain

COUNT = 2
"""Cycles of a motion; the last one is judged."""
LOADING, RESTING = 1.0, 0.5
"""Time in which the load comes, and rest under it, s."""
SEED = 14


class Cycles(NamedTuple):
    """The cycles of a motion under a load, or none: thinned signals of the joint that follows, rad."""

    motion: Motion
    load: Load | None
    recorded: RecordedRun
    unloaded: Array
    """Angle without load and friction, (n,)"""
    theory: Array
    """Angle under the load without friction, (n,)"""
    angle: Array
    """On the twin, (n,)"""
    behind: float
    """How far the joint stays behind theory on the way out, mean over the last cycle, rad"""
    ahead: float
    """How far it is ahead of theory on the way back, rad"""
    beside: float
    """Largest deviation of another joint from theory in the last cycle, rad"""


def protocol(inst: FullForm, motion: Motion, load: Load | None) -> simulate.Protocol:
    """Return the protocol of cycles of a motion under a load, or none."""
    return simulate.Protocol(
        name=f"cycles of {motion.name}"[:60],
        description=f"There and back, {'no load' if load is None else load.text()}",
        phases=[*loading(load), *motion.there_and_back(inst, COUNT)],
    )


def loading(load: Load | None) -> list[simulate.AnyPhase]:
    """Return the phases in which a load comes, or the same time without one."""
    if load is None:
        return [simulate.Hold(duration=LOADING + RESTING)]
    return [simulate.Ramp(duration=LOADING, **load.keys()), simulate.Hold(duration=RESTING)]


def cycle(inst: FullForm, motion: Motion, load: Load | None) -> Cycles | None:
    """Run cycles of a motion under a load, or none, on the twin; None if the joints cannot hold it."""
    recorded = RecordedRun.of(inst, protocol(inst, motion, load), SEED)
    if recorded is None:
        return None
    run = recorded.run
    shown = run.rows(int(np.searchsorted(run.time, LOADING + RESTING, "right")), None, DRAWN.step)
    unloaded = target(inst, shown)
    wrench, grip = (np.zeros(6), 0.0) if load is None else (load.wrench, load.grip)
    theory = target(inst, shown, wrench, grip)
    off = shown.by_column("output_angle") - theory
    follows = motion.follows
    half = len(shown) // COUNT // 2
    out, back = slice(-2 * half, -half), slice(-half, None)
    way = motion.angles[-1, follows] - motion.angles[0, follows]
    shares = (unloaded[:, follows] - motion.angles[0, follows]) / way
    sign = np.sign(way)
    behind = float(-sign * np.interp(WAYS, shares[out], off[out, follows]).mean())
    ahead = float(sign * np.interp(WAYS, shares[back][::-1], off[back, follows][::-1]).mean())
    others = np.delete(off[-2 * half :], follows, axis=1)
    return Cycles(
        motion,
        load,
        recorded,
        unloaded[:, follows],
        theory[:, follows],
        shown.by_column("output_angle")[:, follows],
        behind,
        ahead,
        float(np.abs(others).max(initial=0.0)),
    )


def target(inst: FullForm, run: Run, wrench: Array | float = 0.0, grip_force: float = 0.0) -> Array:
    """Return the angles of the tip without friction at a run's handle angles and strokes, (n, joints), rad."""
    strokes = run.by_column("spool_angle") * (inst.spool_radius or inst.drives.spool_radius)
    return chain.output_angles(inst, run.by_column("handle_angle"), wrench, grip_force=grip_force, strokes=strokes)


def section(context: Context) -> Section:
    """Compute the cycles of every motion, without a load and under the one that takes most."""
    inst = context.whole
    rough = has_friction(inst)
    title = "There and back on the twin" + " with friction" * rough
    pairs = [(motion, load) for motion in motions(inst) for load in (None, most_taking(inst, motion.follows))]
    found = [done for done in (cycle(inst, *pair) for pair in pairs) if done is not None]
    if not found:
        return Section("hysteresis", title, f"<p>Not run: {named(inst)} holds no load while it moves.</p>")
    context.recordings |= {
        f"cycles_{done.motion.name}" + (f"_{done.load.name}" if done.load else ""): done.recorded for done in found
    }
    widest = context.add(
        "hysteresis.widest",
        max(abs(float(np.degrees(done.behind + done.ahead))) for done in found),
        "deg",
        "Largest mean width of a joint's loop on the twin",
    )
    text = (
        "<p>The twin has friction at every bend of every tendon, drives, and sensors with noise. "
        f"{'Each joint of the handle' if inst.handle_joints else 'The motors for each joint'} in turn goes to the far "
        f"end of its motion and back, {COUNT} times, such that the joint that follows turns by about "
        f"{np.degrees(SPEED):.0f}°/s. "
    )
    text += (
        f"Friction holds it back on the way out and ahead on the way back; the widest loop has {fixed(widest)}°."
        if rough
        else "The file has no friction, so that loops are closed but for the lag of moving joints; a "
        "<code>[friction]</code> table opens them."
    )
    return Section("hysteresis", title, text + "</p>", [_plot(context, found)], [_table(context, found)])


def _table(context: Context, found: list[Cycles]) -> ResultTable:
    inst = context.whole

    def column(heading: str, name: str, about: str) -> Column:
        return Column(heading, f"hysteresis.{{motion}}.{name}.{{load}}", "deg", f"{about}, {{motion}}, {{words}}")

    table = context.table(
        "Means over the last cycle; neighbours: largest deviation of another joint from theory",
        "motion",
        "load",
        "follows",
        column("behind, out [°]", "shift_at_flexion", "How far the joint stays behind theory on the way out"),
        column("ahead, back [°]", "shift_at_extension", "How far the joint is ahead of theory on the way back"),
        column("loop [°]", "width", "Width of the joint's loop"),
        column("neighbours [°]", "neighbours", "Largest deviation of another joint from theory"),
    )
    for done in found:
        words = "no load" if done.load is None else done.load.text()
        behind, ahead, beside = np.degrees([done.behind, done.ahead, done.beside])
        table.row(
            done.motion.name,
            words,
            inst.tip_joints[done.motion.follows].name,
            behind,
            ahead,
            behind + ahead,
            beside,
            motion=done.motion.name,
            load="unloaded" if done.load is None else done.load.name,
            words=words,
        )
    return table


def _plot(context: Context, found: list[Cycles]) -> Plot:
    inst = context.whole
    names = list(dict.fromkeys(done.motion.name for done in found))
    chart, axes = panels(len(names), 3.2, 3.7)
    panel_of = dict(zip(names, axes, strict=True))
    for done in found:
        axis, joint = panel_of[done.motion.name], inst.tip_joints[done.motion.follows].name
        color = style.INK if done.load is None else style.AGONIST
        at = f"{done.motion.name}, {'no load' if done.load is None else done.load.text()} [deg]"
        unloaded = chart.keep(f"unloaded angle, {at}", np.degrees(done.unloaded))
        chart.curve(axis, unloaded, f"{joint} by {at}", np.degrees(done.angle), color=color, lw=1.1)
        theory, order = chart.keep(f"theory, {at}", np.degrees(done.theory)), np.argsort(unloaded)
        axis.plot(unloaded[order], theory[order], "--", color=style.ANTAGONIST, lw=1.0)
        loads = [one.load.text() for one in found if one.motion is done.motion and one.load is not None]
        axis.set(title=", ".join([done.motion.name, *loads]), xlabel=f"unloaded angle of {joint} [deg]")
    axes[0].set_ylabel("angle on the twin [deg]")
    style.legend_outside(
        chart.figure,
        ("no load", style.INK, "-"),
        ("under the load above", style.AGONIST, "-"),
        ("theory, no friction", style.ANTAGONIST, "--"),
    )
    return chart.plot(
        "cycles",
        f"Angle of the joint that follows over its unloaded angle, {named(inst)}, {COUNT} cycles of each motion.",
    )
