"""The command that writes the map of a laboratory's file."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from tenodesis.cli.command import command
from tenodesis.cli.common import ProgressBar, load_instrument, note, say, warn
from tenodesis.cli.outputs import FIGURE, Outputs, output, write_text
from tenodesis.errors import RecordingError
from tenodesis.files import write_errors
from tenodesis.instrument import FullForm, expanded
from tenodesis.recording import lab_guess, lab_map, lab_tables, signal_tables
from tenodesis.recording.blocks import IrregularError, RegularBlocks, Thinned
from tenodesis.run import Run

_MOST_POINTS = 20_000
"""Rows of a recording that are drawn, at most."""


@command("file")
def write_map(
    outputs: Outputs,
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE", help="File of a laboratory: text, .lvm, .tdms, .mat, .parquet, .npz, .xlsx, bag."
        ),
    ],
    out: Annotated[
        Path | None, output({".toml": "a map of columns"}, "The map. Default: FILE.columns.toml beside FILE.")
    ] = None,
    instrument_file: Annotated[
        str | None,
        typer.Option(
            "--instrument", metavar="INSTRUMENT", help="Whose tendons turn several joints: columns by their names."
        ),
    ] = None,
    plot_out: Annotated[
        Path | None, output(FIGURE, "Figure of the signals by the map. Default: FILE.columns.png beside FILE.")
    ] = None,
) -> None:
    """Write a map of a file's columns to signals, guessed from headings, units and ranges, and a figure to check it.

    A recording of this package needs no map: only the figure is written.
    """
    path = file.with_name(file.name + lab_tables.MAP_SUFFIX) if out is None else out
    figure = file.with_name(file.name + ".columns.png") if plot_out is None else plot_out
    with outputs.files(out=path, plot_out=figure):
        known = _rows_of(file)
        if known is not None:
            say(f"{file} is a recording of this package, whose signals need no map; none is written.")
            if path.exists():
                note(f"It is read by {path}, and slower, until that is deleted.")
            _draw(known, (), figure)
            return
        table = lab_map.numbers_in(file)
        if instrument_file is not None:
            _of_instrument(table, expanded(load_instrument(instrument_file)), file, path)
            return
        guesses = lab_guess.guess(table)
        text = lab_guess.as_toml(table, guesses)
        mapped = lab_map.by_map(table, text, str(path))
        write_text(path, text)
        run = lab_map.run_of(mapped)
        drawn = [name for name, values in run.signals().items() if values.size]
        say(f"{path}: {', '.join(guesses) or 'no column'} of {file.name} ({table.kind}); check each line.")
        if missing := lab_guess.lacking(guesses):
            warn(f"no heading looks like {', '.join(missing)}, which tenodesis identify needs; name them in {path}.")
        if not drawn:
            note("No signal was found to draw: name columns in the map.")
            return
        _draw(run, drawn, figure)


def _of_instrument(table: lab_tables.LabTable, inst: FullForm, file: Path, path: Path) -> None:
    """Write the map of an instrument's joints and tendons."""
    guesses = signal_tables.guess(table, inst)
    missing = signal_tables.lacking(inst, guesses)
    write_text(path, lab_guess.as_toml(table, guesses, signal_tables.units(guesses), missing, signal_tables.SIGNS))
    say(f"{path}: {', '.join(guesses) or 'no column'} of {file.name} ({table.kind}); check each line.")
    if missing:
        warn(f"no heading looks like {', '.join(missing)}, which tenodesis identify needs; name them in {path}.")


def _rows_of(file: Path) -> Run | None:
    """Return some rows of a recording of this package, enough for a figure; None if it is none."""
    rows = Thinned(_MOST_POINTS)
    with suppress(IrregularError, RecordingError), ProgressBar(f"reading {file.name}", None) as bar:
        for run in RegularBlocks(file, progress=bar):
            rows.add(run)
        return rows.run
    return None


def _draw(run: Run, signals: Sequence[str], figure: Path) -> None:
    from tenodesis import plot  # noqa: PLC0415 - slow to load

    with write_errors(figure, RecordingError):
        plot.run(run, signals).savefig(figure)
    say(f"{figure}: the signals.")
