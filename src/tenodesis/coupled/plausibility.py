"""What is implausible about a coupled instrument: values that a file may have, but hardly any instrument has."""

from collections.abc import Callable, Iterator
from math import degrees, radians
from typing import NamedTuple

import numpy as np

from tenodesis._core import Status
from tenodesis.instrument import FullForm
from tenodesis.statics import Equilibrium
from tenodesis.statics.chain import equilibrium, rates, straight_arms

_FROM_STRAIGHT = radians(0.5)
_DISTURBANCE = 0.05  # of the joint that is moved
_PULLEY_PER_ROPE = 4.0  # diameters


class Doubt(NamedTuple):
    """A value that is allowed, but hardly meant."""

    key: str
    """Key of the file, with the list of tables before a dot."""
    sentence: str


def implausible(inst: FullForm) -> tuple[Doubt, ...]:
    """Return what is implausible about a coupled instrument, each in one sentence."""
    return tuple(Doubt(key, sentence) for key, find in _RULES for sentence in find(inst))


def _at_rest(inst: FullForm) -> Equilibrium:
    return equilibrium(inst, np.zeros((1, len(inst.handle_joints))))


def _rest(inst: FullForm) -> Iterator[str]:
    rest = _at_rest(inst)
    if rest.status[0] != Status.OK:
        yield "without a load and with the handle straight, the joints find no equilibrium under the pretension."
        return
    off = [
        f"{joint.name} at {degrees(angle):.2g}°"
        for joint, angle in zip(inst.tip_joints, rest.output_angle[0], strict=True)
        if abs(angle) > _FROM_STRAIGHT
    ]
    if off:
        yield f"the pretensions do not balance: with a straight handle, joints rest off straight, {', '.join(off)}."


def _slack(inst: FullForm) -> Iterator[str]:
    slack = [t.name for t, tension in zip(inst.tendons, _at_rest(inst).tensions[0], strict=True) if tension == 0]
    if slack:
        yield f"slack without a load: {', '.join(slack)}."


def _strength(inst: FullForm) -> Iterator[str]:
    largest = float(inst.pretensions.max())
    if inst.breaking_load is not None and largest >= inst.breaking_load:
        yield f"pretension is {largest:g} N, and tendons break at a breaking_load of {inst.breaking_load:g} N."


def _useless(inst: FullForm) -> Iterator[str]:
    for tendon, arms in zip(inst.tendons, inst.tendon_arms("tip"), strict=True):
        if not arms.any():
            yield f"tendon {tendon.name} bends no joint at the tip: it crosses none, or all in their middle."


def _disturbing(inst: FullForm) -> Iterator[str]:
    """Yield what the handle's joints turn besides; without a handle, what the tendons that end at a joint turn."""
    found = rates(inst, np.zeros((1, len(inst.handle_joints))))
    if inst.handle_joints:
        moves = [
            (f"handle joint {joint.name}", column)
            for joint, column in zip(inst.handle_joints, found.by_handle[0].T, strict=True)
        ]
    else:
        ends = np.array([tendon.route[-1].joint for tendon in inst.tendons])
        alone = [np.where(ends == j.name, a, 0.0) for j, a in zip(inst.tip_joints, straight_arms(inst).T, strict=True)]
        moves = [
            (f"the tendons that end at joint {joint.name}", found.by_stroke[0] @ drawn)
            for joint, drawn in zip(inst.tip_joints, alone, strict=True)
        ]
    for what, turned in moves:
        if not np.isfinite(turned).all() or not turned.any():
            continue
        most = int(np.argmax(np.abs(turned)))
        shares = turned / turned[most]
        others = [
            f"{joint.name} by {share:+.2g}"
            for i, (joint, share) in enumerate(zip(inst.tip_joints, shares, strict=True))
            if i != most and abs(share) > _DISTURBANCE
        ]
        if others:
            yield f"turning {inst.tip_joints[most].name} by {what} also turns {', '.join(others)} of its angle."


def _in_stem(inst: FullForm) -> Iterator[str]:
    for joint in inst.tip_joints:
        if inst.stem_diameter is not None and 2 * joint.radius > inst.stem_diameter:
            yield (
                f"radius of joint {joint.name} is {1e3 * joint.radius:.4g} mm, so that it is {2e3 * joint.radius:.4g} "
                f"mm wide, wider than the stem of {1e3 * inst.stem_diameter:.4g} mm."
            )


def _rope_on_pulley(inst: FullForm) -> Iterator[str]:
    rope = inst.tendon_diameter
    for joint in inst.tip_joints:
        if joint.mechanism == "pulley" and rope is not None and 2 * joint.radius < _PULLEY_PER_ROPE * rope:
            yield (
                f"tendon_diameter is {1e3 * rope:.4g} mm, on joint {joint.name} of only {2 * joint.radius / rope:.2g} "
                f"times that; ropes last on pulleys of at least {_PULLEY_PER_ROPE:g} times their diameter."
            )


_RULES: tuple[tuple[str, Callable[[FullForm], Iterator[str]]], ...] = (
    ("pretension", _rest),
    ("pretension", _slack),
    ("pretension", _strength),
    ("tendons.route", _useless),
    ("tendons.route", _disturbing),
    ("joints.radius", _in_stem),
    ("joints.radius", _rope_on_pulley),
)
"""The rules: the key that each is about, and what finds it."""
