"""The command that answers what a load takes: ``tenodesis loss``."""

from collections.abc import Iterable, Sequence
from itertools import groupby
from math import degrees, isfinite
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import ArrayLike, NDArray
from rich.markup import escape

from tenodesis import statics
from tenodesis.cli.command import Answer, command
from tenodesis.cli.common import InstrumentFile, components, console, load_instrument, note, quantity, say, table
from tenodesis.errors import CommandError
from tenodesis.instrument import FullForm
from tenodesis.statics import Loss
from tenodesis.statics.bends import Bends
from tenodesis.units import Angle, PositiveForce, SignedForce, SignedMoment

Array = NDArray[np.float64]

_USUAL_LOAD = 1.0  # N
_BESIDE = 4
"""Loads that 80 columns have room for beside the names of tendons."""
_SHARES = (0.5, 1.0)
"""Of the range, beside the straight tip, if no angles are asked for."""
_LEGEND = """\
Forces at the tip in its own axes: z along it, x where positive yaw bends, y
where positive pitch does. Handle and motors held, no friction. Lost: the
unloaded minus the loaded angle; back by: what the hand would move the handle
by, or the motors wind, to bring all joints back. Slack from: the multiple of
the load, raised from none, under which the first tendon goes slack."""
_UNITS = {
    "wrench": "N, N*m", "grip_force": "N", "output_angles": "rad", "loaded_angles": "rad", "lost": "rad",
    "tensions": "N", "strokes": "m", "handle_corrections": "rad", "slack_factor": "1", "slack_tendon": "",
}  # fmt: skip


@command(json="Print JSON, in SI units.")
def loss(  # noqa: PLR0917
    instrument_file: InstrumentFile,
    load: Annotated[
        list[str] | None,
        typer.Option(
            help="Load at the tip: x, y and z in its axes, like '0 0 -1 N', repeatable. Default: 1 N along each. Of "
            "planar axes also like '2 N', against flexion of each. Default: conditions.forces, or 1 N."
        ),
    ] = None,
    angle: Annotated[
        list[str] | None,
        typer.Option(
            help="Unloaded output angle, like '60 deg', repeatable; of several joints one each, like '30 0 15 deg'. "
            "Default: straight, half and end of the range."
        ),
    ] = None,
    moment: Annotated[
        str | None,
        typer.Option(help="Moment on the tip beside each load, like '0 0 5 N*mm'. Default: none."),
    ] = None,
    grip: Annotated[
        str | None, typer.Option(help="Force by which an object presses the jaws apart, like '2 N'. Default: none.")
    ] = None,
    axis: Annotated[
        str | None, typer.Option(help="One axis of two, as if the other were rigid. Default: both.")
    ] = None,
) -> Answer:
    """Print the angle that loads take at the tip, what restores it, and the load at which a tendon goes slack."""
    given = load_instrument(instrument_file)
    planar = given.short_form
    if axis is not None and planar is None:
        raise _no_option("--axis", given.name, "has joints that share tendons", "left out")
    inst = given.expanded if axis is None or planar is None else planar.axis(axis).expanded
    count = len(inst.bends)
    example = f"{' '.join(['30', *['0'] * (count - 1)])} deg"
    forces = _forces(inst, load or (), planar=planar is not None)
    alike = [
        f"{' '.join([text.split()[0]] * count)} {text.split()[-1]}" if planar and len(text.split()) == 2 else text
        for text in angle or ()
    ]
    states = [inst.bent(_numbers("--angle", text, Angle, count, example)) for text in alike]
    _check_within_stops(inst, states)
    beside = np.zeros(3) if moment is None else _numbers("--moment", moment, SignedMoment, 3, "0 0 5 N*mm")
    wrenches = np.hstack([forces, np.broadcast_to(beside, forces.shape)])
    pressing = 0.0 if grip is None else quantity("--grip", grip, PositiveForce)
    if grip is not None and inst.grip is None:
        raise _no_option("--grip", inst.name, "has nothing that grips", "left out, or its file have a table [grip]")
    found = losses(inst, states or statics.usual_states(inst, _SHARES), wrenches, pressing)

    def show() -> None:
        beside_each = [f"{name} {text}" for name, text in (("moment", moment), ("grip", grip)) if text is not None]
        if beside_each:
            say(f"Beside each load: {', '.join(beside_each)}.")
        print_losses(inst, found)

    return Answer(lambda: losses_as_json(inst, found), show)


def _forces(inst: FullForm, given: Sequence[str], *, planar: bool) -> Array:
    """Return loads on joints, (n, 3), N; where one thing bends, or planar axes, single forces are against flexion."""
    axes = [inst.tip_joints[places[0]].axis for places in inst.bends.values()]
    across = [0.0 - np.eye(3)[("yaw", "pitch").index(axis)] for axis in axes if axis in {"yaw", "pitch"}]
    single = planar or (len(axes) == 1 and bool(across))
    if not given and not single:
        return np.eye(3)
    texts = given or [f"{force:.17g} N" for force in sorted(inst.conditions.forces) or [_USUAL_LOAD]]
    rows: list[Array] = []
    for text in texts:
        if single and len(text.split()) < 3:
            rows += [quantity("--load", text, PositiveForce) * one for one in across]
        else:
            rows.append(_numbers("--load", text, SignedForce, 3, "0 0 -1 N"))
    return np.array(rows)


