"""Springs between joints: of the arcs of a backbone, and what stands for gears, links and discs that tie joints."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tenodesis.instrument.backbones import OWN, SHARED
from tenodesis.instrument.joints import Joint, arc_suffix

_RIGID = 1e5
"""Stiffness of what ties joints rigidly, over that of the tendons and springs about them: it gives way by 1e-5 of what
they do, which no measurement shows, and costs five of the sixteen digits."""


class Tie(NamedTuple):
    """A spring between two joints, relaxed where the angle of one is a ratio times that of the other."""

    to: int
    """Place of the other among the tip's joints, before this one; -1: there is no tie."""
    ratio: float
    stiffness: float
    """N m/rad"""
    is_rigid: bool


_NONE = Tie(-1, 0.0, 0.0, False)


def own_stiffness(joint: Joint) -> float:
    """Return the stiffness of a joint's own spring, N m/rad; of an arc, without what ties it to its neighbour."""
    return (OWN if joint.arc else 1.0) * joint.backbone_stiffness + (joint.stiffness or 0.0)


def ties(joints: Sequence[Joint], stiffness: NDArray[np.float64]) -> list[Tie]:
    """Return the tie of every joint of the tip, whose tendons and springs have a stiffness, (joints,), N m/rad."""
    names = [joint.name for joint in joints]
    found = []
    for i, joint in enumerate(joints):
        if joint.tied_to is not None:
            to = names.index(joint.tied_to)
            found.append(Tie(to, joint.tie_ratio, _RIGID * float(stiffness[i] + stiffness[to]), True))
        elif joint.arc and joint.arc % 2 == 0 and not joint.is_twist:
            before = names.index(joint.bend + arc_suffix(joint.arc - 1))
            found.append(Tie(before, -1.0, SHARED * joint.backbone_stiffness, False))
        else:
            found.append(_NONE)
    return found
