"""Constants of the twin of joints and tendons in the core's form: routes, hand, drives and sensors."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tenodesis import _core
from tenodesis.errors import ArgumentError
from tenodesis.instrument import FullForm, Joint, Tendon
from tenodesis.instrument.hardware import Friction
from tenodesis.instrument.instrument import arm_of
from tenodesis.instrument.joints import MECHANISMS, Crossing
from tenodesis.plant.axis import current_parameters, hand_parameters, hardware_parameters
from tenodesis.plant.links import link_rows, natural_frequencies
from tenodesis.plant.time_steps import LARGEST_PHASE_STEP, steps_per_period

Array = NDArray[np.float64]

_PARAMETERS = _core.chain_twin_parameters()
_HANDLE_SHARE = 0.1
"""Share of a tendon's compliance before the joints, where no length says it."""


class TwinRows(NamedTuple):
    """Arguments of the core's twin."""

    passages: Array
    """By tendon and contact: joint (-1: the sheath), coefficient, wrap of sheath or guides, share, arm, bend unwound"""
    contacts: list[int]
    segments: Array
    """Stiffness by tendon and segment, N/m."""
    links: Array
    load_cells: Array
    """Gain, bias, noise, range and resolution of what measures the tension, by tendon."""
    parameters: list[float]
    law: int
    steps_per_sample: int


def twin_rows(inst: FullForm, time_step: float, quasi_static: bool) -> TwinRows:
    """Return the constants of a twin; raises ArgumentError for a time step that does not suit the instrument."""
    if not (np.isfinite(time_step) and time_step > 0):
        raise ArgumentError(key="time_step", value=time_step, allowed="a time above 0 s")
    links = link_rows(inst)
    if not quasi_static:
        fastest = natural_frequencies(inst)[-1]
        longest = LARGEST_PHASE_STEP / fastest
        if time_step > longest:
            raise ArgumentError(
                f"time_step is {time_step:g} s; it must be at most {longest:.3g} s, a twelfth of a period of the "
                f"fastest oscillation of {inst.name} ({fastest / (2 * math.pi):.3g} Hz).",
                key="time_step",
                value=time_step,
                allowed=f"at most {longest:.3g} s",
            )
    per_sample = steps_per_period(inst.sensors.sampling_rate, time_step)
    routes = [_Route(inst, tendon, float(k)) for tendon, k in zip(inst.tendons, inst.stiffnesses, strict=True)]
    width = max(len(route.passages) for route in routes)
    passages, segments = np.zeros((len(routes), width, 6)), np.ones((len(routes), width + 1))
    for m, route in enumerate(routes):
        passages[m, : len(route.passages)] = route.passages
        segments[m, : len(route.passages) + 1] = route.segments
    values = twin_values(inst, time_step)
    parameters = [values[name] for name in _PARAMETERS]
    contacts = [len(route.passages) for route in routes]
    biases = [tendon.load_cell_bias for tendon in inst.tendons]
    sensors = zip(inst.tension_sensors, biases, strict=True)
    cells = np.array([(one.gain, bias, one.noise, one.range, one.resolution) for one, bias in sensors])
    law = {"stribeck": 1, "capstan-power": 2}.get(inst.friction.law, 2 if inst.friction.bends else 0)
    return TwinRows(passages, contacts, segments, links, cells, parameters, law, per_sample)


def twin_values(inst: FullForm, time_step: float) -> dict[str, float]:
    """Return the parameters of a twin that are one number each, SI units, by the core's names."""
    return {
        **_friction(inst.friction),
        "stiffness_ratio": 1.0,
        "pretension_ratio": 1.0,
        "handle_encoder_offset": 0.0,
        "output_encoder_offset": 0.0,
        **current_parameters(inst.drives),
        **hand_parameters(inst.dynamics),
        **hardware_parameters(inst.own_drives, inst.sensors),
        "time_step": time_step,
    }


def _friction(friction: Friction) -> dict[str, float]:
    radius = friction.reference_radius if friction.vertex_radius is None else friction.vertex_radius
    names = ("constant", "viscous", "static_ratio", "stribeck_speed", "memory", "load_index", "reference_tension")
    return {
        **{name: getattr(friction, name) for name in names},
        "bending_loss": friction.tendon_bending_stiffness / (2 * radius**2),
        "sheath_bend_rate": friction.sheath_bend_per_handle_angle,
    }


