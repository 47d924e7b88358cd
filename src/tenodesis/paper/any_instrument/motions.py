"""How an instrument is moved in the chapters: by each joint of the handle, or by motors where there is no handle."""

from typing import NamedTuple

import numpy as np

from tenodesis import statics
from tenodesis.errors import NoSolutionError
from tenodesis.instrument import FullForm
from tenodesis.report.content import Array
from tenodesis.simulate import AnyPhase, Hold, Ramp
from tenodesis.statics import chain

SPEED = float(np.radians(20))
"""Of the joint that follows, about, rad/s."""
_POINTS = 81
_SPOOL_RISE = 0.2
"""Time in which spools come to their speed, s."""
_TURNS = np.radians(0.5)
"""Least angle of a motion."""


class Motion(NamedTuple):
    """A motion from the straight instrument to its far end, handle and motors in proportion."""

    name: str
    """Of the handle's joint that is moved, or of the tip's that the motors bend"""
    follows: int
    """Place of the tip's joint that turns most"""
    handle: Array
    """At the far end, (handle joints,), rad"""
    strokes: Array
    """At the far end, (tendons,), m"""
    shares: Array
    """Shares of the way, (n,)"""
    angles: Array
    """Of the tip's joints there, without load and friction, (n, joints), rad"""

    def there_and_back(self, inst: FullForm, count: int) -> list[AnyPhase]:
        """Return the phases of cycles of the motion."""
        seconds = float(np.ptp(self.angles[:, self.follows])) / SPEED
        out = moved(inst, self.handle, self.strokes, seconds)
        return count * [*out, *moved(inst, 0 * self.handle, -self.strokes, seconds)]


def moved(inst: FullForm, handle: Array, strokes: Array, seconds: float) -> list[AnyPhase]:
    """Return the phases in which the handle moves to angles (rad), and motors wind lengths (m), in a time (s)."""
    phases: list[AnyPhase] = []
    if handle.size:
        angles = {joint.name: float(angle) for joint, angle in zip(inst.handle_joints, handle, strict=True)}
        phases.append(Ramp(duration=seconds, handle_angles=angles))
    speeds = strokes / (inst.spool_radius or inst.drives.spool_radius) / seconds
    spools = {tendon.name: float(speed) for tendon, speed in zip(inst.tendons, speeds, strict=True) if speed}
    if spools:
        phases += [
            Ramp(duration=_SPOOL_RISE, spool_velocities=spools),
            Hold(duration=max(seconds - _SPOOL_RISE, 1e-3)),
            Ramp(duration=_SPOOL_RISE, spool_velocities=dict.fromkeys(spools, 0.0)),
        ]
    return phases


def motions(inst: FullForm) -> list[Motion]:
    """Return the motion of every joint of the handle; without a handle, of the motors for every joint of the tip.

    A motion goes as far as the range of what is moved, and of the joints that it turns. What turns no joint is left
    out, and so is a joint that motors do not turn.
    """
    handles, tips, tendons = inst.handle_joints, inst.tip_joints, len(inst.tendons)
    ends: list[tuple[str, Array, Array]] = [
        (joint.name, joint.range * row, np.zeros(tendons))
        for joint, row in zip(handles, np.eye(len(handles)), strict=True)
    ]
    if not handles:
        for joint, row, arm in zip(tips, np.eye(len(tips)), inst.grip_arms, strict=True):
            try:
                # A jaw opens.
                ends.append((joint.name, *statics.hold(inst, (-1 if arm < 0 else 1) * joint.range * row)))
            except NoSolutionError:
                continue
    found = (_motion(inst, *end) for end in ends)
    return [motion for motion in found if motion is not None]


def _motion(inst: FullForm, name: str, handle: Array, strokes: Array) -> Motion | None:
    shares = np.linspace(0.0, 1.0, _POINTS)
    angles = chain.output_angles(inst, np.outer(shares, handle), strokes=np.outer(shares, strokes))
    ranges = np.array([joint.range for joint in inst.tip_joints])
    beyond = ~(np.abs(angles) <= ranges + 1e-6).all(axis=1)
    last = int(np.argmax(beyond)) - 1 if beyond.any() else _POINTS - 1
    if last < 1:
        return None
    end = shares[last]
    angles = chain.output_angles(inst, np.outer(end * shares, handle), strokes=np.outer(end * shares, strokes))
    turned = np.abs(angles[-1] - angles[0])
    if not turned.max() > _TURNS:
        return None
    return Motion(name, int(np.argmax(turned)), end * handle, end * strokes, shares, angles)
