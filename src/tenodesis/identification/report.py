"""A fit as files: a self-contained HTML page with its figures, all values, and the identified instrument."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tenodesis.errors import IdentificationError
from tenodesis.identification.problem import Parameter, Problem
from tenodesis.identification.results import LIBRARIES, Fit, by_unit, to_json, unexplained
from tenodesis.instrument.text import to_file
from tenodesis.report import page, style
from tenodesis.report.content import unit_text
from tenodesis.units import in_unit

_READABLE = {"rad": "deg", "m": "mm", "s": "ms"}
_IN_A_ROW = 4
"""Entries of a legend."""
_MOST_NAMED = 8
"""Series that a legend names."""
_MOST_WRITTEN = 12
"""Parameters up to which correlations are written out."""


def readable(unit: str) -> tuple[float, str]:
    """Return the factor from an SI unit to the unit shown, and that unit's name."""
    shown = _READABLE.get(unit, unit)
    name = "" if shown in {"", "1"} else unit_text(shown)
    return (in_unit(shown, unit) if shown != unit else 1.0), name


def axis_label(key: str) -> str:
    """Return the label of an axis from a key with its unit last: output angle [deg]."""
    name, _, unit = key.rpartition("_")
    return f"{name.replace('_', ' ')} [{unit}]"


