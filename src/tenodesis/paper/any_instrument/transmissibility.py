"""Transmission of angles and moments from the handle and the motors to the joints at the tip, as matrices."""

import numpy as np

from tenodesis import statics
from tenodesis.paper.any_instrument.held import described, states
from tenodesis.paper.any_instrument.matrix import matrix
from tenodesis.paper.context import Context
from tenodesis.report.content import Section, Table
from tenodesis.statics import chain


def section(context: Context) -> Section:
    """Compute angles by handle and strokes, and moments at the tip by moments at the handle, straight and bent."""
    inst = context.whole
    tables: list[Table] = []
    handles, tendons = [joint.name for joint in inst.handle_joints], [tendon.name for tendon in inst.tendons]
    for state in states(inst):
        rates = chain.rates(inst, state.handle, strokes=state.strokes)
        where = described(inst, state)
        if handles:
            tables += [
                matrix(
                    context,
                    f"Angles by angles of the handle, at {where} [°/°]",
                    f"transmission.{state.name}",
                    "1",
                    f"Angle of {{of}} by the angle of {{by}}, {state.name}",
                    handles,
                    rates.by_handle,
                ),
                matrix(
                    context,
                    f"Torque transmissibility at {where}: moments at the tip by moments at the handle",
                    f"transmissibility.{state.name}",
                    "1",
                    f"Moment about {{of}} by the moment about {{by}}, {state.name}",
                    handles,
                    np.where(np.abs(rates.by_handle).max(axis=0) > 0, rates.transmissibility, np.nan),
                ),
            ]
        tables.append(
            matrix(
                context,
                f"Angles by length wound, at {where} [°/mm]",
                f"by_stroke.{state.name}",
                "deg/mm",
                f"Angle of {{of}} by the length wound on {{by}}, {state.name}",
                tendons,
                1e-3 * np.degrees(rates.by_stroke),
            )
        )
    tables.append(
        matrix(
            context,
            "Moments about the straight joints by tension [N·mm/N]",
            "moment_by_tension",
            "N·mm/N",
            "Moment about {of} by the tension of {by}",
            tendons,
            1e3 * statics.straight_arms(inst).T,
        )
    )
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
