"""Small tables for notebooks: HTML without scripts, styles of its own, or anything from elsewhere."""

import html
from collections.abc import Sequence

_LEFT = 'style="text-align: left"'


def table(title: str, headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table with a title, all of it text, as HTML."""
    head = "".join(f"<th {_LEFT}>{html.escape(text)}</th>" for text in headings)
    body = "".join("<tr>" + "".join(f"<td {_LEFT}>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    caption = f"<caption {_LEFT}>{html.escape(title)}</caption>"
    return f"<table>{caption}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
