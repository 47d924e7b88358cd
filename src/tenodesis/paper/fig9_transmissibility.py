"""Fig. 9: torque transmissibility."""

import numpy as np

from tenodesis import statics
from tenodesis.paper.context import Context, forces, load_name
from tenodesis.report import style
from tenodesis.report.content import Array, Chart, Column, Section, fixed, named

_SHARES = (0.0, 0.5, 1.0)  # of the working range, where the table has values


def section(context: Context) -> Section:
    """Compute how much of the hand's moment reaches the tip."""
    inst = context.inst
    loads = forces(inst)
    labels = [f"{np.degrees(share * inst.output_range):.4g}" for share in _SHARES]
    table = context.table(
        "Torque transmissibility ξ",
        "force at the tip",
        *(
            Column(
                f"ξ at {angle}°",
                f"transmissibility.at_{angle}deg.{{force:g}}N",
                "1",
                f"Torque transmissibility at {angle} deg of output under {{force:g}} N",
                digits=4,
            )
            for angle in labels
        ),
    )
    chart, (axis,) = Chart.panels(height=3.7)
    handle = np.linspace(0.0, min(inst.handle_range, 1.6 * statics.reach(inst)), 321)
    chart.keep("handle_angle [deg]", np.degrees(handle))
    for force, color in zip(loads, style.colors(len(loads)), strict=True):
        output = statics.output_angle(inst, handle, force)
        ratio = statics.torque_transmissibility(inst, handle, force)
        inside = (np.abs(output) <= inst.output_range) & (output >= -1e-12)
        shown = chart.keep(f"output_angle at {force:g} N [deg]", np.where(inside, np.degrees(output), np.nan))
        heading = f"transmissibility at {force:g} N"
        chart.curve(axis, shown, heading, np.where(inside, ratio, np.nan), color=color, label=load_name(force))
        ends = [_at(inst.output_range * share, output, ratio) for share in _SHARES]
        table.row(load_name(force), *ends, force=force)
    straight = context.add(
        "transmissibility.straight",
        statics.torque_transmissibility(inst, 0.0),
        "1",
        "Torque transmissibility of the straight, unloaded instrument",
    )
    axis.set(xlabel="output angle $\\theta_e$ [deg]", ylabel="torque transmissibility ξ")
    style.legend_above(axis, 6)
    text = f"<p>At the straight tip, {fixed(straight, 3)} of the hand's moment arrives."
    if inst.joint_type == "tendon-gear":
        text += (
            " Flexion costs more than load does: the tendons' moment arm shrinks faster at the small distal joint than "
            "at the proximal joint."
        )
    plot = chart.plot("fig9_transmissibility", f"Torque transmissibility, {named(inst)}{context.figure_of('Fig. 9')}.")
    return Section("transmissibility", "Torque transmissibility", text + "</p>", [plot], [table])


def _at(angle: float, output: Array, ratio: Array) -> float:
    """Return the ratio where the output passes an angle, NaN where it never does; arrays are (n,), angles in rad."""
    solved = np.isfinite(output)
    if not solved.any():
        return float("nan")
    return float(np.interp(angle, output[solved], ratio[solved], left=np.nan, right=np.nan))
