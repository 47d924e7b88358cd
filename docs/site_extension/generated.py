"""What is written into pages when the site is built, where a page says so in double braces.

{{commands}}                     the reference of the commands
{{keys instrument}}              the keys of a kind of file
{{traceability}}                 equations, functions, tests
{{homing}}                       why homing fails, and what to do
{{table NAME}}                   a table of measured figures; with {{table NAME: COLUMN COLUMN}} some of its columns
{{figure TABLE.ROW.COLUMN}}      one figure; with a format, {{figure TABLE.ROW.COLUMN:.1f}}
"""

import re
from collections.abc import Callable
from typing import Any

import command_reference
import figures
import keys
import traceability
from sphinx.application import Sphinx

from tenodesis.console.status import HOMING_REMEDIES
from tenodesis.control import HOMING_REASONS

PLACE = re.compile(r"\{\{(commands|keys|traceability|homing|table|figure)(?: ([^}]*))?\}\}")


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the replacement."""
    app.connect("source-read", _write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _write(app: Sphinx, page: str, source: list[str]) -> None:
    source[0] = PLACE.sub(lambda place: WRITERS[place[1]](place[2] or ""), source[0])


def figure(quoted: str) -> str:
    """Return a figure as text, by its name and perhaps a format."""
    name, _, form = quoted.partition(":")
    value, column = figures.flat(figures.read())[name]
    return _shown(value, form or column.form)


def table(quoted: str) -> str:
    """Return a table of figures, by its name and perhaps the names of its columns, as Markdown with its command."""
    name, _, names = quoted.partition(":")
    found = figures.read()[name]
    every = [column.name for column in found.columns]
    wanted = [every.index(one) for one in names.split() or every]
    shown = [found.columns[n] for n in wanted]
    lines = [[found.of, *(f"{one.heading}, {one.unit}" if one.unit else one.heading for one in shown)]]
    lines += [["---"] * (1 + len(shown))]
    lines += [[row, *(_shown(values[n], found.columns[n].form) for n in wanted)] for row, values in found.rows.items()]
    text = "\n".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in line)} |" for line in lines)
    return f"{text}\n\n`{found.command}`\n"


def homing() -> str:
    """Return the reasons for which homing fails, with their remedies, as Markdown."""
    rows = [f"| `{name}` | {HOMING_REASONS[name]} | {remedy} |" for name, remedy in HOMING_REMEDIES.items()]
    return "\n".join(["| reason | meaning | what to do |", "|---|---|---|", *rows]) + "\n"


def _shown(value: Any, form: str) -> str:
    return "–" if value is None else value if isinstance(value, str) else format(value, form)


WRITERS: dict[str, Callable[[str], str]] = {
    "commands": lambda _: command_reference.text(),
    "keys": keys.tables,
    "traceability": lambda _: traceability.tables(),
    "homing": lambda _: homing(),
    "table": table,
    "figure": figure,
}
