"""A protocol for any instrument."""

import math

import numpy as np

from tenodesis.instrument import FullForm, InstrumentLike, expanded
from tenodesis.run import Array
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

    Every joint of the handle in turn goes through half of its range and back; without a handle the spools drive every
    joint of the tip so. Then the tip is loaded across, each way, and jaws grip an object.
    """
    inst = expanded(inst)
    phases: list[AnyPhase] = []
    for name, place in Places.of(inst).joints.items():
        amplitude = min(place.reach, inst.handle_joints[place.handle].range / 2)
        phases.append(Cycles(joint=name, amplitude=amplitude, speed=_SPEED, count=1, shape="smooth"))
    if not phases:
        phases = [phase for n in range(len(inst.bends)) for phase in _there_and_back(inst, n)]
    across = np.abs(chain.rates(inst, np.zeros(len(inst.handle_joints))).by_wrench[:, :2])
    force = float(f"{min(_LOAD, _LOST / across.max()):.1g}")
    for component, bends in zip(("fx", "fy"), across.max(axis=0), strict=True):
        for sign in (1, -1) if bends else ():
            wrench = Wrench(**{component: sign * force})
            phases.append(StepLoad(wrench=wrench, delay=0.2, rise=0.1, duration=0.5, release=0.3))
    if inst.grip is not None:
        phases += _gripping(inst)
    return Protocol(name="default", description=f"Motion, load and grip of {inst.name}"[:200], phases=tuple(phases))


def _there_and_back(inst: FullForm, number: int) -> list[AnyPhase]:
    """Return phases in which the spools drive what bends at the tip through half of its range and back."""
    bends = np.zeros(len(inst.bends))
    bends[number] = inst.bend_ends[number] / 2
    angles, seconds = inst.bent(bends), float(abs(bends[number]) / _SPEED)
    return [*_driven(inst, angles, seconds), Hold(duration=_RISE), *_driven(inst, -angles, seconds)]


def _driven(inst: FullForm, angles: Array, seconds: float) -> list[AnyPhase]:
    """Return phases in which the spools draw what tendons that do not stretch would for a change of the angles."""
    speeds = inst.tendon_arms("tip") @ angles / inst.own_drives.spool_radius / seconds
    spools = {
        tendon.name: float(speed)
        for tendon, speed in zip(inst.tendons, speeds, strict=True)
        if speed and tendon.start == "spool"
    }
    if not spools:
        return []
    return [
        Ramp(duration=_RISE, spool_velocities=spools),
        Hold(duration=max(seconds - _RISE, 1e-3)),
        Ramp(duration=_RISE, spool_velocities=dict.fromkeys(spools, 0.0)),
    ]


def _gripping(inst: FullForm) -> list[AnyPhase]:
    """Return phases in which the jaws close on an object, hold it, and let go."""
    arms = inst.grip_arms
    placed: list[AnyPhase] = [GrippedObject(stiffness=_OBJECT)]
    removed: list[AnyPhase] = [GrippedObject(stiffness=0.0)]
    closed = -_PRESSED * arms / float(arms @ arms)
    if not inst.handle_joints:
        close, open_again = (_driven(inst, sign * closed, 2 * _RISE) for sign in (1, -1))
        return [*placed, *close, Hold(duration=1.0), *open_again, *removed]
    quarters = np.diag([joint.range / 4 for joint in inst.handle_joints])
    aims = np.concatenate([quarters, -quarters])
    opened = chain.output_angles(inst, aims) @ arms
    most = int(np.argmin(opened))
    if not opened[most] < 0:
        return []
    angles = aims[most] * min(1.0, -_PRESSED / opened[most])
    joint = inst.handle_joints[most % len(quarters)].name
    moves = [Ramp(duration=2 * _RISE, handle_angles={joint: aim}) for aim in (float(angles.sum()), 0.0)]
    return [*placed, moves[0], Hold(duration=1.0), moves[1], *removed]
