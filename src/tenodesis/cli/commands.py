"""The command line."""

import json
import re
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from tenodesis import instrument, scaling, tolerance
from tenodesis.cli import console as console_command
from tenodesis.cli import (
    devices,
    export_controller,
    export_model,
    foxglove,
    identify,
    plan_identification,
    recording,
    scale,
    transfer,
)
from tenodesis.cli import tolerance as tolerance_command
from tenodesis.errors import CommandError, Error, InstrumentError
from tenodesis.instrument import Instrument
from tenodesis.paper import run as bench_run
from tenodesis.paper.context import Context
from tenodesis.paper.run import steps

app = typer.Typer(
    help="Model, scale, test and control tendon-driven hand-held surgical instruments. Research software, not a "
    "medical device.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
console = Console()
errors = Console(stderr=True, highlight=False, soft_wrap=True)


@app.callback()
def _root() -> None:
    """Keep commands by name even while there are few."""


@app.command()
def bench(
    instrument_file: Annotated[
        str,
        typer.Argument(metavar="INSTRUMENT", help="Instrument file, or the name of one that is shipped."),
    ] = "real-size",
    scaled_up: Annotated[
        str | None,
        typer.Option(help="Its scale model: file or name. Default: scaled-up, for real-size."),
    ] = None,
    axis: Annotated[
        str | None,
        typer.Option(help="Axis to compute, where yaw and pitch have values of their own. Default: the first."),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for report, figures, curves and results.")] = Path("out"),
) -> None:
    """Compute every figure and table of the paper for an instrument and write out/report.html."""
    inst = instrument.load(instrument_file)
    if scaled_up is None and instrument_file == "real-size":
        scaled_up = "scaled-up"
    scaled = None if scaled_up is None else instrument.load(scaled_up)
    if scaled is not None and scaled.joint_type != inst.joint_type:
        raise InstrumentError(
            f"{scaled.name} has joint_type {scaled.joint_type}, {inst.name} {inst.joint_type}; "
            "allowed is a scale model of the same joint type."
        )
    if axis is not None or inst.overrides:
        inst = inst.axis(axis or inst.axes[0])
    with Progress(
        TextColumn("{task.description:<16}"),
        BarColumn(),
        TimeElapsedColumn(),
        console=console,
        transient=True,
    ) as bar:
        task = bar.add_task("", total=steps(inst, scaled))
        context = bench_run(inst, scaled, out, lambda name: bar.update(task, advance=1, description=name))
    console.print(_summary(context))
    console.print(
        f"Report: [bold]{out / 'report.html'}[/bold]  (figures/, curves/, recordings/ and results.json beside it)"
    )


@app.command()
def schema(
    of: Annotated[
        str, typer.Argument(metavar="KIND", help="Kind of file: instrument, catalogue or tolerances.")
    ] = "instrument",
) -> None:
    """Print the JSON schema of a kind of file, for editors that complete and check TOML."""
    schemas = {
        "instrument": instrument.json_schema,
        "catalogue": scaling.json_schema,
        "tolerances": tolerance.json_schema,
    }
    if of not in schemas:
        raise CommandError(f"KIND is {of!r}; allowed are {', '.join(schemas)}.")
    typer.echo(json.dumps(schemas[of](), indent=2, ensure_ascii=False))


@app.command()
def check(
    instrument_file: Annotated[str, typer.Argument(metavar="INSTRUMENT", help="Instrument file or shipped name.")],
) -> None:
    """Check an instrument file and print what it comes to, in SI units."""
    inst: Instrument = instrument.load(instrument_file)
    table = Table("key", "value", "source", title=f"{escape(inst.name)}: {inst.joint_type}, {' and '.join(inst.axes)}")
    for key, value, quantity in inst.quantities():
        table.add_row(key, f"{value:.6g} {quantity.unit}", escape(inst.sources.get(key, "")))
    for axis, own in inst.overrides.items():
        for key, value, quantity in inst.axis(axis).quantities():
            if key in own:
                table.add_row(f"{axis}: {key}", f"{value:.6g} {quantity.unit}", "")
    console.print(table)


recording.register(app)
scale.register(app)
transfer.register(app)
tolerance_command.register(app)
identify.register(app)
plan_identification.register(app)
console_command.register(app)
devices.register(app)
foxglove.register(app)
export_controller.register(recording.exports)
export_model.register(recording.exports)


def main() -> None:
    """Run the command line; what a user can mend ends in one sentence and exit code 1."""
    try:
        app()
    except Error as problem:
        errors.print(f"tenodesis: {problem}", markup=False, style="red")
        sys.exit(1)


_BRIEF = (
    r"loss\.at_\d+deg\.|tension\.slack_force|transmissibility\.straight|table1\.stiffness|table2\.(force|tension)|"
    r"similarity\..*\.(rms|largest)$|care\.[167]|verification\.\w+\.\w+$|axes"
)
"""What the summary shows, by a result's name; the report has all."""


def _summary(context: Context) -> Table:
    """Return the report's numbers in brief, beside those that the paper prints."""
    title = f"{escape(context.inst.name)}: summary, by name in results.json"
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD)
    table.add_column("result", overflow="fold")
    for heading in ("computed", "published", "residual"):
        table.add_column(heading, justify="right", no_wrap=True)
    for key, result in context.results.items():
        if not re.match(_BRIEF, key):
            continue
        unit = {"1": "", "deg": "°"}.get(result.unit, f" {result.unit}")
        published = "" if result.published is None else f"{result.published.value:g}{unit}"
        residual = "" if result.residual is None else f"{result.residual:+.2g}{unit}"
        table.add_row(key, f"{result.value:.5g}{unit}", published, residual)
    return table
