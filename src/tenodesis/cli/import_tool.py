"""The commands that read what other programs describe: ``tenodesis import``."""

from pathlib import Path
from typing import Annotated

import typer

from tenodesis import instrument
from tenodesis.cli.command import command
from tenodesis.cli.common import console, quantity, say, table
from tenodesis.cli.outputs import INSTRUMENT, Outputs, output, write_text
from tenodesis.units import Length


@command("file")
def import_dvrk(
    outputs: Outputs,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Tool file of the da Vinci Research Kit, JSON.")],
    pulley_radius: Annotated[
        str, typer.Option(help="Radius of the largest pulley about the pitch axis; all scale with it.")
    ] = f"{1e3 * instrument.PULLEY_RADIUS:g} mm",
    jaw_angle: Annotated[
        instrument.JawAngle,
        typer.Option(help="What the file's jaw angle is: between the jaws, of each jaw, or as pulleys have it."),
    ] = "between",
    out: Annotated[Path | None, output(INSTRUMENT, "The file. Default: NAME.toml.")] = None,
) -> None:
    """Write an instrument from a tool file of the da Vinci Research Kit, with the file's coupling matrix."""
    radius = quantity("--pulley-radius", pulley_radius, Length)
    text = instrument.dvrk_text(file, pulley_radius=radius, jaw_angle=jaw_angle)
    inst = instrument.parse(text, str(file))
    path = Path(f"{inst.name}.toml") if out is None else out
    with outputs.files(out=path):
        write_text(path, text)
    joints = ", ".join(joint.name for joint in inst.tip_joints)
    say(f"{path}: {inst.name}, {len(inst.tendons)} tendons, angles {joints}; [sources] lists what is assumed.")
    unknown = table("what a tool file does not say", "unknown", "assumed", "told by")
    for row in instrument.DVRK_UNKNOWN:
        unknown.add_row(*row)
    console.print(unknown)
    if reading := instrument.jaw_reading(file, jaw_angle):
        say(reading)
