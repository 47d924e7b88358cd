"""Fig. 7: the input-output relationship under load."""

import numpy as np
from numpy.typing import NDArray

from tenodesis import statics
from tenodesis.instrument import Instrument
from tenodesis.paper.context import Context
from tenodesis.report import style
from tenodesis.report.content import Plot, Section, Table, fixed, named, number

Array = NDArray[np.float64]


def forces(inst: Instrument) -> list[float]:
    """Return the loads that curves are drawn for, N: none, and those of the instrument's conditions."""
    by_text = {f"{force:g}": force for force in inst.conditions.forces or (0.5, 1.0, 1.5)}
    return [0.0, *sorted(by_text.values())]


def slack_onset(inst: Instrument, force: float) -> tuple[float, float]:
    """Return output and handle angle, rad, from which on the antagonist is slack; NaN if never in the working range."""
    output = np.linspace(0.0, inst.output_range, 4001)
    margin = statics.slack_force(inst, output) - force
    crossing = np.flatnonzero((margin[:-1] > 0) & (margin[1:] <= 0))
    if not crossing.size:
        return np.nan, np.nan
    at = int(crossing[0])
    share = margin[at] / (margin[at] - margin[at + 1])
    angle = float(output[at] + share * (output[at + 1] - output[at]))
    handle = statics.handle_angle(inst, np.array([angle]), force)
    return angle, float(handle[0])


def slack_told(inst: Instrument, force: float, onset: float) -> str:
    """Return in words where in the working range the antagonist is slack under a force, given the onset (rad)."""
    slack = statics.slack_force(inst, np.linspace(0.0, inst.output_range, 401)) <= force
    if slack.all() or not slack.any():
        return "everywhere" if slack.all() else "nowhere"
    return f"θ_e ≥ {fixed(np.degrees(onset), 1)}°" if np.isfinite(onset) else "near the straight tip"


def section(context: Context) -> Section:
    """Compute the input-output curves and what the load takes from the tip."""
    inst = context.inst
    end = statics.reach(inst)
    unloaded = float(np.degrees(statics.output_angle(inst, end)))
    loads = forces(inst)
    handle = np.linspace(0.0, min(inst.handle_range, 1.3 * end), 301)
    curves: dict[str, Array] = {"handle_angle [deg]": np.degrees(handle)}
    fig, (axis,) = style.figure()
    ratio = float(statics.gradient(statics.output_angle, inst, 0.0, wrt=["handle_angle"])["handle_angle"])
    line = ratio * np.degrees(handle)
    curves["gear ratio line [deg]"] = line
    inside = line <= np.degrees(inst.output_range)
    axis.plot(
        np.degrees(handle[inside]),
        line[inside],
        "--",
        color=style.REFERENCE,
        lw=1.3,
        label=f"ratio {ratio:.3g} (linear)",
    )

    rows = []
    for force, color in zip(loads, style.colors(len(loads)), strict=True):
        output = np.degrees(statics.output_angle(inst, handle, force))
        output[output > np.degrees(inst.output_range) + 1e-9] = np.nan
        curves[f"output_angle at {force:g} N [deg]"] = output
        axis.plot(np.degrees(handle), output, color=color, label="no load" if force == 0 else f"{force:g} N")
        onset, onset_handle = slack_onset(inst, force)
        if np.isfinite(onset_handle):
            axis.plot(np.degrees(onset_handle), np.degrees(onset), "o", color=color, ms=5.5, mec="white")
        flexed = context.add(
            f"input_output.output_angle.at_{force:g}N",
            np.degrees(statics.output_angle(inst, np.array([end]), force)[0]),
            "deg",
            f"Output angle at a handle angle of {np.degrees(end):.1f} deg under {force:g} N",
        )
        straight = context.add(
            f"input_output.straight_handle.at_{force:g}N",
            float(output[0]),
            "deg",
            f"Output angle at a straight handle under {force:g} N",
        )
        rows.append(
            [
                "no load" if force == 0 else f"{force:g} N",
                fixed(straight),
                fixed(flexed),
                fixed(unloaded - flexed),
                slack_told(inst, force, onset),
            ]
        )
    axis.plot([], [], "o", color=style.MUTED, mec="white", label="antagonist goes slack")
    axis.set(
        xlabel="handle angle $\\theta_h$ [deg]",
        ylabel="output angle $\\theta_e$ [deg]",
        xlim=(0, np.degrees(handle[-1])),
    )
    style.legend_above(axis, 4)

    context.add("input_output.linear_ratio", ratio, "1", "Ratio of output to handle angle near zero, no load")
    gap = unloaded - float(np.degrees(ratio * end))
    context.add(
        "input_output.linear_ratio_error",
        gap,
        "deg",
        "Unloaded output angle minus the linear ratio's at the end of the working range",
    )
    if inst.joint_type != "tendon-gear":
        text = f"<p>The unloaded tip turns {number(ratio, 4)} times as far as the handle. A load takes angle away, and "
        text += "takes it faster once the antagonist is slack and only one tendon resists.</p>"
    else:
        text = _gear_text(ratio, end, gap)
    plot = Plot(
        "fig7_input_output",
        f"Input–output relationship under load, {named(inst)}, T<sub>o</sub> = {inst.pretension:g} N "
        f"({context.figure_of('Fig. 7')}). The dashed line is linear.",
        fig,
        curves,
    )
    table = Table(
        f"Angle kept and lost, handle at {fixed(np.degrees(end), 1)}°",
        ["force at the tip", "output at handle 0° [°]", "output [°]", "lost [°]", "antagonist slack"],
        rows,
    )
    return Section("input_output", "Input and output under load", text, [plot], [table])


def _gear_text(ratio: float, end: float, gap: float) -> str:
    return (
        f"<p>The unloaded tip follows the exact geometry, not the ratio {number(ratio, 3)}: at a handle angle of "
        f"{fixed(np.degrees(end), 1)}° the linear rule is {fixed(abs(gap), 1)}° off. A load takes angle away, and "
        "takes it faster once the antagonist is slack and only one tendon resists: there the curve turns from bending "
        "upward to bending downward.</p>"
    )
