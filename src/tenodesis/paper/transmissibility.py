"""Transmission of angles and moments from the handle and the motors to the joints at the tip (eqs. 10-14, Fig. 9)."""

import numpy as np

from tenodesis import statics
from tenodesis.instrument import ShortForm
from tenodesis.paper.context import Context
from tenodesis.paper.stiffness import matrix
from tenodesis.report import curves
from tenodesis.report.content import Array, ResultColumn, Section, Table, fixed, named
from tenodesis.report.curves import forces, load_name
from tenodesis.statics.bends import straight_arms

_SHARES = (0.0, 0.5, 1.0)  # of the working range, where the table has values


def section(context: Context) -> Section:
    """Compute how angles, strokes and moments are transmitted: straight and bent, or of one joint over loads."""
    subject = context.subject
    if subject.plane is not None:
        return _over_loads(context, subject.plane)
    inst = subject.inst
    tables: list[Table] = []
    handles, tendons = [joint.name for joint in inst.handle_joints], [tendon.name for tendon in inst.tendons]

    def add(  # noqa: PLR0917
        caption: str, name: str, unit: str, about: str, by: list[str], values: Array, at: str
    ) -> None:
        if by:
            tables.append(matrix(context, caption, f"{name}.{at}", unit, f"{about}, {at}", by, values))

    for state in subject.states:
        rates, where = subject.rates(state.handle, state.strokes), subject.described(state)
        moments = np.where(np.abs(rates.by_handle).max(axis=0, initial=0.0) > 0, rates.transmissibility, np.nan)

        caption, about = f"Angles by angles of the handle, at {where} [°/°]", "Angle of {of} by the angle of {by}"
        add(caption, "transmission", "1", about, handles, rates.by_handle, state.name)
        caption = f"Torque transmissibility at {where}: moments at the tip by moments at the handle"
        add(
            caption, "transmissibility", "1", "Moment about {of} by the moment about {by}", handles, moments, state.name
        )
        caption, about = f"Angles by length wound, at {where} [°/mm]", "Angle of {of} by the length wound on {by}"
        add(caption, "by_stroke", "deg/mm", about, tendons, 1e-3 * np.degrees(rates.by_stroke), state.name)
    caption, about = "Moments about the straight joints by tension [N·mm/N]", "Moment about {of} by the tension of {by}"
    arms = 1e3 * straight_arms(inst).T
    tables.append(matrix(context, caption, "moment_by_tension", "N·mm/N", about, tendons, arms))
    text = (
        "<p>All is exact at rest, without a load and without friction, tendons’ stretch and springs of the joints "
        "included. Rows are joints of the tip; what stands beside a joint’s own handle or motors is coupling. "
    )
    if handles:
        text += (
            "Moments arrive by virtual work: of two joints in one plane their matrix is the ratio of eq. 13. A dash: "
            "the tendon is slack there, or the spring of the joint bears the moment."
        )
    else:
        text += "There are no joints at the handle: motors hold the tip’s moments by the tensions."
    return Section("transmissibility", "Transmission and torque transmissibility", text + "</p>", (), tables)


def _over_loads(context: Context, inst: ShortForm) -> Section:
    loads = forces(inst)
    labels = [f"{np.degrees(share * inst.output_range):.4g}" for share in _SHARES]
    table = context.table(
        "Torque transmissibility ξ",
        "force at the tip",
        *(
            ResultColumn(
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
