"""The command that compares an instrument with poses of another solver: ``tenodesis compare``."""

from pathlib import Path
from typing import Annotated

import typer

from tenodesis import poses
from tenodesis.cli.command import Answer, command
from tenodesis.cli.common import InstrumentFile, check_choice, console, load_instrument, note, say, table
from tenodesis.cli.outputs import FIGURE, Outputs, output
from tenodesis.errors import CommandError
from tenodesis.files import atomic_file, write_errors
from tenodesis.poses.report import table as rows_of

_PAGE = {".html": "a page"}
_MOST_ROWS = 20


@command("instrument_file", "poses_file", json="Print JSON, in SI units.")
def compare(  # noqa: PLR0917
    outputs: Outputs,
    instrument_file: InstrumentFile,
    poses_file: Annotated[
        Path, typer.Argument(metavar="POSES", help="CSV file of tip poses, with what acts on the instrument at each.")
    ],
    arcs: Annotated[
        int | None, typer.Option(min=1, max=12, help="Arcs of each backbone. Default: those of the instrument.")
    ] = None,
    axes: Annotated[
        str, typer.Option(metavar="tip|stem", help="Axes of forces and moments: they turn with the tip, or do not.")
    ] = "tip",
    out: Annotated[Path | None, output(_PAGE, "Write a page here: .html.", metavar="FILE")] = None,
    picture: Annotated[
        Path | None, output(FIGURE, "Draw tips and errors here: .svg, .png or .pdf.", metavar="FILE")
    ] = None,
) -> Answer:
    """Compare an instrument with tip poses that another solver computed, by tensions, strokes or handle angles."""
    check_choice("--axes", axes, ("tip", "stem"))
    for given in (instrument_file, str(poses_file)):
        if given.endswith(".mcap"):
            raise CommandError(
                f"{given} is a recording, and compare takes an instrument and poses; tenodesis replay {given} "
                "--instrument OTHER --plot-out FIGURE.png draws a recording and what OTHER makes of its commands, and "
                "tn.plot.run(tn.Recording.open(FILE).run) the signals of one.",
                key="file",
                value=given,
                allowed="an instrument and poses",
            )
    inst = load_instrument(instrument_file)
    with outputs.files(out=out, picture=picture):
        found = poses.compare(inst, poses_file, arcs=arcs, axes="stem" if axes == "stem" else "tip")
        if out is not None:
            poses.write(found, out)
        if picture is not None:
            with write_errors(picture, CommandError), atomic_file(picture) as new:
                poses.plot(found).savefig(new, format=picture.suffix[1:])

    def show() -> None:
        shown = rows_of(found, _MOST_ROWS)
        console.print(table(shown.caption, *(f">{heading}" for heading in shown.columns), rows=shown.rows))
        for name, value in found.summary.items():
            kind, unit = name.removesuffix("]").split(" [")
            what = "of the direction" if unit == "deg" else "of the tip's place"
            unit = "% of the length" if unit == "%" else unit
            say(f"Error {what}, {kind}: {value:.3g} {unit}")
        place = f"{found.worst + 1} of {len(found.error)}"
        say(f"Largest at pose {place}; the instrument is {1e3 * found.length:.4g} mm long.")
        for sentence in found.notes:
            note(sentence)

    return Answer(found.to_json, show)
