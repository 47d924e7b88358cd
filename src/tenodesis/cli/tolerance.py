"""The command about tolerances: what manufacturing and identification leave open."""

import time
from pathlib import Path
from typing import Annotated

import typer
from pydantic import TypeAdapter, ValidationError
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from tenodesis import instrument, tolerance
from tenodesis.cli.common import PatientBar
from tenodesis.errors import CommandError
from tenodesis.report.content import fixed
from tenodesis.tolerance.conduct import SAMPLES
from tenodesis.tolerance.report import write
from tenodesis.tolerance.results import QUANTILES
from tenodesis.units import PositiveForce

console = Console()

_NAMED = 3
"""How many of the dominating parameters the table names."""


def register(app: typer.Typer) -> None:
    """Add the command to an app."""
    app.command("tolerance")(study_tolerances)


def study_tolerances(  # noqa: PLR0917
    real_size: Annotated[str, typer.Argument(metavar="REAL", help="Real-size instrument: file or shipped name.")],
    scaled_up: Annotated[str, typer.Argument(metavar="SCALED", help="Scaled-up instrument: file or shipped name.")],
    tolerances: Annotated[
        Path | None,
        typer.Option(help="Tolerance file. Default: ISO 2768-1 and what an identification leaves.", show_default=False),
    ] = None,
    samples: Annotated[
        int, typer.Option(help="Base samples N, rounded up to a power of two; N (parameters + 2) runs.")
    ] = SAMPLES,
    seed: Annotated[int, typer.Option(help="Seed of the samples.")] = 0,
    force: Annotated[
        str | None,
        typer.Option(help="Force on the real-size instrument. Default: the largest test force.", show_default=False),
    ] = None,
    out: Annotated[
        Path,
        typer.Option(help="Folder for page, figures, samples and numbers; those of an earlier study are replaced."),
    ] = Path("out/tolerance"),
    engine: Annotated[str, typer.Option(help="threads or ray.")] = "threads",
    address: Annotated[
        str | None, typer.Option(help="Of the Ray cluster: host:port of its head, or auto.", show_default=False)
    ] = None,
) -> None:
    """Study what tolerances do to a scale model's loss of angle and similarity, and which of them dominate."""
    model, prototype = instrument.load(real_size), instrument.load(scaled_up)
    given = None if tolerances is None else tolerance.load(tolerances)
    newton = None if force is None else _force(force)
    begun = time.monotonic()
    with PatientBar(console, "samples") as bar:
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
        console.print(statement, highlight=False, markup=False)
    console.print(f"{study.runs} runs in {took:.3g} s, {study.runs / took:.0f} a second.", highlight=False)
    console.print(
        f"Page: [bold]{escape(str(out / 'tolerance.html'))}[/bold]  (figures/, samples.csv and tolerance.json)"
    )


def _force(text: str) -> float:
    try:
        return TypeAdapter(PositiveForce).validate_python(text, context={"file": True})
    except ValidationError as invalid:
        told = invalid.errors(include_url=False)[0]["msg"].removeprefix("Value error, ")
        raise CommandError(f"--force = {text!r}: {told}.") from None


def _distributions(study: tolerance.Study) -> Table:
    names = f"{escape(study.scaled_up.name)} for {escape(study.real_size.name)}"
    title = f"{names}, {study.force:.3g} N at real size: quantiles in deg"
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD)
    table.add_column("response", overflow="fold")
    for heading in ("nominal", "mean", "std", *(f"{100 * share:g} %" for share in QUANTILES)):
        table.add_column(heading, justify="right", no_wrap=True)
    for one in study.responses.values():
        numbers = (one.nominal, one.mean, one.std, *(one.quantile(share) for share in QUANTILES))
        table.add_row(one.description, *(fixed(number) for number in numbers))
    return table


def _dominating(study: tolerance.Study) -> Table:
    table = Table(title="what dominates: total Sobol index", title_justify="left", box=box.SIMPLE_HEAD)
    table.add_column("response", overflow="fold")
    table.add_column("parameters", overflow="fold")
    for one in study.responses.values():
        named = [
            study.parameters[n].label + ("" if one.indices is None else f" {fixed(one.indices.total[n])}")
            for n in one.order[:_NAMED]
        ]
        table.add_row(one.description, escape(", ".join(named)) if one.varies else "does not vary")
    return table
