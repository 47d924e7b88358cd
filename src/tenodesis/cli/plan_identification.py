"""The command that proposes a bench protocol for an identification."""

from pathlib import Path
from typing import Annotated

import typer

from tenodesis.cli.command import command
from tenodesis.cli.common import InstrumentFile, ProgressBar, console, load_instrument, quantity, say, table
from tenodesis.cli.outputs import Outputs
from tenodesis.errors import CommandError
from tenodesis.identification.experiment import DURATION, ProposedProtocol, plan, report
from tenodesis.identification.experiment.information import CriterionName
from tenodesis.units import Duration, PositiveForce

_NONE = "none"


@command("instrument_file")
def plan_identification(  # noqa: PLR0917
    outputs: Outputs,
    instrument_file: InstrumentFile,
    want: Annotated[
        str | None, typer.Option(metavar="NAMES", help="Parameters or groups. Default: friction,stiffness,pretension.")
    ] = None,
    duration: Annotated[str, typer.Option(help="Longest duration of the protocol.")] = f"{DURATION:g} s",
    without_distal_encoder: Annotated[
        bool, typer.Option("--without-distal-encoder", help="The bench has no encoder at the tip.")
    ] = False,
    forces: Annotated[
        str | None,
        typer.Option(
            metavar="FORCES", help='Known forces at the tip, "0.5 N,1 N", or none. Default: shares of the slack limit.'
        ),
    ] = None,
    law: Annotated[str | None, typer.Option(help="Friction law. Default: the file's.")] = None,
    criterion: Annotated[CriterionName, typer.Option(help="D: confidence region; A: sum of variances.")] = "D",
    axis: Annotated[str | None, typer.Option(help="Axis to plan for. Default: the first.")] = None,
    out: Annotated[
        Path,
        typer.Option(help="Folder for protocol.toml, plan.html, plan.svg and plan.json; of joints for commands.csv."),
    ] = Path("out/plan-identification"),
) -> None:
    """Propose the bench protocol that makes parameters identifiable, and predict their precision."""
    given = load_instrument(instrument_file)
    words = None if want is None else [word.strip() for word in want.split(",") if word.strip()]
    several = given.short_form is None
    if several and axis is not None:
        raise CommandError(key="--axis", value=axis, allowed="left out: tendons turn several joints")
    inst = given if several else load_instrument(instrument_file, planar=True)
    if axis is not None:
        inst = inst.axis(axis)
    files = (report.COMMANDS,) if several else (report.PROTOCOL, report.PAGE, report.FIGURE)
    with outputs.folder(out, (*files, report.NUMBERS)), ProgressBar("protocols tried") as bar:
        found = plan(
            inst,
            words,
            duration=quantity("--duration", duration, Duration),
            distal_encoder=not without_distal_encoder,
            forces=None if forces is None else _forces(forces),
            law=law,
            criterion=criterion,
            progress=bar,
        )
        written = report.write(found, out)
    _print_plan(found)
    say(f"Written: {', '.join(str(path) for path in written)}")
    if found.protocol is None:
        return
    alone = "" if axis is None else f" --axis {axis}"
    say(f"Record: tenodesis record {instrument_file} {out / report.PROTOCOL}{alone} --out LOG.mcap")
    say(
        f"Identify: tenodesis identify LOG.mcap --instrument {instrument_file} --law {found.law} --fit "
        f"{','.join(found.open)}"
    )


def _forces(text: str) -> list[float]:
    if text.strip() == _NONE:
        return []
    return [quantity("--forces", part.strip(), PositiveForce) for part in text.split(",")]


def _print_plan(found: ProposedProtocol) -> None:
    title = f"{found.inst.name}: proposed protocol, {found.proposed.seconds:.4g} s"
    blocks = ((f"{one.begins:.2f}", f"{one.seconds:.2f}", one.candidate.name) for one in found.blocks)
    console.print(table(title, ">begins [s]", ">lasts [s]", "block", rows=blocks))
    title = "predicted 95 % intervals, all parameters open; times as wide by the others"
    others = (">" + one.name.replace(" ", "\n") for one in found.baselines)
    intervals = table(title, "wanted", ">file", ">half width", *others, "")
    for name in found.wanted:
        ratios = (report.ratio(found, one, name) for one in found.baselines)
        intervals.add_row(
            name, *report.shown(found, name), *ratios, "" if found.identifiable(name) else "not identifiable"
        )
    console.print(intervals)
    for sentence in (*dict.fromkeys(found.unidentifiable.values()), *found.warnings, found.caveat):
        say(sentence)
