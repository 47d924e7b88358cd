"""Flanks of spur gears: involutes and the fillets that a rack leaves, with the backlash taken from the teeth."""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from tenodesis.run import Array

PRESSURE_ANGLE = math.radians(20)
"""ISO 53."""
_ROOT = 1.25  # of a module below the pitch circle, ISO 53 profile A
_POINTS = 9
_FLATTEST_TIP = 0.2  # of a module; a thinner tip breaks


class Gear(NamedTuple):
    """A spur gear without profile shift; lengths in any one unit."""

    module: float
    teeth: int
    backlash: float = 0.0
    """Play of two such gears along their pitch circles; either gear's teeth are thinner by half of it."""

    @property
    def pitch_radius(self) -> float:
        """Radius at which two gears roll on each other."""
        return self.module * self.teeth / 2

    @property
    def root_radius(self) -> float:
        """Radius at the bottom of the spaces."""
        return self.pitch_radius - _ROOT * self.module

    @property
    def tip_radius(self) -> float:
        """Radius at the tips of the teeth: a module above the pitch circle, less where teeth would become pointed."""
        radii = np.linspace(self.pitch_radius, self.pitch_radius + self.module, 50)
        widths = 2 * radii * (math.pi / self.teeth - self.space(radii))
        wide = widths >= _FLATTEST_TIP * self.module
        return float(radii[wide][-1]) if wide.any() else self.pitch_radius

    def space(self, radii: Array) -> Array:
        """Return half the angle of a space at radii from root to tip, rad.

        It is the envelope of a rack (ISO 53, with sharp corners) that rolls on the pitch circle: the involute of its
        flank, and below it the trochoid of its corner, which undercuts gears of fewer than 22 teeth.
        """
        pitch, depth = self.pitch_radius, _ROOT * self.module
        base = pitch * math.cos(PRESSURE_ANGLE)
        extra = self.backlash / (4 * pitch)
        ratio = np.minimum(base / np.maximum(radii, base), 1.0)
        involute = math.pi / (2 * self.teeth) + extra - _involute(math.cos(PRESSURE_ANGLE)) + _involute(ratio)
        involute = np.where(radii < base, -np.inf, involute)
        corner = math.pi * self.module / 4 + self.backlash / 4 - depth * math.tan(PRESSURE_ANGLE)
        along = np.sqrt(np.maximum(radii**2 - (pitch - depth) ** 2, 0.0))
        trochoids = [np.arctan2(sign * along, pitch - depth) - (sign * along - corner) / pitch for sign in (1, -1)]
        found: Array = np.maximum(involute, np.maximum(*trochoids))
        return found

    def flank(self) -> list[Array]:
        """Return the flank of a space about the x axis from root to tip: fillet and involute, each points (n, 2)."""
        fine = np.linspace(self.root_radius, self.tip_radius, 400)
        angles = self.space(fine)
        bends = np.abs(np.diff(angles, 2))
        kink = int(bends[20:-20].argmax()) + 21 if bends.size else 0
        cuts = [0, kink, len(fine) - 1]
        pieces = []
        for begin, end in pairwise(cuts):
            # Closer points at the root, where the fillet is round.
            chosen = fine[begin] + (fine[end] - fine[begin]) * np.linspace(0, 1, _POINTS) ** 1.5
            half = self.space(chosen)
            pieces.append(np.stack([chosen * np.cos(half), chosen * np.sin(half)], 1))
        return pieces


def _involute(cosine: "float | Array") -> "Array":
    """Return inv(angle) = tan(angle) - angle by the angle's cosine."""
    angle = np.arccos(cosine)
    found: Array = np.tan(angle) - angle
    return found
