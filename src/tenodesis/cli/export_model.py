"""The commands that write an instrument as a model for other tools: URDF and MuJoCo."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from tenodesis import instrument, kinematics
from tenodesis.errors import CommandError
from tenodesis.files import atomic_file
from tenodesis.instrument import Instrument

InstrumentFile = Annotated[
    str, typer.Argument(metavar="INSTRUMENT", help="Instrument file, or the name of one that is shipped.")
]
Out = Annotated[Path | None, typer.Option(help="The file. Default: by the instrument's name.", show_default=False)]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace a file that exists.")]


def register(exports: typer.Typer) -> None:
    """Add the models to the exports."""
    exports.command("urdf")(export_urdf)
    exports.command("mjcf")(export_mjcf)


def export_urdf(instrument_file: InstrumentFile, out: Out = None, overwrite: Overwrite = False) -> None:
    """Write an instrument as a URDF robot: links, joints, mimics; no tendons. The file says what it does not carry."""
    _export(instrument_file, kinematics.urdf, ".urdf", out, overwrite)


def export_mjcf(instrument_file: InstrumentFile, out: Out = None, overwrite: Overwrite = False) -> None:
    """Write an instrument as a MuJoCo model: bodies, tied joints, tendons. The file says what it does not carry."""
    _export(instrument_file, kinematics.mjcf, ".xml", out, overwrite)


def _export(
    source: str, writer: Callable[[Instrument], str], extension: str, out: Path | None, overwrite: bool
) -> None:
    inst = instrument.load(source)
    path = Path(f"{inst.name.replace(' ', '-').replace('/', '-')}{extension}") if out is None else out
    if path.exists() and not overwrite:
        raise CommandError(f"{path} exists already; allowed is another path, or --overwrite.")
    text = writer(inst)
    try:
        with atomic_file(path) as new:
            new.write_text(text, "utf-8")
    except OSError as problem:
        raise CommandError(f"{path} cannot be written: {problem.strerror or problem}.") from None
    axes = " and ".join(inst.axes)
    typer.echo(f"{path}: {inst.name} ({axes}); what the format does not carry is told at its top.")
