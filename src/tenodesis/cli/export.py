"""The commands that write an instrument for other programs: a controller's C header, URDF and MuJoCo."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from tenodesis import control, kinematics
from tenodesis.cli.command import command
from tenodesis.cli.common import AnyLaw, InstrumentFile, load_instrument, refuse_choices
from tenodesis.cli.outputs import HEADER, MJCF, URDF, Outputs, output, write_text
from tenodesis.control.controller import ActuationName, ObserverName
from tenodesis.errors import CommandError
from tenodesis.files import write_errors
from tenodesis.instrument import Instrument, expanded

_OUT = "The file. Default: by the instrument's name."


@command("instrument_file")
def export_controller(  # noqa: PLR0917
    outputs: Outputs,
    instrument_file: InstrumentFile,
    axis: Annotated[str | None, typer.Option(help="Axis to control alone. Default: all.")] = None,
    observer: Annotated[
        ObserverName | None, typer.Option(help="Observer that estimates the tip angle. Default: friction.")
    ] = None,
    law: Annotated[
        AnyLaw | None,
        typer.Option(
            help="Compensation law; joints: of all joints, whatever tendons turn them, which need not home. Default: "
            "robust, or joints where no joint has a pair of tendons of its own."
        ),
    ] = None,
    actuation: Annotated[ActuationName | None, typer.Option(help="Motors that act. Default: differential.")] = None,
    homed: Annotated[
        bool,
        typer.Option(
            "--homed/--not-homed", help="Spools start at the pretension, or at unknown angles, and home first."
        ),
    ] = False,
    own_clock: Annotated[bool, typer.Option("--own-clock", help="Ticks count as one period each.")] = False,
    name: Annotated[str | None, typer.Option(help="Of the constant in C. Default: the instrument's.")] = None,
    out: Annotated[Path | None, output(HEADER, "The file. Default: NAME.h.")] = None,
) -> None:
    """Write a controller's parameters as a C header, for tenodesis_init or tenodesis_joints_init."""
    given = load_instrument(instrument_file)
    write: Callable[..., None]
    if law == "joints" or (law in (None, "off") and not control.pairs(given)):
        choices = {"--axis": axis, "--observer": observer, "--actuation": actuation}
        refuse_choices("the law of all joints has one of its own", choices)
        inst, call = given, "tenodesis_joints_init"
        served = ", ".join(joint.name for joint in expanded(given).tip_joints)
        write = partial(control.export_joints_header, law="off" if law == "off" else "joints")
    else:
        inst = control.compensated(given)
        inst = inst if axis is None else inst.axis(axis)
        call, served = "tenodesis_init", " and ".join(inst.axes)
        acting = actuation or "differential"
        write = partial(
            control.export_header, observer=observer or "friction", law=law or "robust", actuation=acting, homed=homed
        )
    name = control.identifier(inst.name) if name is None else name
    path = Path(f"{name}.h") if out is None else out
    with outputs.files(out=path), write_errors(path, CommandError):
        write(inst, path, name, own_clock=own_clock, source=instrument_file)
    typer.echo(f"{path}: {name}, the controller of {inst.name} ({served}), for {call}.")


@command("instrument_file")
def export_urdf(
    outputs: Outputs, instrument_file: InstrumentFile, out: Annotated[Path | None, output(URDF, _OUT)] = None
) -> None:
    """Write an instrument as a URDF robot: links, joints, mimics; no tendons. Says what is missing."""
    _export(instrument_file, kinematics.urdf, ".urdf", out, outputs)


@command("instrument_file")
def export_mjcf(
    outputs: Outputs, instrument_file: InstrumentFile, out: Annotated[Path | None, output(MJCF, _OUT)] = None
) -> None:
    """Write an instrument as a MuJoCo model: bodies, tied joints, tendons. Says what is missing."""
    _export(instrument_file, kinematics.mjcf, ".xml", out, outputs)


def _export(
    source: str, written: Callable[[Instrument], str], extension: str, out: Path | None, outputs: Outputs
) -> None:
    inst = load_instrument(source)
    path = Path(f"{inst.name.replace(' ', '-').replace('/', '-')}{extension}") if out is None else out
    text = written(inst)
    with outputs.files(out=path):
        write_text(path, text)
    joints = [joint.name for joint in expanded(inst).joints]
    typer.echo(f"{path}: {inst.name} ({', '.join(joints)}). Its first lines repeat what the format does not contain:")
    note = text[: text.index("-->")]
    typer.echo(note[note.index("\n- ") + 1 :].strip())
