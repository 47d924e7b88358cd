"""Backbones as chains of arcs: what a joint with `arcs` or `planes` in a file is written out to.

A backbone bends unevenly where forces act across it. Two arcs of equal length follow a curvature that is linear along
them to the fourth order, in the place and the direction of their far end, if their springs are coupled: a curvature of
κ₁ and κ₂ at the two Gauss points of a length h bends the arcs by h (κ₁ + κ₂) / 4 ± h (κ₁ - κ₂) / (2 √3), as in
commutator-free Magnus integrators (Celledoni, Marthinsen, Owren, Future Generation Computer Systems 19, 2003), and
takes the energy E I h (κ₁² + κ₂²) / 4. In the arcs' angles that is E I / (8 h) (6 β₁² + 6 β₂² + (β₁ + β₂)²): two
springs, and one that ties the second arc to the opposite of the first.

An arc that bends in two planes is two joints, one within the other (tendon_chain.hpp). Their angles are the parts of
its bend in both planes but for a third order, of which the half that depends on which joint is the outer one changes
sign from one arc to the next, as the outer joints alternate. Between the arcs of a pair, a backbone with a torsional
rigidity turns about itself, by a spring of G J / (2 h).
"""

import math
from collections.abc import Container, Sequence
from typing import Any

from tenodesis import _core
from tenodesis.instrument.joints import FARTHEST_STOP, SIGNS, Crossing, Joint, Tendon, arc_suffix

_ADDED = ("stiffness", "damping")
"""What arcs one after another have as many times of as there are arcs."""
_BEYOND = ("end_effector_length", "mass", "centre_of_mass", "inertia")
"""What the last joint of a backbone alone has."""
OWN, SHARED = 6 / 8, 1 / 8
"""Stiffness of an arc of a pair, and of the spring between both, over that of an arc alone."""
_RANGE_OF_A_PAIR = 0.65
"""Range over which two arcs are within half a percent of a backbone's deflection, rad.

Measured against 16 arcs: under a force across, up to E I / L², the end of a backbone in n arcs, bent by θ, is within
about 0.5 % (θ / 0.65)^(8/3) (2 / n)⁴ of its way (`pytest tests/python/test_backbones.py`).
"""
_MIDDLE = 1e-9
"""Part of a tendon's distance from the middle that is rounding."""


def cut(joints: Sequence[Joint], tendons: Sequence[Tendon]) -> tuple[tuple[Joint, ...], tuple[Tendon, ...]]:
    """Return joints and tendons with every backbone as its planes and arcs; others as they are."""
    joints = _with_arcs(joints)
    parts = {joint.name: _parts(joint) for joint in joints}
    last = {name: found[-1].name for name, found in parts.items()}
    standing = [
        part
        if part.on is None or last.get(part.on, part.on) == part.on
        else part.model_copy(update={"on": last[part.on]})
        for joint in joints
        for part in parts[joint.name]
    ]
    given = {joint.name: joint for joint in joints}
    routes = []
    for tendon in tendons:
        route = tuple(
            found
            for one in tendon.route
            for found in (_crossed(one, given[one.joint], parts[one.joint]) if one.joint in given else [one])
        )
        routes.append(tendon if route == tendon.route else tendon.model_copy(update={"route": route}))
    return tuple(standing), tuple(routes)


def _with_arcs(joints: Sequence[Joint]) -> list[Joint]:
    """Return joints with the number of arcs of every backbone: as given, or as many as its range takes and fit."""
    held = {name for joint in joints for name in (joint.within, joint.tied_to)}
    free = [i for i, joint in enumerate(joints) if joint.arcs is None]
    found = list(joints)
    for i in free:
        found[i] = joints[i].model_copy(update={"arcs": _needed(joints[i], held)})
    while sum(_size(joint) for joint in found if joint.place == "tip") > _core.MOST_JOINTS:
        most = max(free, key=lambda i: found[i].arc_count, default=None)
        if most is None or (arcs := found[most].arc_count) == 1:
            break
        found[most] = found[most].model_copy(update={"arcs": arcs - 2 or 1})
    return found


def _needed(joint: Joint, held: Container[str | None]) -> int:
    """Return in how many arcs a joint bends whose file does not say so; those that `held` names are one."""
    if joint.mechanism != "continuum" or joint.place == "handle" or joint.within or joint.tied_to or joint.name in held:
        return 1
    return 2 * math.ceil(math.pow(joint.range / _RANGE_OF_A_PAIR, 2 / 3))


