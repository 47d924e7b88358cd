"""The file of measured figures, docs/results.json: tables by name, each with the command that wrote it.

A study writes its tables with ``--figures docs/results.json``, ``make docs`` those of the report. Pages quote a figure
as TABLE.ROW.COLUMN, or TABLE.ROW where the column is ``value``.
"""

import argparse
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from tenodesis.json_values import json_values

FILE = Path(__file__).parents[1] / "docs/results.json"


class Heading(NamedTuple):
    """A column of a table in the file."""

    name: str
    heading: str
    unit: str = ""
    form: str = ""
    """As :func:`format` takes it, where a value is shown; empty for text"""


class FigureTable(NamedTuple):
    """A table of the file."""

    command: str
    """Which writes it"""
    of: str
    """What its rows differ in"""
    columns: Sequence[Heading]
    rows: Mapping[str, Sequence[Any]]
    """Values of the columns, by the name of a row"""


def read(file: Path = FILE) -> dict[str, FigureTable]:
    """Return the tables of a file by name; none if there is no file."""
    content = json.loads(file.read_text("utf-8")) if file.exists() else {}
    return {
        name: FigureTable(**{**table, "columns": [Heading(*column) for column in table["columns"]]})
        for name, table in content.items()
    }


def keep(name: str, table: FigureTable, file: Path = FILE) -> None:
    """Write a table into the file, in the place of one of the same name; rows stand on a line each."""
    parts = []
    for one, own in sorted({**read(file), name: table}.items()):
        columns = ",\n   ".join(_json(column) for column in own.columns)
        rows = ",\n   ".join(f"{_json(row)}: {_json(values)}" for row, values in own.rows.items())
        head = f'"command": {_json(own.command)}, "of": {_json(own.of)},\n  '
        parts.append(f'{_json(one)}: {{\n  {head}"columns": [\n   {columns}],\n  "rows": {{\n   {rows}}}}}')
    file.write_text("{" + ",\n".join(parts) + "}\n", "utf-8")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the option of the file that tables are written into."""
    parser.add_argument("--figures", type=Path, help="JSON file into which the tables are written: docs/results.json")


def shown(row: Sequence[Any]) -> str:
    """Return a row as a line of text, with a dash where there is no value."""
    return "; ".join("-" if one is None else f"{one:.4g}" if isinstance(one, float) else str(one) for one in row)


def headed(columns: Sequence[Heading]) -> str:
    """Return headings and units as a line of text."""
    return "; ".join(f"{one.heading}{f' [{one.unit}]' * bool(one.unit)}" for one in columns)


def flat(tables: Mapping[str, FigureTable]) -> dict[str, tuple[Any, Heading]]:
    """Return each figure by its name: its value, and its column."""
    return {
        f"{name}.{slug(row) if ' ' in row else row}" + ("" if column.name == "value" else f".{column.name}"): (
            value,
            column,
        )
        for name, table in tables.items()
        for row, values in table.rows.items()
        for column, value in zip(table.columns, values, strict=True)
    }


def slug(text: str) -> str:
    """Return a text as a part of a name."""
    return "_".join(re.sub(r"(?<!\w)\.|\.(?!\w)|[^\w.]", " ", text.lower()).split()) or "all"


def _json(value: Any) -> str:
    return json.dumps(json_values(value), ensure_ascii=False)
