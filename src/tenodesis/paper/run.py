"""A run of the report: compute every section, then write all files or none."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from tenodesis.errors import ReportError
from tenodesis.instrument import Instrument
from tenodesis.paper import (
    campaign,
    checks,
    compensation_laws,
    fig7_input_output,
    fig8_tension,
    fig9_transmissibility,
    fig11_loss,
    fig14_compensated,
    fig14_cycles,
    fig15_compensated,
    fig15_step_load,
    report,
    scale_model_design,
    tables_1_2_scale_model,
    unlike_model,
    workspace,
)
from tenodesis.paper.context import SEEDS, Context
from tenodesis.recording.simulation import write_run
from tenodesis.report import style
from tenodesis.report.content import Section
from tenodesis.report.page import about, json_number, json_text, write_columns, write_figure, written

RESULTS_SCHEMA = 1
"""Version of the layout of results.json."""

SECTIONS: tuple[tuple[str, Callable[[Context], Section]], ...] = (
    ("input and output", fig7_input_output.section),
    ("tension", fig8_tension.section),
    ("transmissibility", fig9_transmissibility.section),
    ("loss", fig11_loss.section),
    ("compensation", compensation_laws.section),
    ("workspace", workspace.section),
    ("scale model", tables_1_2_scale_model.section),
    ("scale-model design", scale_model_design.section),
    ("flexion and extension", fig14_cycles.section),
    ("step load", fig15_step_load.section),
    ("compensated step load", fig15_compensated.section),
    ("compensated cycles", fig14_compensated.section),
    ("campaign", campaign.section),
    ("instruments unlike the model", unlike_model.section),
    ("checks", checks.section),
)
"""The sections of the report in order, each with its name in the progress bar."""


def steps(inst: Instrument, scaled: Instrument | None) -> int:
    """Return how often a run reports progress."""
    return len(SECTIONS) + 1 + checks.mujoco_cases(inst, scaled)


def run(
    inst: Instrument,
    scaled: Instrument | None = None,
    out: Path = Path("out"),
    progress: Callable[[str], None] = lambda _: None,
    recordings: bool = True,
    *,
    seeds: int = SEEDS,
) -> Context:
    """Compute the report for an instrument, write it with its figures and curves, and return it with its results.

    Parameters
    ----------
    scaled
        Its scale model, of the same joint type; without it the report leaves similarity out.
    out
        Folder for report.html, results.json, figures/, curves/ and recordings/; made if absent.
    progress
        Called with the name of what is being computed.
    recordings
        Whether the twin's experiments are recorded as well.
    seeds
        Noise seeds of the robust law's campaign; 0 leaves it out.

    Raises
    ------
    ReportError
        The folder cannot be written.
    """
    context = Context.of(inst, scaled, seeds=seeds, progress=progress)
    # A folder that cannot be written is reported before a minute of work, not after it.
    with written(out, ReportError):
        pass
    with style.applied():
        sections = []
        for name, section in SECTIONS:
            progress(name)
            sections.append(section(context))
        progress("writing")
        if not recordings:
            context.recordings.clear()
        write(context, sections, out)
    return context


def write(context: Context, sections: Sequence[Section], out: Path) -> None:
    """Write the report on sections into a folder, all files or none.

    Raises ReportError if the folder cannot be written.
    """
    with written(out, ReportError, last="report.html") as new:
        for folder in ("figures", "curves", "recordings"):
            (new / folder).mkdir()
        drawings = {}
        for plot in (plot for section in sections for plot in section.plots):
            drawings[plot.name] = write_figure(plot, new / "figures")
            write_columns(plot.curves, new / "curves" / f"{plot.name}.csv")
        for name, done in context.recordings.items():
            path = new / "recordings" / f"{name}.mcap"
            write_run(done.run, done.inst, path, protocol=done.protocol, seed=done.seed)
        (new / "results.json").write_text(json_text(_results(context)), "utf-8")
        (new / "report.html").write_text(report.render(context, sections, drawings), "utf-8")


def _results(context: Context) -> dict[str, Any]:
    entries = {}
    for key, result in sorted(context.results.items()):
        entries[key] = {"value": json_number(result.value), "unit": result.unit, "description": result.description}
        if result.published is not None:
            entries[key] |= {
                "published": result.published.value,
                "residual": json_number(result.value - result.published.value),
                "source": result.published.source,
            }
    return {
        "schema": RESULTS_SCHEMA,
        "about": about(),
        "instrument": context.inst.name,
        "scaled_up": None if context.scaled is None else context.scaled.name,
        "results": entries,
    }
