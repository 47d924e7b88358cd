"""The figures of a workshop plan: what tip and tendons will do at the test loads, and where similarity ends."""

from collections.abc import Sequence
from io import StringIO
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patheffects import Normal, Stroke
from numpy.typing import ArrayLike, NDArray

from tenodesis import statics
from tenodesis.instrument import Instrument
from tenodesis.report import style
from tenodesis.similarity import SimilarityError

if TYPE_CHECKING:
    from tenodesis.scaling.design import Design, TestLoad

MOST_CURVES = 4
"""Test loads that curves are drawn for; more would hide each other."""

_SIZE = (3.55, 1.75)  # inches: half the page's width
_SMALL: Any = {
    "font.size": 6.5,
    "legend.fontsize": 6,
    "lines.linewidth": 1.0,
    "axes.linewidth": 0.6,
}
_POINTS = 161
_LEAST_BOUND = 1e-3  # deg
_FAR = 2.0  # times the largest tension; what lies beyond would flatten the curves


def input_output(design: "Design") -> str:
    """Return output over handle angle at the test loads, both instruments over each other, as SVG."""
    handle, tests = _handle(design), shown(design.tests)
    fig = Figure(figsize=_SIZE, layout="constrained")
    axis = fig.subplots()
    rows = [(0.0, 0.0), *((test.real_force, test.force) for test in tests)]
    for (real, scaled), color in zip(rows, style.colors(len(rows)), strict=True):
        expected = _output(design.real_size, handle, real)
        found = _output(design.scaled_up, design.comparison.scaled_up_handle_angle(handle), scaled)
        axis.plot(np.degrees(handle), expected, color=color, lw=3.2, alpha=0.3, solid_capstyle="butt")
        label = f"{real:.3g} → {scaled:.3g} N" if real else "no load"
        axis.plot(np.degrees(handle), found, color=color, label=label)
    axis.set(xlabel="handle angle [°]", ylabel="output angle [°]", xlim=np.degrees(handle[[0, -1]]))
    place: Any = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.02), "handlelength": 1.2}
    axis.legend(**place, title="real-size → scaled-up", title_fontsize=6)
    return _svg(fig)


def tensions(design: "Design") -> str:
    """Return the scaled-up tendons' tensions at the largest test load, with what bounds them (N), as SVG."""
    handle, tests = np.asarray(design.comparison.scaled_up_handle_angle(_handle(design))), shown(design.tests)
    inst, cell = design.scaled_up, design.choice.load_cell
    fig = Figure(figsize=_SIZE, layout="constrained")
    axis = fig.subplots()
    # The largest load's curves may end before the others do.
    loads = dict.fromkeys([tests[0].force, tests[-1].force] if tests else [0.0])
    for force, dashes in zip(loads, (":", "-")[-len(loads) :], strict=True):
        found = statics.tensions(inst, handle, force)
        for values, color, name in (
            (found.agonist, style.AGONIST, "agonist"),
            (found.antagonist, style.ANTAGONIST, "antagonist"),
        ):
            axis.plot(np.degrees(handle), values, dashes, color=color, label=f"{name} at {force:.3g} N")
    axis.axhline(inst.pretension, color=style.MUTED, lw=0.8, ls="--", label=f"pretension {inst.pretension:.3g} N")
    axis.axhline(0.0, color=style.INK, lw=1.0, label="slack at 0 N")
    top = 1.08 * max(design.largest_tension, axis.get_ylim()[1])
    bounds = [("load cell", cell.range, style.ACCENT), ("rope breaks", design.choice.rope.breaking_load, style.INK)]
    for name, bound, color in bounds:
        near = bound <= _FAR * design.largest_tension
        label = f"{name} {bound:.4g} N" + ("" if near else " (above)")
        axis.axhline(bound if near else np.nan, color=color, lw=1.0, ls="-.", label=label)
        top = max(top, 1.05 * bound) if near else top
    axis.set(
        xlabel="handle angle [°]",
        ylabel="tension [N]",
        xlim=np.degrees(handle[[0, -1]]),
        ylim=(-0.03 * top, top),
    )
    axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.02), handlelength=1.5)
    return _svg(fig)


def error_map(error: SimilarityError) -> str:
    """Return the similarity error over handle angle and force, its worst point marked, as SVG."""
    fig = Figure(figsize=_SIZE, layout="constrained")
    axis = fig.subplots()
    bound = max(_LEAST_BOUND, error.quantile_95)
    handle, force = error.worst
    mesh = axis.pcolormesh(
        np.degrees(error.handle_angle), error.force, error.error.T, cmap="RdBu_r", vmin=-bound, vmax=bound,
        shading="gouraud", rasterized=True,
    )  # fmt: skip
    # The worst point is often a corner: above the axes' lines, and told from dark errors by its rim.
    ring: Any = {"mfc": "none", "mec": style.INK, "ms": 5, "mew": 1, "clip_on": False, "zorder": 5}
    rim = [Stroke(linewidth=2.5, foreground="white"), Normal()]
    axis.plot(np.degrees(handle), force, "o", **ring, path_effects=rim, label="worst")
    axis.set_facecolor("#d5dae0")
    axis.grid(visible=False)
    axis.set(xlabel="handle angle [°]", ylabel="real-size force [N]")
    axis.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderpad=0, handletextpad=0.3)
    fig.colorbar(mesh, ax=axis, label="error [°]; grey: no equilibrium", extend="both")
    return _svg(fig)


def drawn(design: "Design", error: SimilarityError) -> tuple[str, str, str]:
    """Return the figures as SVG, in the bench's style."""
    with style.applied(), mpl.rc_context(_SMALL):
        return input_output(design), tensions(design), error_map(error)


def shown(tests: Sequence["TestLoad"]) -> list["TestLoad"]:
    """Return the test loads that curves are drawn for, by size: all, or a few spread over them."""
    ordered = sorted(tests, key=lambda test: test.real_force)
    spread = np.linspace(0, len(ordered) - 1, MOST_CURVES).round().astype(int)
    return [ordered[at] for at in np.unique(spread)] if ordered else []


def _handle(design: "Design") -> NDArray[np.float64]:
    return np.linspace(-design.comparison.reach, design.comparison.reach, _POINTS)


def _output(inst: Instrument, handle: ArrayLike, force: float) -> NDArray[np.float64]:
    found: NDArray[np.float64] = np.degrees(statics.output_angle(inst, handle, force))
    return found


def _svg(fig: Figure) -> str:
    text = StringIO()
    fig.savefig(text, format="svg", metadata={"Date": None}, dpi=200)
    return text.getvalue()
