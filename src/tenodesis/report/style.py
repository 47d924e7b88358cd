"""The style of the figures: palette, fonts, and a size for screen and print."""

import io
import re
from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

INK = "#1b2733"
MUTED = "#6b7785"
GRID = "#e3e8ed"
REFERENCE = "#8a97a5"
ACCENT = "#c2410c"
AGONIST = "#b4232f"
ANTAGONIST = "#1f5fa8"
LOADS = ("#0f766e", "#2563a8", "#7c3aed", "#c2410c", "#9d174d", "#4d7c0f")

_STYLE: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 9.5,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.titlesize": 10,
    "axes.titleweight": "bold",
    "axes.titlecolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "text.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.8,
    "svg.hashsalt": "tenodesis",
    "figure.dpi": 110,
}


def colors(count: int) -> list[str]:
    """Return a colour for each of `count` curves, the first of which has no load."""
    fixed = [INK, *LOADS]
    if count <= len(fixed):
        return fixed[:count]
    shades = mpl.colormaps["viridis"](np.linspace(0, 0.92, count - 1))
    return [INK, *(mpl.colors.to_hex(shade) for shade in shades)]


class StyledFigure(Figure):
    """A figure that is saved in this style wherever, and that notebooks show."""

    def savefig(self, *args: Any, **kwargs: Any) -> None:
        """Save the figure, as matplotlib does."""
        with applied():
            super().savefig(*args, **kwargs)

    def _repr_png_(self) -> bytes:
        file = io.BytesIO()
        self.savefig(file, format="png")
        return file.getvalue()


def drawing(*, width: float, height: float) -> StyledFigure:
    """Return a new figure without panels; the size is in inches."""
    return StyledFigure(figsize=(width, height), layout="constrained")


def figure(columns: int = 1, *, width: float = 7.0, height: float = 4.1) -> tuple[Figure, Sequence[Axes]]:
    """Return a new figure with this many panels side by side."""
    fig = drawing(width=width, height=height)
    return fig, list(fig.subplots(1, columns, squeeze=False)[0])


def applied() -> AbstractContextManager[None]:
    """Return the context in which figures are made and saved; figures made outside it keep their own style."""
    return mpl.rc_context(_STYLE)


def legend_above(axis: Axes, columns: int) -> None:
    """Put an axis's legend above it, where no curve runs."""
    axis.legend(loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.3, ncols=columns)


def legend_outside(fig: Figure, *entries: tuple[str, str, str], columns: int | None = None) -> None:
    """Put a legend above all panels of a figure, in one row; an entry is a name, a colour and a line style."""
    handles = [Line2D([], [], color=color, ls=line, label=name) for name, color, line in entries]
    fig.legend(handles=handles, loc="outside upper left", ncols=columns or len(entries))


def inlined(name: str, svg: str) -> str:
    """Return an SVG for use within HTML: no prologue, no size of its own, and ids that no other figure uses."""
    body = re.sub(r'\bid="([^"]+)"', rf'id="{name}-\1"', svg[svg.index("<svg") :])
    body = re.sub(r'(xlink:href="#|url\(#)', rf"\1{name}-", body)
    return re.sub(r"^<svg[^>]*>", lambda tag: re.sub(r' (width|height)="[^"]+"', "", tag[0]), body)
