"""The workshop plan of a design: one page, as HTML that needs nothing beside it and as PDF."""

import json
import re
from base64 import b64encode
from bisect import bisect_left
from dataclasses import asdict
from errno import EISDIR
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jinja2
import matplotlib as mpl
import typst
from markupsafe import Markup, escape

from tenodesis.errors import DesignError
from tenodesis.files import atomic_files
from tenodesis.report import style
from tenodesis.scaling.plan_content import Plan, content
from tenodesis.scaling.plan_tables import Limits

if TYPE_CHECKING:
    from tenodesis.scaling.design import Design

__all__ = ["Limits", "Plan", "content", "write"]

_SIZES = (8.4, 8.1, 7.8, 7.5, 7.2, 6.9, 6.6, 6.3, 6.0)
"""Sizes of type, pt: the largest that fits is taken; below the last nobody reads."""
_CUTS = (
    Limits(drawings=2),
    Limits(groups=5, warnings=6, drawings=2),
    Limits(12, 6, 4, 5, 2),
    Limits(8, 5, 4, 4, 2),
    Limits(6, 4, 3, 3, 2),
    Limits(4, 3, 2, 2, 0),
)
_TITLE = ((50, 2.0), (90, 1.5), (1000, 1.2))
"""Sizes of the title over that of the type, by its most characters."""
_ENDLESS = r"(\S{24,})"
_SYMBOL = r"([^\W\d_]+)_(\w+)"


def write(design: "Design", folder: Path) -> tuple[Path, Path]:
    """Write the plan of a design as plan.html and plan.pdf, each exactly one A4 page, both or neither.

    Parameters
    ----------
    design
        The design.
    folder
        Where to; made if absent.

    Returns
    -------
    tuple of Path
        The HTML file and the PDF.

    Raises
    ------
    DesignError
        The folder cannot be written.
    """
    plan, size = _fitted(design)
    files = {"plan.html": _html(plan, size).encode(), "plan.pdf": _pdf(plan, size)}
    try:
        for name in files:
            if (folder / name).is_dir():
                raise IsADirectoryError(EISDIR, f"{name} is a folder")
        with atomic_files(folder) as new:
            for name, data in files.items():
                (new / name).write_bytes(data)
    except OSError as problem:
        raise DesignError(f"{folder} cannot be written: {problem.strerror or problem}.") from problem
    return folder / "plan.html", folder / "plan.pdf"


def _fitted(design: "Design") -> tuple[Plan, float]:
    """Return the fullest plan that fits a page, and its size of type (pt)."""
    plan = content(design)
    fitting = bisect_left(_SIZES, True, key=lambda size: _pages(plan, size) == 1)
    if fitting < len(_SIZES):
        return plan, _SIZES[fitting]
    for limits in _CUTS:
        plan = content(design, limits)
        if _pages(plan, _SIZES[-1]) == 1:
            break
    return plan, _SIZES[-1]


def _html(plan: Plan, size: float) -> str:
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    template = environment.from_string(_template("plan.html.j2").decode())
    return template.render(plan=plan, **_look(plan, size), marked=_marked, broken=_broken, encoded=_encoded)


def _pdf(plan: Plan, size: float) -> bytes:
    return typst.compile(_template("plan.typ"), sys_inputs=_inputs(plan, size), font_paths=_fonts())


def _pages(plan: Plan, size: float) -> int:
    told = typst.query(
        _template("plan.typ"), "<pages>", field="value", one=True, sys_inputs=_inputs(plan, size), font_paths=_fonts()
    )
    return int(json.loads(told))


def _inputs(plan: Plan, size: float) -> dict[str, str]:
    return {"data": json.dumps(asdict(plan) | _look(plan, size))}


def _template(name: str) -> bytes:
    return (resources.files("tenodesis.scaling") / name).read_bytes()


@cache
def _fonts() -> typst.Fonts:
    """Return the fonts that come with matplotlib, so that the page is the same on every machine."""
    return typst.Fonts(include_system_fonts=False, font_paths=[Path(mpl.get_data_path()) / "fonts/ttf"])


def _look(plan: Plan, size: float) -> dict[str, Any]:
    """Return what both templates look by: size of type (pt), that of the title over it, and colours."""
    title = next(relative for most, relative in _TITLE if len(plan.title) <= most)
    colors = {"ink": style.INK, "muted": style.MUTED, "line": style.GRID, "accent": style.ACCENT}
    return {"size": size, "title_size": title, "colors": colors}


def _encoded(svg: str) -> str:
    """Return a figure as the text of a data address, within which its ids meet no other figure's."""
    return b64encode(svg.encode()).decode()


def _broken(text: str) -> Markup:
    """Return text as HTML whose words without end may be broken anywhere."""
    parts = re.split(_ENDLESS, text)
    return Markup("").join(Markup("<wbr>").join(part) if index % 2 else part for index, part in enumerate(parts))


def _marked(text: str) -> Markup:
    """Return text as HTML, the indices of its symbols lowered."""
    return Markup(re.sub(_SYMBOL, r"\1<sub>\2</sub>", str(escape(text))))
