"""A protocol for any instrument."""

import math

import numpy as np

from tenodesis.instrument import FullForm, InstrumentLike, expanded
from tenodesis.simulate.loads import Wrench
from tenodesis.simulate.phases import Cycles, GrippedObject, Hold, Ramp, StepLoad
from tenodesis.simulate.places import Places
from tenodesis.simulate.protocol import AnyPhase, Protocol
from tenodesis.statics import chain

_SPEED = math.radians(40)
"""Of joints, rad/s."""
_RISE = 0.2
"""Time in which the spools come to their speed, s."""
_LOAD = 1.0
"""Largest load, N."""
_LOST = math.radians(5)
"""Largest angle that it may take from a joint, rad."""
_PRESSED = 1e-3
"""How far the jaws close beyond where they touch the object, m."""
_OBJECT = 2e3
"""Stiffness of the object, N/m."""


def default_protocol(inst: InstrumentLike) -> Protocol:
    """Return a protocol that shows what an instrument does.

    Every joint of the handle in turn, without a handle of the tip, goes through half of its range and back. Then the
    tip is loaded across, each way, and jaws grip an object.
    """
    inst = expanded(inst)
    phases: list[AnyPhase] = []
    for name, place in Places.of(inst).joints.items():
        end = inst.bend_ends[place.number] if place.joint is None else place.joint.range
        amplitude = math.copysign(min(place.reach, abs(end) / 2), end)
        phases.append(Cycles(joint=name, amplitude=amplitude, speed=_SPEED, count=1, shape="smooth"))
    across = np.abs(chain.rates(inst, np.zeros(len(inst.handle_joints))).by_wrench[:, :2])
    force = float(f"{min(_LOAD, _LOST / across.max()):.1g}")
    for component, bends in zip(("fx", "fy"), across.max(axis=0), strict=True):
        for sign in (1, -1) if bends else ():
            wrench = Wrench(**{component: sign * force})
            phases.append(StepLoad(wrench=wrench, delay=0.2, rise=0.1, duration=0.5, release=0.3))
    if inst.grip is not None:
        phases += _gripping(inst)
    return Protocol(name="default", description=f"Motion, load and grip of {inst.name}"[:200], phases=tuple(phases))


def _gripping(inst: FullForm) -> list[AnyPhase]:
    """Return phases in which the jaws close on an object, hold it, and let go."""
    arms = inst.grip_arms
    placed: list[AnyPhase] = [GrippedObject(stiffness=_OBJECT)]
    removed: list[AnyPhase] = [GrippedObject(stiffness=0.0)]
    if inst.handle_joints:
        quarters = np.diag([joint.range / 4 for joint in inst.handle_joints])
        aims = np.concatenate([quarters, -quarters])
        opened = chain.output_angles(inst, aims) @ arms
        most = int(np.argmin(opened))
        if not opened[most] < 0:
            return []
        angles = aims[most] * min(1.0, -_PRESSED / opened[most])
        closed = {inst.handle_joints[most % len(quarters)].name: float(angles.sum())}
    else:
        turned = -_PRESSED * arms / float(arms @ arms)
        closed = {name: float(turned[at].sum()) for name, at in inst.bends.items() if turned[at].any()}
    moves = [Ramp(duration=2 * _RISE, handle_angles=aim) for aim in (closed, dict.fromkeys(closed, 0.0))]
    return [*placed, moves[0], Hold(duration=1.0), moves[1], *removed]
