"""The axes of an instrument that a controller compensates: joints with a pair of tendons of their own.

What such a joint loses is the stretch of its pair, whatever load or neighbour causes it, and the pair's proximal
tensions and spool angles show that stretch. So each axis of the planar controller does for one joint of the wrist what
it does for an instrument of one joint, on a microcontroller too.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from tenodesis.errors import ArgumentError, InstrumentError
from tenodesis.instrument import (
    FullForm,
    Instrument,
    InstrumentLike,
    Joint,
    ShortForm,
    as_instrument,
    expanded,
    in_arcs,
)
from tenodesis.instrument.mechanisms import JOINT_TYPES
from tenodesis.plant import link_rows, mass_matrix
from tenodesis.run import Names
from tenodesis.toml import validated

_JOINT_TYPES = {"tendon-gear": "tendon-gear", "pulley": "tendon-pulley", "continuum": "continuum"}
_ALIKE = 1e-6
_SHARED = ("friction", "drives", "sensors", "control", "conditions")


class Pair(NamedTuple):
    """A joint of the tip with the joint of the handle and the two tendons that are its own, by their places."""

    joint: int
    handle: int
    agonist: int
    antagonist: int


def pairs(inst: InstrumentLike) -> dict[str, Pair]:
    """Return the pairs of an instrument by the axis (yaw, pitch) of their joint, in the order of the joints.

    A joint has its own pair where one joint of the handle winds two tendons of the same stiffness and pretension on its
    two sides, both from a spool, that pass all other joints in their middle. A backbone in arcs counts as one joint,
    in the place of its first arc.
    """
    inst, given = in_arcs(inst, 1), expanded(inst)
    places = {joint.bend: i for i, joint in reversed(list(enumerate(given.tip_joints)))}
    tips, handles = inst.tendon_arms("tip"), inst.tendon_arms("handle")
    found: dict[str, Pair] = {}
    for j, joint in enumerate(inst.tip_joints):
        own = [m for m in range(len(inst.tendons)) if tips[m, j] and np.count_nonzero(tips[m]) == 1]
        if len(own) != 2 or joint.axis not in ("yaw", "pitch") or joint.axis in found:
            continue
        agonist, antagonist = own if tips[own[0], j] > 0 else own[::-1]
        wound = np.flatnonzero(handles[agonist])
        alike = (
            math.isclose(tips[agonist, j], -tips[antagonist, j], rel_tol=_ALIKE)
            and (np.abs(handles[agonist] + handles[antagonist]) <= _ALIKE * np.abs(handles[agonist])).all()
            and math.isclose(inst.stiffnesses[agonist], inst.stiffnesses[antagonist], rel_tol=_ALIKE)
            and inst.pretensions[agonist] == inst.pretensions[antagonist]
            and all(inst.tendons[m].start == "spool" for m in own)
        )
        if len(wound) == 1 and handles[agonist, wound[0]] > 0 and alike:
            found[str(joint.axis)] = Pair(places[joint.name], int(wound[0]), agonist, antagonist)
    return found


def names_of(inst: InstrumentLike) -> Names:
    """Return what the columns of an instrument's runs are named after."""
    inst, whole = expanded(inst), in_arcs(inst, 1)
    own = [whole.tip_joints[pair.joint] for pair in pairs(whole).values()]
    groups = (inst.tip_joints, inst.handle_joints, inst.tendons, own)
    return Names(*(tuple(one.name for one in group) for group in groups))


def served_motors(inst: Instrument, *, all_joints: bool) -> list[int]:
    """Return the tendons whose motors a controller commands, by number: all, or those of pairs."""
    if all_joints:
        return list(range(len(inst.expanded.tendons)))
    return [motor for pair in pairs(inst).values() for motor in (pair.agonist, pair.antagonist)]


