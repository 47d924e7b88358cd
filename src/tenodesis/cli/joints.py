"""Joints, tendons and what follows from them, as ``tenodesis check`` prints them."""

from collections.abc import Sequence
from math import degrees
from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from tenodesis import statics
from tenodesis.cli.common import components, console, matrix, say, table
from tenodesis.cli.loss import losses_as_json, print_losses
from tenodesis.errors import NoSolutionError
from tenodesis.instrument import FullForm, Tendon, in_arcs
from tenodesis.statics import Loss, Rates
from tenodesis.statics.bends import Bends, straight_arms


def rates_at_rest(inst: FullForm) -> Rates | None:
    """Return stiffness and transmission without a load, handle straight; None where there is no equilibrium."""
    try:
        return statics.rates(inst, np.zeros(len(inst.handle_joints)))
    except NoSolutionError:
        return None


def joints_as_json(inst: FullForm, found: Sequence[Loss]) -> dict[str, Any]:
    """Return joints, tendons and what follows from them as JSON has it."""
    rates, bases = rates_at_rest(inst), _bases(inst)
    return {
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
        "arms": statics.straight_arms(inst).tolist(),
        "handle_arms": statics.straight_arms(inst, "handle").tolist(),
        "coupling": statics.coupling(inst).tolist(),
        "stiffness": None if rates is None else rates.stiffness.tolist(),
        "by_handle": None if rates is None else rates.by_handle.tolist(),
        "losses": losses_as_json(inst, found),
    }


def print_joints(inst: FullForm, found: Sequence[Loss]) -> None:
    """Print joints, tendons and what follows from them."""
    bends, whole = Bends.of(inst), in_arcs(inst, 1)
    tip_names, handle_names = bends.names, [joint.name for joint in inst.handle_joints]
    say(
        f"{inst.name}: {_count(len(tip_names), 'joint')} at the tip, {len(handle_names) or 'none'} at the handle, "
        f"{_count(len(inst.tendons), 'tendon')}" + (f". {inst.description}" * bool(inst.description))
    )
    for name, arcs in zip(tip_names, bends.sums.sum(axis=1), strict=True):
        if arcs > 1:
            say(f"{name} is in {arcs:g} arcs; its angle is their sum, and the table has the whole.")
    _print("Joints", _joints(whole))
    _print("Tendons", _tendons(whole))
    arms = np.hstack([statics.straight_arms(inst, "handle")[:, ::-1], straight_arms(inst)])
    names = [tendon.name for tendon in inst.tendons]
    _print("Moment arms of the straight joints [mm]", matrix(names, [*handle_names[::-1], *tip_names], 1e3 * arms))
    per_mm = bends.summed(np.degrees(statics.coupling(inst)).T) * 1e-3
    _print("Coupling: angles by drawn tendon, taut and without stretch [°/mm]", matrix(names, tip_names, per_mm))
    if (at_rest := rates_at_rest(inst)) is not None:
        rates = bends.rates(at_rest)
        _print("Stiffness at rest: moment by angle [N·m/rad]", matrix(tip_names, tip_names, rates.stiffness))
        if handle_names:
            _print("Angles by angles of the handle, at rest", matrix(tip_names, handle_names, rates.by_handle))
    print_losses(inst, found)


def route(inst: FullForm, tendon: Tendon) -> str:
    """Return a tendon's route in words, from its start to its end."""
    radii = {joint.name: joint.radius for joint in inst.joints}
    words: list[str] = [tendon.start]
    for crossing in tendon.route:
        radius = radii[crossing.joint] if crossing.radius is None else crossing.radius
        at = "" if crossing.side == "middle" else f" at {1e3 * radius:.4g} mm"
        bends = {"wrap": crossing.base_wrap, "guides": crossing.guide_wrap}
        wraps = "".join(f", {name} {degrees(bend):.4g}°" for name, bend in bends.items() if bend)
        words.append(f"{crossing.joint} {crossing.side}{at}{wraps}")
    return f"{' → '.join(words)} → end"


def _joints(inst: FullForm) -> Table:
    bases = _bases(inst)
    shown = table(None, "joint", "stands on", "mechanism", "axis", ">radius\n[mm]", ">range\n[°]")
    for joint in (*inst.handle_joints[::-1], *inst.tip_joints):
        axis = joint.axis if isinstance(joint.axis, str) else components(joint.axis_vector)
        radius, most = f"{1e3 * joint.radius:.4g}", joint.range_text
        mechanism = "twist" if joint.is_twist else joint.mechanism
        shown.add_row(*map(escape, (joint.bend, bases[joint.name], mechanism, axis, radius, most)))
    return shown


def _bases(inst: FullForm) -> dict[str, str]:
    """Return the name of what each joint stands on, by its own."""
    tips, handles = inst.tip_joints, inst.handle_joints
    names = ["stem", *(joint.name for joint in handles)]
    found = {joint.name: joint.on or before for joint, before in zip(handles, names, strict=False)}
    return found | {
        joint.name: "stem" if on < 0 else tips[on].name for joint, on in zip(tips, inst.parents, strict=True)
    }


def _tendons(inst: FullForm) -> Table:
    shown = table(None, "tendon", "route", ">stiffness\n[N/mm]", ">pretension\n[N]")
    for tendon, stiffness, tension in zip(inst.tendons, inst.stiffnesses, inst.pretensions, strict=True):
        cells = (tendon.name, route(inst, tendon), f"{1e-3 * stiffness:.4g}", f"{tension:.4g}")
        shown.add_row(*map(escape, cells))
    return shown


def _print(title: str, shown: Table) -> None:
    """Print a table below its title, however narrow it is."""
    say(title)
    console.print(shown)


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'s' * (number != 1)}"