def _size(joint: Joint) -> int:
    """Return how many joints one with a number of arcs is written out to."""
    arcs = joint.arc_count
    return 1 if joint.arc else arcs * joint.planes + (joint.torsional_rigidity is not None) * math.ceil(arcs / 2)


def _parts(joint: Joint) -> list[Joint]:
    """Return the arcs of a backbone in its planes, from the stem outward; any other joint alone."""
    count = joint.arc_count
    if joint.arc or (count == 1 and joint.planes == 1 and joint.torsional_rigidity is None):
        return [joint]
    low, high = joint.stops
    limits = joint.limits[0] / count, joint.limits[1] / count
    common: dict[str, Any] = {
        "backbone_length": (joint.backbone_length or 0.0) / count,
        "given_range": limits if isinstance(joint.given_range, tuple) else limits[1],
        # Under a force across, an arc bends further than its share; a file's stops are below the farthest.
        "stop": (max(low, -0.99 * FARTHEST_STOP), min(high, 0.99 * FARTHEST_STOP)),
        "planes": 1,
        "torsional_rigidity": None,
    }
    common |= {key: count * value for key in _ADDED if (value := getattr(joint, key)) is not None}
    common |= dict.fromkeys(_BEYOND)
    planes = _planes(joint)
    found: list[Joint] = []
    for arc in range(1, count + 1):
        outer = None
        for name, axis in planes if arc % 2 else reversed(planes):
            own: dict[str, Any] = {"name": name, "axis": axis, "within": outer}
            if count > 1:
                own |= {"name": name + arc_suffix(arc), "arc": arc}
            if found:
                own |= {"offset": 0.0, "on": None}
            found.append(joint.model_copy(update=common | own))
            outer = found[-1].name
        if arc % 2 and joint.torsional_rigidity is not None:
            found.append(_twist(joint, arc // 2 + 1))
    found[-1] = found[-1].model_copy(update={key: getattr(joint, key) for key in _BEYOND})
    return found


def _planes(joint: Joint) -> list[tuple[str, Any]]:
    """Return name and axis of every plane that a backbone bends in."""
    if joint.planes == 1:
        return [(joint.name, joint.axis)]
    x, y, z = joint.axis_vector
    if joint.axis == "yaw":
        return [(f"{joint.name}_yaw", "yaw"), (f"{joint.name}_pitch", "pitch")]
    return [(f"{joint.name}_first", joint.axis), (f"{joint.name}_second", (-y, x, z))]


def _twist(joint: Joint, place: int) -> Joint:
    """Return the joint that turns a backbone about itself between the arcs of a pair, of which place is the number."""
    pairs = max(joint.arc_count // 2, 1)
    return Joint(
        name=f"{joint.name}_twist{arc_suffix(place)}",
        mechanism="pulley",
        axis="roll",
        radius=joint.radius,
        stiffness=pairs * (joint.torsional_rigidity or 0.0) / (joint.backbone_length or 1.0),
        range=joint.range / pairs,
        stop=0.99 * FARTHEST_STOP,
        arcs=pairs,
        arc=place,
    )


def _crossed(crossing: Crossing, joint: Joint, parts: Sequence[Joint]) -> list[Crossing]:
    """Return a tendon's passages over the parts of a joint."""
    if crossing.angle is None and len(parts) == 1:
        return [crossing]
    arcs = joint.arc_count
    near = joint.radius if crossing.radius is None else crossing.radius
    far = near if crossing.far_radius is None else crossing.far_radius
    names = [name for name, _ in _planes(joint)]
    found = []
    for part in parts:
        if part.is_twist:
            continue
        own: dict[str, Any] = {
            "joint": part.name,
            "base_wrap": 0.0,
            "guide_wrap": 0.0,
            "angle": None,
            "far_radius": None,
        }
        if part.within is None:
            # Over an arc in two planes a tendon wraps once: the outer joint has the friction of both.
            own |= {key: getattr(crossing, key) / arcs for key in ("base_wrap", "guide_wrap")}
        if crossing.angle is not None or crossing.far_radius is not None or len(names) > 1:
            radius = near + (far - near) * (max(part.arc, 1) - 0.5) / arcs
            sign = 1.0 if crossing.side is None else SIGNS[crossing.side]
            arm = sign * radius * math.cos((crossing.angle or 0.0) - math.pi / 2 * names.index(part.bend))
            in_middle = abs(arm) <= _MIDDLE * radius
            own["side"] = "middle" if in_middle else "agonist" if arm > 0 else "antagonist"
            own["radius"] = None if in_middle else abs(arm)
        found.append(crossing.model_copy(update=own))
    return found
