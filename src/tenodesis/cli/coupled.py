"""What ``tenodesis check`` and ``tenodesis loss`` print of instruments whose joints share tendons."""

import json
from collections.abc import Iterable, Sequence
from itertools import groupby
from math import degrees, isfinite
from typing import Any

import numpy as np
import typer
from numpy.typing import ArrayLike, NDArray
from rich.markup import escape
from rich.table import Table

from tenodesis import coupled, statics
from tenodesis.cli.common import console, note, quantity, say, table, warn
from tenodesis.coupled import CoupledInstrument, Joint, Loss, Tendon
from tenodesis.errors import CommandError, NoSolutionError
from tenodesis.units import Angle, PositiveForce, SignedForce, SignedMoment

Array = NDArray[np.float64]

_UNITS = {
    "wrench": "N, N*m", "grip_force": "N", "output_angles": "rad", "loaded_angles": "rad", "lost": "rad",
    "tensions": "N", "strokes": "m", "handle_corrections": "rad", "slack_factor": "1", "slack_tendon": "",
}  # fmt: skip
_LEGEND = """\
Forces at the tip in its own axes: z along it, x where positive yaw bends, y
where positive pitch does. Handle and motors held, no friction. Lost: the
unloaded minus the loaded angle. The last columns have the multiple of the load,
raised from none, under which the first tendon goes slack, and that tendon."""
_RESTORED = "What motors wind to bring all joints back [mm]"


def print_coupled(inst: CoupledInstrument, *, as_json: bool) -> None:
    """Print what `check` says of a coupled instrument."""
    found = losses(inst, statics.usual_states(inst), np.eye(3, 6))
    doubts = coupled.implausible(inst)
    if as_json:
        typer.echo(json.dumps(_as_json(inst, found, doubts), indent=1, ensure_ascii=False))
        return
    tips, handles = len(inst.tip_joints), len(inst.handle_joints)
    say(
        f"{inst.name}: {_count(tips, 'joint')} at the tip, {handles or 'none'} at the handle, "
        f"{_count(len(inst.tendons), 'tendon')}" + (f". {inst.description}" * bool(inst.description))
    )
    _print("Joints", _joints(inst))
    _print("Tendons", _tendons(inst))
    joints = (*inst.handle_joints[::-1], *inst.tip_joints)
    arms = np.hstack([coupled.straight_arms(inst, "handle")[:, ::-1], coupled.straight_arms(inst)])
    names = [tendon.name for tendon in inst.tendons]
    tip_names = [joint.name for joint in inst.tip_joints]
    _print("Moment arms of the straight joints [mm]", _matrix(names, [j.name for j in joints], 1e3 * arms))
    per_mm = np.degrees(coupled.coupling(inst)) * 1e-3
    _print("Coupling: angles by drawn tendon, taut and without stretch [°/mm]", _matrix(names, tip_names, per_mm.T))
    if (rates := _rates(inst)) is not None:
        _print("Stiffness at rest: moment by angle [N·m/rad]", _matrix(tip_names, tip_names, rates.stiffness))
        if handles:
            handle_names = [joint.name for joint in inst.handle_joints]
            _print("Angles by angles of the handle, at rest", _matrix(tip_names, handle_names, rates.by_handle))
    _print_losses(inst, found)
    for doubt in doubts:
        warn(doubt.sentence)


def print_coupled_losses(
    inst: CoupledInstrument,
    load: Sequence[str],
    angle: Sequence[str],
    *,
    moment: str | None,
    grip: str | None,
    as_json: bool,
) -> None:
    """Print what `loss` says of a coupled instrument; options as the command has them."""
    forces = np.array([_numbers("--load", text, SignedForce, 3, "0 0 -1 N") for text in load] or np.eye(3))
    states = [_numbers("--angle", text, Angle, len(inst.tip_joints), _example(inst)) for text in angle]
    _check_angles(inst, states)
    beside = np.zeros(3) if moment is None else _numbers("--moment", moment, SignedMoment, 3, "0 0 5 N*mm")
    wrenches = np.hstack([forces, np.broadcast_to(beside, forces.shape)])
    pressing = 0.0 if grip is None else quantity("--grip", grip, PositiveForce)
    if grip is not None and inst.grip is None:
        raise CommandError(
            f"--grip is given, but {inst.name} has nothing that grips; its file must have a table [grip].",
            key="--grip",
            value=grip,
        )
    found = losses(inst, states or statics.usual_states(inst), wrenches, pressing)
    if as_json:
        typer.echo(json.dumps(_losses_as_json(inst, found), indent=1))
        return
    beside_each = f"moment {moment}" * (moment is not None), f"grip {grip}" * (grip is not None)
    if any(beside_each):
        say(f"Beside each load: {', '.join(filter(None, beside_each))}.")
    _print_losses(inst, found, restored=True)


