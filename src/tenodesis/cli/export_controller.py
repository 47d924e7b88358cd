"""The commands about the controller: export its parameters."""

from pathlib import Path
from typing import Annotated, cast

import typer

from tenodesis import control, instrument
from tenodesis.control.controller import ActuationName
from tenodesis.errors import CommandError


def register(exports: typer.Typer) -> None:
    """Add the commands about the controller to the exports."""
    exports.command("controller")(export_controller)


def export_controller(  # noqa: PLR0917
    instrument_file: Annotated[
        str, typer.Argument(metavar="INSTRUMENT", help="Instrument file, or the name of one that is shipped.")
    ],
    axis: Annotated[str | None, typer.Option(help="Axis to control alone. Default: all.", show_default=False)] = None,
    observer: Annotated[str, typer.Option(help="paper, exact or friction.")] = "friction",
    law: Annotated[str, typer.Option(help="off, paper, paper-feedback, exact or robust.")] = "robust",
    actuation: Annotated[str, typer.Option(help="agonist or differential.")] = "differential",
    not_homed: Annotated[bool, typer.Option("--not-homed", help="Spool angles count from anywhere: home first.")] = (
        False
    ),
    own_clock: Annotated[bool, typer.Option("--own-clock", help="Ticks count as one period each.")] = False,
    name: Annotated[
        str | None, typer.Option(help="Of the constant in C. Default: the instrument's.", show_default=False)
    ] = None,
    out: Annotated[Path | None, typer.Option(help="The file. Default: NAME.h.", show_default=False)] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a file that exists.")] = False,
) -> None:
    """Write a controller's parameters as a C header, for tenodesis_init."""
    inst = instrument.load(instrument_file)
    if axis is not None:
        inst = inst.axis(axis)
    name = control.identifier(inst.name) if name is None else name
    path = Path(f"{name}.h") if out is None else out
    if path.exists() and not overwrite:
        raise CommandError(f"{path} exists already; allowed is another path, or --overwrite.")
    try:
        control.export_header(
            inst,
            path,
            name,
            observer=cast(control.ObserverName, observer),
            law=cast(control.LawName, law),
            actuation=cast(ActuationName, actuation),
            homed=not not_homed,
            own_clock=own_clock,
            source=instrument_file,
        )
    except ValueError as problem:
        raise CommandError(str(problem)) from None
    except OSError as problem:
        raise CommandError(f"{path} cannot be written: {problem.strerror or problem}.") from None
    axes = " and ".join(inst.axes)
    typer.echo(f"{path}: {name}, the controller of {inst.name} ({axes}), for tenodesis_init.")
