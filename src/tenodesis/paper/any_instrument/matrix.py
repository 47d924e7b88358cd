"""A matrix as a table of the report: a row for every joint of the tip."""

from collections.abc import Sequence

import numpy as np

from tenodesis.paper.context import Context
from tenodesis.report.content import Array, Column, Table, number

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
        Column(
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
    for joint, row in zip(context.whole.tip_joints, values, strict=True):
        table.row(joint.name, *map(float, row), of=joint.name)
    return table
