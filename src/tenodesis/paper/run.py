"""A run of the report: compute every section, then write all files or none."""

from collections.abc import Callable, Collection, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from tenodesis.errors import ArgumentError, ReportError
from tenodesis.instrument import ShortForm, TendonGear
from tenodesis.paper import report
from tenodesis.paper.context import SEEDS, Context
from tenodesis.report import style
from tenodesis.report.content import Section
from tenodesis.report.page import about, json_number, json_text, write_columns, write_figure, written

RESULTS_SCHEMA = 1
"""Version of the layout of results.json."""


class Chapter(NamedTuple):
    """A chapter of the report; its module is imported when it is computed."""

    module: str
    """Module of this package that computes it"""
    concerns: Callable[[Context], bool] = lambda _: True
    """Whether an instrument of one's own has this chapter"""

    def section(self, context: Context) -> Section:
        """Compute the chapter."""
        computed: Section = import_module(f"tenodesis.paper.{self.module}").section(context)
        return computed


CHAPTERS = {
    "input-output": Chapter("fig7_input_output"),
    "slack": Chapter("fig8_tension"),
    "transmissibility": Chapter("fig9_transmissibility"),
    "loss": Chapter("fig11_loss"),
    "compensation": Chapter("compensation_laws"),
    "workspace": Chapter("workspace"),
    "similarity": Chapter("tables_1_2_scale_model", lambda context: context.scaled is not None),
    "design": Chapter("scale_model_design", lambda _: False),
    "cycles": Chapter("fig14_cycles"),
    "step-load": Chapter("fig15_step_load"),
    "compensated-step-load": Chapter("fig15_compensated"),
    "compensated-cycles": Chapter("fig14_compensated"),
    "campaign": Chapter("campaign"),
    "unlike-model": Chapter("unlike_model", lambda context: context.inst.friction.law != "none"),
    "tip-force": Chapter("tip_force", lambda context: context.inst.friction.law != "none"),
    "checks": Chapter("checks", lambda context: isinstance(context.inst, TendonGear)),
}
"""The chapters of the report in order, by name."""


def chosen(context: Context, only: Collection[str] = ()) -> dict[str, Chapter]:
    """Return the chapters of a report: those that are named, or all that concern the instrument.

    Raises
    ------
    ArgumentError
        There is no chapter of a name.
    """
    unknown = next((name for name in only if name not in CHAPTERS), None)
    if unknown is not None:
        raise ArgumentError(key="only", value=unknown, allowed=f"one of {', '.join(CHAPTERS)}")
    if only:
        return {name: chapter for name, chapter in CHAPTERS.items() if name in only}
    return {name: one for name, one in CHAPTERS.items() if not context.is_own or one.concerns(context)}


def steps(inst: ShortForm, scaled: ShortForm | None, only: Collection[str] = ()) -> int:
    """Return how often a run reports progress."""
    chapters = chosen(Context.of(inst, scaled), only)
    return len(chapters) + 1 + (_mujoco_cases(inst, scaled) if "checks" in chapters else 0)


def _mujoco_cases(inst: ShortForm, scaled: ShortForm | None) -> int:
    from tenodesis.paper import checks  # noqa: PLC0415 - SciPy takes long to import

    return checks.mujoco_cases(inst, scaled)


def run(
    inst: ShortForm,
    scaled: ShortForm | None = None,
    out: Path = Path("out"),
    progress: Callable[[str], None] = lambda _: None,
    recordings: bool = True,
    *,
    seeds: int = SEEDS,
    only: Collection[str] = (),
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
    only
        Names of chapters; by default all that concern the instrument.

    Raises
    ------
    ArgumentError
        There is no chapter of a name in `only`.
    ReportError
        The folder cannot be written.
    """
    context = Context.of(inst, scaled, seeds=seeds, progress=progress)
    chapters = chosen(context, only)
    context.chapters = frozenset(chapters)
    # A folder that cannot be written is reported before a minute of work, not after it.
    with written(out, ReportError):
        pass
    with style.applied():
        sections = []
        for name, chapter in chapters.items():
            progress(name)
            sections.append(chapter.section(context))
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
        if context.recordings:
            from tenodesis.recording.simulation import write_run  # noqa: PLC0415 - a report without runs does without
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
        "chapters": [name for name in CHAPTERS if name in context.chapters],
        "results": entries,
    }
