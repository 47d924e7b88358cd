"""One run of the bench: compute every section, then write all files or none."""

import csv
import json
import math
import platform
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tenodesis import instrument as instruments
from tenodesis import statics
from tenodesis.errors import ReportError
from tenodesis.files import atomic_files
from tenodesis.instrument import Instrument
from tenodesis.paper import (
    campaign,
    checks,
    compensated,
    compensated_cycles,
    compensation,
    designing,
    hysteresis,
    input_output,
    loss,
    report,
    scaling,
    step_load,
    tension,
    transmissibility,
    working_space,
)
from tenodesis.paper.context import Context
from tenodesis.recording.simulation import record
from tenodesis.report import style
from tenodesis.report.content import Plot, Section

RESULTS_SCHEMA = 1
"""Version of the layout of results.json."""

_DRAWINGS = ("svg", "png")


def steps(inst: Instrument, scaled: Instrument | None) -> int:
    """Return how often a run reports progress."""
    return 14 + checks.mujoco_cases(inst, scaled)


def run(
    inst: Instrument,
    scaled: Instrument | None = None,
    out: Path = Path("out"),
    progress: Callable[[str], None] = lambda _: None,
    recordings: bool = True,
    *,
    seeds: int = campaign.SEEDS,
) -> Context:
    """Compute the bench for an instrument and write report, figures, curves and results.

    Parameters
    ----------
    inst
        The instrument.
    scaled
        Its scale model, of the same joint type; without one the report leaves similarity out.
    out
        Folder for report.html, results.json, figures/, curves/ and recordings/; made if absent.
    progress
        Called with the name of what is being worked on.
    recordings
        Whether the twin's experiments are recorded as well.
    seeds
        Noise seeds of the robust law's campaign; 0 leaves it out.

    Returns
    -------
    Context
        The results by name.

    Raises
    ------
    ReportError
        The folder cannot be written.
    """
    context = Context(_within_reach(inst), scaled, _is_paper(inst, scaled))
    # A folder that cannot be written is said before a minute of work, not after it.
    with _written(out), atomic_files(out):
        pass
    with style.applied():
        return _run(context, out, progress, recordings, seeds)


@contextmanager
def _written(out: Path) -> Iterator[None]:
    """Say of what fails within that a folder cannot be written."""
    try:
        yield
    except OSError as problem:
        raise ReportError(f"{out} cannot be written: {problem.strerror or problem}.") from problem


def _within_reach(inst: Instrument) -> Instrument:
    """Return an instrument whose working range ends where the handle's range does, if it ends before."""
    reached = statics.output_angle(inst, np.array([inst.handle_range]))[0]
    return inst.replace(output_range=reached) if reached < inst.output_range else inst


def _run(context: Context, out: Path, progress: Callable[[str], None], recordings: bool, seeds: int) -> Context:
    sections: list[Section] = []
    for name, section in (
        ("input and output", input_output.section),
        ("tension", tension.section),
        ("transmissibility", transmissibility.section),
        ("loss", loss.section),
        ("compensation", compensation.section),
        ("workspace", working_space.section),
        ("scale model", scaling.section),
        ("scale-model design", designing.section),
        ("flexion and extension", hysteresis.section),
        ("step load", step_load.section),
        ("compensated step load", compensated.section),
        ("compensated cycles", compensated_cycles.section),
        ("campaign", partial(campaign.section, seeds=seeds)),
    ):
        progress(name)
        sections.append(section(context))
    sections.append(checks.section(context, lambda: progress("MuJoCo")))
    progress("writing")
    if not recordings:
        context.recordings.clear()
    with _written(out):
        _write(context, sections, out)
    return context


def about() -> dict[str, str]:
    """Return the versions a report was made with."""
    from tenodesis import __version__  # noqa: PLC0415

    return {"tenodesis": __version__, "python": platform.python_version(), "numpy": np.__version__}


def _is_paper(inst: Instrument, scaled: Instrument | None) -> bool:
    return inst == instruments.load("real-size") and scaled == instruments.load("scaled-up")


def _write(context: Context, sections: list[Section], out: Path) -> None:
    """Write everything beside its place first, and move it there when all of it is written."""
    with atomic_files(out, last="report.html") as new:
        for folder in ("figures", "curves", "recordings"):
            (new / folder).mkdir()
        drawings: dict[str, str] = {}
        for plot in (plot for section in sections for plot in section.plots):
            drawings[plot.name] = _draw(plot, new / "figures")
            _write_curves(plot, new / "curves" / f"{plot.name}.csv")
        for file_name, session in context.recordings.items():
            record(session.inst, session.protocol, new / "recordings" / f"{file_name}.mcap", seed=session.seed)
        (new / "results.json").write_text(json.dumps(_results(context), indent=1, ensure_ascii=False) + "\n", "utf-8")
        (new / "report.html").write_text(report.render(context, sections, drawings, about()), "utf-8")


def _draw(plot: Plot, folder: Path) -> str:
    """Write a figure as SVG and PNG and return the SVG."""
    for kind in _DRAWINGS:
        metadata: dict[str, Any] = {"Date": None} if kind == "svg" else {}
        plot.figure.savefig(folder / f"{plot.name}.{kind}", dpi=200, metadata=metadata)
        # Where things are on the page has been found for all kinds, and takes as long as drawing them.
        plot.figure.set_layout_engine("none")
    return (folder / f"{plot.name}.svg").read_text("utf-8")


def _write_curves(plot: Plot, path: Path) -> None:
    columns = {heading: np.atleast_1d(np.asarray(values, float)) for heading, values in plot.curves.items()}
    length = max(column.size for column in columns.values())
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        for i in range(length):
            writer.writerow(
                "" if i >= column.size or math.isnan(column[i]) else f"{column[i]:.9g}" for column in columns.values()
            )


def _results(context: Context) -> dict[str, Any]:
    entries = {}
    for key, result in sorted(context.results.items()):
        entry: dict[str, Any] = {
            "value": result.value if math.isfinite(result.value) else None,
            "unit": result.unit,
            "description": result.description,
        }
        if result.published is not None:
            entry |= {
                "published": result.published.value,
                "residual": result.residual,
                "source": result.published.source,
            }
        entries[key] = entry
    return {
        "schema": RESULTS_SCHEMA,
        "about": about(),
        "instrument": context.inst.name,
        "scaled_up": None if context.scaled is None else context.scaled.name,
        "results": entries,
    }
