"""The study as files: one HTML page that needs nothing beside it, figures, samples and all numbers."""

import csv
import json
import math
import platform
from importlib import resources
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup

from tenodesis.errors import StudyError
from tenodesis.files import atomic_files
from tenodesis.report import style
from tenodesis.report.content import Plot, fixed
from tenodesis.tolerance import figures
from tenodesis.tolerance.results import QUANTILES, Response, Study

RESULTS_SCHEMA = 1
"""Version of the layout of tolerance.json."""

_TEMPLATE = "tolerance.html.j2"
_DRAWINGS = ("svg", "png")
_PAGE = "tolerance.html"


def write(study: Study, out: Path) -> None:
    """Write tolerance.html, tolerance.json, samples.csv and figures/ into a folder, or nothing.

    Raises
    ------
    StudyError
        The folder cannot be written.
    """
    try:
        with style.applied():
            _write(study, out)
    except OSError as problem:
        raise StudyError(f"{out} cannot be written: {problem.strerror or problem}.") from problem


def _write(study: Study, out: Path) -> None:
    """Write everything beside its place first, and move it there when all of it is written."""
    with atomic_files(out, last=_PAGE) as new:
        (new / "figures").mkdir()
        plots = figures.plots(study)
        drawings = {plot.name: _draw(plot, new / "figures") for plot in plots}
        _write_samples(study, new / "samples.csv")
        (new / "tolerance.json").write_text(
            json.dumps(_numbers(study), indent=1, ensure_ascii=False, allow_nan=False) + "\n", "utf-8"
        )
        (new / _PAGE).write_text(_rendered(study, plots, drawings), "utf-8")
    for name in set(figures.NAMES) - drawings.keys():
        for kind in _DRAWINGS:
            (out / f"figures/{name}.{kind}").unlink(missing_ok=True)


def _draw(plot: Plot, folder: Path) -> str:
    """Write a figure as SVG and PNG and return the SVG, fit to stand within HTML."""
    for kind in _DRAWINGS:
        metadata: dict[str, Any] = {"Date": None} if kind == "svg" else {}
        plot.figure.savefig(folder / f"{plot.name}.{kind}", dpi=200, metadata=metadata)
    return style.inlined(plot.name, (folder / f"{plot.name}.svg").read_text("utf-8"))


def _write_samples(study: Study, path: Path) -> None:
    """Write every row of the scheme: its parameters in SI, its responses in deg, its status."""
    headings = [f"{one.instrument} {one.key} [{one.unit}]" for one in study.parameters]
    columns = [*study.matrix.T, *(one.scheme for one in study.responses.values())]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([*headings, *(f"{key} [deg]" for key in study.responses), "status"])
        for row, status in zip(np.column_stack(columns), study.status, strict=True):
            writer.writerow([*("" if math.isnan(value) else f"{value:.12g}" for value in row), int(status)])


def about() -> dict[str, str]:
    """Return the versions a study was made with."""
    from tenodesis import __version__  # noqa: PLC0415

    return {"tenodesis": __version__, "python": platform.python_version(), "numpy": np.__version__}


def _numbers(study: Study) -> dict[str, Any]:
    names = [f"{one.instrument}.{one.key}" for one in study.parameters]

    def by_name(values: Any) -> dict[str, Any]:
        return {name: _number(value) for name, value in zip(names, values, strict=True)}

    responses = {}
    for key, one in study.responses.items():
        found = one.indices
        responses[key] = {
            "description": one.description,
            "unit": "deg",
            "varies": one.varies,
            "nominal": _number(one.nominal),
            "mean": _number(one.mean),
            "std": _number(one.std),
            "quantiles": {f"{share:g}": _number(one.quantile(share)) for share in QUANTILES},
            "tornado": {name: [_number(value) for value in pair] for name, pair in zip(names, one.swings, strict=True)},
            "sobol": found
            and {
                "first": by_name(found.first),
                "first_half_width": by_name(found.first_half_width),
                "total": by_name(found.total),
                "total_half_width": by_name(found.total_half_width),
                "converged": found.converged,
            },
        }
    return {
        "schema": RESULTS_SCHEMA,
        "about": about(),
        "model": study.real_size.name,
        "prototype": study.scaled_up.name,
        "tolerances": study.tolerances.model_dump(exclude_none=True),
        "parameters": {
            name: one._asdict() | {"lower": _number(one.lower), "upper": _number(one.upper)}
            for name, one in zip(names, study.parameters, strict=True)
        },
        "samples": study.samples,
        "runs": study.runs,
        "seed": study.seed,
        "force": study.force,
        "force_factor": study.force_factor,
        "handle_angle": math.degrees(study.end),
        "failed": study.failed,
        "incomplete": study.incomplete,
        "indices_valid": study.indices_valid,
        "statements": list(study.statements),
        "responses": responses,
    }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _rendered(study: Study, plots: list[Plot], drawings: dict[str, str]) -> str:
    text = (resources.files("tenodesis.tolerance") / _TEMPLATE).read_text("utf-8")
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    loss, similarity = study.responses["loss_flexion"], study.responses["similarity_rms"]
    cards = [
        ("output loss in flexion, 5 to 95 %", f"{_range(loss.quantile(0.05), loss.quantile(0.95))}"),
        ("similarity error (rms), 95 % stay below", f"{fixed(similarity.quantile(0.95))}°"),
        ("dominates the loss", _first(study, loss)),
        ("dominates the similarity error", _first(study, similarity)),
    ]
    return environment.from_string(text).render(
        study=study,
        cards=cards,
        quantiles=QUANTILES,
        ranked=next((one.order for one in study.responses.values() if one.indices), ()),
        end=fixed(math.degrees(study.end), 1),
        plots=[(plot, Markup(drawings[plot.name])) for plot in plots],
        fixed=fixed,
        about=about(),
    )


def _first(study: Study, response: Response) -> str:
    return study.parameters[response.order[0]].label if response.order else "nothing: it does not vary"


def _range(low: float, high: float) -> str:
    return f"{fixed(low, 1)} … {fixed(high, 1)}°"
