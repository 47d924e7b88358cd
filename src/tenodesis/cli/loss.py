"""The command that answers what a load takes: ``tenodesis loss``."""

import json
from collections.abc import Sequence
from math import degrees, isfinite
from typing import Annotated, NamedTuple

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

from tenodesis import statics
from tenodesis.cli.common import InstrumentFile, console, load_instrument, note, quantity, table
from tenodesis.cli.coupled import print_coupled_losses
from tenodesis.errors import CommandError
from tenodesis.instrument import ShortForm, expanded
from tenodesis.statics.stroke import settled_stroke
from tenodesis.units import Angle, PositiveForce

_USUAL_LOAD = 1.0  # N
_LEGEND = """\
Handle held, no friction. To bring the tip back, the hand moves the handle by so
much more, or one motor winds the stroke and the other lets it out. Slack from:
the load, raised from none, under which the first tendon goes slack."""
_SLACK_WITHOUT = "no load: a tendon is slack without one."


class Loss(NamedTuple):
    """What a load takes from the tip at a held handle, and what gives it back; SI, NaN where there is none."""

    output_angle: float
    """Unloaded, rad"""
    force: float
    """At the tip, against flexion, N"""
    loaded_angle: float
    lost: float
    """The unloaded minus the loaded angle, rad"""
    handle_correction: float
    """By which the hand would have to move the handle to bring the tip back, rad"""
    stroke: float
    """Length of tendon that one motor winds and the other lets out to bring the tip back, m"""
    agonist: float
    """Tension under the load, handle held, N"""
    antagonist: float
    slack_force: float
    """Force under which the first tendon goes slack, handle held, N; 0 if one is slack without a force"""


_UNITS = ("rad", "N", "rad", "rad", "rad", "m", "N", "N", "N")


def loss(  # noqa: PLR0917
    instrument_file: InstrumentFile,
    load: Annotated[
        list[str] | None,
        typer.Option(
            help="Load at the tip, like '2 N', repeatable. Default: conditions.forces, or 1 N. Of joints that share "
            "tendons: x, y and z in the tip's axes, like '0 0 -1 N'. Default: 1 N along each."
        ),
    ] = None,
    angle: Annotated[
        list[str] | None,
        typer.Option(
            help="Unloaded output angle, like '60 deg', repeatable. Default: straight, half and end of the range. Of "
            "joints that share tendons: one each, like '30 0 15 deg'. Default: straight and half."
        ),
    ] = None,
    moment: Annotated[
        str | None,
        typer.Option(
            help="Moment on the tip beside each load, like '0 0 5 N*mm', of joints that share tendons. Default: none."
        ),
    ] = None,
    grip: Annotated[
        str | None,
        typer.Option(help="Force by which an object presses the jaws apart, like '2 N'. Default: none."),
    ] = None,
    axis: Annotated[
        str | None,
        typer.Option(help="Axis to compute, where yaw and pitch have values of their own. Default: the first."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, in SI units.")] = False,
) -> None:
    """Print the angle that loads take at the tip, what restores it, and the load at which a tendon goes slack."""
    inst = load_instrument(instrument_file)
    if not isinstance(inst, ShortForm):
        if axis is not None:
            raise _no_option("--axis", inst.name, "has joints that share tendons", "left out")
        print_coupled_losses(expanded(inst), load or (), angle or (), moment=moment, grip=grip, as_json=as_json)
        return
    for option, given in (("--moment", moment), ("--grip", grip)):
        if given is not None:
            raise _no_option(option, inst.name, "is planar", "left out, or the instrument list joints and tendons")
    inst = inst.planar[0] if axis is None else inst.axis(axis)
    forces = [quantity("--load", text, PositiveForce) for text in load or ()]
    forces = forces or sorted(inst.conditions.forces) or [_USUAL_LOAD]
    angles = [quantity("--angle", text, Angle) for text in angle or ()]
    _check_angles(inst, angles)
    if not angles:
        end = float(statics.output_angle(inst, statics.reach(inst)))
        angles = [0.0, end / 2, end]
    found = losses(inst, angles, forces)
    if as_json:
        units = dict(zip(Loss._fields, _UNITS, strict=True))
        rows = [{key: value if isfinite(value) else None for key, value in one._asdict().items()} for one in found]
        typer.echo(json.dumps({"instrument": inst.name, "axis": inst.axes[0], "units": units, "rows": rows}, indent=1))
        return
    console.print(_table(inst, found))
    note(_LEGEND)
    if any(one.slack_force == 0 for one in found):
        note(_SLACK_WITHOUT)
    if any(not isfinite(value) for one in found for value in one):
        note(f"–: beyond the handle's ±{degrees(inst.handle_range):.4g}°, or the tip cannot be held under that load.")


def _no_option(option: str, name: str, reason: str, allowed: str) -> CommandError:
    return CommandError(f"{option} is given, but {name} {reason}; it must be {allowed}.", key=option, allowed=allowed)


def losses(inst: ShortForm, angles: Sequence[float], forces: Sequence[float]) -> list[Loss]:
    """Return what each force (N) takes at each unloaded output angle (rad)."""
    found = []
    for force in forces:
        output = np.array(angles)
        handle = statics.handle_angle(inst, output)
        loaded, (agonist, antagonist), _ = statics.equilibrium(inst, handle, force)
        correction = statics.handle_angle(inst, output, force) - handle
        stroke = settled_stroke(inst, handle, force, "differential", "exact")
        slack = statics.slack_load(inst, handle)
        same = np.full_like(output, force)
        columns = (output, same, loaded, output - loaded, correction, stroke, agonist, antagonist, slack)
        found += [Loss(*map(float, row)) for row in zip(*columns, strict=True)]
    return found


def _check_angles(inst: ShortForm, angles: Sequence[float]) -> None:
    for angle in angles:
        if not isfinite(statics.handle_angle(inst, np.array([angle]))[0]):
            end = degrees(float(statics.output_angle(inst, inst.handle_range)))
            raise CommandError(
                key="--angle",
                value=f"{degrees(angle):.6g} deg",
                allowed=f"within ±{end:.4g} deg, which is what the handle reaches",
            )


def _table(inst: ShortForm, found: Sequence[Loss]) -> Table:
    shown = table(f"{escape(inst.name)}, {inst.axes[0]}: what a load takes at the tip", padding=(0, 1, 0, 0))
    for heading in (
        "load\n[N]",
        "tip at\n[°]",
        "falls to\n[°]",
        "lost\n[°]",
        "handle\nby [°]",
        "stroke\n[mm]",
        "agonist\n[N]",
        "antago-\nnist [N]",
        "slack\nfrom [N]",
    ):
        shown.add_column(escape(heading), justify="right", no_wrap=True)
    for n, one in enumerate(found):
        last = n + 1 == len(found) or found[n + 1].force != one.force
        cells = (
            f"{one.force:.4g}",
            _fixed(degrees(one.output_angle), 1),
            _fixed(degrees(one.loaded_angle)),
            _fixed(degrees(one.lost)),
            _fixed(degrees(one.handle_correction)),
            _fixed(1e3 * one.stroke, 3),
            _fixed(one.agonist, 1),
            "slack" if one.antagonist == 0 else _fixed(one.antagonist, 1),
            _fixed(one.slack_force) if one.slack_force != 0 else "no load",
        )
        shown.add_row(*cells, end_section=last)
    return shown


def _fixed(value: float, decimals: int = 2) -> str:
    return f"{round(value, decimals) + 0.0:.{decimals}f}" if isfinite(value) else "–"