def losses(inst: FullForm, states: Iterable[ArrayLike], wrenches: ArrayLike, grip_force: float = 0.0) -> list[Loss]:
    """Return what each load takes at each state, as far as the unloaded instrument can be held there."""
    rows = np.asarray(wrenches, float)
    return [statics.loss(inst, state, wrench, grip_force) for state in states for wrench in rows]


def losses_as_json(inst: FullForm, found: Sequence[Loss]) -> dict[str, Any]:
    """Return what loads take from joints as JSON has it."""
    return {
        "instrument": inst.name,
        "joints": [joint.name for joint in inst.tip_joints],
        "tendons": [tendon.name for tendon in inst.tendons],
        "units": _UNITS,
        "rows": [one._asdict() for one in found],
    }


def print_losses(inst: FullForm, found: Sequence[Loss]) -> None:
    """Print tables for each state: what each load takes, what restores it, and the tensions under it."""
    bends = Bends.of(inst)
    for _, state in groupby(found, key=lambda one: one.output_angles.tolist()):
        rows = list(state)
        at = dict(zip(bends.names, bends.summed(rows[0].output_angles).tolist(), strict=True))
        shown = table(f"{inst.name} at {', '.join(f'{name} {_fixed(degrees(one), 1)}°' for name, one in at.items())}")
        for heading in ("load [N]", *(f"{name} lost [°]" for name in bends.names), "slack from"):
            shown.add_column(escape(heading), justify="right")
        shown.add_column("tendon", no_wrap=True)
        for one in rows:
            lost = [_fixed(angle) for angle in np.degrees(bends.summed(one.lost))]
            shown.add_row(components(one.wrench[:3]), *lost, _slack(one), escape(one.slack_tendon) or "–")
        console.print(shown)
        # As many loads beside each other as have room.
        for begin in range(0, len(rows), _BESIDE):
            _print_under(inst, bends, rows[begin : begin + _BESIDE])
    note(_LEGEND)
    if any(not isfinite(value) for one in found for value in (*one.lost, *one.strokes)):
        note("–: the tip cannot be held under that load.")


def _print_under(inst: FullForm, bends: Bends, rows: Sequence[Loss]) -> None:
    """Print what the angles and tensions are under loads, and what restores the angles, a column a load."""
    shown = table()
    shown.add_column("load [N]", no_wrap=True)
    for one in rows:
        shown.add_column(components(one.wrench[:3]), justify="right", no_wrap=True)
    tips, handles, tendons = (bends.names, *([one.name for one in of] for of in (inst.handle_joints, inst.tendons)))
    for what, names, values, decimals in (
        ("falls to [°]", tips, [np.degrees(bends.summed(one.loaded_angles)) for one in rows], 2),
        ("back by [°]", handles, [np.degrees(one.handle_corrections) for one in rows], 2),
        ("back by [mm]", tendons, [1e3 * one.strokes for one in rows], 3),
        ("tension [N]", tendons, [one.tensions for one in rows], 1),
    ):
        for name, row in zip(names, np.array(values).T, strict=True):
            shown.add_row(f"{escape(name)} {escape(what)}", *(_fixed(value, decimals) for value in row))
    console.print(shown)


def _slack(one: Loss) -> str:
    if not one.slack_tendon:
        return "–"
    return f"{one.slack_factor:.3g} times" if one.slack_factor else "no load"


def _no_option(option: str, name: str, reason: str, allowed: str) -> CommandError:
    return CommandError(f"{option} is given, but {name} {reason}; it must be {allowed}.", key=option, allowed=allowed)


def _check_within_stops(inst: FullForm, states: Iterable[Array]) -> None:
    for state in states:
        for joint, angle in zip(inst.tip_joints, state, strict=True):
            low, high = joint.stops
            if not low - 1e-9 <= angle <= high + 1e-9:
                raise CommandError(
                    key=f"--angle of {joint.name}",
                    value=f"{degrees(angle):.6g} deg",
                    allowed=f"between its stops at {degrees(low):.4g} and {degrees(high):.4g} deg",
                )


def _numbers(option: str, text: str, kind: Any, count: int, example: str) -> Array:
    """Return several quantities of one unit, "0 0 -1 N", in SI."""
    *numbers, unit = text.split() or [""]
    if len(numbers) != count:
        allowed = f"{count} number{'s' * (count != 1)} and a unit"
        raise CommandError(
            f"{option} = {text!r}: it must be {allowed}, like '{example}'.", key=option, value=text, allowed=allowed
        )
    return np.array([quantity(option, f"{number} {unit}", kind) for number in numbers])


def _fixed(value: float, decimals: int = 2) -> str:
    return f"{round(value, decimals) + 0.0:.{decimals}f}" if isfinite(value) else "–"