class _Route:
    """The contacts of a tendon from the spool to the tip, and the stiffness of the segments between them, N/m."""

    def __init__(self, inst: FullForm, tendon: Tendon, stiffness: float) -> None:
        friction = inst.friction
        places = {joint.name: i for i, joint in enumerate((*inst.tip_joints, *inst.handle_joints))}
        joints = {joint.name: joint for joint in inst.joints}
        length = inst.tendon_length if tendon.length is None else tendon.length

        count = friction.sheath_contacts
        in_handle = handle_share(inst, length)
        bend = friction.sheath_bend / count
        self.passages = [(-1.0, friction.sheath_coefficient, bend, 1 / count, 0.0, 0.0)] * count
        shares = [in_handle / (count + 1)] * (count + 1)
        stem = None
        spans = span = 0.0
        before: Joint | None = None
        vertices = friction.vertices_per_joint
        part = 1 / vertices
        for place in ("handle", "tip"):
            given = friction.handle_joint_compliance_share if place == "handle" else friction.tip_joint_compliance_share
            for crossing in tendon.route:
                joint = joints[crossing.joint]
                if joint.place != place:
                    continue
                # Of two joints of which one bends within the other, the outer one has friction and compliance of both.
                inside = joint.within is not None
                span = 0.0 if inside else given / joint.arc_count if given is not None else _share(joint, length)
                spans += span
                name = crossing.joint
                arm = arm_of(crossing, joint) * (1.0 if place == "handle" else -1.0)
                coefficient = _coefficient(friction, crossing, joint, before)
                before = before if inside else joint
                base = crossing.base_wrap / vertices
                wound = _core.joint_wound_bend(MECHANISMS[joint.mechanism], base, arm)
                fixed = crossing.guide_wrap / vertices + base - abs(wound)
                one = (float(places[name]), coefficient, fixed, 0.0 if inside else part)
                # A joint's span is the segment that it draws: between two vertices, or before the only one at the
                # handle and beyond it at the tip.
                if vertices > 1:
                    stem = len(shares) - 1 if stem is None and place == "tip" else stem
                    self.passages += [(*one, by, wound) for by in ((0.0, arm) if place == "handle" else (arm, 0.0))]
                    shares += [span, 0.0]
                elif place == "handle":
                    self.passages.append((*one, arm, wound))
                    shares[-1] += span
                    shares.append(0.0)
                else:
                    self.passages.append((*one, arm, wound))
                    stem = len(shares) - 1 if stem is None else stem
                    shares.append(span)
        if vertices > 1 and stem is not None:
            given = friction.anchor_compliance_share
            shares[-1] = span / 2 if given is None else given
            spans += shares[-1]
        shares[len(shares) - 1 if stem is None else stem] += _rest(inst, tendon, in_handle + spans)
        least = 1e-3  # a segment is never quite rigid
        shares = [max(share, least) for share in shares]
        self.segments = stiffness * sum(shares) / np.array(shares)


def handle_share(inst: FullForm, length: float | None) -> float:
    """Return the share of the compliance of a tendon of a length, m, that is before the first joint."""
    if inst.friction.handle_compliance_share is not None:
        return inst.friction.handle_compliance_share
    held = [joint.end_effector_length for joint in inst.handle_joints if joint.end_effector_length is not None]
    return min(sum(held) / length, 0.5) if held and length else _HANDLE_SHARE


def _rest(inst: FullForm, tendon: Tendon, taken: float) -> float:
    """Return what handle and joints leave of a tendon's compliance; raises ArgumentError if that is nothing."""
    if taken < 1:
        return 1 - taken
    raise ArgumentError(
        f"the joints and the handle take {taken:.3g} of the compliance of tendon {tendon.name} of {inst.name}; it must "
        "be less than 1: give a longer tendon, or smaller shares in [friction].",
        key="friction.handle_compliance_share",
        value=taken,
        allowed="shares below 1 together",
    )


def _coefficient(friction: Friction, crossing: Crossing, joint: Joint, before: Joint | None) -> float:
    """Return the friction coefficient at a contact, of which an arc's bends differ before and after."""
    own = friction.vertex_coefficient if crossing.coefficient is None else crossing.coefficient
    return own * (_bend_before(joint, before) if friction.vertices_per_joint == 1 else 1.0) * friction.vertex_factor


def _share(joint: Joint, length: float | None) -> float:
    """Part of a tendon's length, m, that runs along a straight joint; none of one without a length."""
    return (joint.chord or 2 * joint.radius) / length if length else 0.0


def _bend_before(joint: Joint, before: Joint | None) -> float:
    """Return the share of an arc's bend after which a tendon has the tension with which it bends the arc.

    That is its tension in the arc's middle. So an arc after another has half the bend of either before it, and all of
    one for evenly bent arcs; the first has half of its own.
    """
    is_first = joint.arc == 1 and not (before is not None and before.arc and before.arc == before.arcs)
    return 0.5 if is_first else 1.0