def compensated(inst: InstrumentLike) -> ShortForm:
    """Return the instrument of one or two planar axes that a controller of an instrument is made for.

    Its axes are the joints with a pair of their own (:func:`pairs`): ``Controller(tn.control.compensated(inst))``. One
    in the short form has no others, and is returned as it is.

    Raises
    ------
    ArgumentError
        No joint has a pair of its own, or their mechanisms differ.
    """
    given = as_instrument(inst)
    if given.short_form is not None:
        return given.short_form
    inst = in_arcs(given, 1)
    axes = pairs(inst)
    if not axes:
        raise ArgumentError(
            f"{inst.name} has no joint that a controller can compensate; one joint of the handle must wind two tendons "
            "on the two sides of a yaw or pitch joint at the tip, which pass all other joints in their middle; the law "
            "joints needs no such pairs.",
            key="inst",
            value=inst.name,
        )
    mechanisms = {inst.tip_joints[pair.joint].mechanism for pair in axes.values()}
    if len(mechanisms) > 1:
        raise ArgumentError(
            f"{inst.name} has axes of {' and '.join(sorted(mechanisms))}; a controller takes joints of one mechanism.",
            key="inst",
            value=inst.name,
        )
    joint_type = _JOINT_TYPES[mechanisms.pop()]
    by_axis = {axis: _axis_values(inst, joint_type, pair) for axis, pair in axes.items()}
    motions = [_motion(inst, pair) for pair in axes.values()]
    first, *others = by_axis.values()
    values: dict[str, Any] = {
        "name": inst.name,
        "joint_type": joint_type,
        "axes": list(axes),
        **first,
        **{table: getattr(inst, table).model_dump(exclude_none=True, exclude_unset=True) for table in _SHARED},
    }
    values["drives"]["spool_radius"] = inst.own_drives.spool_radius
    # Tendons of a farther joint bend over the nearer ones.
    values["friction"]["passing_coefficient"] = inst.friction.vertex_coefficient if _passes(inst, axes) else 0.0
    # One table for all axes: the one that is slowest to turn decides how fast a law may be.
    values["dynamics"] = max(motions, key=lambda motion: motion["tip_inertia"]) | {
        name: getattr(inst.dynamics, name) for name in ("hand_stiffness", "hand_damping", "hand_inertia")
    }
    differing = [{key: value for key, value in other.items() if value != first[key]} for other in others]
    values["overrides"] = {axis: change for axis, change in zip(list(axes)[1:], differing, strict=True) if change}
    return validated(JOINT_TYPES[joint_type], values, InstrumentError, inst.name)


def _axis_values(inst: FullForm, joint_type: str, pair: Pair) -> dict[str, Any]:
    joint, handle = inst.tip_joints[pair.joint], inst.handle_joints[pair.handle]
    tendon = inst.tendons[pair.agonist]
    beyond = _beyond(inst, pair.joint)
    length = tendon.length or inst.tendon_length or (inst.stem_length or 0.0) + beyond + _held(inst)
    names = {
        "tendon-gear": ("distal_gear_radius", "proximal_gear_radius"),
        "tendon-pulley": ("distal_pulley_radius", "proximal_pulley_radius"),
        "continuum": ("distal_tendon_offset", "proximal_pulley_radius"),
    }[joint_type]
    values: dict[str, Any] = {
        names[0]: _radius(inst, pair, joint),
        names[1]: _radius(inst, pair, handle),
        "overall_length": length,
        "end_effector_length": beyond,
        "handle_length": _held(inst),
        "tendon_stiffness": float(inst.stiffnesses[pair.agonist]),
        "pretension": float(inst.pretensions[pair.agonist]),
        "handle_range": handle.range,
        "output_range": joint.range,
    }
    if joint_type == "continuum":
        values |= {"backbone_length": joint.backbone_length, "backbone_rigidity": joint.backbone_rigidity}
    return values


def _passes(inst: FullForm, axes: dict[str, Pair]) -> bool:
    """Whether the second axis's tendons cross the first one's joint at the tip."""
    first, *others = axes.values()
    nearer = inst.tip_joints[first.joint].name
    return any(nearer in (crossing.joint for crossing in inst.tendons[pair.agonist].route) for pair in others)


def _motion(inst: FullForm, pair: Pair) -> dict[str, float]:
    links = link_rows(inst)
    inertia, _ = mass_matrix(inst, links, np.zeros(len(inst.tip_joints)))
    return {"tip_inertia": float(inertia[pair.joint, pair.joint]), "tip_damping": float(links[pair.joint, 5])}


def _radius(inst: FullForm, pair: Pair, joint: Joint) -> float:
    """Radius at which the pair crosses a joint, m."""
    route = inst.tendons[pair.agonist].route
    own = next(crossing.radius for crossing in route if crossing.joint == joint.name)
    return joint.radius if own is None else own


def _beyond(inst: FullForm, joint: int) -> float:
    """Length of the straight tip from the far end of a joint to the force, m."""
    last = inst.tip_joints[inst.bearing[0]]
    length = last.end_effector_length or 0.0
    at = inst.bearing[0]
    while at != joint and at >= 0:
        length += inst.tip_joints[at].offset + inst.tip_joints[at].chord
        at = inst.parents[at]
    return length


def _held(inst: FullForm) -> float:
    """Length from the handle's last joint to the hand, m; a tenth of a metre where the file does not say."""
    lengths = [joint.end_effector_length for joint in inst.handle_joints if joint.end_effector_length]
    return max(lengths, default=0.1)
