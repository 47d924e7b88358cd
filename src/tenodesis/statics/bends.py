"""Backbones in arcs as one joint each: angles summed, and how the sums answer."""

from typing import NamedTuple

import numpy as np

from tenodesis.instrument import FullForm
from tenodesis.statics import chain
from tenodesis.statics.chain import Array, Rates


class Bends(NamedTuple):
    """The joints of a tip, a backbone's arcs as one."""

    names: list[str]
    sums: Array
    """Zeros and ones that sum the angles of arcs, (bends, joints)"""

    @classmethod
    def of(cls, inst: FullForm) -> "Bends":
        """Return those of an instrument."""
        arcs = inst.arc_places
        sums = np.zeros((len(arcs), len(inst.tip_joints)))
        for row, places in zip(sums, arcs.values(), strict=True):
            row[places] = 1.0
        return cls(list(arcs), sums)

    @property
    def cut(self) -> bool:
        """Whether there are arcs."""
        return bool(len(self.sums) < self.sums.shape[1])

    def summed(self, angles: Array) -> Array:
        """Return angles (..., joints) with those of arcs summed, (..., bends)."""
        return np.asarray(angles @ self.sums.T) if self.cut else angles

    def mean(self, values: Array) -> Array:
        """Return what all arcs of a backbone have alike, (..., joints), of each once, (..., bends)."""
        return np.asarray(values @ (self.sums / self.sums.sum(axis=1, keepdims=True)).T) if self.cut else values

    def rates(self, found: Rates) -> Rates:
        """Return how the bends answer; moments act at the end of a backbone."""
        if not self.cut:
            return found
        known = np.isfinite(found.stiffness).all(axis=(-2, -1), keepdims=True)
        compliance = np.linalg.inv(np.where(known, found.stiffness, np.eye(self.sums.shape[1])))
        stiffness = np.where(known, np.linalg.inv(self.sums @ compliance @ self.sums.T), np.nan)
        by = (found.by_wrench, found.by_grip[..., np.newaxis], found.by_stroke, found.by_handle)
        wrench, grip, stroke, turned = (np.asarray(self.sums @ one) for one in by)
        return Rates(stiffness, wrench, grip[..., 0], stroke, turned)


def straight_arms(inst: FullForm) -> Array:
    """Return the moment arms of the tendons about what bends at the straight tip, (tendons, bends), m."""
    return Bends.of(inst).mean(chain.straight_arms(inst))
