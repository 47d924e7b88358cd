"""The command that computes a report on an instrument, of the paper's every figure and table: ``tenodesis bench``."""

import re
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from tenodesis.cli.command import command
from tenodesis.cli.common import (
    AxisToCompute,
    InstrumentFile,
    ProgressBar,
    check_choice,
    console,
    load_instrument,
    say,
    say_resolution,
    table,
)
from tenodesis.cli.outputs import Outputs, written_by_us
from tenodesis.errors import CommandError, InstrumentError
from tenodesis.instrument import Instrument, as_short_form, expanded
from tenodesis.paper.context import Context
from tenodesis.paper.run import CHAPTERS, run, steps
from tenodesis.similarity.joints import compare_joints

_BRIEF = (
    r"loss\.at_\d+deg\.|tension\.slack_load|transmissibility\.straight|table1\.stiffness|table2\.(force|tension)|"
    r"similarity\..*\.(rms|largest)$|care\.[167]|verification\.\w+\.\w+$|axes|tip_force\.\w+\.after\.error|"
    r"loss\.largest|slack\.least|stiffness\.softest|hysteresis\.widest|compensated\.robust\.worst"
)
"""Names of the results that the summary shows; the report has all."""


@command("instrument_file", "scaled_up")
def bench(  # noqa: PLR0917
    outputs: Outputs,
    instrument_file: InstrumentFile = "real-size",
    scaled_up: Annotated[
        str | None, typer.Option(help="Its scale model: file or name. Default: scaled-up, for real-size.")
    ] = None,
    axis: AxisToCompute = None,
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="CHAPTERS", help=f"These chapters alone, with commas between: {', '.join(CHAPTERS)}."),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for report, figures, curves and results.")] = Path("out"),
) -> None:
    """Compute a report on an instrument, every figure of the paper for its own, and write out/report.html."""
    chapters = [name.strip() for names in only or () for name in names.split(",")]
    for name in chapters:
        check_choice("--only", name, CHAPTERS)
    inst = load_instrument(instrument_file)
    if scaled_up is None and instrument_file == "real-size":
        scaled_up = "scaled-up"
    inst, scaled = _studied(inst, scaled_up, axis)
    done, total = 0, steps(inst, scaled, chapters)
    # A report of some chapters must not take the place of one that has more.
    own = written_by_us(out / "results.json", "results", chapters=chapters)
    with (
        outputs.folder(out, ("report.html", "results.json"), ("figures", "curves", "recordings"), replace=own),
        ProgressBar("") as bar,
    ):

        def report(name: str) -> None:
            nonlocal done
            done += 1
            bar(done, total, f"{name:<21}")

        context = run(inst, scaled, out, report, only=chapters)
    summary = _summary(context)
    if summary.row_count:
        console.print(summary)
    if context.controlled is not None:
        say_resolution(context.controlled)
    say(f"Report: {out / 'report.html'}")
    say("with figures/, curves/, recordings/ and results.json beside it")


def _studied(inst: Instrument, scaled_up: str | None, axis: str | None) -> tuple[Instrument, Instrument | None]:
    """Return instrument and scale model: of one axis, or all joints unless the scale model has one axis alone."""
    scaled = None if scaled_up is None else load_instrument(scaled_up)
    if inst.short_form is None and axis is not None:
        raise CommandError(
            f"--axis is given, but {inst.name} lists joints and tendons; it must be left out.",
            key="--axis",
            value=axis,
            allowed="left out",
        )
    all_joints = axis is None and Context.of(inst, scaled).is_own and (scaled is None or len(scaled.bends) > 1)
    if inst.short_form is None or (all_joints and len(inst.bends) > 1):
        if scaled is not None:
            compare_joints(inst, scaled)
        return expanded(inst), scaled
    if scaled is not None and as_short_form(scaled, "--scaled-up").joint_type != inst.joint_type:
        raise InstrumentError(
            f"{scaled.name} has joint_type {scaled.joint_type}, {inst.name} {inst.joint_type}; a scale model must "
            "be of the same joint type.",
            key="joint_type",
            value=scaled.joint_type,
            allowed=inst.joint_type,
        )
    return (inst.axis(axis or inst.axes[0]) if axis is not None or inst.overrides else inst), scaled


def _summary(context: Context) -> Table:
    """Return the most important results, beside those that the paper prints."""
    beside = any(result.published for result in context.results.values())
    columns = (">computed", ">published", ">residual") if beside else (">computed",)
    summary = table(f"{context.given.name}: summary, by name in results.json", "result", *columns)
    for key, result in context.results.items():
        if not re.match(_BRIEF, key):
            continue
        unit = {"1": "", "deg": "°"}.get(result.unit, f" {result.unit}")
        cells = [f"{result.value:.5g}{unit}"]
        if beside:
            cells.append("" if result.published is None else f"{result.published.value:g}{unit}")
            cells.append("" if result.residual is None else f"{result.residual:+.2g}{unit}")
        summary.add_row(key, *cells)
    return summary
