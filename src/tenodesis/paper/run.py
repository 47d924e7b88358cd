"""A run of the report: compute every section, then write all files or none."""

import sys
from collections.abc import Callable, Collection, Sequence
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from tenodesis.errors import ArgumentError, ReportError
from tenodesis.instrument import Instrument
from tenodesis.paper import report
from tenodesis.paper.context import SEEDS, Context
from tenodesis.paper.needs import (
    TESTS,
    Need,
    friction,
    gears,
    law,
    listed,
    matrices,
    papers,
    peers,
    planar,
    scale_model,
)
from tenodesis.report import style
from tenodesis.report.content import Section
from tenodesis.report.page import about, json_text, write_columns, write_figure, written

RESULTS_SCHEMA = 1
"""Version of the layout of results.json."""


class Chapter(NamedTuple):
    """A chapter of the report; its module is imported when it is computed."""

    module: str
    """Module of this package that computes it, or one of the tests' `peers`"""
    needs: tuple[Need, ...] = ()
    """What an instrument must have"""
    concerns: tuple[Need, ...] = ()
    """What one's own must have besides, unless the chapter is named"""
    otherwise: "Chapter | None" = None
    """What takes its place where the instrument lacks something"""

    def section(self, context: Context) -> Section:
        """Compute the chapter."""
        computed: Section = self.imported().section(context)
        return computed

    def imported(self) -> ModuleType:
        """Return the module."""
        if not self.module.startswith("peers."):
            return import_module(f"tenodesis.paper.{self.module}")
        if str(TESTS) not in sys.path:
            sys.path.append(str(TESTS))
        return import_module(self.module)

    def fitting(self, context: Context, *, is_named: bool) -> "tuple[Chapter | None, str]":
        """Return the chapter, or what takes its place; None, and in a sentence what is missing, if nothing fits."""
        needs = self.needs if is_named or not context.is_own else self.needs + self.concerns
        missing = next(filter(None, (need(context) for need in needs)), "")
        if not missing:
            return self, ""
        return (None, missing) if self.otherwise is None else self.otherwise.fitting(context, is_named=is_named)


CHAPTERS = {
    "posture": Chapter("posture", (listed,)),
    "input-output": Chapter("input_output"),
    "slack": Chapter("slack"),
    "transmissibility": Chapter("transmissibility"),
    "loss": Chapter("loss"),
    "stiffness": Chapter("stiffness", (matrices,)),
    "compensation": Chapter("compensation_laws", (planar,)),
    "workspace": Chapter("workspace"),
    "similarity": Chapter(
        "tables_1_2_scale_model", (planar,), (scale_model,), Chapter("joints_scale_model", (scale_model, listed))
    ),
    "design": Chapter("scale_model_design", (planar,), (papers,)),
    "cycles": Chapter("cycles"),
    "step-load": Chapter("step_load"),
    "compensated-step-load": Chapter("compensated_step", (law,)),
    "compensated-cycles": Chapter("compensated_cycles", (law,)),
    "campaign": Chapter("campaign", (planar,)),
    "unlike-model": Chapter("unlike_model", (planar,), (friction,)),
    "tip-force": Chapter("tip_force", (planar,), (friction,)),
    "checks": Chapter("peers.checks", (peers, planar), (gears,), Chapter("peers.chain_checks", (peers, listed))),
}
"""The chapters of the report in order, by name."""


def chosen(context: Context, only: Collection[str] = ()) -> dict[str, Chapter]:
    """Return the chapters of a report: those that are named, or all that concern the instrument.

    Raises
    ------
    ArgumentError
        There is no chapter of a name, or the instrument lacks what it needs.
    """
    unknown = next((name for name in only if name not in CHAPTERS), None)
    if unknown is not None:
        raise ArgumentError(key="only", value=unknown, allowed=f"one of {', '.join(CHAPTERS)}")
    found: dict[str, Chapter] = {}
    for name, chapter in CHAPTERS.items():
        fits, missing = chapter.fitting(context, is_named=name in only)
        if name in only and fits is None:
            raise ArgumentError(
                f"only names {name}, which {context.given.name} does not have: {missing}", key="only", value=name
            )
        if fits is not None and (not only or name in only):
            found[name] = fits
    return found


def left_out(context: Context) -> dict[str, str]:
    """Return the chapters that a report on all that concerns the instrument lacks, each with the reason."""
    reasons = {name: chapter.fitting(context, is_named=False)[1] for name, chapter in CHAPTERS.items()}
    return {name: reason for name, reason in reasons.items() if reason}


def steps(inst: Instrument, scaled: Instrument | None, only: Collection[str] = ()) -> int:
    """Return how often a run reports progress."""
    context = Context.of(inst, scaled)
    chapters = chosen(context, only)
    checks = CHAPTERS["checks"]
    cases = checks.imported().mujoco_cases(context.inst, scaled) if chapters.get("checks") is checks else 0
    return len(chapters) + 1 + cases


def run(
    inst: Instrument,
    scaled: Instrument | None = None,
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
        Its scale model, of the same joint type, or the same joints and tendons; without it the report leaves similarity
        out.
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
        There is no chapter of a name in `only`, or the instrument lacks what it needs.
    ReportError
        The folder cannot be written.
    """
    context = Context.of(inst, scaled, seeds=seeds, progress=progress)
    chapters = chosen(context, only)
    context.chapters = frozenset(chapters)
    context.left_out = left_out(context) if context.is_own and not only else {}
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
        entries[key] = {"value": result.value, "unit": result.unit, "description": result.description}
        if result.published is not None:
            entries[key] |= {
                "published": result.published.value,
                "residual": result.residual,
                "source": result.published.source,
            }
    return {
        "schema": RESULTS_SCHEMA,
        "about": about(),
        "instrument": context.given.name,
        "scaled_up": None if context.scaled is None else context.scaled.name,
        "chapters": [name for name in CHAPTERS if name in context.chapters],
        "results": entries,
    }
