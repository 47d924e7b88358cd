"""Motions of the handle under load with the robust law: how well the joints follow that a controller compensates."""

import numpy as np

from tenodesis import control
from tenodesis.control import Controller
from tenodesis.paper.any_instrument.compensated_step import LAWS
from tenodesis.paper.any_instrument.cycles import LOADING, RESTING, SEED, protocol
from tenodesis.paper.any_instrument.held import Load, most_taking, panels
from tenodesis.paper.any_instrument.motions import Motion, motions
from tenodesis.paper.context import Context, RecordedRun
from tenodesis.report import style
from tenodesis.report.content import Array, Column, Plot, Section, named
from tenodesis.statics import chain
from tenodesis.twin import TIME_STEP

_EVERY = 20  # samples that are drawn
_TITLE = "There and back with compensation"


def section(context: Context) -> Section:
    """Compute the cycles of the compensated joints with the motors off and with the robust law."""
    inst = context.whole
    joints = [pair.joint for pair in control.pairs(inst).values()]
    found: dict[tuple[str, str], tuple[Load, Array, Array]] = {}
    for motion in motions(inst):
        if motion.follows in joints:
            load = most_taking(inst, motion.follows)
            for law in LAWS:
                curve = _run(context, motion, load, law)
                if curve is not None:
                    found[motion.name, law] = (load, *curve)
    if not found:
        return Section("compensated_cycles", _TITLE, f"<p>Not run: {named(inst)} holds no load while it moves.</p>")
    table = context.table(
        "Error of the joint that follows against its unloaded angle, root mean square and largest, of the last cycle",
        "motion",
        "load",
        "law",
        Column("rms [°]", "compensated_cycles.{law}.rms.{motion}", "deg", "RMS error, {motion}, {words}, {law}"),
        Column("worst [°]", "compensated_cycles.{law}.worst.{motion}", "deg", "Worst error, {motion}, {words}, {law}"),
    )
    for (motion_name, law), (load, _, error) in found.items():
        last = error[len(error) // 2 :]
        rms, worst = float(np.sqrt(np.mean(last**2))), float(np.abs(last).max())
        table.row(motion_name, load.text(), LAWS[law], rms, worst, motion=motion_name, law=law, words=load.text())
    text = (
        "<p>The cycles above under load, with the controller enabled. The error is that of the joint that follows "
        "against where it would be without load and friction.</p>"
    )
    return Section("compensated_cycles", _TITLE, text, [_plot(context, found)], [table])


def _run(context: Context, motion: Motion, load: Load, law: str) -> tuple[Array, Array] | None:
    """Return handle angle and error of the joint that follows, (n,), deg; None if the joints cannot hold the load."""
    inst = context.whole
    controller = Controller(inst, law="robust", enabled=True) if law == "robust" else None
    done = RecordedRun.of(inst, protocol(inst, motion, load), SEED, controller)
    if done is None:
        return None
    shown = done.run.rows(round((LOADING + RESTING) / TIME_STEP), None, _EVERY)
    aims = chain.output_angles(inst, shown.by_column("handle_angle"))
    error = np.degrees(shown.by_column("output_angle") - aims)[:, motion.follows]
    return np.degrees(shown.by_column("handle_angle")[:, int(np.argmax(np.abs(motion.handle)))]), error


def _plot(context: Context, found: dict[tuple[str, str], tuple[Load, Array, Array]]) -> Plot:
    names = list(dict.fromkeys(motion for motion, _ in found))
    chart, axes = panels(len(names), 3.2)
    panel_of = dict(zip(names, axes, strict=True))
    looks = {"off": (style.INK, "--"), "robust": (style.AGONIST, "-")}
    for (motion, law), (load, handle, error) in found.items():
        chart.keep(f"{motion}, {law} [deg]", handle)
        color, line = looks[law]
        chart.curve(panel_of[motion], handle, f"error by {motion}, {law} [deg]", error, line, color=color, lw=1.2)
        panel_of[motion].set(title=load.text(), xlabel=f"{motion} [deg]")
    axes[0].set_ylabel("off the unloaded angle [deg]")
    style.legend_outside(chart.figure, *((LAWS[law], *looks[law]) for law in LAWS))
    return chart.plot(
        "compensated_cycles",
        f"Error of the joint that follows over the handle’s angle, {named(context.whole)} under load on the twin.",
    )
