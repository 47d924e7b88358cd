"""The command about tolerances: what manufacturing and identification leave open."""

import time
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.markup import escape
from rich.table import Table

from tenodesis import tolerance
from tenodesis.cli.command import command
from tenodesis.cli.common import ProgressBar, console, load_instrument, quantity, say, table
from tenodesis.cli.outputs import Outputs, written_by_us
from tenodesis.extras import require
from tenodesis.report.content import fixed
from tenodesis.tolerance.conduct import JOINT_SAMPLES, SAMPLES
from tenodesis.tolerance.report import NUMBERS, PAGE, SAMPLES_FILE, write
from tenodesis.tolerance.results import QUANTILES
from tenodesis.units import PositiveForce

_NAMED = 3
"""How many of the dominating parameters the table names."""


@command("real_size", "scaled_up", "tolerances")
def study_tolerances(  # noqa: PLR0917
    outputs: Outputs,
    real_size: Annotated[str, typer.Argument(metavar="REAL", help="Real-size instrument: file or shipped name.")],
    scaled_up: Annotated[str, typer.Argument(metavar="SCALED", help="Scaled-up instrument: file or shipped name.")],
    tolerances: Annotated[
        Path | None, typer.Option(help="Tolerance file. Default: ISO 2768-1 and errors of identification.")
    ] = None,
    samples: Annotated[
        int | None,
        typer.Option(
            help=f"Base samples N, rounded up to a power of two; N (parameters + 2) runs. Default: {SAMPLES}, of "
            f"several joints {JOINT_SAMPLES}."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the samples.")] = 0,
    force: Annotated[
        str | None,
        typer.Option(
            help="Force on the real-size instrument. Default: the largest test force, of several joints the usual."
        ),
    ] = None,
    out: Annotated[
        Path,
        typer.Option(help="Folder for page, figures, samples and results; those of an earlier study are replaced."),
    ] = Path("out/tolerance"),
    engine: Annotated[Literal["threads", "ray"], typer.Option(help="Engine that runs the samples.")] = "threads",
    joints: Annotated[
        bool, typer.Option("--joints", help="Of two planar axes each, study both at once instead of the first.")
    ] = False,
    address: Annotated[
        str | None, typer.Option(help="Of the Ray cluster: host:port of its head, auto, or local.")
    ] = None,
) -> None:
    """Study what tolerances do to a scale model's loss of angle and similarity, and which of them dominate.

    Of several joints, each has its own figures, and the tip has millimetres.
    """
    require("SALib", "design")
    model, prototype = load_instrument(real_size), load_instrument(scaled_up)
    if joints:
        model, prototype = model.expanded, prototype.expanded
    given = None if tolerances is None else tolerance.load(tolerances)
    newton = None if force is None else quantity("--force", force, PositiveForce)
    begun = time.monotonic()
    own = written_by_us(out / NUMBERS, "responses")
    with outputs.folder(out, (PAGE, NUMBERS, SAMPLES_FILE), ("figures",), replace=own), ProgressBar("samples") as bar:
        study = tolerance.study(
            model,
            prototype,
            given,
            samples=samples,
            seed=seed,
            force=newton,
            engine=engine,
            address=address,
            progress=bar,
        )
        took = time.monotonic() - begun
        write(study, out)
    console.print(_distributions(study))
    console.print(_dominating(study))
    for statement in study.statements:
        say(statement)
    console.print(f"{study.runs} runs in {took:.3g} s, {study.runs / took:.0f} a second.", highlight=False)
    console.print(
        f"Page: [bold]{escape(str(out / 'tolerance.html'))}[/bold]  (figures/, samples.csv and tolerance.json)"
    )


def _distributions(study: tolerance.Study) -> Table:
    names = f"{study.scaled_up.name} for {study.real_size.name}"
    title = f"{names}, {study.force:.3g} N at real size: quantiles"
    quantiles = table(title, "response", ">nominal", ">mean", ">std", *(f">{100 * share:g} %" for share in QUANTILES))
    for one in study.responses.values():
        values = (one.nominal, one.mean, one.std, *(one.quantile(share) for share in QUANTILES))
        quantiles.add_row(f"{one.description} ({one.unit})", *(fixed(value) for value in values))
    return quantiles


def _dominating(study: tolerance.Study) -> Table:
    indices = table("what dominates: total Sobol index", "response", "parameters")
    for one in study.responses.values():
        named = [
            study.parameters[n].label + ("" if one.indices is None else f" {fixed(one.indices.total[n])}")
            for n in one.order[:_NAMED]
        ]
        indices.add_row(one.description, escape(", ".join(named)) if one.varies else "does not vary")
    return indices
