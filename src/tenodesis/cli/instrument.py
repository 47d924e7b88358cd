"""The commands about instrument files: check a file, and print the schemas of all kinds of files."""

import json
from collections.abc import Callable, Sequence
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

from tenodesis import instrument, statics
from tenodesis.cli.common import InstrumentFile, console, load_instrument, note, say, table, warn
from tenodesis.cli.joints import joints_as_json, print_joints
from tenodesis.cli.loss import losses_of_joints
from tenodesis.cli.outputs import FIGURE, Overwrite, check_suffix, write_errors, writing
from tenodesis.control.derived import Derived, derive
from tenodesis.control.plausibility import implausible
from tenodesis.control.resolution import sentences, shares
from tenodesis.errors import InstrumentError
from tenodesis.files import atomic_file
from tenodesis.instrument import FullForm, Instrument, RouteError
from tenodesis.instrument.listing import Listed, listed

_WIDTH = 24
"""Width of a list of values in a table."""

Kind: TypeAlias = Literal["instrument", "protocol", "catalogue", "tolerances"]


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


def check(
    instrument_file: InstrumentFile,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print JSON: values in SI units, and as in the file.")
    ] = False,
    picture: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Draw the tendons' routes over the joints here: .svg, .png or .pdf.",
            show_default=False,
        ),
    ] = None,
    overwrite: Overwrite = False,
) -> None:
    """Check an instrument file; print its values, what follows from them, and what is implausible about it.

    Of joints that share tendons: routes, moment arms, coupling, and what loads take. A picture marks a wrong route.
    """
    check_suffix("--picture", picture, FIGURE)
    with writing([("--picture", picture)], [instrument_file], overwrite=overwrite):
        try:
            inst = load_instrument(instrument_file)
        except InstrumentError:
            wrong = instrument.misrouted(instrument_file) if picture else None
            if picture and wrong:
                _draw(picture, wrong.inst, wrong)
                note(f"{picture} is written, with what is wrong in red.")
            raise
        content, show = _values(instrument_file, inst)
        found = implausible(inst)
        if as_json:
            about = {"name": inst.name, "description": inst.description}
            warnings = {"warnings": [one._asdict() for one in found]}
            typer.echo(json.dumps(about | content | warnings, indent=1, ensure_ascii=False))
        else:
            show()
            for one in found:
                warn(one.sentence)
        if picture:
            _draw(picture, inst.expanded)
            if not as_json:
                note(f"{picture} is written.")


def _draw(path: Path, inst: FullForm, problem: RouteError | None = None) -> None:
    from tenodesis.report import routing  # noqa: PLC0415 - loads matplotlib

    with write_errors(path), atomic_file(path) as new:
        routing.write(new, inst, problem)


def _values(instrument_file: str, inst: Instrument) -> tuple[dict[str, Any], Callable[[], None]]:
    """Return what JSON has of an instrument's values and what follows from them, and what prints it."""
    if (short := inst.short_form) is None:
        joints = inst.expanded
        found = losses_of_joints(joints, statics.usual_states(joints), np.eye(3, 6))
        return joints_as_json(joints, found), partial(print_joints, joints, found)
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
        "derived": {
            one.key: {"value": one.value if isfinite(one.value) else None, "unit": one.unit, "meaning": one.meaning}
            for one in derived
        },
        "resolution": resolution,
    }
    return content, show


def _table(values: Sequence[Listed], derived: Sequence[Derived]) -> Table:
    """Return the values by table of the file, and what follows from them; a value is never broken over lines."""
    shown = table(padding=(0, 2, 0, 0))
    shown.add_column("key", no_wrap=True)
    shown.add_column("value", justify="right", no_wrap=True)
    shown.add_column("source", overflow="fold")
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
