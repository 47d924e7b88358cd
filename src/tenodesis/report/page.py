"""Self-contained HTML pages, from a template of the reporting package."""

import csv
import io
import math
import platform
from collections.abc import Mapping
from importlib import metadata, resources
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from tenodesis.report import style
from tenodesis.report.content import Plot, fixed, number
from tenodesis.version import __version__

DRAWINGS = ("svg", "png")
"""File types in which a figure is written."""

_PNG_DOTS = 200  # per inch


def render(package: str, template: str, **values: Any) -> str:
    """Return a page from a Jinja template in a package; templates may use `fixed`, `number` and `about`."""
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.globals.update(fixed=fixed, number=number, about=about())
    text = (resources.files(package) / template).read_text("utf-8")
    return environment.from_string(text).render(**values)


def about(*libraries: str) -> dict[str, str]:
    """Return the versions a report was made with: ours, Python's, NumPy's and those of further libraries by name."""
    versions = {"tenodesis": __version__, "python": platform.python_version(), "numpy": np.__version__}
    return versions | {name: metadata.version(name) for name in libraries}


def inline_svg(name: str, figure: Figure, *, dots_per_inch: float = _PNG_DOTS) -> Markup:
    """Return a figure as SVG for use within HTML, its ids made unique by a name."""
    file = io.StringIO()
    figure.savefig(file, format="svg", dpi=dots_per_inch, metadata={"Date": None})
    return Markup(style.inlined(name, file.getvalue()))


def write_figure(plot: Plot, folder: Path) -> Markup:
    """Write a figure as SVG and PNG into a folder and return the SVG for use within HTML."""
    for kind in DRAWINGS:
        details: dict[str, Any] = {"Date": None} if kind == "svg" else {}
        plot.figure.savefig(folder / f"{plot.name}.{kind}", dpi=_PNG_DOTS, metadata=details)
        # The layout is the same for all kinds, and finding it takes as long as drawing.
        plot.figure.set_layout_engine("none")
    return Markup(style.inlined(plot.name, (folder / f"{plot.name}.svg").read_text("utf-8")))


def write_columns(columns: Mapping[str, ArrayLike], path: Path, *, digits: int = 9) -> None:
    """Write columns by heading as CSV; shorter ones end early, and what is NaN stays empty."""
    arrays = {heading: np.atleast_1d(np.asarray(values, float)) for heading, values in columns.items()}
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(arrays)
        for i in range(max((column.size for column in arrays.values()), default=0)):
            writer.writerow(
                "" if i >= column.size or math.isnan(column[i]) else f"{column[i]:.{digits}g}"
                for column in arrays.values()
            )


def json_number(value: float) -> float | None:
    """Return a number for JSON: None if it is not finite."""
    return float(value) if math.isfinite(value) else None
