"""Drawings of parts to make: one page each, with views, dimensions and their tolerances."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from textwrap import wrap
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from tenodesis.cad import kernel as k
from tenodesis.cad.model import Model
from tenodesis.cad.parts import PAGE, Dimension, Part, View, on_page
from tenodesis.report import style
from tenodesis.run import Array
from tenodesis.tolerance.defaults import general_tolerance

_PAGE = (297.0, 210.0)  # mm, A4 landscape
_VIEWS = (12.0, 14.0, 186.0, 188.0)  # mm: left, low, width, height of the place for the views
_PITCH = 6.5  # mm between dimension lines
_GAP = 12.0  # mm between views, beside their dimensions
_SCALES = (20, 10, 5, 4, 3, 2, 1.5, 1, 1 / 1.5, 0.5, 0.4, 0.25, 0.2, 0.1)
_FROM: Mapping[View, tuple[k.Point, k.Point]] = {
    "front": ((0, -1e3, 0), (0, 0, 1)),
    "side": ((-1e3, 0, 0), (0, 0, 1)),
    "top": ((0, 0, 1e3), (0, 1, 0)),
}
"""Place of the eye and its upward direction."""
_EYE = (620.0, -900.0, 560.0)
_GENERAL = "m"
"""Class of ISO 2768-1."""


class Row(NamedTuple):
    """A dimension as it stands in a drawing's table, mm."""

    name: str
    label: str
    nominal: float
    tolerance: float
    own: bool
    """Whether the tolerance was given; otherwise it is the general one."""


def rows(part: Part, tolerances: Mapping[str, float] | None = None) -> list[Row]:
    """Return a part's dimensions with their tolerances, mm.

    Parameters
    ----------
    part
        The part.
    tolerances
        Half widths, m, by the key of the instrument file that a dimension sets, such as "distal_gear_radius", or by
        "part.dimension"; without one a dimension has the general tolerance of ISO 2768-1, class m.
    """
    given = tolerances or {}
    found = []
    for one in part.dimensions:
        tolerance = given.get(f"{part.name}.{one.name}")
        if tolerance is None and one.key in given:
            tolerance = given[one.key] * one.factor
        nominal = one.value
        own = tolerance is not None
        shown = k.MM * tolerance if tolerance is not None else general_tolerance(nominal / k.MM, _GENERAL)
        found.append(Row(one.name, f"{one.sign}{nominal:.4g}", nominal, shown, own))
    return found


def draw_part(model: Model, part: Part, tolerances: Mapping[str, float] | None = None) -> Figure:
    """Return the drawing of a part; tolerances as in :func:`rows`."""
    fig = style.StyledFigure(figsize=(_PAGE[0] / 25.4, _PAGE[1] / 25.4))
    axis = fig.add_axes((0, 0, 1, 1))
    axis.set(xlim=(0, _PAGE[0]), ylim=(0, _PAGE[1]))
    axis.set_axis_off()
    scale = _draw_views(axis, part)
    _draw_frame(axis, model, part, scale)
    _draw_table(axis, part, rows(part, tolerances))
    return fig


def write_drawings(
    model: Model, path: Path, tolerances: Mapping[str, float] | None = None, *, progress: Any = None
) -> None:
    """Write the drawings of all parts to make as a PDF file of a page each; tolerances as in :func:`rows`."""
    made = [part for part in model.parts if part.made]
    with style.applied(), PdfPages(path, metadata={"CreationDate": None, "Title": model.instrument.name}) as pages:
        for number, part in enumerate(made):
            if progress is not None:
                progress(number, len(made), "drawings")
            pages.savefig(draw_part(model, part, tolerances))


class _Lines(NamedTuple):
    visible: list[Array]
    hidden: list[Array]

    @property
    def bounds(self) -> tuple[Array, Array]:
        points = np.vstack([*self.visible, *self.hidden])
        return points.min(0), points.max(0)


def projected(solid: k.Solid, eye: k.Point, up: k.Point) -> _Lines:
    """Return the visible and the hidden edges of a solid as polylines (points, 2), mm."""
    visible, hidden = solid.project_to_viewport(eye, up, (0, 0, 0))
    return _Lines(list(_polylines(visible)), list(_polylines(hidden)))


def _polylines(edges: Sequence[Any]) -> Iterator[Array]:
    line = k.kernel().GeomType.LINE
    for edge in edges:
        # By the curve's own parameter: the kernel finds no place by length on some of the short ones.
        curve = k.curve(edge)
        places = np.linspace(curve.FirstParameter(), curve.LastParameter(), 2 if edge.geom_type == line else 65)
        points = (curve.Value(float(place)) for place in places)
        yield np.array([(point.X(), point.Y()) for point in points])