def losses(
    inst: CoupledInstrument, states: Iterable[ArrayLike], wrenches: ArrayLike, grip_force: float = 0.0
) -> list[Loss]:
    """Return what each load takes at each state, as far as the unloaded instrument can be held there."""
    rows = np.asarray(wrenches, float)
    return [coupled.loss(inst, state, wrench, grip_force) for state in states for wrench in rows]


def _rates(inst: CoupledInstrument) -> coupled.Rates | None:
    try:
        return coupled.rates(inst, np.zeros(len(inst.handle_joints)))
    except NoSolutionError:
        return None


def _joints(inst: CoupledInstrument) -> Table:
    shown = _table()
    for heading in ("joint", "stands on", "mechanism", "axis", "radius [mm]", "range [°]"):
        shown.add_column(escape(heading), justify="right" if "[" in heading else "left", overflow="fold")
    for joint, on in [*zip(inst.handle_joints[::-1], _handle_bases(inst), strict=True), *_tip_bases(inst)]:
        axis = joint.axis if isinstance(joint.axis, str) else _components(joint.axis_vector)
        cells = (joint.name, on, joint.mechanism, axis, f"{1e3 * joint.radius:.4g}", f"±{degrees(joint.range):.4g}")
        shown.add_row(*map(escape, cells))
    return shown


def _handle_bases(inst: CoupledInstrument) -> list[str]:
    """Return what each of the handle's joints stands on, the outermost first."""
    names = [joint.name for joint in inst.handle_joints]
    return [joint.on or before for joint, before in zip(inst.handle_joints, ["stem", *names], strict=False)][::-1]


def _tip_bases(inst: CoupledInstrument) -> list[tuple[Joint, str]]:
    tips = inst.tip_joints
    return [(joint, "stem" if on < 0 else tips[on].name) for joint, on in zip(tips, inst.parents, strict=True)]


def _tendons(inst: CoupledInstrument) -> Table:
    shown = _table()
    shown.add_column("tendon", no_wrap=True)
    shown.add_column("route")
    shown.add_column(escape("stiffness\n[N/mm]"), justify="right")
    shown.add_column(escape("pretension\n[N]"), justify="right")
    for tendon, stiffness, tension in zip(inst.tendons, inst.stiffnesses, inst.pretensions, strict=True):
        cells = (tendon.name, route(inst, tendon), f"{1e-3 * stiffness:.4g}", f"{tension:.4g}")
        shown.add_row(*map(escape, cells))
    return shown


def route(inst: CoupledInstrument, tendon: Tendon) -> str:
    """Return a tendon's route in words, from its start to its end."""
    radii = {joint.name: joint.radius for joint in inst.joints}
    words: list[str] = [tendon.start]
    for crossing in tendon.route:
        radius = radii[crossing.joint] if crossing.radius is None else crossing.radius
        at = "" if crossing.side == "middle" else f" at {1e3 * radius:.4g} mm"
        wrap = f", wrap {degrees(crossing.base_wrap):.4g}°" if crossing.base_wrap else ""
        words.append(f"{crossing.joint} {crossing.side}{at}{wrap}")
    return f"{' → '.join(words)} → end"


def _matrix(rows: Sequence[str], columns: Sequence[str], values: Array, corner: str = "") -> Table:
    shown = _table()
    shown.add_column(escape(corner), no_wrap=True)
    for heading in columns:
        shown.add_column(escape(heading), justify="right", overflow="fold")
    none = 1e-9 * np.nanmax(np.abs(values), initial=0.0)
    for name, row in zip(rows, values, strict=True):
        shown.add_row(escape(name), *("–" if np.isnan(v) else "·" if abs(v) <= none else f"{v:.3g}" for v in row))
    return shown


