"""The front as a picture: what every objective costs in the others."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from tenodesis.report import style
from tenodesis.scaling.design import Front, Objectives

_MOST_DOTS = 20_000
_LEAST_ERROR = 1e-3  # deg; what is less is drawn there


def draw(front: Front, marked: Mapping[str, Objectives]) -> Figure:
    """Return the front as a figure, with some designs marked by name; use within ``style.applied()``."""
    costs = front.sweep.costs
    if len(costs) > _MOST_DOTS:
        costs = costs[:: -(-len(costs) // _MOST_DOTS)]
    error = np.maximum(costs[:, 0], _LEAST_ERROR)
    resolution, length, margin = 1e3 * costs[:, 1], 1e3 * costs[:, 2], 1 / costs[:, 3]
    fig, (left, right) = style.figure(2, width=9.0, height=4.0)
    dots: Any = {"s": 7, "linewidths": 0, "rasterized": True}
    by_length = left.scatter(resolution, error, c=length, cmap="viridis", **dots)
    by_error = right.scatter(length, margin, c=np.log10(error), cmap="magma_r", **dots)
    left.set(
        xlabel="force resolution on the real instrument [mN]",
        ylabel="largest similarity error [deg]",
        yscale="log",
        title="Similarity against resolution",
    )
    right.set(xlabel="overall length [mm]", ylabel="breaking load / largest tension", title="Size against margin")
    fig.colorbar(by_length, ax=left, label="overall length [mm]")
    bar = fig.colorbar(by_error, ax=right, label="largest similarity error [deg]")
    ticks = np.arange(np.ceil(np.log10(error.min())), np.floor(np.log10(error.max())) + 1)
    bar.set_ticks(ticks.tolist(), labels=[f"{10**tick:g}" for tick in ticks])
    left.yaxis.set_major_formatter("{x:g}")
    markers = zip("*DsP", (style.ACCENT, style.ANTAGONIST, style.AGONIST, style.INK), strict=True)
    for (name, one), (marker, color) in zip(marked.items(), markers, strict=False):
        look: Any = {"marker": marker, "s": 120, "color": color, "edgecolors": "white", "linewidths": 1.0, "zorder": 5}
        left.scatter(1e3 * one.force_resolution, max(one.similarity_error, _LEAST_ERROR), label=name, **look)
        right.scatter(1e3 * one.overall_length, one.tension_margin, label=name, **look)
    if marked:
        left.legend(loc="best", frameon=True, framealpha=0.9)
    return fig
