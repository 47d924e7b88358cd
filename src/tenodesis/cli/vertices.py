"""The command about rounder vertices: ``tenodesis vertices``."""

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from tenodesis.cli.command import command
from tenodesis.cli.common import InstrumentFile, ProgressBar, console, load_instrument, quantity, say, table
from tenodesis.cli.outputs import Outputs, written_by_us
from tenodesis.paper import rounder_vertices
from tenodesis.paper.rounder_vertices import NUMBERS, PAGE, SWEEP, tables, write
from tenodesis.units import PositiveForce


@command("instrument_file")
def study_vertices(
    outputs: Outputs,
    instrument_file: InstrumentFile = "scaled-up",
    force: Annotated[
        str | None,
        typer.Option(help="Load at the tip. Default: that of the load rig, or the second of the conditions."),
    ] = None,
    axis: Annotated[
        str | None, typer.Option(help="Axis of the joint that is judged, the others straight. Default: the first.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for page, figure, sweep and results.")] = Path("out/vertices"),
) -> None:
    """Study rounder vertices: radius, coefficient and rope against loss, hysteresis and final errors."""
    inst = load_instrument(instrument_file)
    if inst.short_form is not None:
        inst = inst.axis(axis or inst.axes[0])
    newton = None if force is None else quantity("--force", force, PositiveForce)
    own = written_by_us(out / NUMBERS, "designs")
    with outputs.folder(out, (PAGE, NUMBERS, SWEEP), ("figures",), replace=own), ProgressBar("designs") as bar:
        found = rounder_vertices.study(inst, newton, axis=axis, progress=bar)
        write(found, out)
    for one in tables(found):
        first, *others = one.columns
        shown = table(one.caption, first, *(f">{heading}" for heading in others), rows=one.rows)
        console.print(shown)
    limits = found.limits
    say(f"The joint holds vertices of up to {1e3 * limits.largest:.2g} mm, for {limits.reason}.")
    say(rounder_vertices.answer(found))
    console.print(f"Page: [bold]{escape(str(out / 'vertices.html'))}[/bold]  (figures/, sweep.csv and results.json)")
