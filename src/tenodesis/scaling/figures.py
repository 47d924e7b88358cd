"""The figures of scale models: those of a workshop plan, and the front of designs."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patheffects import Normal, Stroke
from numpy.typing import ArrayLike

from tenodesis import statics
from tenodesis.instrument import ShortForm
from tenodesis.report import style
from tenodesis.report.page import inline_svg
from tenodesis.run import Array
from tenodesis.scaling.sweep import ERROR_STEP
from tenodesis.similarity import SimilarityError

if TYPE_CHECKING:
    from tenodesis.scaling.design import Front
    from tenodesis.scaling.joints import JointFront
    from tenodesis.scaling.scale_model import Design, Objectives, TestLoad

MOST_CURVES = 4
"""Largest number of test loads with curves; more would overlap."""

_SIZE = (3.55, 1.75)  # inches: half the page's width
_SMALL: Any = {"font.size": 6.5, "legend.fontsize": 6, "lines.linewidth": 1.0, "axes.linewidth": 0.6}
_POINTS = 161
_LEAST_BOUND = 1e-3  # deg
_FAR = 2.0  # times the largest tension; a bound beyond would flatten the curves
_MOST_DOTS = 20_000
_LEAST_ERROR = 1e-3  # deg; smaller errors are drawn there


def plan_figures(design: "Design", error: SimilarityError) -> tuple[str, str, str]:
    """Return the figures of a plan as SVG: output angles, tensions and the similarity error."""
    with style.applied(), mpl.rc_context(_SMALL):
        drawn = {"output": _output_angles(design), "tensions": _tensions(design), "error": _error_map(error)}
        output, tensions, errors = (inline_svg(name, figure) for name, figure in drawn.items())
        return output, tensions, errors


def shown(tests: Sequence["TestLoad"]) -> list["TestLoad"]:
    """Return the test loads that curves are drawn for, by size: all, or a few of them evenly spread."""
    ordered = sorted(tests, key=lambda test: test.real_force)
    spread = np.linspace(0, len(ordered) - 1, MOST_CURVES).round().astype(int)
    return [ordered[at] for at in np.unique(spread)] if ordered else []


def _output_angles(design: "Design") -> Figure:
    """Draw output over handle angle at the test loads, of both instruments."""
    handle, tests = _handle(design), shown(design.tests)
    fig = Figure(figsize=_SIZE, layout="constrained")
    axis = fig.subplots()
    forces = [(0.0, 0.0), *((test.real_force, test.force) for test in tests)]
    for (real, scaled), color in zip(forces, style.colors(len(forces)), strict=True):
        expected = _output(design.real_size, handle, real)
        found = _output(design.scaled_up, design.comparison.scaled_up_handle_angle(handle), scaled)
        axis.plot(np.degrees(handle), expected, color=color, lw=3.2, alpha=0.3, solid_capstyle="butt")
        label = f"{real:.3g} → {scaled:.3g} N" if real else "no load"
        axis.plot(np.degrees(handle), found, color=color, label=label)
    axis.set(xlabel="handle angle [°]", ylabel="output angle [°]", xlim=np.degrees(handle[[0, -1]]))
    place: Any = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.02), "handlelength": 1.2}
    axis.legend(**place, title="real-size → scaled-up", title_fontsize=6)
    return fig


def _tensions(design: "Design") -> Figure:
    """Draw the scaled-up tendons' tensions (N) at the smallest and the largest test load, with their bounds."""
    handle, tests = np.asarray(design.comparison.scaled_up_handle_angle(_handle(design))), shown(design.tests)
    inst, cell = design.scaled_up, design.choice.load_cell
    fig = Figure(figsize=_SIZE, layout="constrained")
    axis = fig.subplots()
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
    axis.set(xlabel="handle angle [°]", ylabel="tension [N]", xlim=np.degrees(handle[[0, -1]]), ylim=(-0.03 * top, top))
    axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.02), handlelength=1.5)
    return fig


