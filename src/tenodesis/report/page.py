"""Self-contained HTML pages, from a template of the reporting package."""

import csv
import io
import json
import math
import platform
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from tenodesis.errors import Error
from tenodesis.files import atomic_files, write_errors
from tenodesis.json_values import json_values
from tenodesis.report import style
from tenodesis.report.content import Plot, fixed
from tenodesis.version import __version__

DRAWINGS = ("svg", "png")
"""File types in which a figure is written."""

_PNG_DOTS = 200  # per inch


def render(package: str, template: str, **values: Any) -> str:
    """Return a page from a Jinja template in a package; it may extend base.html.j2, and use `fixed` and `about`."""
    loader = jinja2.ChoiceLoader([jinja2.PackageLoader(one, "") for one in (package, "tenodesis.report")])
    environment = jinja2.Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.globals.update(fixed=fixed, about=about())
    return environment.get_template(template).render(**values)


def about(*libraries: str) -> dict[str, str]:
    """Return the versions a report was made with: ours, Python's, NumPy's and those of further libraries by name."""
    versions = {"tenodesis": __version__, "python": platform.python_version(), "numpy": np.__version__}
    return versions | {name: metadata.version(name) for name in libraries}


def svg_text(figure: Figure, *, dots_per_inch: float = _PNG_DOTS) -> str:
    """Return a figure as the text of an SVG file."""
    file = io.StringIO()
    figure.savefig(file, format="svg", dpi=dots_per_inch, metadata={"Date": None})
    return file.getvalue()


def inline_svg(name: str, figure: Figure, *, dots_per_inch: float = _PNG_DOTS) -> Markup:
    """Return a figure as SVG for use within HTML, its ids made unique by a name."""
    return Markup(style.inlined(name, svg_text(figure, dots_per_inch=dots_per_inch)))


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


@contextmanager
def written(out: Path, error: type[Error], *, last: str = "") -> Iterator[Path]:
    """Yield a temporary folder whose files go to a folder, all or none, or raise an error that names the folder."""
    with write_errors(out, error), atomic_files(out, last=last) as new:
        yield new


def json_text(values: Mapping[str, Any]) -> str:
    """Return values as the text of a JSON file, as :func:`json_values`."""
    return json.dumps(json_values(values), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
