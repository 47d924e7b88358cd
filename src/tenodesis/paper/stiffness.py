"""Stiffness of the joints as a matrix, and how far forces at the tip turn them."""

from collections.abc import Sequence

import numpy as np

from tenodesis.paper.context import Context
from tenodesis.paper.subject import Subject
from tenodesis.report import style
from tenodesis.report.content import Array, Chart, Plot, ResultColumn, Section, Table, named, number

_FORCES = ("x", "y", "z")
_NOTHING = 1e-9
"""Share of the largest number that is shown as a dot."""


def matrix(  # noqa: PLR0917
    context: Context, caption: str, key: str, unit: str, about: str, by: Sequence[str], values: Array
) -> Table:
    """Return the table of a matrix, (joints, columns), whose numbers become results.

    Parameters
    ----------
    caption, by
        Of the table, and of its columns.
    key, unit, about
        Of the results: ``key.JOINT.COLUMN``; `about` names joint and column as {of} and {by}.
    values
        NaN where there is none.
    """
    nothing = _NOTHING * float(np.nanmax(np.abs(values), initial=0.0))
    columns = [
        ResultColumn(
            column,
            f"{key}.{{of}}.{column}",
            unit,
            about.replace("{by}", column),
            form=lambda value: "·" if abs(value) <= nothing else number(value, 3),
            optional=True,
        )
        for column in by
    ]
    table = context.table(caption, "", *columns)
    for joint, row in zip(Subject(context.whole).joints, values, strict=True):
        table.row(joint, *map(float, row), of=joint)
    return table


def section(context: Context) -> Section:
    """Compute the matrices of stiffness and compliance, straight and bent, and how stiffness changes on the way."""
    subject = Subject(context.whole)
    inst, names = subject.inst, subject.joints
    tables: list[Table] = []
    softest: list[float] = []
    for state in subject.states:
        rates = subject.rates(state.handle, state.strokes)
        where = subject.described(state)
        compliance = np.degrees(np.column_stack([rates.by_wrench[:, :3], rates.by_grip]))
        by = (*_FORCES, "grip") if inst.jaws else _FORCES
        tables += [
            matrix(
                context,
                f"Stiffness at {where}: moment by angle [N·m/rad]",
                f"stiffness.{state.name}",
                "N·m/rad",
                f"Moment about {{of}} by the angle of {{by}}, {state.name}",
                names,
                rates.stiffness,
            ),
            matrix(
                context,
                f"Compliance at {where}: angle by force at the tip [°/N]",
                f"compliance.{state.name}",
                "deg/N",
                f"Angle of {{of}} by a force along {{by}}, {state.name}",
                by,
                compliance[:, : len(by)],
            ),
        ]
        softest.append(float(np.linalg.eigvalsh((rates.stiffness + rates.stiffness.T) / 2)[0]))
    least = min(softest)
    context.add("stiffness.softest", least, "N·m/rad", "Least stiffness of a motion of the joints, straight or bent")
    text = (
        "<p>Rows are the moments about the joints, columns the angles by which they are turned, handle and motors held "
        "(eq. 16 in one plane). What stands beside the diagonal is the moment that a neighbour’s angle brings: tendons "
        f"that cross both joints. The softest motion of all joints together has {number(least, 3)} N·m/rad.</p>"
    )
    return Section("stiffness", "Stiffness of the joints", text, [_plot(subject)], tables)


def _plot(subject: Subject) -> Plot:
    inst = subject.inst
    bent = subject.states[-1]
    shares, handle, strokes = subject.along(bent)
    rates = subject.rates(handle, strokes)
    chart, (left, right) = Chart.panels(2, width=8.6, height=3.6)
    percent = chart.keep("share of the bent state [%]", 100 * shares)
    for n, (name, look) in enumerate(subject.looks.items()):
        own = rates.stiffness[:, n, n]
        chart.curve(left, percent, f"stiffness of {name} [N*m/rad]", own, label=name, **look)
        turned = np.degrees(np.linalg.norm(rates.by_wrench[:, n, :3], axis=1))
        chart.curve(right, percent, f"{name} by a newton in its worst direction [deg/N]", turned, **look)
    left.set(ylabel="stiffness, others held [N·m/rad]", ylim=(0, None))
    right.set(ylabel="angle by force, worst direction [deg/N]", ylim=(0, None))
    for axis in (left, right):
        axis.set_xlabel("share of the bent state [%]")
    style.legend_above(left, 3)
    return chart.plot(
        "stiffness",
        f"Left: stiffness of every joint, the others held, from straight through {subject.described(bent)} (100 %), "
        f"{named(inst)}. Right: angle by force at the tip, in the direction that turns the joint most.",
    )
