"""The report of a study: a self-contained HTML page, figures, samples and all results."""

import math
from pathlib import Path
from typing import Any

from markupsafe import Markup

from tenodesis.errors import StudyError
from tenodesis.report import style
from tenodesis.report.content import Plot, fixed
from tenodesis.report.page import DRAWINGS, about, json_text, render, write_columns, write_figure, written
from tenodesis.tolerance import figures
from tenodesis.tolerance.results import QUANTILES, Response, Study

RESULTS_SCHEMA = 1
"""Version of the layout of tolerance.json."""

PAGE, NUMBERS, SAMPLES_FILE = "tolerance.html", "tolerance.json", "samples.csv"
"""What a study is written as, beside its figures."""


def write(study: Study, out: Path) -> None:
    """Write tolerance.html, tolerance.json, samples.csv and figures/ into a folder, atomically.

    Raises StudyError if the folder cannot be written.
    """
    with style.applied(), written(out, StudyError, last=PAGE) as new:
        (new / "figures").mkdir()
        drawings = [(plot, write_figure(plot, new / "figures")) for plot in figures.plots(study)]
        _write_samples(study, new / SAMPLES_FILE)
        (new / NUMBERS).write_text(json_text(_results(study)), "utf-8")
        (new / PAGE).write_text(_rendered(study, drawings), "utf-8")
        for name in set(figures.NAMES) - {plot.name for plot, _ in drawings}:
            for kind in DRAWINGS:
                (out / f"figures/{name}.{kind}").unlink(missing_ok=True)


def _write_samples(study: Study, path: Path) -> None:
    """Write every row of the scheme: its parameters in SI units, its responses in deg, its status."""
    headings = [f"{one.instrument} {one.key} [{one.unit}]" for one in study.parameters]
    columns = dict(zip(headings, study.matrix.T, strict=True))
    columns |= {f"{key} [{one.unit}]": one.scheme for key, one in study.responses.items()}
    write_columns(columns | {"status": study.status}, path, digits=12)


def _results(study: Study) -> dict[str, Any]:
    names = [f"{one.instrument}.{one.key}" for one in study.parameters]

    def by_name(values: Any) -> dict[str, Any]:
        return dict(zip(names, values, strict=True))

    responses = {}
    for key, one in study.responses.items():
        found = one.indices
        responses[key] = {
            "description": one.description,
            "unit": one.unit,
            "varies": one.varies,
            "nominal": one.nominal,
            "mean": one.mean,
            "std": one.std,
            "quantiles": {f"{share:g}": one.quantile(share) for share in QUANTILES},
            "tornado": by_name(one.at_quantiles),
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
        "parameters": by_name(one._asdict() for one in study.parameters),
        "samples": study.samples,
        "runs": study.runs,
        "seed": study.seed,
        "force": study.force,
        "force_factor": study.force_factor,
        "handle_angle": None if study.joints else math.degrees(study.end),
        "failed": study.failed,
        "incomplete": study.incomplete,
        "indices_valid": study.indices_valid,
        "statements": list(study.statements),
        "responses": responses,
    }


def _rendered(study: Study, plots: list[tuple[Plot, Markup]]) -> str:
    cards = _joint_cards(study) if study.joints else _cards(study)
    return render(
        "tenodesis.tolerance",
        "tolerance.html.j2",
        study=study,
        key_figures=cards,
        quantiles=QUANTILES,
        ranked=next((one.order for one in study.responses.values() if one.indices), ()),
        end="" if study.joints else fixed(math.degrees(study.end), 1),
        plots=plots,
    )


def _cards(study: Study) -> list[tuple[str, str]]:
    loss, similarity = study.responses["loss_flexion"], study.responses["similarity_rms"]
    low, high = (fixed(loss.quantile(share), 1) for share in (0.05, 0.95))
    return [
        ("output loss in flexion, 5 to 95 %", f"{low} … {high}°"),
        ("similarity error (rms), 95 % stay below", f"{fixed(similarity.quantile(0.95))}°"),
        ("dominates the loss", _dominating(study, loss)),
        ("dominates the similarity error", _dominating(study, similarity)),
    ]


def _joint_cards(study: Study) -> list[tuple[str, str]]:
    own = [(joint, study.responses[f"similarity_largest.{joint}"].quantile(0.95)) for joint in study.joints]
    tip = study.responses["tip_largest"]
    return [
        *((f"largest similarity error of {joint}, 95 % stay below", f"{fixed(value)}°") for joint, value in own),
        ("largest distance at the real-size tip, 95 % stay below", f"{fixed(tip.quantile(0.95))} mm"),
        ("dominates at the tip", _dominating(study, tip)),
    ]


def _dominating(study: Study, response: Response) -> str:
    return study.parameters[response.order[0]].label if response.order else "nothing: it does not vary"
