"""The command that carries an experiment on a scaled-up instrument to the real-size one."""

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from tenodesis import instrument
from tenodesis.errors import CommandError
from tenodesis.files import atomic_file
from tenodesis.instrument.text import to_file
from tenodesis.recording import Recording
from tenodesis.scaling.transfer import Carried, carry
from tenodesis.scaling.transfer_factors import KEYS, QUANTITY
from tenodesis.scaling.transfer_friction import carry_friction

console = Console()


def register(app: typer.Typer) -> None:
    """Add the command to an app."""
    app.command()(transfer)


def transfer(  # noqa: PLR0917
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Recording made on the scaled-up instrument.")],
    to: Annotated[str, typer.Option(metavar="INSTRUMENT", help="Real-size instrument: file or shipped name.")],
    out: Annotated[
        Path | None, typer.Option(help="The file. Default: LOG-INSTRUMENT.mcap, beside LOG.", show_default=False)
    ] = None,
    scaled_up: Annotated[
        str | None,
        typer.Option(metavar="INSTRUMENT", help="What was recorded: file or name. Default: what LOG holds."),
    ] = None,
    instrument_out: Annotated[
        Path | None,
        typer.Option(help="Instrument file to write: the real-size one with the friction of the scaled-up one."),
    ] = None,
    time_factor: Annotated[
        float | None, typer.Option(help="Factor of time. Default: that of the tips' swings.", show_default=False)
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace files that exist, but no input.")] = False,
) -> None:
    """Carry a recording of a scaled-up instrument to real-size units, and its friction to the real-size file."""
    model = instrument.load(to)
    given = None if scaled_up is None else instrument.load(scaled_up)
    path = log.with_name(f"{log.stem}-{Path(to).stem}.mcap") if out is None else out
    _refuse([("--out", path), ("--instrument-out", instrument_out)], (log, to, scaled_up), overwrite=overwrite)
    try:
        carried = carry(Recording.open(log), model, scaled_up=given, time_factor=time_factor)
    except ValueError as problem:
        raise CommandError(str(problem)) from problem
    rubbing = None
    if instrument_out is not None:
        source = log.name if scaled_up is None else scaled_up
        rubbing = to_file(carry_friction(carried.scaled_up, model, source=source, time_factor=time_factor))
    carried.write(path, overwrite=overwrite)
    if instrument_out is not None and rubbing is not None:
        _write(instrument_out, rubbing)
    _tell(carried)
    _say(f"{path}: {log} in units of {model.name}, {carried.run.time[-1]:.6g} s, {len(carried.run)} rows.")
    if instrument_out is not None:
        _say(f"{instrument_out}: {model.name} with the friction of {carried.scaled_up.name}.")


def _tell(carried: Carried) -> None:
    """Print the factors and what they were used for, what came out, and the warnings."""
    title = f"{escape(carried.scaled_up.name)} over {escape(carried.real_size.name)}"
    table = Table("factor", title=title, title_justify="left", box=box.SIMPLE_HEAD)
    for axis in carried.factors:
        table.add_column(axis, justify="right")
    table.add_column("divides", overflow="fold")
    there = carried.run.signals()
    for key in (*KEYS, "output_velocity"):
        used = ["time"] if key == "time" else [name for name in there if QUANTITY.get(name) == key]
        table.add_row(key, *(f"{own[key]:.5g}" for own in carried.factors.values()), ", ".join(used))
    console.print(table)
    same = [name for name in there if name not in QUANTITY]
    _say(f"as it was: {', '.join(same) or 'nothing'}.")
    for what, size in (("force", carried.largest_force), ("tension", carried.largest_tension)):
        if not math.isnan(size):
            _say(f"largest {what} on {carried.real_size.name}: {size:.4g} N.")
    error = carried.similarity_error()
    if not math.isnan(error):
        _say(f"largest similarity error up to that force, without friction: {error:.2g} deg.")
    for sentence in carried.warnings:
        console.print(f"warning: {sentence}", markup=False, highlight=False, soft_wrap=True, style="yellow")


def _refuse(
    outputs: Iterable[tuple[str, Path | None]], inputs: Iterable[Path | str | None], *, overwrite: bool
) -> None:
    """Refuse to write into no folder, over an input, over the other output, or unasked over any file."""
    taken = {Path(one).resolve() for one in inputs if one is not None}
    for option, path in outputs:
        if path is None:
            continue
        if path.resolve() in taken:
            raise CommandError(f"{option} is {path}, which is in use already; allowed is another path.")
        if path.exists() and not overwrite:
            raise CommandError(f"{path} exists already; allowed is another path, or --overwrite.")
        if not path.parent.is_dir():
            raise CommandError(f"{option} is {path}, but there is no folder {path.parent}; allowed is one that exists.")
        if path.is_dir():
            raise CommandError(f"{option} is {path}, which is a folder; allowed is a file.")
        taken.add(path.resolve())


def _write(path: Path, text: str) -> None:
    """Write a file whole or not at all."""
    try:
        with atomic_file(path) as new:
            new.write_text(text, "utf-8")
    except OSError as problem:
        raise CommandError(f"{path} cannot be written: {problem.strerror or problem}.") from None


def _say(sentence: str) -> None:
    console.print(sentence, markup=False, highlight=False, soft_wrap=True)
