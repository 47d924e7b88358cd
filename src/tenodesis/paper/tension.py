"""Fig. 8: tension variation and slack."""

import numpy as np
from numpy.typing import NDArray

from tenodesis import statics
from tenodesis.paper.context import Context
from tenodesis.paper.input_output import forces, slack_onset, slack_told
from tenodesis.report import style
from tenodesis.report.content import CarePoint, Plot, Section, Table, fixed, named

Array = NDArray[np.float64]


def section(context: Context) -> Section:
    """Compute how the tensions vary with the output angle and where a tendon goes slack."""
    inst = context.inst
    handle = np.linspace(0.0, min(inst.handle_range, 1.6 * statics.reach(inst)), 321)
    curves: dict[str, Array] = {"handle_angle [deg]": np.degrees(handle)}
    fig, (axis,) = style.figure()
    loads = forces(inst)
    at_zero, at_end = statics.slack_force(inst, np.array([0.0, inst.output_range]))
    rows = []
    for force, color in zip(loads[1:], style.colors(len(loads))[1:], strict=True):
        state = statics.equilibrium(inst, handle, force)
        inside = np.abs(state.output_angle) <= inst.output_range
        output = np.where(inside, np.degrees(state.output_angle), np.nan)
        agonist = np.where(inside, state.agonist - inst.pretension, np.nan)
        antagonist = np.where(inside, state.antagonist - inst.pretension, np.nan)
        curves[f"output_angle at {force:g} N [deg]"] = output
        curves[f"agonist at {force:g} N [N]"] = agonist
        curves[f"antagonist at {force:g} N [N]"] = antagonist
        axis.plot(output, agonist, color=color, label=f"{force:g} N")
        axis.plot(output, antagonist, "--", color=color)
        onset, onset_handle = slack_onset(inst, force)
        if np.isfinite(onset):
            context.add(
                f"tension.slack_onset_handle.at_{force:g}N",
                np.degrees(onset_handle),
                "deg",
                f"Handle angle from which on the antagonist is slack under {force:g} N",
            )
            context.add(
                f"tension.slack_onset.at_{force:g}N",
                np.degrees(onset),
                "deg",
                f"Output angle from which on the antagonist is slack under {force:g} N",
            )
        rise = context.add(
            f"tension.agonist_rise.at_{force:g}N",
            float(np.fmax.reduce(agonist)),
            "N",
            f"Largest rise of the agonist's tension in the working range under {force:g} N",
        )
        handle_told = f"θ_h ≥ {fixed(np.degrees(onset_handle), 1)}°" if np.isfinite(onset_handle) else "–"
        rows.append([f"{force:g} N", slack_told(inst, force, onset), handle_told, fixed(rise, 1)])
    context.add("tension.slack_force.straight", at_zero, "N", "Force at which the antagonist goes slack, tip straight")
    context.add(
        "tension.slack_force.flexed",
        at_end,
        "N",
        "Force at which the antagonist goes slack at the working range's end",
    )
    axis.axhline(-inst.pretension, color=style.ACCENT, lw=1.1)
    axis.annotate(
        f"antagonist slack: variation −T$_o$ = −{inst.pretension:g} N",
        (0.99, -inst.pretension),
        xycoords=("axes fraction", "data"),
        xytext=(0, -4),
        textcoords="offset points",
        ha="right",
        va="top",
        color=style.ACCENT,
        fontsize=8.5,
    )
    axis.plot([], [], color=style.MUTED, label="agonist")
    axis.plot([], [], "--", color=style.MUTED, label="antagonist")
    axis.set(xlabel="output angle $\\theta_e$ [deg]", ylabel="tension variation T − T$_o$ [N]")
    axis.margins(y=0.1)
    style.legend_above(axis, 6)
    text = (
        f"<p>Both tensions vary by the same amount until the antagonist has none left. With T<sub>o</sub> = "
        f"{inst.pretension:g} N that takes {fixed(at_zero)} N at the straight tip and {fixed(at_end)} N at "
        f"{np.degrees(inst.output_range):.0f}°; below the smaller, no tendon goes slack in the working range.</p>"
    )
    plot = Plot(
        "fig8_tension",
        f"Variation of tendon tension, {named(inst)}, T<sub>o</sub> = {inst.pretension:g} N "
        f"({context.figure_of('Fig. 8')}).",
        fig,
        curves,
    )
    table = Table(
        "Slack of the antagonist in the working range",
        ["force at the tip", "slack", "at handle angle", "largest agonist rise [N]"],
        rows,
    )
    return Section("tension", "Tension and slack", text, [plot], [table], _care(context))


def _care(context: Context) -> list[CarePoint]:
    inst = context.inst
    handle = statics.reach(inst)
    force = 1.1 * float(statics.slack_force(inst, 0.0))
    state = statics.equilibrium(inst, np.array([handle]), force)
    if inst.joint_type != "tendon-gear" or np.isnan(state.output_angle[0]):
        return []
    truth = float(np.degrees(state.output_angle[0]))
    pulls = float(state.agonist[0]), float(state.antagonist[0])
    # A threshold below zero makes the slack tendon count as taut, which is eq. 19 as printed.
    printed = np.degrees(statics.estimate_output_angle(inst, np.array([handle]), *pulls, slack_below=-1.0)[0])
    aware = float(np.degrees(statics.estimate_output_angle(inst, handle, *pulls)))
    context.add("care.2.force", force, "N", "Force that slackens the antagonist")
    context.add("care.2.output_angle", truth, "deg", "Output angle under that force")
    context.add("care.2.estimate_printed", printed - truth, "deg", "Error of eq. 19 as printed with a slack tendon")
    context.add("care.2.estimate_slack_aware", aware - truth, "deg", "Error of the slack-aware estimate at that state")
    return [
        CarePoint(
            2,
            "Equations 19, 20 and 22 hold only while neither tendon is slack",
            f"With {fixed(force)} N at θ_h = {fixed(np.degrees(handle), 1)}° the antagonist is slack and the tip "
            f"stands at {fixed(truth)}°. Eq. 19 as printed says {fixed(float(printed))}°, "
            f"{fixed(abs(printed - truth))}° off; with the second branch of eq. 8 the estimate is {fixed(aware)}°.",
        )
    ]
