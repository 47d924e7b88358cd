"""What the motors give back: eq. 22 as printed and the exact law, by one motor and by two, without friction."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tenodesis import statics
from tenodesis.instrument import Instrument
from tenodesis.paper.context import Context
from tenodesis.paper.loss import shown_force
from tenodesis.report import style
from tenodesis.report.content import CarePoint, Plot, Section, Table, fixed, named

Array = NDArray[np.float64]

_LAWS: tuple[tuple[str, statics.Actuation, statics.Law], ...] = (
    ("eq. 22 as printed, agonist's motor alone", "agonist", "paper"),
    ("exact law, agonist's motor alone", "agonist", "exact"),
    ("eq. 22, both motors", "differential", "paper"),
    ("exact law, both motors", "differential", "exact"),
)
_ROUNDS = 200
_SETTLED = 1e-15  # m


def settled_stroke(
    inst: Instrument, handle_angle: Array, force: float, actuation: statics.Actuation, law: statics.Law
) -> Array:
    """Return the agonist's stroke, m, at which the measured tensions ask for just that stroke, NaN if there is none.

    The motors follow the law while the tip gives way and comes back; half steps keep the repetition from overshooting.
    """
    stroke = np.zeros_like(handle_angle)
    for _ in range(_ROUNDS):
        tension = statics.tensions(inst, handle_angle, force, wound=wound(stroke, actuation))
        solved = np.isfinite(tension.agonist)
        agonist, antagonist = (np.where(solved, pull, 0.0) for pull in tension)
        wanted = statics.compensation_stroke(inst, agonist, antagonist, actuation, law)
        step = np.where(solved, (wanted - stroke) / 2, np.nan)
        # What finds no equilibrium on the way stays without a stroke, and out of the solves that follow.
        lost = ~np.isfinite(step)
        stroke = np.where(lost, 0.0, stroke + step)
        if np.all(lost | (np.abs(step) < _SETTLED)):
            return np.where(lost, np.nan, stroke)
    return np.full_like(stroke, np.nan)


def wound(stroke: Array, actuation: statics.Actuation) -> tuple[Array, Array]:
    """Return what both motors have wound for an agonist's stroke, m."""
    return stroke, -stroke if actuation == "differential" else np.zeros_like(stroke)


def section(context: Context) -> Section:
    """Compute the loss that remains under each law at four held states."""
    inst = context.scaled if context.is_paper and context.scaled is not None else context.inst
    force = max(inst.conditions.forces) if context.is_paper else shown_force(inst)
    states = np.array(inst.conditions.output_angles or np.linspace(0.0, inst.output_range, 4))
    handle = statics.handle_angle(inst, states)
    states, handle = states[np.isfinite(handle)], handle[np.isfinite(handle)]
    lost = np.degrees(states - statics.output_angle(inst, handle, force))
    labels = [f"{np.degrees(state):.4g}°" for state in states]
    rows = [["no compensation", *(fixed(value) for value in lost)]]
    for label, value in zip(labels, lost, strict=True):
        context.add(
            f"compensation.none.remaining_at_{label.rstrip('°')}deg",
            value,
            "deg",
            f"Loss at {label} without compensation, {force:g} N",
        )
    remaining = {"no compensation": lost}
    for name, actuation, law in _LAWS:
        stroke = settled_stroke(inst, handle, force, actuation, law)
        output = statics.output_angle(inst, handle, force, wound=wound(np.nan_to_num(stroke), actuation))
        remaining[name] = np.degrees(states - np.where(np.isfinite(stroke), output, np.nan))
        rows.append([name, *(fixed(value + 0.0) for value in np.round(remaining[name], 9))])
        for label, value in zip(labels, remaining[name], strict=True):
            context.add(
                f"compensation.{actuation}.{law}.remaining_at_{label.rstrip('°')}deg",
                value,
                "deg",
                f"Loss left at {label} by the {law} law, {actuation} actuation, {force:g} N, no friction",
            )
    fig = _bars(labels, remaining)
    plot = Plot(
        "compensation_laws",
        f"Loss of output angle under {force:g} N, {named(inst)}, T<sub>o</sub> = {inst.pretension:g} N, once the "
        "motors have settled; no friction.",
        fig,
        {"unloaded_output_angle [deg]": np.degrees(states)} | {f"{k} [deg]": v for k, v in remaining.items()},
    )
    table = Table(
        f"Loss that remains under {force:g} N [°], by unloaded output angle",
        ["law and actuation", *labels],
        rows,
    )
    text = (
        "<p>Eq. 22 turns measured tensions into a motor angle. What it gives back depends on how many motors act on "
        "it; the exact law counts that, and slack. Friction, which spoiled the experiments, is not in these "
        "numbers.</p>"
    )
    if inst.joint_type == "continuum":
        text += (
            "<p>A continuum's tensions carry its backbone's own moment too. The laws give back what that stretches as "
            "well, and so bring the tip beyond its unloaded angle, to where tendons that do not stretch would.</p>"
        )
    return Section(
        "compensation",
        "Compensation by the motors",
        text,
        [plot],
        [table],
        _care(context, inst, handle, force),
    )