def _print_losses(inst: CoupledInstrument, found: Sequence[Loss], *, restored: bool = False) -> None:
    """Print a table for each state: what each load takes, and on demand what motors wind to restore it."""
    for _, state in groupby(found, key=lambda one: one.output_angles.tolist()):
        rows = list(state)
        shown = _table()
        for heading in ("load [N]", *(f"{joint.name}\n[°]" for joint in inst.tip_joints), "slack from", "tendon"):
            shown.add_column(escape(heading), justify="right", overflow="fold")
        for one in rows:
            lost = [_fixed(degrees(angle)) for angle in one.lost]
            factor = f"{one.slack_factor:.3g} times" if one.slack_factor else "no load"
            factor = factor if one.slack_tendon else "–"
            shown.add_row(_components(one.wrench[:3]), *lost, factor, escape(one.slack_tendon))
        _print(f"Lost at {_at(inst, rows[0])}", shown)
        if restored:
            strokes = 1e3 * np.array([one.strokes for one in rows]).T
            loads = [_components(one.wrench[:3]) for one in rows]
            _print(_RESTORED, _matrix([tendon.name for tendon in inst.tendons], loads, strokes, "load [N]"))
    note(_LEGEND)
    if any(not isfinite(value) for one in found for value in (*one.lost, *one.strokes)):
        note("–: the tip cannot be held under that load.")


def _at(inst: CoupledInstrument, one: Loss) -> str:
    angles = zip(inst.tip_joints, one.output_angles, strict=True)
    return ", ".join(f"{joint.name} {_fixed(degrees(angle), 1)}°" for joint, angle in angles)


def _print(title: str, shown: Table) -> None:
    """Print a table below its title, however narrow it is."""
    say(title)
    console.print(shown)


def _table() -> Table:
    return table(padding=(0, 1, 0, 0))


def _as_json(inst: CoupledInstrument, found: Sequence[Loss], doubts: Sequence[coupled.Doubt]) -> dict[str, Any]:
    rates = _rates(inst)
    bases = dict(zip([joint.name for joint in inst.handle_joints[::-1]], _handle_bases(inst), strict=True))
    bases |= {joint.name: on for joint, on in _tip_bases(inst)}
    return {
        "name": inst.name,
        "description": inst.description,
        "joints": [
            joint.model_dump(exclude_none=True) | {"on": bases[joint.name], "axis": joint.axis_vector}
            for joint in inst.joints
        ],
        "tendons": [
            tendon.model_dump(exclude_none=True)
            | {"stiffness": stiffness, "pretension": tension, "in_words": route(inst, tendon)}
            for tendon, stiffness, tension in zip(
                inst.tendons, inst.stiffnesses.tolist(), inst.pretensions.tolist(), strict=True
            )
        ],
        "arms": coupled.straight_arms(inst).tolist(),
        "handle_arms": coupled.straight_arms(inst, "handle").tolist(),
        "coupling": coupled.coupling(inst).tolist(),
        "stiffness": None if rates is None else rates.stiffness.tolist(),
        "by_handle": None if rates is None else rates.by_handle.tolist(),
        "losses": _losses_as_json(inst, found),
        "warnings": [doubt._asdict() for doubt in doubts],
    }


def _losses_as_json(inst: CoupledInstrument, found: Sequence[Loss]) -> dict[str, Any]:
    def plain(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            return [plain(item) for item in value.tolist()]
        return None if isinstance(value, float) and not isfinite(value) else value

    return {
        "instrument": inst.name,
        "joints": [joint.name for joint in inst.tip_joints],
        "tendons": [tendon.name for tendon in inst.tendons],
        "units": _UNITS,
        "rows": [{key: plain(value) for key, value in one._asdict().items()} for one in found],
    }


def _numbers(option: str, text: str, kind: Any, count: int, example: str) -> Array:
    """Return several quantities of one unit, "0 0 -1 N", in SI."""
    *numbers, unit = text.split() or [""]
    if len(numbers) != count:
        raise CommandError(
            f"{option} = {text!r}: it must be {_count(count, 'number')} and a unit, like '{example}'.",
            key=option,
            value=text,
            allowed=f"{_count(count, 'number')} and a unit",
        )
    return np.array([quantity(option, f"{number} {unit}", kind) for number in numbers])


def _check_angles(inst: CoupledInstrument, states: Iterable[Array]) -> None:
    for state in states:
        for joint, angle in zip(inst.tip_joints, state, strict=True):
            if abs(angle) > joint.range + 1e-9:
                raise CommandError(
                    key=f"--angle of {joint.name}",
                    value=f"{degrees(angle):.6g} deg",
                    allowed=f"within its range of ±{degrees(joint.range):.4g} deg",
                )


def _example(inst: CoupledInstrument) -> str:
    return f"{' '.join(['30', *['0'] * (len(inst.tip_joints) - 1)])} deg"


def _components(values: ArrayLike) -> str:
    return " ".join(f"{value:.3g}" for value in np.asarray(values, float))


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'s' * (number != 1)}"


def _fixed(value: float, decimals: int = 2) -> str:
    return f"{round(value, decimals) + 0.0:.{decimals}f}" if isfinite(value) else "–"
