"""The figures of a study: distributions, tornado chart, Sobol indices."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from tenodesis.report import style
from tenodesis.report.content import Plot
from tenodesis.tolerance.results import Response, Study

_BINS = 48
_MOST_BARS = 12
_LOW, _HIGH = style.ANTAGONIST, style.AGONIST
NAMES = ("distributions", "tornado", "sobol")
"""Names of the figures that a study may have."""
_SHOWN = {
    "loss_flexion": ("output loss, in flexion", "output loss [deg]"),
    "similarity_rms": ("similarity error, rms", "similarity error [deg]"),
    "loop_width": ("mean width of the loop", "loop width [deg]"),
}
_HISTOGRAMS = {
    "output loss [deg]": {"loss_flexion": "approached in flexion", "loss_extension": "approached in extension"},
    "similarity error [deg]": {"similarity_rms": "rms over the cycle", "similarity_largest": "largest"},
}
"""Label of the axis, and responses with their names."""
_LABEL = "largest similarity error [deg]"
_TIP = "distance at the real-size tip [mm]"


def plots(study: Study) -> list[Plot]:
    """Return the figures of a study."""
    pages = [_distributions(study), _tornado(study)]
    if any(study.responses[key].indices for key in _shown(study)):
        pages.append(_sobol(study))
    return pages


def _shown(study: Study) -> dict[str, tuple[str, str]]:
    """Return title and label by the responses that have panels."""
    if not study.joints:
        return _SHOWN
    own = {f"similarity_largest.{joint}": (f"similarity error of {joint}", _LABEL) for joint in study.joints}
    return own | {"tip_largest": ("at the real-size tip", "largest distance [mm]")}


def _histograms_of(study: Study) -> dict[str, dict[str, str]]:
    if not study.joints:
        return _HISTOGRAMS
    return {
        _LABEL: {f"similarity_largest.{joint}": joint for joint in study.joints},
        _TIP: {"tip_largest": "largest", "tip_rms": "rms"},
    }


def _conditions(study: Study) -> str:
    scaled_force = study.force * study.force_factor
    return f"{study.force:.3g} N on {study.real_size.name}, {scaled_force:.3g} N on {study.scaled_up.name}"


def _distributions(study: Study) -> Plot:
    fig, axes = style.figure(2, width=10.0, height=4.3)
    panels = _histograms_of(study)
    for axis, (label, names) in zip(axes, panels.items(), strict=True):
        _histograms(axis, [study.responses[key] for key in names], list(names.values()))
        axis.set_xlabel(label)
    axes[0].set_ylabel("share of samples [%]")
    marks: list[tuple[str, dict[str, Any]]] = [
        ("5 % and 95 % quantile", {"ls": ":"}),
        ("median", {"ls": "-"}),
        ("nominal", {"ls": "", "marker": "^", "ms": 7}),
    ]
    handles = [Line2D([], [], color=style.INK, lw=1.2, label=name, **look) for name, look in marks]
    fig.legend(handles=handles, loc="outside lower center", ncols=len(marks))
    shown = [study.responses[key] for names in panels.values() for key in names]
    curves = {f"{one.key} [{one.unit}]": one.samples for one in shown}
    what = "Similarity error over the loops of all joints"
    if not study.joints:
        what = f"Output loss at {np.degrees(study.end):.3g}° of handle and similarity error over the cycle"
    return Plot("distributions", f"{what}, {_conditions(study)}: {2 * study.samples} samples.", fig, curves)


def _histograms(axis: Axes, responses: Sequence[Response], names: Sequence[str]) -> None:
    everything = np.concatenate([one.samples for one in responses])
    # Longer tails would compress the rest.
    low, high = np.quantile(everything, [0.0005, 0.9995])
    low = min(low, *(one.nominal for one in responses))
    high = max(high, *(one.nominal for one in responses))
    edges = np.linspace(low, high, _BINS + 1) if high > low else np.linspace(low - 0.5, high + 0.5, _BINS + 1)
    colors = (_HIGH, _LOW) if len(responses) == 2 else style.colors(len(responses))
    for one, name, color in zip(responses, names, colors, strict=True):
        weights = np.full(one.samples.size, 100 / one.samples.size)
        axis.hist(one.samples, edges.tolist(), weights=weights, color=color, alpha=0.45, label=name)
        for share, line in ((0.05, ":"), (0.5, "-"), (0.95, ":")):
            axis.axvline(one.quantile(share), color=color, ls=line, lw=1.2)
        axis.plot([one.nominal], [0], "^", color=color, ms=8, clip_on=False, zorder=5, mec="white", mew=0.8)
    style.legend_above(axis, len(responses))


def _panels(study: Study) -> tuple[Figure, list[tuple[Axes, Response, list[int]]]]:
    """Return a panel for each response that is shown, and its parameters by falling influence."""
    responses = [study.responses[key] for key in _shown(study)]
    bars = min(_MOST_BARS, len(study.parameters))
    fig, axes = style.figure(len(responses), width=4.4 * len(responses), height=1.5 + 0.34 * bars)
    panels = [(axis, one, list(one.order[:bars])) for axis, one in zip(axes, responses, strict=True)]
    for axis, one, order in panels:
        axis.set_title(_shown(study)[one.key][0])
        if not order:
            axis.text(0.5, 0.5, "does not vary", transform=axis.transAxes, ha="center", color=style.MUTED)
        axis.set_yticks(range(len(order)), [study.parameters[n].label for n in order], color=style.INK)
        axis.set_ylim(bars - 0.4, -0.6)
        axis.grid(axis="y", visible=False)
    return fig, panels


def _tornado(study: Study) -> Plot:
    fig, panels = _panels(study)
    curves = {}
    for axis, one, order in panels:
        for side, color, label in ((0, _LOW, "at its 5 % quantile"), (1, _HIGH, "at its 95 % quantile")):
            change = one.at_quantiles[order, side] - one.nominal
            axis.barh(range(len(order)), change, left=one.nominal, height=0.66, color=color, label=label)
            curves[f"{one.key} {label} [{one.unit}]"] = one.at_quantiles[:, side]
        if order:
            axis.axvline(one.nominal, color=style.INK, lw=1.2)
            axis.margins(x=0.08)
        else:
            axis.set_xticks([])
        axis.set_xlabel(_shown(study)[one.key][1])
    handles, names = panels[0][0].get_legend_handles_labels()
    fig.legend(handles, names, loc="outside upper left", ncols=2)
    return Plot(
        "tornado",
        "Tornado chart: each parameter from its 5 % to its 95 % quantile, the others at the median; the line is the "
        f"nominal value, {_conditions(study)}.",
        fig,
        curves,
    )


def _sobol(study: Study) -> Plot:
    fig, panels = _panels(study)
    curves = {}
    for axis, one, order in panels:
        if one.indices is None:
            continue
        found = one.indices
        kinds = (
            (-0.19, found.first, found.first_half_width, _LOW, "first index"),
            (0.19, found.total, found.total_half_width, _HIGH, "total index"),
        )
        for shift, values, half_widths, color, label in kinds:
            axis.barh(
                np.arange(len(order)) + shift,
                values[order],
                xerr=half_widths[order],
                height=0.36,
                color=color,
                label=label,
                error_kw={"ecolor": style.INK, "elinewidth": 1.0, "capsize": 2},
            )
            curves[f"{one.key} {label} [1]"] = values
        axis.axvline(0, color=style.INK, lw=1.0)
        axis.set_xlabel("share of the variance [1]")
    handles, names = next(axis for axis, one, _ in panels if one.indices).get_legend_handles_labels()
    fig.legend(handles, names, loc="outside upper left", ncols=2)
    return Plot(
        "sobol",
        "Sobol indices with their 95 % confidence intervals: first, the share of the variance that would vanish "
        "if a parameter alone were known; total, the share that remains if it alone is unknown.",
        fig,
        curves,
    )