def _draw_views(axis: Axes, part: Part) -> float:
    """Draw three views and an oblique one, and return the scale."""
    views: dict[View, _Lines] = {view: projected(part.solid, *_FROM[view]) for view in PAGE}
    sizes = {view: lines.bounds[1] - lines.bounds[0] for view, lines in views.items()}
    margins = {view: _margins(part, view) for view in views}
    left, low, width, height = _VIEWS

    def taken(view: View, direction: int) -> float:
        first, second = margins[view][direction]
        return first + second

    across = max(taken("front", 0), taken("top", 0)) + taken("side", 0) + _GAP
    up = max(taken("front", 1), taken("side", 1)) + taken("top", 1) + _GAP
    wide = max(sizes["front"][0], sizes["top"][0]) + sizes["side"][0]
    high = max(sizes["front"][1], sizes["side"][1]) + sizes["top"][1]
    scale = next((one for one in _SCALES if one * wide <= width - across and one * high <= height - up), _SCALES[-1])
    left += (width - across - scale * wide) / 2
    low -= (height - up - scale * high) / 2
    right = left + max(margins["front"][0][0], margins["top"][0][0])
    column = scale * max(sizes["front"][0], sizes["top"][0])
    beside = right + column + max(margins["front"][0][1], margins["top"][0][1]) + _GAP + margins["side"][0][0]
    top = low + height - max(margins["front"][1][1], margins["side"][1][1])
    below = top - scale * max(sizes["front"][1], sizes["side"][1])
    below -= max(margins["front"][1][0], margins["side"][1][0]) + _GAP + margins["top"][1][1]
    middle = right + column / 2
    places = {
        "front": np.array([middle - scale * sizes["front"][0] / 2, top - scale * sizes["front"][1]]),
        "side": np.array([beside, top - scale * sizes["side"][1]]),
        "top": np.array([middle - scale * sizes["top"][0] / 2, below - scale * sizes["top"][1]]),
    }
    for view, lines in views.items():
        shift = places[view] - scale * lines.bounds[0]
        _draw_lines(axis, lines, scale, shift)
        _draw_dimensions(axis, part, view, lines, (scale, shift))
    oblique = projected(part.solid, _EYE, k.UP)
    lowest, highest = oblique.bounds
    factor = min(82 / (highest - lowest)[0], 52 / (highest - lowest)[1])
    shift = np.array([246.0, 174.0]) - factor * (lowest + highest) / 2
    _draw_lines(axis, _Lines(oblique.visible, []), factor, shift)
    return scale


def _margins(part: Part, view: View) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return what dimensions take on a page: left and right of a view, below and above it, mm."""
    counts = {
        (along, side): sum(one.view == view and (one.along, one.side) == (along, side) for one in part.dimensions)
        for along in ("x", "y")
        for side in (-1, 1)
    }

    def room(along: str, side: int) -> float:
        count = counts[along, side]
        return _PITCH * count + (3.0 if count else 0.0)

    return (room("y", -1), room("y", 1)), (room("x", -1), room("x", 1))


def _draw_lines(axis: Axes, lines: _Lines, scale: float, shift: Array) -> None:
    hidden, visible = ([scale * piece + shift for piece in pieces] for pieces in (lines.hidden, lines.visible))
    axis.add_collection(LineCollection(hidden, linewidths=0.35, linestyles=(0, (4, 2.5)), colors=style.MUTED))
    axis.add_collection(LineCollection(visible, linewidths=0.75, colors=style.INK, capstyle="round"))


def _draw_dimensions(axis: Axes, part: Part, view: View, lines: _Lines, place: tuple[float, Array]) -> None:
    """Draw a view's dimensions, the shortest nearest to it, each on a line of its own; place is scale and shift."""
    scale, shift = place
    low, high = (scale * corner + shift for corner in lines.bounds)
    for along in ("x", "y"):
        for side in (-1, 1):
            chosen = [one for one in part.dimensions if (one.view, one.along, one.side) == (view, along, side)]
            for number, one in enumerate(sorted(chosen, key=lambda one: one.value), start=1):
                ends = [scale * np.array(on_page(view, point)) + shift for point in (one.first, one.second)]
                reach = 3.0 + _PITCH * (number - 0.5)
                _draw_dimension(axis, one, ends, (high if side > 0 else low) + side * reach)


