"""A fit as files: a self-contained HTML page, all values, and the identified instrument."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tenodesis.errors import IdentificationError
from tenodesis.identification import figures
from tenodesis.identification.goodness import unexplained
from tenodesis.identification.problem import Parameter, Problem
from tenodesis.identification.results import LIBRARIES, Fit, by_unit, to_json
from tenodesis.instrument.text import to_file
from tenodesis.report import page, style

PAGE, NUMBERS, INSTRUMENT = "report.html", "result.json", "instrument.toml"
"""What a fit is written as."""

as_text = page.json_text
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
            for name, (figure, caption) in figures.all_figures(problem, found, runs).items()
        ]
    return page.render(
        "tenodesis.identification",
        _TEMPLATE,
        found=found,
        numbers=numbers,
        key_figures=cards(found),
        rows=[(one.name.replace("_", " "), one.meaning, shown(found, one)) for one in found.parameters],
        keys=list(dict.fromkeys(key for one in found.files for key in one.rmse)),
        axis_label=figures.axis_label,
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


class Shown(NamedTuple):
    """A parameter as people read it, all in its unit."""

    value: str
    unit: str
    std: str
    interval: str
    bootstrap: str
    identifiable: str
    """yes, no or held, and the bound that the value is on."""


def shown(found: Fit, one: Parameter) -> Shown:
    """Return a parameter as people read it."""
    factor, unit = figures.readable(one.unit)
    std = found.std.get(one.name, math.nan) * factor
    digits = _digits(found.values[one.name] * factor, std)

    def number(value: float) -> str:
        return f"{value * factor:.{digits}f}" if digits is not None else f"{value * factor:.5g}"

    def interval(pair: tuple[float, float] | None) -> str:
        return "" if pair is None else f"{number(pair[0])} … {number(pair[1])}"

    spread = "" if one.name not in found.free else f"{std:.2g}" if math.isfinite(std) else "open"
    side = found.identifiability.at_bound.get(one.name)
    identifiable = {None: "held", True: "yes", False: "no"}[found.identifiability.identifiable.get(one.name)]
    return Shown(
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
