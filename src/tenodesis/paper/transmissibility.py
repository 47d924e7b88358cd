"""Fig. 9: torque transmissibility."""

import numpy as np
from numpy.typing import NDArray

from tenodesis import statics
from tenodesis.paper.context import Context
from tenodesis.paper.input_output import forces
from tenodesis.report import style
from tenodesis.report.content import Plot, Section, Table, fixed, named

Array = NDArray[np.float64]


def section(context: Context) -> Section:
    """Compute how much of the hand's moment reaches the tip."""
    inst = context.inst
    handle = np.linspace(0.0, min(inst.handle_range, 1.6 * statics.reach(inst)), 321)
    curves: dict[str, Array] = {"handle_angle [deg]": np.degrees(handle)}
    fig, (axis,) = style.figure(height=3.7)
    loads = forces(inst)
    rows = []
    for force, color in zip(loads, style.colors(len(loads)), strict=True):
        output = statics.output_angle(inst, handle, force)
        ratio = statics.torque_transmissibility(inst, handle, force)
        inside = (np.abs(output) <= inst.output_range) & (output >= -1e-12)
        curves[f"output_angle at {force:g} N [deg]"] = np.where(inside, np.degrees(output), np.nan)
        curves[f"transmissibility at {force:g} N"] = np.where(inside, ratio, np.nan)
        label = "no load" if force == 0 else f"{force:g} N"
        axis.plot(np.degrees(output[inside]), ratio[inside], color=color, label=label)
        ends = [_at(inst.output_range * share, output, ratio) for share in (0.0, 0.5, 1.0)]
        rows.append([label, *(fixed(value, 4) for value in ends)])
        for share, value in zip((0.0, 0.5, 1.0), ends, strict=True):
            angle = np.degrees(share * inst.output_range)
            context.add(
                f"transmissibility.at_{angle:.4g}deg.{force:g}N",
                value,
                "1",
                f"Torque transmissibility at {angle:.4g} deg of output under {force:g} N",
            )
    straight = context.add(
        "transmissibility.straight",
        statics.torque_transmissibility(inst, 0.0),
        "1",
        "Torque transmissibility of the straight, unloaded instrument",
    )
    axis.set(xlabel="output angle $\\theta_e$ [deg]", ylabel="torque transmissibility ξ")
    style.legend_above(axis, 6)
    half, full = (f"ξ at {np.degrees(inst.output_range * share):.4g}°" for share in (0.5, 1.0))
    text = f"<p>Of the hand's moment, {fixed(straight, 3)} arrives at the straight tip."
    if inst.joint_type == "tendon-gear":
        text += (
            " Flexion costs more than load does: the tendons' moment arm shrinks faster at the small distal joint than "
            "at the proximal one."
        )
    text += "</p>"
    caption = f"Torque transmissibility, {named(inst)} ({context.figure_of('Fig. 9')})."
    plot = Plot("fig9_transmissibility", caption, fig, curves)
    table = Table("Torque transmissibility ξ", ["force at the tip", "ξ at 0°", half, full], rows)
    return Section("transmissibility", "Torque transmissibility", text, [plot], [table])


def _at(angle: float, output: Array, ratio: Array) -> float:
    """Return the ratio where the output passes an angle, NaN where it never does."""
    solved = np.isfinite(output)
    if not solved.any():
        return float("nan")
    return float(np.interp(angle, output[solved], ratio[solved], left=np.nan, right=np.nan))
