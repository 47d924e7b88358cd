"""The command that answers what a load takes: ``tenodesis loss``."""

from collections.abc import Iterable, Sequence
from itertools import groupby
from math import degrees, isfinite
from typing import Annotated, Any, NamedTuple

import numpy as np
import typer
from numpy.typing import ArrayLike, NDArray
from rich.markup import escape
from rich.table import Table

from tenodesis import statics
from tenodesis.cli.command import Answer, command
from tenodesis.cli.common import (
    InstrumentFile,
    components,
    console,
    load_instrument,
    matrix,
    note,
    quantity,
    say,
    table,
)
from tenodesis.errors import CommandError
from tenodesis.instrument import FullForm, ShortForm
from tenodesis.statics import Loss
from tenodesis.statics.stroke import settled_stroke
from tenodesis.units import Angle, PositiveForce, SignedForce, SignedMoment

Array = NDArray[np.float64]

_USUAL_LOAD = 1.0  # N
_LEGEND = """\
Handle held, no friction. To bring the tip back, the hand moves the handle by so
much more, or one motor winds the stroke and the other lets it out. Slack from:
the load, raised from none, under which the first tendon goes slack."""
_SLACK_WITHOUT = "no load: a tendon is slack without one."
_LEGEND_OF_JOINTS = """\
Forces at the tip in its own axes: z along it, x where positive yaw bends, y
where positive pitch does. Handle and motors held, no friction. Lost: the
unloaded minus the loaded angle. The last columns have the multiple of the load,
raised from none, under which the first tendon goes slack, and that tendon."""
_RESTORED = "What motors wind to bring all joints back [mm]"
_UNITS_OF_JOINTS = {
    "wrench": "N, N*m", "grip_force": "N", "output_angles": "rad", "loaded_angles": "rad", "lost": "rad",
    "tensions": "N", "strokes": "m", "handle_corrections": "rad", "slack_factor": "1", "slack_tendon": "",
}  # fmt: skip


class AxisLoss(NamedTuple):
    """What a load takes from an axis at a held handle, and what gives it back; SI, NaN where there is none."""

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


_UNITS = dict(zip(AxisLoss._fields, ("rad", "N", "rad", "rad", "rad", "m", "N", "N", "N"), strict=True))


class Asked(NamedTuple):
    """What the options of the command ask for, as text."""

    load: Sequence[str]
    angle: Sequence[str]
    moment: str | None
    grip: str | None
    axis: str | None