def _bars(labels: Sequence[str], remaining: dict[str, Array]) -> Figure:
    fig, (axis,) = style.figure(height=3.5)
    width = 0.8 / len(remaining)
    colors = (style.REFERENCE, style.ACCENT, style.LOADS[0], style.LOADS[2], style.LOADS[1])
    for place, ((name, values), color) in enumerate(zip(remaining.items(), colors, strict=True)):
        at = np.arange(len(labels)) + (place - (len(remaining) - 1) / 2) * width
        # Rounding's remains of a loss that is gone would put its label below the axis.
        bars = axis.bar(at, np.round(values, 9) + 0.0, width * 0.92, color=color, label=name)
        axis.bar_label(bars, fmt="%.1f", fontsize=7.5, padding=1)
    axis.set_xticks(range(len(labels)), labels)
    axis.set(xlabel="unloaded output angle", ylabel="loss that remains [deg]")
    axis.axhline(0, color=style.MUTED, lw=0.8)
    shown = np.nan_to_num(np.array(list(remaining.values())))
    axis.set_ylim(1.2 * min(0.0, float(shown.min())), 1.15 * max(1e-3, float(shown.max())))
    style.legend_above(axis, 2)
    return fig


def _care(context: Context, inst: Instrument, handle: Array, force: float) -> list[CarePoint]:
    if inst.joint_type != "tendon-gear" or not handle.size:
        return []
    middle = handle[handle.size // 3 : handle.size // 3 + 1]
    stroke = settled_stroke(inst, middle, force, "agonist", "paper")
    if np.isnan(stroke).any():
        return []
    tension = statics.tensions(inst, middle, force, wound=stroke)
    free = float(np.sin(statics.output_angle(inst, middle)[0] / 2))
    left = free - float(np.sin(statics.output_angle(inst, middle, force, wound=stroke)[0] / 2))
    asked = free - float(np.sin(statics.estimate_output_angle(inst, middle, *tension)[0] / 2))
    share = context.add(
        "care.1.remaining_share",
        left / asked,
        "1",
        "Share of the loss in sin θ_d that eq. 22 leaves with one motor",
    )
    stroke = settled_stroke(inst, middle, force, "agonist", "exact")
    tension = statics.tensions(inst, middle, force, wound=stroke)
    truth = float(np.degrees(statics.output_angle(inst, middle, force, wound=stroke)[0]))
    blind = float(np.degrees(statics.estimate_output_angle(inst, middle, *tension)[0]))
    aware = float(np.degrees(statics.estimate_output_angle(inst, middle, *tension, wound=stroke)[0]))
    context.add("care.3.output_angle", truth, "deg", "Output angle with the loss made up")
    context.add("care.3.estimate_without_motor", blind - truth, "deg", "Error of eq. 19 that ignores the wound length")
    context.add("care.3.estimate_with_motor", aware - truth, "deg", "Error of the motor-aware estimate there")
    return [
        CarePoint(
            1,
            "Eq. 22 under-compensates by half when one motor acts",
            "The handle stretches one tendon and slackens the other, a motor on the agonist moves one only. Full "
            "compensation by it takes Δl = ΔT/k, not the ΔT/2k of eq. 22; with ΔT/2k a share of "
            f"<b>{fixed(share, 6)}</b> of the loss in sin θ<sub>d</sub> remains. ΔT/2k is right when both motors act, "
            "one winding what the other lets out.",
        ),
        CarePoint(
            3,
            "Eq. 19 ignores what the motors have wound",
            f"With the loss at θ_h = {fixed(float(np.degrees(middle[0])), 1)}° fully made up, the tip stands at "
            f"{fixed(truth)}°, but eq. 19 still says {fixed(blind)}°. Adding (Δl₁ − Δl₂)/4r to sin θ<sub>d</sub> gives "
            f"{fixed(aware)}°.",
        ),
    ]
