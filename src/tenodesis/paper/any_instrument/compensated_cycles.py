"""Motions of the handle under load with the robust law: how well the joints follow that a controller compensates."""

from functools import partial

import numpy as np

from tenodesis import control
from tenodesis.instrument import FullForm
from tenodesis.paper.any_instrument.compensated_step import LAWS, controller_of
from tenodesis.paper.any_instrument.cycles import LOADING, RESTING, SEED, protocol
from tenodesis.paper.any_instrument.held import Load, most_taking, panels
from tenodesis.paper.any_instrument.motions import Motion, motions
from tenodesis.paper.context import DRAWN, Context, RecordedRun
from tenodesis.report import style
from tenodesis.report.content import Array, Column, Plot, Section, named
from tenodesis.simulate import campaign
from tenodesis.statics import chain
from tenodesis.twin import TIME_STEP

_TITLE = "There and back with compensation"


def section(context: Context) -> Section:
    """Compute the cycles of the compensated joints with the motors off and with the robust law."""
    inst = context.whole
    joints = [pair.joint for pair in control.pairs(inst).values()]
    cases = [
        {"motion": motion, "load": most_taking(inst, motion.follows), "law": law}
        for motion in motions(inst)
        if motion.follows in joints
        for law in LAWS
    ]
    found = campaign.run(partial(_trial, inst), cases, on="threads")
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
    for row in found:
        last, words = row["error"][len(row["error"]) // 2 :], row["load"].text()
        labels = {"motion": row["motion"].name, "law": row["law"], "words": words}
        errors = campaign.rms(last), campaign.farthest(last)
        table.row(row["motion"].name, words, LAWS[row["law"]], *errors, **labels)
    text = (
        "<p>The cycles above under load, with the controller enabled. The error is that of the joint that follows "
        "against where it would be without load and friction.</p>"
    )
    return Section("compensated_cycles", _TITLE, text, [_plot(context, found)], [table])


def _trial(inst: FullForm, motion: Motion, load: Load, law: str) -> dict[str, Array] | None:
    """Return handle angle and error of the joint that follows, (n,), deg; None if the joints cannot hold the load."""
    done = RecordedRun.of(inst, protocol(inst, motion, load), SEED, controller_of(inst, law))
    if done is None:
        return None
    shown = done.run.rows(round((LOADING + RESTING) / TIME_STEP), None, DRAWN.step)
    error = np.degrees(shown.by_column("output_angle") - chain.output_angles(inst, shown.by_column("handle_angle")))
    moved = int(np.argmax(np.abs(motion.handle)))
    return {"handle": np.degrees(shown.by_column("handle_angle")[:, moved]), "error": error[:, motion.follows]}


def _plot(context: Context, found: campaign.Rows) -> Plot:
    names = list(dict.fromkeys(row["motion"].name for row in found))
    chart, axes = panels(len(names), 3.2)
    panel_of = dict(zip(names, axes, strict=True))
    looks = {"off": (style.INK, "--"), "robust": (style.AGONIST, "-")}
    for row in found:
        motion, law = row["motion"].name, row["law"]
        handle = chart.keep(f"{motion}, {law} [deg]", row["handle"])
        color, line = looks[law]
        heading = f"error by {motion}, {law} [deg]"
        chart.curve(panel_of[motion], handle, heading, row["error"], line, color=color, lw=1.2)
        panel_of[motion].set(title=row["load"].text(), xlabel=f"{motion} [deg]")
    axes[0].set_ylabel("off the unloaded angle [deg]")
    style.legend_outside(chart.figure, *((LAWS[law], *looks[law]) for law in LAWS))
    return chart.plot(
        "compensated_cycles",
        f"Error of the joint that follows over the handle’s angle, {named(context.whole)} under load on the twin.",
    )
