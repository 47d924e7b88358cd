"""Fig. 8: tension variation and slack."""

import numpy as np

from tenodesis import statics
from tenodesis.paper.context import Context
from tenodesis.paper.fig7_input_output import slack_range
from tenodesis.report import curves
from tenodesis.report.content import CarePoint, Column, Section, fixed, named
from tenodesis.report.curves import forces, load_name


def section(context: Context) -> Section:
    """Compute how the tensions vary with the output angle and where a tendon goes slack."""
    inst = context.inst
    loads = forces(inst)
    table = context.table(
        "Slack of the antagonist in the working range",
        "force at the tip",
        "slack",
        "at handle angle",
        Column(
            "largest agonist rise [N]",
            "tension.agonist_rise.at_{force:g}N",
            "N",
            "Largest rise of the agonist's tension in the working range under {force:g} N",
            digits=1,
        ),
    )
    for force in loads[1:]:
        onset, onset_handle = curves.slack_onset(inst, force)
        if np.isfinite(onset):
            for key, kind, at in (("slack_onset_handle", "Handle", onset_handle), ("slack_onset", "Output", onset)):
                about = f"{kind} angle from which the antagonist is slack under {force:g} N"
                context.add(f"tension.{key}.at_{force:g}N", np.degrees(at), "deg", about)
        from_handle = f"θ_h ≥ {fixed(np.degrees(onset_handle), 1)}°" if np.isfinite(onset_handle) else "–"
        rise = float(np.fmax.reduce(curves.tension_variation(inst, force).agonist))
        table.row(load_name(force), slack_range(inst, force, onset), from_handle, rise, force=force)
    straight, flexed = (
        context.add(
            f"tension.slack_force.{key}", value, "N", f"Force at which the antagonist is slack, tip held {where}"
        )
        for key, value, where in zip(
            ("straight", "flexed"),
            statics.slack_force(inst, np.array([0.0, inst.output_range])),
            ("straight", "at the working range's end"),
            strict=True,
        )
    )
    handle_held = statics.slack_load(inst, np.array([0.0, statics.reach(inst)]))
    for key, value, where in zip(("straight", "flexed"), handle_held, ("straight", "bent"), strict=True):
        about = f"Force under which the first tendon goes slack, handle held, tip {where} without it"
        context.add(f"tension.slack_load.{key}", float(value), "N", about)
    chart = curves.tension(inst, loads[1:])
    takes = (
        f"{fixed(straight)} N at the straight tip and {fixed(flexed)} N at {np.degrees(inst.output_range):.0f}°; below "
        "the smaller"
        if fixed(straight) != fixed(flexed)
        else f"{fixed(straight)} N at every angle; below"
    )
    text = (
        f"<p>Both tensions vary by the same amount until the antagonist is slack. With T<sub>o</sub> = "
        f"{inst.pretension:g} N this takes {takes}, no tendon goes slack in the working range.</p>"
    )
    plot = chart.plot(
        context.file_name("fig8", "tension"),
        f"Variation of tendon tension, {named(inst)}, T<sub>o</sub> = {inst.pretension:g} N"
        f"{context.figure_of('Fig. 8')}.",
    )
    return Section("tension", "Tension and slack", text, [plot], [table], _care(context))


def _care(context: Context) -> list[CarePoint]:
    inst = context.inst
    handle = statics.reach(inst)
    force = 1.1 * float(statics.slack_force(inst, 0.0))
    state = statics.equilibrium(inst, np.array([handle]), force)
    if context.is_own or inst.joint_type != "tendon-gear" or np.isnan(state.output_angle[0]):
        return []
    truth = float(np.degrees(state.output_angle[0]))
    tensions = float(state.agonist[0]), float(state.antagonist[0])
    # A threshold below zero makes the slack tendon count as taut, which is eq. 19 as printed.
    printed = float(np.degrees(statics.estimate_output_angle(inst, np.array([handle]), *tensions, slack_below=-1.0)[0]))
    aware = float(np.degrees(statics.estimate_output_angle(inst, handle, *tensions)))
    context.add("care.2.force", force, "N", "Force that slackens the antagonist")
    context.add("care.2.output_angle", truth, "deg", "Output angle under a force that slackens the antagonist")
    context.add("care.2.estimate_printed", printed - truth, "deg", "Error of eq. 19 as printed with a slack tendon")
    context.add("care.2.estimate_slack_aware", aware - truth, "deg", "Error of the slack-aware estimate at that state")
    return [
        CarePoint(
            2,
            "Equations 19, 20 and 22 hold only while neither tendon is slack",
            f"With {fixed(force)} N at θ_h = {fixed(np.degrees(handle), 1)}° the antagonist is slack and the output "
            f"angle is {fixed(truth)}°. Eq. 19 as printed gives {fixed(printed)}°, {fixed(abs(printed - truth))}° off; "
            f"with the second branch of eq. 8 the estimate is {fixed(aware)}°.",
        )
    ]
