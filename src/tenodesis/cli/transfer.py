"""The command that converts an experiment on a scaled-up instrument to real-size units."""

import math
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Annotated

import typer

from tenodesis.cli.command import command
from tenodesis.cli.common import ProgressBar, console, load_instrument, say, table, warn
from tenodesis.cli.outputs import INSTRUMENT, RECORDING, Outputs, output, write_text
from tenodesis.errors import CommandError
from tenodesis.instrument.text import to_file
from tenodesis.recording import Blocks
from tenodesis.scaling.transfer import KEYS, OF_JOINTS, QUANTITY, Carried, carry, carry_friction

_DIVIDES = {"wrench": ("force", "moment")}


@command("log", "real_size", "scaled_up")
def transfer(  # noqa: PLR0917
    outputs: Outputs,
    real_size: Annotated[str, typer.Argument(metavar="REAL", help="Real-size instrument: file or shipped name.")],
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Recording made on the scaled-up instrument.")],
    out: Annotated[Path | None, output(RECORDING, "The file. Default: LOG-REAL.mcap, next to LOG.")] = None,
    scaled_up: Annotated[
        str | None, typer.Option(metavar="INSTRUMENT", help="Recorded instrument: file or name. Default: that in LOG.")
    ] = None,
    instrument_out: Annotated[
        Path | None,
        output(INSTRUMENT, "Real-size instrument file to write, with the friction of the scaled-up instrument."),
    ] = None,
    time_factor: Annotated[float | None, typer.Option(help="Time factor. Default: ratio of the tips' periods.")] = None,
) -> None:
    """Carry a recording of a scaled-up instrument to real-size units, and its friction to the real-size file."""
    model = load_instrument(real_size)
    given = None if scaled_up is None else load_instrument(scaled_up)
    path = log.with_name(f"{log.stem}-{Path(real_size).stem}.mcap") if out is None else out
    with outputs.files(out=path, instrument_out=instrument_out), ProgressBar(f"converting {log.name}", None) as bar:
        blocks = Blocks(log, progress=bar)
        runs = iter(blocks)
        first = next(runs)
        carried = carry(blocks.recording(first), model, scaled_up=given, time_factor=time_factor)
        _check_order(carried)
        with_friction = None
        if instrument_out is not None:
            source = log.name if scaled_up is None else scaled_up
            with_friction = to_file(carry_friction(carried.scaled_up, model, source=source, time_factor=time_factor))
        carried, rows = carried.write_blocks(chain([first], runs), path, overwrite=outputs.overwrite)
        if instrument_out is not None and with_friction is not None:
            write_text(instrument_out, with_friction)
    if blocks.damage is not None and blocks.damage not in carried.warnings:
        carried = replace(carried, warnings=(blocks.damage, *carried.warnings))
    _print_factors(carried)
    say(f"{path}: {log} in units of {model.name}, {carried.run.time[-1]:.6g} s, {rows} rows.")
    if instrument_out is not None:
        say(f"{instrument_out}: {model.name} with the friction of {carried.scaled_up.name}.")


def _check_order(carried: Carried) -> None:
    length = max(own["length"] for own in carried.factors.values())
    if length < 1:
        raise CommandError(
            f"{carried.real_size.name} is larger than {carried.scaled_up.name}, on which LOG was recorded and whose "
            f"joints have {length:.3g} of its size; REAL must be the real-size instrument, and LOG a recording of its "
            "scaled-up one.",
            key="REAL",
            value=carried.real_size.name,
        )


def _print_factors(carried: Carried) -> None:
    """Print the factors and what they were used for, what came out, and the warnings."""
    title = f"{carried.scaled_up.name} over {carried.real_size.name}"
    factors = table(title, "factor", *(f">{axis}" for axis in carried.factors), "divides")
    signals = carried.run.signals()
    every = next(iter(carried.factors.values()))
    for key in (*(key for key in (*KEYS, *OF_JOINTS) if key in every), "output_velocity"):
        used = (
            ["time"]
            if key == "time"
            else [name for name in signals if key in _DIVIDES.get(QUANTITY.get(name, ""), (QUANTITY.get(name),))]
        )
        factors.add_row(key, *(f"{own[key]:.5g}" for own in carried.factors.values()), ", ".join(used))
    console.print(factors)
    same = [name for name in signals if name not in QUANTITY]
    say(f"unchanged: {', '.join(same) or 'nothing'}.")
    for what, size in (("force", carried.largest_force), ("tension", carried.largest_tension)):
        if not math.isnan(size):
            say(f"largest {what} on {carried.real_size.name}: {size:.4g} N.")
    error = carried.similarity_error()
    if not math.isnan(error):
        say(f"largest similarity error up to that force, without friction: {error:.2g} deg.")
    for sentence in carried.warnings:
        warn(sentence)
