"""Fig. 9: torque transmissibility."""

import numpy as np

from tenodesis import statics
from tenodesis.paper.context import Context
from tenodesis.report import curves
from tenodesis.report.content import Array, Column, Section, fixed, named
from tenodesis.report.curves import forces, load_name

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
    handle = curves.handle_angles(inst)
    for force in loads:
        output = statics.output_angle(inst, handle, force)
        ratio = statics.torque_transmissibility(inst, handle, force)
        ends = [_at(inst.output_range * share, output, ratio) for share in _SHARES]
        table.row(load_name(force), *ends, force=force)
    straight = context.add(
        "transmissibility.straight",
        statics.torque_transmissibility(inst, 0.0),
        "1",
        "Torque transmissibility of the straight, unloaded instrument",
    )
    chart = curves.transmissibility(inst, loads)
    text = f"<p>At the straight tip, {fixed(straight, 3)} of the hand's moment arrives."
    if inst.joint_type == "tendon-gear":
        text += (
            " Flexion costs more than load does: the tendons' moment arm shrinks faster at the small distal joint than "
            "at the proximal joint."
        )
    plot = chart.plot(
        context.file_name("fig9", "transmissibility"),
        f"Torque transmissibility, {named(inst)}{context.figure_of('Fig. 9')}.",
    )
    return Section("transmissibility", "Torque transmissibility", text + "</p>", [plot], [table])


def _at(angle: float, output: Array, ratio: Array) -> float:
    """Return the ratio where the output passes an angle, NaN where it never does; arrays are (n,), angles in rad."""
    solved = np.isfinite(output)
    if not solved.any():
        return float("nan")
    return float(np.interp(angle, output[solved], ratio[solved], left=np.nan, right=np.nan))
