"""What a backbone that bends as one arc leaves out: the S into which a force across bends it."""

from typing import NamedTuple

import numpy as np

from tenodesis import kinematics, statics
from tenodesis.errors import Error
from tenodesis.instrument import FullForm, InstrumentLike, expanded, in_arcs
from tenodesis.run import ACROSS, COMPONENTS

_SMALL = 5e-3
"""Error of a deflection below which nothing need be said, as a share of it."""


class OneArc(NamedTuple):
    """How far a force across moves the tip, handle and motors held, m: by arcs as given, and by more of them."""

    joint: str
    """The backbone."""
    force: float
    """N"""
    given: float
    finer: float
    arcs: int
    """Of each backbone, in the finer."""

    @property
    def matters(self) -> bool:
        """Whether the difference is more than half a percent."""
        return abs(self.given - self.finer) > _SMALL * self.finer


def one_arc(inst: InstrumentLike) -> OneArc | None:
    """Return what backbones as one arc leave out; None without such a backbone, or where neither finds its place."""
    whole = expanded(inst)
    single = [joint for joint in whole.tip_joints if joint.mechanism == "continuum" and not joint.arc]
    if not single or single[0].axis not in ACROSS:
        return None
    in_several = in_arcs(whole)
    force = max(whole.conditions.forces, default=1.0)
    wrench = np.zeros(6)
    wrench[COMPONENTS.index(ACROSS[str(single[0].axis)])] = force
    try:
        given, finer = (_deflection(one, wrench) for one in (whole, in_several))
    except Error:
        return None
    return OneArc(single[0].name, force, given, finer, max(joint.arc_count for joint in in_several.tip_joints))


def _deflection(inst: FullForm, wrench: np.ndarray) -> float:
    angles = statics.chain.output_angles(inst, np.zeros(len(inst.handle_joints)), [np.zeros(6), wrench])
    start, end = kinematics.tip_pose(inst, angles).position[:, 0]
    return float(np.linalg.norm(end - start))
