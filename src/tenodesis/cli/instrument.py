"""The commands about instrument files: check a file, and print the schemas of all kinds of files."""

import json
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

from tenodesis import instrument, statics
from tenodesis.cli.command import Answer, command
from tenodesis.cli.common import InstrumentFile, console, load_instrument, note, say, table, warn
from tenodesis.cli.joints import joints_as_json, print_joints
from tenodesis.cli.loss import losses
from tenodesis.cli.outputs import FIGURE, Outputs, output
from tenodesis.control.derived import Derived, derive
from tenodesis.control.plausibility import implausible
from tenodesis.control.resolution import sentences, shares
from tenodesis.errors import CommandError, InstrumentError
from tenodesis.files import atomic_file, write_errors
from tenodesis.instrument import FullForm, Instrument, RouteError
from tenodesis.instrument.listing import Listed, listed

_WIDTH = 24
"""Width of a list of values in a table."""

Kind: TypeAlias = Literal["instrument", "protocol", "catalogue", "tolerances"]


@command()
def schema(
    kind: Annotated[
        Kind, typer.Argument(metavar="KIND", help="instrument, protocol, catalogue or tolerances.")
    ] = "instrument",
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


@command("instrument_file", json="Print JSON: values in SI units, and as in the file.")
def check(
    outputs: Outputs,
    instrument_file: InstrumentFile,
    picture: Annotated[
        Path | None,
        output(FIGURE, "Draw the tendons' routes over the joints here: .svg, .png or .pdf.", metavar="FILE"),
    ] = None,
) -> Answer:
    """Check an instrument file; print its values, what follows from them, and what is implausible about it.

    Of joints that share tendons: routes, moment arms, coupling, and what loads take. A picture marks a wrong route.
    """
    with outputs.files(picture=picture):
        try:
            inst = load_instrument(instrument_file)
        except InstrumentError:
            wrong = instrument.misrouted(instrument_file) if picture else None
            if picture and wrong:
                _draw(picture, wrong.inst, wrong)
                note(f"{picture} is written, with what is wrong in red.")
            raise
        values, found = _values(instrument_file, inst), implausible(inst)
        if picture:
            _draw(picture, instrument.in_arcs(inst, 1))

    def show() -> None:
        values.show()
        for one in found:
            warn(one.sentence)
        if picture:
            note(f"{picture} is written.")

    about = {"name": inst.name, "description": inst.description}
    warnings = {"warnings": [one._asdict() for one in found]}
    return Answer(lambda: about | values.content() | warnings, show)


def _draw(path: Path, inst: FullForm, problem: RouteError | None = None) -> None:
    from tenodesis.report import routing  # noqa: PLC0415 - loads matplotlib

    with write_errors(path, CommandError), atomic_file(path) as new:
        routing.write(new, inst, problem)


def _values(instrument_file: str, inst: Instrument) -> Answer:
    """Return what JSON has of an instrument's values and what follows from them, and what prints it."""
    if (short := inst.short_form) is None:
        joints = inst.expanded
        found = losses(joints, statics.usual_states(joints), np.eye(3, 6))
        return Answer(partial(joints_as_json, joints, found), partial(print_joints, joints, found))
    values, derived = listed(instrument_file, short), tuple(derive(short))
    resolution = [*sentences(short), *shares(short)]

    def show() -> None:
        axes = f"{short.name}: {short.joint_type}, {' and '.join(short.axes)}"
        say(axes + (f". {short.description}" * bool(short.description)))
        console.print(_table(values, derived))
        if short.devices.model_fields_set:
            say(f"Devices: {', '.join(sorted(short.devices.model_fields_set))}.")
        for sentence in resolution:
            say(sentence)

    content = {
        "joint_type": short.joint_type,
        "axes": short.axes,
        "values": {one.key: {name: item for name, item in one._asdict().items() if name != "key"} for one in values},
        "derived": {one.key: {"value": one.value, "unit": one.unit, "meaning": one.meaning} for one in derived},
        "resolution": resolution,
    }
    return Answer(lambda: content, show)


def _table(values: Sequence[Listed], derived: Sequence[Derived]) -> Table:
    """Return the values by table of the file, and what follows from them; a value is never broken over lines."""
    shown = table(None, "key", ">value", "source")
    heading = ""
    for one in values:
        name, _, key = one.key.rpartition(".")
        if name != heading:
            shown.add_section()
            shown.add_row(f"[bold]\\[{name}][/bold]", "", "")
            heading = name
        style = None if one.given else "dim"
        shown.add_row(escape(key), escape(_lines(one.text)), escape(one.source), style=style)
    shown.add_section()
    shown.add_row("[bold]follows[/bold]", "", "")
    for result in derived:
        shown.add_row(escape(result.key.replace("_", " ")), result.text, escape(result.meaning))
    return shown


def _lines(text: str) -> str:
    """Return the values of a list on as many lines as they need, none of them broken."""
    lines = [""]
    for atom in text.split(", "):
        joined = f"{lines[-1]}, {atom}".removeprefix(", ")
        if len(joined) <= _WIDTH or not lines[-1]:
            lines[-1] = joined
        else:
            lines[-1] += ","
            lines.append(atom)
    return "\n".join(lines)