def run_figure(problem: Problem, found: Fit, run: int) -> Figure:
    """Return measured and modelled signals of a run over time, and the residuals of each."""
    values = found.vector
    errors = problem.errors(values, run)
    traces = problem.traces(values, run)
    panels = [(key, kind) for key in errors for kind in (("signal", "error") if key in traces else ("error",))]
    heights = [2.0 if kind == "signal" else 1.0 for _, kind in panels]
    fig = Figure(figsize=(8.6, 0.5 + 1.25 * sum(heights)), layout="constrained")
    axes = fig.subplots(len(panels), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    for axis, (key, kind) in zip(axes, panels, strict=True):
        error = errors[key]
        if kind == "signal":
            trace = traces[key]
            axis.plot(trace.time, trace.measured, color=style.INK, lw=1.4, label="measured", rasterized=True)
            axis.plot(trace.time, trace.model, color=style.ACCENT, lw=1.1, label="model", rasterized=True)
            axis.set_ylabel(axis_label(key))
            style.legend_above(axis, 2)
        else:
            signal, _, unit = key.rpartition("_")
            # an error may be of several signals, one after the other: of all tendons
            parts = (f"{signal}_", f"{signal}.")
            names = [name for name in traces if name == key or (name.startswith(parts) and name.endswith(unit))]
            sizes = [traces[name].time.size for name in names]
            if names and sum(sizes) == error.size:
                colours = [style.MUTED] if len(names) == 1 else style.colors(len(names) + 1)[1:]
                for name, part, colour in zip(names, np.split(error, np.cumsum(sizes)[:-1]), colours, strict=True):
                    label = name[len(signal) + 1 :].removesuffix(f"_{unit}").replace("_", " ")
                    axis.plot(traces[name].time, part, color=colour, lw=0.8, label=label, rasterized=True)
                if len(names) > 1:
                    style.legend_above(axis, min(len(names), _IN_A_ROW))
            else:
                time = np.arange(error.size) * problem.sample_time(run)
                axis.plot(time, error, color=style.MUTED, lw=0.8, rasterized=True)
            axis.axhline(0, color=style.INK, lw=0.8)
            axis.set_ylabel(f"residual [{unit}]" if key in traces else f"residual of\n{axis_label(key)}")
    axes[-1].set_xlabel("time [s]")
    fig.align_ylabels()
    return fig


def autocorrelation(found: Fit) -> Figure:
    """Return the autocorrelation of each series of residuals over the lag."""
    fig, (axis,) = style.figure(1, width=8.6, height=3.6)
    several = any(one.channel for one in found.whiteness)
    for colour, one in zip(style.colors(len(found.whiteness)), found.whiteness, strict=True):
        label = f"{one.run}, {one.sensor}" if several else one.run
        lags = np.arange(one.autocorrelation.size) * one.sample_time
        axis.plot(lags, one.autocorrelation, color=colour, lw=1.3, label=label)
    band = 1.96 / np.sqrt(min(one.samples for one in found.whiteness))
    axis.axhspan(-band, band, color=style.GRID, zorder=0.5, label="white noise, 95 %")
    axis.axhline(0, color=style.INK, lw=0.8)
    axis.set(xlabel="lag [s]", ylabel="autocorrelation")
    axis.margins(x=0)
    if len(found.whiteness) <= _MOST_NAMED:
        axis.legend(loc="upper right", ncols=1 if len(found.whiteness) < 4 else 2)
    return fig


def intervals(found: Fit) -> Figure:
    """Return each fitted parameter with its intervals, on an axis of its own."""
    parameters = [one for one in found.parameters if one.name in found.free]
    fig = Figure(figsize=(8.6, 0.6 + 0.78 * len(parameters)), layout="constrained")
    axes = fig.subplots(len(parameters), 1, squeeze=False)[:, 0]
    for axis, one in zip(axes, parameters, strict=True):
        _interval(axis, one, found)
    handles, labels = axes[0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside upper right", ncols=4)
    return fig


def _interval(axis: Axes, one: Parameter, found: Fit) -> None:
    factor, unit = readable(one.unit)
    value = found.values[one.name] * factor
    half = 1.96 * found.std_white[one.name]
    white = (max(one.lower, found.values[one.name] - half), min(one.upper, found.values[one.name] + half))
    rows = [("as if white", white, style.REFERENCE), ("corrected", found.interval_95[one.name], style.ANTAGONIST)]
    if found.bootstrap_interval_95:
        rows.append(("block bootstrap", found.bootstrap_interval_95[one.name], style.LOADS[0]))
    for height, (label, bounds, colour) in enumerate(rows):
        low, high = (bound * factor for bound in bounds)
        axis.plot([low, high], [height, height], color=colour, lw=4, solid_capstyle="butt", label=label)
    face = style.INK if found.identifiability.identifiable[one.name] else "white"
    axis.plot([value] * len(rows), range(len(rows)), "o", ms=5, mfc=face, mec=style.INK, ls="none", label="value")
    axis.set_ylim(-0.7, len(rows) - 0.3)
    axis.set_yticks([])
    axis.grid(axis="y", visible=False)
    axis.margins(x=0.08)
    axis.ticklabel_format(axis="x", useOffset=False, style="plain") if 1e-3 < abs(value) < 1e6 else None
    axis.locator_params(axis="x", nbins=6)
    axis.tick_params(axis="x", labelsize=8)
    name = one.name.replace("_", " ")
    axis.set_ylabel(f"{name} [{unit}]" if unit else name, rotation=0, ha="right", va="center")


def correlations(found: Fit) -> Figure:
    """Return the correlation matrix of the fitted parameters as a map of colours."""
    count = len(found.free)
    longest = max(len(name) for name in found.free)
    side, labels = 0.52 * count + 0.9, 0.08 * longest
    fig, (axis,) = style.figure(1, width=side + labels + 0.9, height=side + 0.7 * labels)
    image = axis.imshow(found.correlation, cmap="RdBu_r", vmin=-1, vmax=1)
    names = [name.replace("_", " ") for name in found.free]
    axis.set_xticks(range(count), names, rotation=45, ha="right", rotation_mode="anchor")
    axis.set_yticks(range(count), names)
    axis.grid(visible=False)
    if count <= _MOST_WRITTEN:
        for row, column in np.ndindex(count, count):
            shade = found.correlation[row, column]
            colour = "white" if abs(shade) > 0.6 else style.INK
            axis.text(column, row, f"{shade:.2f}", ha="center", va="center", fontsize=8, color=colour)
    fig.colorbar(image, ax=axis, shrink=0.8, label="correlation")
    return fig


def all_figures(problem: Problem, found: Fit, runs: Sequence[int]) -> dict[str, tuple[Figure, str]]:
    """Return every figure with its caption, by name; runs are the indices behind the fit's files."""
    out: dict[str, tuple[Figure, str]] = {
        "intervals": (
            intervals(found),
            "Parameters with their 95 % intervals, each on its own axis; hollow where not identifiable.",
        )
    }
    if len(found.free) > 1:
        out["correlation"] = (correlations(found), "Correlation of the estimates.")
    out["autocorrelation"] = (
        autocorrelation(found),
        "Autocorrelation of the whitened residuals of the training runs.",
    )
    for place, (run, one) in enumerate(zip(runs, found.files, strict=True)):
        kind = "fitted" if one.split == "train" else "held out"
        out[f"run-{place}"] = (
            run_figure(problem, found, run),
            f"{one.name}, {kind}: residual is measured minus model.",
        )
    return out


PAGE, NUMBERS, INSTRUMENT = "report.html", "result.json", "instrument.toml"
"""What a fit is written as."""

_POOR = "From a poor fit: do not rely on these values."
_TEMPLATE = "identification.html.j2"
_DOTS = 150
"""Per inch, of the curves over time."""
_DOTS_PER_INCH = 96
"""On a screen, by which no figure is shown larger than it was drawn."""


def write(
    problem: Problem,
    found: Fit,
    out: Path,
    *,
    runs: Sequence[int],
    format: str,
    law: str,
    notes: Mapping[str, Sequence[str]] | None = None,
    arrangements: Sequence[Mapping[str, Any]] = (),
) -> list[Path]:
    """Write report.html, result.json and, if there is an instrument, instrument.toml into a folder, atomically.

    `runs` are the indices of the runs, train then test, as they were fitted; `notes` are the loader's on each
    recording, by its name; `arrangements` are those that were compared. Returns the paths of what was written. Raises
    IdentificationError if the folder cannot be written.
    """
    numbers = to_json(found, format=format, law=law, notes=notes, arrangements=arrangements)
    texts = {NUMBERS: page.json_text(numbers), PAGE: render(problem, found, runs=runs, numbers=numbers)}
    inst = problem.instrument(found.vector)
    if inst is not None:
        fitted = ", ".join(found.free)
        logs = ", ".join(one.name for one in found.files if one.split == "train")
        poor = unexplained(problem, found.vector, found.files)
        comment = "\n".join([f"Identified from {logs}: {fitted}.", *([_POOR, *poor] if poor else [])])
        texts = {INSTRUMENT: to_file(inst, comment=comment), **texts}
    return write_files(out, texts, last=PAGE)


def write_files(out: Path, texts: Mapping[str, str], *, last: str) -> list[Path]:
    """Write text files by name into a folder, all or none, and return their paths.

    Raises IdentificationError if the folder cannot be written.
    """
    with page.written(out, IdentificationError, last=last) as new:
        for name, text in texts.items():
            (new / name).write_text(text, "utf-8")
    return [out / name for name in texts]


def render(problem: Problem, found: Fit, *, runs: Sequence[int], numbers: Mapping[str, Any]) -> str:
    """Return the page."""
    with style.applied():
        drawn = [
            (
                name,
                page.inline_svg(name, figure, dots_per_inch=_DOTS),
                caption,
                round(_DOTS_PER_INCH * figure.get_figwidth()),
            )
            for name, (figure, caption) in all_figures(problem, found, runs).items()
        ]
    return page.render(
        "tenodesis.identification",
        _TEMPLATE,
        found=found,
        numbers=numbers,
        key_figures=cards(found),
        rows=[(one.name.replace("_", " "), one.meaning, shown(found, one)) for one in found.parameters],
        keys=list(dict.fromkeys(key for one in found.files for key in one.rmse)),
        axis_label=axis_label,
        unit_of=lambda key: key.rpartition("_")[2],
        notes=grouped(numbers["notes"]),
        files=list(zip(numbers["files"], found.files, strict=True)),
        drawn=[one for one in drawn if not one[0].startswith("run-")],
        drawn_runs=[one for one in drawn if one[0].startswith("run-")],
        short=_short,
        about=page.about(*LIBRARIES),
    )


def cards(found: Fit) -> list[tuple[str, str]]:
    """Return the key figures for the top of the report, with their descriptions."""
    errors = [
        (f"rmse, {name}", f"{_short(value)} {unit}".replace(" deg", "°"))
        for name, rmse in (("runs fitted", found.train_rmse), ("runs held out", found.test_rmse))
        for unit, value in by_unit(rmse).items()
    ]
    known = sum(found.identifiability.identifiable.values())
    return [
        *errors,
        ("parameters identifiable", f"{known} of {len(found.free)}"),
        ("starts that reached this optimum", f"{found.same_optimum} of {found.starts}"),
        ("model evaluations", f"{found.evaluations}"),
    ]


class ReadableParameter(NamedTuple):
    """A parameter as people read it, all in its unit."""

    value: str
    unit: str
    std: str
    interval: str
    bootstrap: str
    identifiable: str
    """yes, no or held, and the bound that the value is on."""


def shown(found: Fit, one: Parameter) -> ReadableParameter:
    """Return a parameter as people read it."""
    factor, unit = readable(one.unit)
    std = found.std.get(one.name, math.nan) * factor
    digits = _digits(found.values[one.name] * factor, std)

    def number(value: float) -> str:
        return f"{value * factor:.{digits}f}" if digits is not None else f"{value * factor:.5g}"

    def interval(pair: tuple[float, float] | None) -> str:
        return "" if pair is None else f"{number(pair[0])} … {number(pair[1])}"

    spread = "" if one.name not in found.free else f"{std:.2g}" if math.isfinite(std) else "open"
    side = found.identifiability.at_bound.get(one.name)
    identifiable = {None: "held", True: "yes", False: "no"}[found.identifiability.identifiable.get(one.name)]
    return ReadableParameter(
        number(found.values[one.name]),
        unit,
        spread,
        interval(found.interval_95.get(one.name)),
        interval((found.bootstrap_interval_95 or {}).get(one.name)),
        f"{identifiable}, {side} bound" if side else identifiable,
    )


def grouped(notes: Mapping[str, Sequence[str]]) -> list[tuple[str, str]]:
    """Return notes as recordings and sentence, once where that of several recordings differs in their names only."""
    found: dict[str, list[tuple[str, str]]] = {}
    for name, sentences in notes.items():
        file = name.rpartition("/")[2]
        for sentence in sentences:
            found.setdefault(sentence.replace(file, "…").rstrip("."), []).append((name, sentence.rstrip(".")))
    return [
        (", ".join(name for name, _ in notes_), common if len(notes_) > 1 else notes_[0][1])
        for common, notes_ in found.items()
    ]


def _digits(value: float, std: float) -> int | None:
    """Return the decimals that show two digits of the standard deviation, or None where there is no such number."""
    if not (math.isfinite(std) and std > 0) or abs(value) >= 1e7 or std < 1e-7:
        return None
    return int(np.clip(1 - math.floor(math.log10(std)), 0, 8))


def _short(value: float) -> str:
    return f"{value:#.3g}" if 1e-4 <= abs(value) < 1000 else f"{value:.3g}"
