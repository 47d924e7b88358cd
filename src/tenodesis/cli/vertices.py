"""The command about rounder vertices: ``tenodesis vertices``."""

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from tenodesis.cli.common import InstrumentFile, ProgressBar, console, load_instrument, quantity, say, table
from tenodesis.cli.outputs import Overwrite, writing, written_by_us
from tenodesis.paper import rounder_vertices
from tenodesis.paper.rounder_vertices_report import NUMBERS, PAGE, SWEEP, tables, write
from tenodesis.units import PositiveForce


def study_vertices(
    instrument_file: InstrumentFile = "scaled-up",
    force: Annotated[
        str | None,
        typer.Option(
            help="Load at the tip. Default: that of the load rig, or the second of the conditions.", show_default=False
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for page, figure, sweep and results.")] = Path("out/vertices"),
    overwrite: Overwrite = False,
) -> None:
    """Study rounder vertices: radius, coefficient and rope against loss, hysteresis and final errors."""
    inst = load_instrument(instrument_file, planar=True).planar[0]
    newton = None if force is None else quantity("--force", force, PositiveForce)
    outputs = [("--out", out / name) for name in (PAGE, NUMBERS, SWEEP)]
    replace = overwrite or written_by_us(out / NUMBERS, "designs")
    with (
        writing(outputs, [instrument_file], overwrite=replace, folder=out, subfolders=("figures",)),
        ProgressBar("designs") as bar,
    ):
        found = rounder_vertices.study(inst, newton, progress=bar)
        write(found, out)
    for one in tables(found):
        shown = table(escape(one.caption), padding=(0, 1, 0, 0))
        for n, heading in enumerate(one.columns):
            # On 80 columns text may take two lines, a number may not.
            widest = max(len(word) for row in one.rows for word in row[n].split())
            shown.add_column(heading, justify="right" if n else "left", overflow="fold", min_width=widest)
        for row in one.rows:
            shown.add_row(*row)
        console.print(shown)
    limits = found.limits
    say(f"The joint holds vertices of up to {1e3 * limits.largest:.2g} mm, for {limits.reason}.")
    say(rounder_vertices.answer(found))
    console.print(f"Page: [bold]{escape(str(out / 'vertices.html'))}[/bold]  (figures/, sweep.csv and results.json)")