def _error_map(error: SimilarityError) -> Figure:
    """Draw the similarity error over handle angle and force, with its largest value marked."""
    fig = Figure(figsize=_SIZE, layout="constrained")
    axis = fig.subplots()
    bound = max(_LEAST_BOUND, error.quantile_95)
    handle, force = error.worst
    mesh = axis.pcolormesh(
        np.degrees(error.handle_angle), error.force, error.error.T, cmap="RdBu_r", vmin=-bound, vmax=bound,
        shading="gouraud", rasterized=True,
    )  # fmt: skip
    # Often in a corner: drawn above the axes' lines, with a white rim against dark errors.
    ring: Any = {"mfc": "none", "mec": style.INK, "ms": 5, "mew": 1, "clip_on": False, "zorder": 5}
    rim = [Stroke(linewidth=2.5, foreground="white"), Normal()]
    axis.plot(np.degrees(handle), force, "o", **ring, path_effects=rim, label="largest")
    axis.set_facecolor("#d5dae0")
    axis.grid(visible=False)
    axis.set(xlabel="handle angle [°]", ylabel="real-size force [N]")
    axis.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderpad=0, handletextpad=0.3)
    fig.colorbar(mesh, ax=axis, label="error [°]; grey: no equilibrium", extend="both")
    return fig


def _handle(design: "Design") -> Array:
    return np.linspace(-design.comparison.reach, design.comparison.reach, _POINTS)


def _output(inst: ShortForm, handle: ArrayLike, force: float) -> Array:
    angles: Array = np.degrees(statics.output_angle(inst, handle, force))
    return angles


def draw_front(front: "Front | JointFront", marked: Mapping[str, "Objectives"]) -> Figure:
    """Return the front as a figure, with some designs marked by name; use within ``style.applied()``."""
    costs = front.costs
    if len(costs) > _MOST_DOTS:
        costs = costs[:: -(-len(costs) // _MOST_DOTS)]
    error = np.maximum(costs[:, 0], _LEAST_ERROR)
    resolution, length, margin = 1e3 * costs[:, 1], 1e3 * costs[:, 2], 1 / costs[:, 3]
    fig, (left, right) = style.figure(2, width=9.0, height=4.0)
    dots: Any = {"s": 7, "linewidths": 0, "rasterized": True}
    # Where all are as similar as a bench can tell, only the others differ.
    alike = bool(error.max() < ERROR_STEP)
    title = f"All similar within {ERROR_STEP:g} deg" if alike else "Similarity against resolution"
    by_length = left.scatter(resolution, margin if alike else error, c=length, cmap="viridis", **dots)
    left.set(xlabel="force resolution on the real instrument [mN]", title=title)
    fig.colorbar(by_length, ax=left, label="overall length [mm]")
    shades: Any = {"c": resolution, "cmap": "viridis"} if alike else {"c": np.log10(error), "cmap": "magma_r"}
    by_error = right.scatter(length, margin, **shades, **dots)
    right.set(xlabel="overall length [mm]", ylabel="breaking load / largest tension", title="Size against margin")
    bar = fig.colorbar(by_error, ax=right, label="resolution [mN]" if alike else "largest similarity error [deg]")
    if alike:
        left.set(ylabel="breaking load / largest tension")
    else:
        left.set(ylabel="largest similarity error [deg]", yscale="log")
        ticks = np.arange(np.ceil(np.log10(error.min())), np.floor(np.log10(error.max())) + 1)
        bar.set_ticks(ticks.tolist(), labels=[f"{10**tick:g}" for tick in ticks])
        left.yaxis.set_major_formatter("{x:g}")
    markers = zip("*DsP", (style.ACCENT, style.ANTAGONIST, style.AGONIST, style.INK), strict=True)
    for (name, one), (marker, color) in zip(marked.items(), markers, strict=False):
        look: Any = {"marker": marker, "s": 120, "color": color, "edgecolors": "white", "linewidths": 1.0, "zorder": 5}
        height = one.tension_margin if alike else max(one.similarity_error, _LEAST_ERROR)
        left.scatter(1e3 * one.force_resolution, height, label=name, **look)
        right.scatter(1e3 * one.overall_length, one.tension_margin, label=name, **look)
    if marked:
        left.legend(loc="best", frameon=True, framealpha=0.9)
    return fig
