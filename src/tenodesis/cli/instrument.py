"""The commands about instrument files: check a file, and print the schemas of all kinds of files."""

import json
from typing import Annotated, Literal, TypeAlias

import typer
from rich.markup import escape
from rich.table import Table

from tenodesis import instrument, plant
from tenodesis.cli.common import InstrumentFile, console, say_resolution, warn
from tenodesis.errors import Error

Kind: TypeAlias = Literal["instrument", "protocol", "catalogue", "tolerances"]


def schema(
    kind: Annotated[Kind, typer.Argument(metavar="KIND", help="instrument, protocol, catalogue or tolerances.")] = (
        "instrument"
    ),
) -> None:
    """Print the JSON schema of a kind of file, for editors that complete and check TOML."""
    from tenodesis import scaling, simulate, tolerance  # noqa: PLC0415 - instrument files do without them

    schemas = {
        "instrument": instrument.json_schema,
        "protocol": simulate.json_schema,
        "catalogue": scaling.json_schema,
        "tolerances": tolerance.json_schema,
    }
    typer.echo(json.dumps(schemas[kind](), indent=2, ensure_ascii=False))


def check(instrument_file: InstrumentFile) -> None:
    """Check an instrument file; print its values in SI units, and what its sensors resolve at the tip."""
    inst: instrument.Instrument = instrument.load(instrument_file)
    title = f"{escape(inst.name)}: {inst.joint_type}, {' and '.join(inst.axes)}"
    values = Table("key", "value", "source", title=title)
    for key, value, quantity in inst.quantities():
        values.add_row(key, f"{value:.6g} {quantity.unit}", escape(inst.sources.get(key, "")))
    for axis, own in inst.overrides.items():
        for key, value, quantity in inst.axis(axis).quantities():
            if key in own:
                values.add_row(f"{axis}: {key}", f"{value:.6g} {quantity.unit}", "")
    console.print(values)
    say_resolution(inst)
    try:
        plant.check_runnable(inst)
    except Error as problem:
        warn(f"this file can be neither run live nor simulated in time steps of {plant.TIME_STEP:g} s: {problem}")