def _draw_dimension(axis: Axes, one: Dimension, ends: Sequence[Array], line: Array) -> None:
    along = 0 if one.along == "x" else 1
    across = 1 - along
    feet = []
    for end in ends:
        foot = end.copy()
        foot[across] = line[across]
        feet.append(foot)
        over = np.sign(foot - end) * 1.2
        axis.plot(*np.stack([end + 0.6 * over, foot + over]).T, color=style.MUTED, lw=0.35)
    length = float(np.linalg.norm(feet[1] - feet[0]))
    text = f"{one.sign}{one.value:.4g}"
    outside = length < 2.2 * len(text) + 4
    first, second = sorted(feet, key=lambda foot: float(foot[along]))
    if length < 5:
        step = np.zeros(2)
        step[along] = 4.0
        for foot, sign in ((first, -1), (second, 1)):
            _draw_arrow(axis, foot + sign * step, foot, "-|>")
    else:
        _draw_arrow(axis, first, second, "<|-|>")
    place = (first + second) / 2
    if outside:
        place = second.copy()
        place[along] += (4.6 if length < 5 else 1.0) + (1.1 * len(text) if along == 1 else 0)
    else:
        place[across] += 1.9 if along == 0 else -1.9
    axis.text(
        float(place[0]),
        float(place[1]),
        text,
        rotation=90 if along == 1 else 0,
        fontsize=6.5,
        color=style.INK,
        ha="left" if outside and along == 0 else "center",
        va="center",
        bbox={"fc": "white", "ec": "none", "pad": 0.4},
    )


def _draw_arrow(axis: Axes, start: Array, end: Array, heads: str) -> None:
    look = {"arrowstyle": f"{heads},head_width=0.09,head_length=0.22", "lw": 0.5, "color": style.ACCENT}
    first, second = ((float(point[0]), float(point[1])) for point in (end, start))
    axis.annotate("", first, second, arrowprops=look | {"shrinkA": 0, "shrinkB": 0})


def _draw_frame(axis: Axes, model: Model, part: Part, scale: float) -> None:
    axis.plot([5, 292, 292, 5, 5], [5, 5, 205, 205, 5], color=style.INK, lw=1.0)
    axis.plot([200, 200], [5, 205], color=style.INK, lw=0.6)
    axis.plot([200, 292], [38, 38], color=style.INK, lw=0.6)
    ratio = f"{scale:g}:1" if scale >= 1 else f"1:{1 / scale:.3g}"
    mass = part.solid.volume * 1e-6 * part.density
    pieces = len(part.places)
    entries = (
        (32.5, part.title, 9.5, "bold"),
        (26.5, f"{part.name} · {pieces} {'piece' if pieces == 1 else 'pieces'}", 7.5, "normal"),
        (21.0, f"{model.instrument.name}", 7.5, "normal"),
        (15.5, f"{model.process.name}, {model.process.material} · {mass:.3g} g each", 7.5, "normal"),
        (10.0, f"Scale {ratio} · lengths in mm · first-angle projection · A4", 7.0, "normal"),
    )
    for y, text, size, weight in entries:
        axis.text(203, y, text, fontsize=size, weight=weight, va="center")


def _draw_table(axis: Axes, part: Part, table: Sequence[Row]) -> None:
    y = 139.0
    for x, heading, align in ((203, "dimension", "left"), (259, "nominal", "right"), (289, "tolerance", "right")):
        axis.text(x, y, heading, fontsize=6.5, color=style.MUTED, ha=align, va="center")
    for row in table:
        y -= 5.0
        axis.text(203, y, row.name, fontsize=6.8, va="center")
        axis.text(259, y, row.label, fontsize=6.8, ha="right", va="center")
        axis.text(
            289,
            y,
            f"± {row.tolerance:.3g}{'' if row.own else ' *'}",
            fontsize=6.8,
            ha="right",
            va="center",
            color=style.ACCENT if row.own else style.INK,
            weight="bold" if row.own else "normal",
        )
    y -= 6.0
    notes = [*part.notes, f"Sizes that are not given: {part.name}.step."]
    if any(not row.own for row in table):
        notes.append("* General tolerance, ISO 2768-1, class m.")
    for note in notes:
        for number, line in enumerate(wrap(note, 62)):
            axis.text(
                203, y, ("– " if number == 0 and not note.startswith("*") else "   ") + line, fontsize=6.2, va="center"
            )
            y -= 3.6
        y -= 0.8
