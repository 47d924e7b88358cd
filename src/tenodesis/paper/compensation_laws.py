"""Compensation without friction: eq. 22 as printed and the exact law, by one motor and by two."""

import numpy as np
from matplotlib.axes import Axes

from tenodesis import statics
from tenodesis.instrument import ShortForm
from tenodesis.paper.context import Context, shown_force
from tenodesis.report import style
from tenodesis.report.content import Array, CarePoint, Chart, ResultColumn, Section, fixed, named
from tenodesis.statics.stroke import settled_stroke, wound

_LAWS: tuple[tuple[str, statics.Actuation, statics.Law, str], ...] = (
    ("eq. 22 as printed, agonist's motor alone", "agonist", "paper", style.ACCENT),
    ("exact law, agonist's motor alone", "agonist", "exact", style.LOADS[0]),
    ("eq. 22, both motors", "differential", "paper", style.LOADS[2]),
    ("exact law, both motors", "differential", "exact", style.LOADS[1]),
)


def section(context: Context) -> Section:
    """Compute the loss that remains under each law at four held states."""
    inst = context.tested
    force = max(inst.conditions.forces) if context.is_paper else shown_force(inst)
    states = np.array(inst.conditions.output_angles or np.linspace(0.0, inst.output_range, 4))
    handle = statics.handle_angle(inst, states)
    states, handle = states[np.isfinite(handle)], handle[np.isfinite(handle)]
    labels = [f"{np.degrees(state):.4g}" for state in states]
    table = context.table(
        f"Loss that remains under {force:g} N [°], by unloaded output angle",
        "law and actuation",
        *(
            ResultColumn(
                f"{angle}°",
                f"compensation.{{key}}.remaining_at_{angle}deg",
                "deg",
                f"Loss{{left}} at {angle}°{{by}}, {force:g} N{{without}}",
            )
            for angle in labels
        ),
    )
    lost = np.degrees(states - statics.output_angle(inst, handle, force))
    table.row("no compensation", *lost, key="none", left="", by=" without compensation", without="")
    remaining = [("no compensation", style.REFERENCE, lost)]
    for printed, actuation, law, color in _LAWS:
        name = (
            printed.replace("eq. 22", "law “paper” (eq. 22)").replace(" as printed", "") if context.is_own else printed
        )
        stroke = settled_stroke(inst, handle, force, actuation, law)
        output = statics.output_angle(inst, handle, force, wound=wound(np.nan_to_num(stroke), actuation))
        lost = np.degrees(states - np.where(np.isfinite(stroke), output, np.nan))
        by = f" by the {law} law, {actuation} actuation"
        table.row(name, *lost, key=f"{actuation}.{law}", left=" left", by=by, without=", no friction")
        remaining.append((name, color, lost))

    chart, (axis,) = Chart.panels(height=3.5)
    chart.keep("unloaded_output_angle [deg]", np.degrees(states))
    for place, (name, color, lost) in enumerate(remaining):
        _bars(axis, chart.keep(f"{name} [deg]", lost), place, len(remaining), color=color, label=name)
    axis.set_xticks(range(len(labels)), [f"{angle}°" for angle in labels])
    axis.set(xlabel="unloaded output angle", ylabel="loss that remains [deg]")
    axis.axhline(0, color=style.MUTED, lw=0.8)
    shown = np.nan_to_num(np.array([lost for _, _, lost in remaining]))
    axis.set_ylim(1.2 * min(0.0, float(shown.min())), 1.15 * max(1e-3, float(shown.max())))
    style.legend_above(axis, 2)
    plot = chart.plot(
        "compensation_laws",
        f"Loss of output angle under {force:g} N, {named(inst)}, T<sub>o</sub> = {inst.pretension:g} N, once the "
        "motors have settled; no friction.",
    )
    experiments = "" if context.is_own else ", which limited the paper's experiments"
    text = (
        "<p>The law “paper” (eq. 22) turns measured tensions into a motor angle. How much of the loss it restores "
        "depends on how many motors act on it; the exact law takes this into account, and slack. These results are "
        f"without friction{experiments}.</p>"
    )
    care = _care(context, inst, handle, force)
    return Section("compensation", "Compensation by the motors", text, [plot], [table], care)


def _bars(axis: Axes, values: Array, place: int, groups: int, *, color: str, label: str) -> None:
    width = 0.8 / groups
    at = np.arange(values.size) + (place - (groups - 1) / 2) * width
    # Rounding errors of a loss that is gone would put its label below the axis.
    bars = axis.bar(at, np.round(values, 9) + 0.0, width * 0.92, color=color, label=label)
    axis.bar_label(bars, fmt="%.1f", fontsize=7.5, padding=1)


def _care(context: Context, inst: ShortForm, handle: Array, force: float) -> list[CarePoint]:
    if context.is_own or inst.joint_type != "tendon-gear" or not handle.size:
        return []
    middle = handle[handle.size // 3 : handle.size // 3 + 1]
    stroke = settled_stroke(inst, middle, force, "agonist", "paper")
    if np.isnan(stroke).any():
        return []
    tension = statics.tensions(inst, middle, force, wound=stroke)
    free = float(np.sin(statics.output_angle(inst, middle)[0] / 2))
    left = free - float(np.sin(statics.output_angle(inst, middle, force, wound=stroke)[0] / 2))
    asked = free - float(
        np.sin(statics.estimate_output_angle(inst, middle, tension.agonist, tension.antagonist)[0] / 2)
    )
    share = context.add(
        "care.1.remaining_share", left / asked, "1", "Share of the loss in sin θ_d that eq. 22 leaves with one motor"
    )
    stroke = settled_stroke(inst, middle, force, "agonist", "exact")
    tension = statics.tensions(inst, middle, force, wound=stroke)
    truth = float(np.degrees(statics.output_angle(inst, middle, force, wound=stroke)[0]))
    blind = float(np.degrees(statics.estimate_output_angle(inst, middle, tension.agonist, tension.antagonist)[0]))
    pair = tension.agonist, tension.antagonist
    aware = float(np.degrees(statics.estimate_output_angle(inst, middle, *pair, wound=stroke)[0]))
    context.add("care.3.output_angle", truth, "deg", "Output angle with the loss compensated")
    context.add("care.3.estimate_without_motor", blind - truth, "deg", "Error of eq. 19 that ignores the wound length")
    context.add(
        "care.3.estimate_with_motor",
        aware - truth,
        "deg",
        "Error of the estimate that takes the wound length into account",
    )
    return [
        CarePoint(
            1,
            "Eq. 22 under-compensates by half when one motor acts",
            "The handle stretches one tendon and slackens the other; a motor on the agonist moves that tendon only. "
            "Full compensation by it takes Δl = ΔT/k, not the ΔT/2k of eq. 22; with ΔT/2k a share of "
            f"<b>{fixed(share, 6)}</b> of the loss in sin θ<sub>d</sub> remains. ΔT/2k is right when both motors act, "
            "one of which winds what the other releases.",
        ),
        CarePoint(
            3,
            "Eq. 19 ignores what the motors have wound",
            f"With the loss at θ_h = {fixed(float(np.degrees(middle[0])), 1)}° fully compensated, the output angle is "
            f"{fixed(truth)}°, but eq. 19 gives {fixed(blind)}°. Adding (Δl₁ − Δl₂)/4r to sin θ<sub>d</sub> gives "
            f"{fixed(aware)}°.",
        ),
    ]