@command(json="Print JSON, in SI units.")
def loss(  # noqa: PLR0917
    instrument_file: InstrumentFile,
    load: Annotated[
        list[str] | None,
        typer.Option(
            help="Load at the tip, like '2 N', repeatable. Default: conditions.forces, or 1 N. Of joints that share "
            "tendons, and of two axes: x, y and z in the tip's axes, like '0 0 -1 N'. Default: 1 N along each."
        ),
    ] = None,
    angle: Annotated[
        list[str] | None,
        typer.Option(
            help="Unloaded output angle, like '60 deg', repeatable. Default: straight, half and end of the range. Of "
            "several joints: one each, like '30 0 15 deg'. Default: straight and half."
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
    inst = load_instrument(instrument_file)
    asked = Asked(load or (), angle or (), moment, grip, axis)
    short = inst.short_form
    if short is None or (len(short.axes) > 1 and axis is None):
        return _of_joints(inst.expanded, asked, planar=short is not None)
    one = short.planar[0] if axis is None else short.axis(axis)
    if moment is not None or grip is not None:
        return _of_joints(one.expanded, asked._replace(axis=None), planar=True)
    return _of_axis(one, asked)


def _of_axis(inst: ShortForm, asked: Asked) -> Answer:
    forces = [quantity("--load", text, PositiveForce) for text in asked.load]
    forces = forces or sorted(inst.conditions.forces) or [_USUAL_LOAD]
    angles = [quantity("--angle", text, Angle) for text in asked.angle]
    _check_reached(inst, angles)
    if not angles:
        end = float(statics.output_angle(inst, statics.reach(inst)))
        angles = [0.0, end / 2, end]
    found = losses(inst, angles, forces)

    def show() -> None:
        console.print(_table(inst, found))
        note(_LEGEND)
        if any(one.slack_force == 0 for one in found):
            note(_SLACK_WITHOUT)
        if any(not isfinite(value) for one in found for value in one):
            note(
                f"–: beyond the handle's ±{degrees(inst.handle_range):.4g}°, or the tip cannot be held under that load."
            )

    rows = [_plain(one) for one in found]
    return Answer(lambda: {"instrument": inst.name, "axis": inst.axes[0], "units": _UNITS, "rows": rows}, show)


def _of_joints(inst: FullForm, asked: Asked, *, planar: bool) -> Answer:
    """Return what is asked of all joints at once; those of planar axes also take one force or angle for each."""
    if asked.axis is not None:
        raise _no_option("--axis", inst.name, "has joints that share tendons", "left out")
    count = len(inst.bends)
    example = f"{' '.join(['30', *['0'] * (count - 1)])} deg"
    forces = _forces(inst, asked.load, planar=planar)
    alike = [
        f"{' '.join([text.split()[0]] * count)} {text.split()[-1]}" if planar and len(text.split()) == 2 else text
        for text in asked.angle
    ]
    states = [inst.bent(_numbers("--angle", text, Angle, count, example)) for text in alike]
    _check_within_range(inst, states)
    beside = np.zeros(3) if asked.moment is None else _numbers("--moment", asked.moment, SignedMoment, 3, "0 0 5 N*mm")
    wrenches = np.hstack([forces, np.broadcast_to(beside, forces.shape)])
    pressing = 0.0 if asked.grip is None else quantity("--grip", asked.grip, PositiveForce)
    if asked.grip is not None and inst.grip is None:
        raise _no_option("--grip", inst.name, "has nothing that grips", "left out, or its file have a table [grip]")
    found = losses_of_joints(inst, states or statics.usual_states(inst), wrenches, pressing)

    def show() -> None:
        given = {"moment": asked.moment, "grip": asked.grip}
        beside_each = [f"{name} {text}" for name, text in given.items() if text is not None]
        if beside_each:
            say(f"Beside each load: {', '.join(beside_each)}.")
        print_losses(inst, found, restored=True)

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


def losses(inst: ShortForm, angles: Sequence[float], forces: Sequence[float]) -> list[AxisLoss]:
    """Return what each force (N) takes from a planar instrument at each unloaded output angle (rad)."""
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
        found += [AxisLoss(*map(float, row)) for row in zip(*columns, strict=True)]
    return found


def losses_of_joints(
    inst: FullForm, states: Iterable[ArrayLike], wrenches: ArrayLike, grip_force: float = 0.0
) -> list[Loss]:
    """Return what each load takes at each state, as far as the unloaded instrument can be held there."""
    rows = np.asarray(wrenches, float)
    return [statics.loss(inst, state, wrench, grip_force) for state in states for wrench in rows]


def losses_as_json(inst: FullForm, found: Sequence[Loss]) -> dict[str, Any]:
    """Return what loads take from joints as JSON has it."""
    return {
        "instrument": inst.name,
        "joints": [joint.name for joint in inst.tip_joints],
        "tendons": [tendon.name for tendon in inst.tendons],
        "units": _UNITS_OF_JOINTS,
        "rows": [_plain(one) for one in found],
    }


def print_losses(inst: FullForm, found: Sequence[Loss], *, restored: bool = False) -> None:
    """Print a table for each state: what each load takes, and on demand what motors wind to restore it."""
    for _, state in groupby(found, key=lambda one: one.output_angles.tolist()):
        rows = list(state)
        angles = (f">{name}\n[°]" for name in inst.bends)
        shown = table(None, ">load [N]", *angles, ">slack from", ">tendon")
        for one in rows:
            lost = [_fixed(degrees(one.lost[arcs].sum())) for arcs in inst.bends.values()]
            factor = f"{one.slack_factor:.3g} times" if one.slack_factor else "no load"
            factor = factor if one.slack_tendon else "–"
            shown.add_row(components(one.wrench[:3]), *lost, factor, escape(one.slack_tendon))
        at = {name: rows[0].output_angles[arcs].sum() for name, arcs in inst.bends.items()}
        say(f"Lost at {', '.join(f'{name} {_fixed(degrees(angle), 1)}°' for name, angle in at.items())}")
        console.print(shown)
        if restored:
            strokes = 1e3 * np.array([one.strokes for one in rows]).T
            loads = [components(one.wrench[:3]) for one in rows]
            say(_RESTORED)
            console.print(matrix([tendon.name for tendon in inst.tendons], loads, strokes, "load [N]"))
    note(_LEGEND_OF_JOINTS)
    if any(not isfinite(value) for one in found for value in (*one.lost, *one.strokes)):
        note("–: the tip cannot be held under that load.")


def _no_option(option: str, name: str, reason: str, allowed: str) -> CommandError:
    return CommandError(f"{option} is given, but {name} {reason}; it must be {allowed}.", key=option, allowed=allowed)


def _check_reached(inst: ShortForm, angles: Sequence[float]) -> None:
    for angle in angles:
        if not isfinite(statics.handle_angle(inst, np.array([angle]))[0]):
            end = degrees(float(statics.output_angle(inst, inst.handle_range)))
            raise CommandError(
                key="--angle",
                value=f"{degrees(angle):.6g} deg",
                allowed=f"within ±{end:.4g} deg, which is what the handle reaches",
            )


def _check_within_range(inst: FullForm, states: Iterable[Array]) -> None:
    for state in states:
        for joint, angle in zip(inst.tip_joints, state, strict=True):
            low, high = joint.limits
            if not low - 1e-9 <= angle <= high + 1e-9:
                raise CommandError(
                    key=f"--angle of {joint.name}",
                    value=f"{degrees(angle):.6g} deg",
                    allowed=f"within its range from {degrees(low):.4g} to {degrees(high):.4g} deg",
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


def _table(inst: ShortForm, found: Sequence[AxisLoss]) -> Table:
    shown = table(
        f"{inst.name}, {inst.axes[0]}: what a load takes at the tip", ">load\n[N]", ">tip at\n[°]", ">falls to\n[°]",
        ">lost\n[°]", ">handle\nby [°]", ">stroke\n[mm]", ">agonist\n[N]", ">antago-\nnist [N]", ">slack\nfrom [N]",
    )  # fmt: skip
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


def _plain(row: AxisLoss | Loss) -> dict[str, Any]:
    """Return a row as JSON has it: arrays as lists, None where there is no number."""

    def plain(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            return [plain(item) for item in value.tolist()]
        return None if isinstance(value, float) and not isfinite(value) else value

    return {key: plain(value) for key, value in row._asdict().items()}


def _fixed(value: float, decimals: int = 2) -> str:
    return f"{round(value, decimals) + 0.0:.{decimals}f}" if isfinite(value) else "–"
