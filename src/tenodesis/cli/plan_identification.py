"""The command that proposes a bench protocol for an identification."""

from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import TypeAdapter, ValidationError
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from tenodesis import instrument
from tenodesis.cli.common import PatientBar, check_outputs
from tenodesis.errors import CommandError
from tenodesis.identification.experiment import DURATION, OPTIMISTIC, Plan, plan, report
from tenodesis.identification.experiment.choice import CriterionName
from tenodesis.units import Duration, PositiveForce

console = Console()

_NONE = "none"


def register(app: typer.Typer) -> None:
    """Add the command to an app."""
    app.command("plan-identification")(plan_identification)


def plan_identification(  # noqa: PLR0917
    instrument_file: Annotated[str, typer.Argument(metavar="INSTRUMENT", help="Instrument file or shipped name.")],
    want: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Parameters or groups. Default: friction,stiffness,pretension.",
            show_default=False,
        ),
    ] = None,
    duration: Annotated[str, typer.Option(help="How long the protocol may last.")] = f"{DURATION:g} s",
    without_distal_encoder: Annotated[
        bool, typer.Option("--without-distal-encoder", help="The bench has no encoder at the tip.")
    ] = False,
    forces: Annotated[
        str | None,
        typer.Option(
            metavar="FORCES",
            help='Known forces at the tip, "0.5 N,1 N", or none. Default: shares of the slack limit.',
            show_default=False,
        ),
    ] = None,
    law: Annotated[str | None, typer.Option(help="Friction law. Default: the file's.", show_default=False)] = None,
    criterion: Annotated[str, typer.Option(help="D: confidence region; A: sum of variances.")] = "D",
    axis: Annotated[str | None, typer.Option(help="Axis to plan for. Default: the first.", show_default=False)] = None,
    out: Annotated[Path, typer.Option(help="Folder for protocol.toml, plan.html, plan.svg and plan.json.")] = Path(
        "out/plan-identification"
    ),
) -> None:
    """Propose the bench protocol that makes parameters identifiable, and predict how well they will be known."""
    inst = instrument.load(instrument_file)
    if axis is not None:
        inst = inst.axis(axis)
    names = (report.PROTOCOL, report.PAGE, report.FIGURE, report.NUMBERS)
    check_outputs([("--out", out / name) for name in names], [Path(instrument_file)])
    seconds = _quantity("--duration", duration, Duration)
    loads = None if forces is None else _forces(forces)
    with PatientBar(console, "protocols tried") as bar:
        found = plan(
            inst,
            None if want is None else [word.strip() for word in want.split(",") if word.strip()],
            duration=seconds,
            distal_encoder=not without_distal_encoder,
            forces=loads,
            law=law,
            criterion=_criterion(criterion),
            progress=bar,
        )
    written = report.write(found, out)
    _tell(found)
    _say(f"Written: {', '.join(str(path) for path in written)}")
    alone = "" if axis is None else f" --axis {axis}"
    _say(f"Record: tenodesis record {out / report.PROTOCOL} {instrument_file}{alone} --out LOG.mcap")
    _say(
        f"Identify: tenodesis identify LOG.mcap --instrument {instrument_file} --law {found.law} --fit "
        f"{','.join(found.open)}"
    )


def _criterion(name: str) -> CriterionName:
    if name == "D":
        return "D"
    if name == "A":
        return "A"
    raise CommandError(f"--criterion is {name}; allowed are D, A.")


def _forces(text: str) -> list[float]:
    if text.strip() == _NONE:
        return []
    return [_quantity("--forces", part.strip(), PositiveForce) for part in text.split(",")]


def _quantity(option: str, text: str, kind: Any) -> float:
    try:
        number: float = TypeAdapter(kind).validate_python(text, context={"file": True})
    except ValidationError as invalid:
        told = invalid.errors(include_url=False)[0]["msg"].removeprefix("Value error, ")
        raise CommandError(f"{option} = {text!r}: {told}.") from None
    return number


def _tell(found: Plan) -> None:
    title = f"{escape(found.inst.name)}: proposed protocol, {found.proposed.seconds:.4g} s"
    blocks = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD)
    for heading in ("begins [s]", "lasts [s]"):
        blocks.add_column(heading, justify="right")
    blocks.add_column("block", overflow="fold")
    for block in found.blocks:
        blocks.add_row(f"{block.begins:.2f}", f"{block.seconds:.2f}", escape(block.candidate.name))
    console.print(blocks)
    table = Table(
        title="predicted 95 % intervals, all parameters open; times as wide by the others",
        title_justify="left",
        box=box.SIMPLE_HEAD,
    )
    table.add_column("wanted", no_wrap=True)
    for heading in ("file", "half width"):
        table.add_column(heading, justify="right", no_wrap=True)
    for one in found.baselines:
        table.add_column(one.name, justify="right", overflow="fold")
    table.add_column("")
    for name in found.wanted:
        ratios = (report.ratio(found, one, name) for one in found.baselines)
        table.add_row(name, *report.shown(found, name), *ratios, "" if found.identifiable(name) else "not identifiable")
    console.print(table)
    for sentence in (*dict.fromkeys(found.unidentifiable.values()), *found.warnings, OPTIMISTIC):
        _say(sentence)


def _say(sentence: str) -> None:
    console.print(sentence, markup=False, highlight=False, soft_wrap=True)
