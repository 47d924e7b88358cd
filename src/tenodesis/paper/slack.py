"""How loads change the tensions of a held instrument, and from which load on a tendon is slack (Fig. 8)."""

import numpy as np

from tenodesis import statics
from tenodesis.instrument import ShortForm
from tenodesis.paper.context import Context
from tenodesis.paper.input_output import slack_range
from tenodesis.paper.subject import HeldState, Load, Subject, panels
from tenodesis.report import curves, style
from tenodesis.report.content import CarePoint, Plot, ResultColumn, Section, fixed, named
from tenodesis.report.curves import forces, load_name
from tenodesis.report.routing import tendon_colours
from tenodesis.statics import chain

_TITLE = "Tension and slack"
_POINTS = 61
_FARTHEST = 20.0
"""How far curves go, over the shown load."""


def section(context: Context) -> Section:
    """Compute from which load in each direction a tendon is slack, and how the tensions vary."""
    subject = context.subject
    if subject.plane is not None:
        return _over_motion(context, subject.plane)
    inst, held, applied = subject.inst, subject.states, subject.loads
    table = context.table(
        "Load at which the first tendon goes slack, handle and motors held",
        "state",
        "direction",
        ResultColumn(
            "slack from [N]",
            "slack.{state}.{load}",
            "N",
            "Load {direction} at which the first tendon goes slack, {state}",
            optional=True,
        ),
        "tendon",
    )
    least: list[float] = []
    found: dict[tuple[str, str], float] = {}
    for state in held:
        for load in applied:
            lost = statics.loss(inst, state.angles, load.wrench, load.grip)
            force = lost.slack_factor * load.size
            found[state.name, load.name] = lost.slack_factor
            least += [force] if force > 0 else []
            labels = {"state": state.name, "load": load.name, "direction": load.direction}
            table.row(state.name, load.direction, force, lost.slack_tendon or "–", **labels)
    text = "<p>Handle and motors are held, without friction, and a force grows at the tip or between the jaws."
    if least:
        context.add("slack.least", min(least), "N", "Least load at which a tendon goes slack, none before")
        text += f" The least load of all, where none is slack before, is {min(least):.3g} N."
    if 0.0 in found.values():
        text += " Zero: that tendon is slack without a load."
    bent = held[-1]
    plot = _plot(subject, bent, applied, [found[bent.name, load.name] for load in applied])
    return Section("tension", _TITLE, text + "</p>", [plot], [table])


def _plot(subject: Subject, state: HeldState, applied: list[Load], slack: list[float]) -> Plot:
    inst = subject.inst
    colors = tendon_colours(len(inst.tendons))
    chart, axes = panels(len(applied), 2.6, 3.8)
    for axis, load, factor in zip(axes, applied, slack, strict=True):
        last = load.multiples[-1]
        end = np.clip(1.25 * factor, last, max(last, _FARTHEST)) if np.isfinite(factor) else last
        multiples = np.linspace(0.0, float(end), _POINTS)
        forces = chart.keep(f"force {load.direction} [N]", multiples * load.size)
        wrench, grip = np.outer(multiples, load.wrench), multiples * load.grip
        tensions = chain.tensions(inst, state.handle, wrench, grip_force=grip, strokes=state.strokes)
        for n, (tendon, color) in enumerate(zip(inst.tendons, colors, strict=True)):
            chart.curve(
                axis,
                forces,
                f"{tendon.name}, {load.direction} [N]",
                tensions[:, n],
                color=color,
                lw=max(2.8 - 0.4 * n, 1.0),
            )
        if 0 < factor <= end:
            axis.axvline(factor * load.size, color=style.ACCENT, lw=1.1, ls=":")
        axis.set(title=load.direction, xlabel="force [N]", xlim=(0, forces[-1]), ylim=(0, None))
    axes[0].set_ylabel("tension [N]")
    lines = [(tendon.name, color, "-") for tendon, color in zip(inst.tendons, colors, strict=True)]
    style.legend_outside(chart.figure, *lines, ("first tendon slack", style.ACCENT, ":"), columns=4)
    where = subject.described(state)
    return chart.plot("tension", f"Tensions of all tendons over the load, {named(inst)} at {where}.")


def _over_motion(context: Context, inst: ShortForm) -> Section:
    loads = forces(inst)
    table = context.table(
        "Slack of the antagonist in the working range",
        "force at the tip",
        "slack",
        "at handle angle",
        ResultColumn(
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
    return Section("tension", _TITLE, text, [plot], [table], _care(context, inst))


def _care(context: Context, inst: ShortForm) -> list[CarePoint]:
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
