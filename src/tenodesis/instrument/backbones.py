"""Backbones as chains of arcs: what a joint with `arcs` in a file is written out to.

A backbone bends unevenly where forces act across it. Two arcs of equal length follow a curvature that is linear along
them to the fourth order, in the place and the direction of their far end, if their springs are coupled: a curvature of
κ₁ and κ₂ at the two Gauss points of a length h bends the arcs by h (κ₁ + κ₂) / 4 ± h (κ₁ - κ₂) / (2 √3), as in
commutator-free Magnus integrators (Celledoni, Marthinsen, Owren, Future Generation Computer Systems 19, 2003), and
takes the energy E I h (κ₁² + κ₂²) / 4. In the arcs' angles that is E I / (8 h) (6 β₁² + 6 β₂² + (β₁ + β₂)²): two
springs, and one that ties the second arc to the opposite of the first.
"""

from collections.abc import Sequence
from typing import Any

from tenodesis.instrument.joints import FARTHEST_STOP, Crossing, Joint, Tendon, arc_suffix

_ADDED = ("stiffness", "damping")
"""What arcs one after another have as many times of as there are arcs."""
OWN, SHARED = 6 / 8, 1 / 8
"""Stiffness of an arc of a pair, and of the spring between both, over that of an arc alone."""


def cut(joints: Sequence[Joint], tendons: Sequence[Tendon]) -> tuple[tuple[Joint, ...], tuple[Tendon, ...]]:
    """Return joints and tendons with every backbone as its arcs; others as they are."""
    arcs = {joint.name: _arcs(joint) for joint in joints}
    last = {name: parts[-1].name for name, parts in arcs.items()}
    standing = [
        part.model_copy(update={"on": last[part.on]}) if part.on in last else part
        for joint in joints
        for part in arcs[joint.name]
    ]
    routes = [
        tendon.model_copy(update={"route": tuple(_crossed(tendon.route, arcs))})
        if any(len(arcs.get(one.joint, ())) > 1 for one in tendon.route)
        else tendon
        for tendon in tendons
    ]
    return tuple(standing), tuple(routes)


def join(joints: Sequence[Joint], tendons: Sequence[Tendon]) -> tuple[list[Joint], list[Tendon]]:
    """Return joints and tendons with every backbone as one arc: what :func:`cut` was given, with one arc each."""
    backbone = {joint.name: joint.bend for joint in joints if joint.arc}
    first: dict[str, Joint] = {}
    found = []
    for joint in joints:
        standing = joint.model_copy(update={"on": backbone[joint.on]}) if joint.on in backbone else joint
        if joint.arc == 1:
            first[backbone[joint.name]] = standing
        if not joint.arc:
            found.append(standing)
        elif joint.arc == joint.arcs:
            start, count = first[backbone[joint.name]], joint.arcs
            change: dict[str, Any] = {"name": backbone[joint.name], "arcs": 1, "arc": 0, "range": count * joint.range}
            change |= {
                "backbone_length": count * (joint.backbone_length or 0.0),
                "offset": start.offset,
                "on": start.on,
            }
            change |= {key: value / count for key in _ADDED if (value := getattr(joint, key)) is not None}
            found.append(joint.model_copy(update=change))
    counts = {start.name: start.arcs for start in first.values()}
    routes = []
    for tendon in tendons:
        route = [
            crossing.model_copy(
                update={
                    "joint": backbone.get(crossing.joint, crossing.joint),
                    "base_wrap": counts.get(crossing.joint, 1) * crossing.base_wrap,
                }
            )
            for crossing in tendon.route
            if crossing.joint in counts or crossing.joint not in backbone
        ]
        routes.append(tendon.model_copy(update={"route": tuple(route)}))
    return found, routes


def _arcs(joint: Joint) -> list[Joint]:
    """Return the arcs of a backbone, from the stem outward; a joint that is not cut alone."""
    count = joint.arcs
    if count == 1 or joint.arc:
        return [joint]
    common: dict[str, Any] = {
        "backbone_length": (joint.backbone_length or 0.0) / count,
        "range": joint.range / count,
        # Under a force across, an arc bends further than its share; a file's stops are below the farthest.
        "stop": min(joint.outer_stop, 0.99 * FARTHEST_STOP),
    }
    common |= {key: count * value for key in _ADDED if (value := getattr(joint, key)) is not None}
    beyond = ("end_effector_length", "mass", "centre_of_mass", "inertia")
    found = []
    for arc in range(1, count + 1):
        change = common | {"name": joint.name + arc_suffix(arc), "arc": arc}
        if arc > 1:
            change |= {"offset": 0.0, "on": None}
        if arc < count:
            change |= dict.fromkeys(beyond)
        found.append(joint.model_copy(update=change))
    return found


def _crossed(route: Sequence[Crossing], arcs: dict[str, list[Joint]]) -> list[Crossing]:
    found = []
    for crossing in route:
        parts = arcs.get(crossing.joint, [])
        if len(parts) < 2:
            found.append(crossing)
            continue
        wrap = crossing.base_wrap / len(parts)
        found += [crossing.model_copy(update={"joint": part.name, "base_wrap": wrap}) for part in parts]
    return found
