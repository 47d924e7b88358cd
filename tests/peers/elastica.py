"""A planar backbone as an elastica: a boundary-value problem, solved by SciPy, which shares nothing with arcs."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_bvp


class Backbone(NamedTuple):
    """A backbone between tendons at offsets on its two sides, with an end-effector beyond; SI."""

    length: float
    rigidity: float
    offset: float
    stiffness: float
    """Of a tendon, N/m"""
    pretension: float
    end_effector_length: float


class Tip(NamedTuple):
    """Angle (rad) and place (m) of the backbone's end; the larger is the angle, the more it bends toward x."""

    angle: float
    x: float
    z: float


def tip(backbone: Backbone, force: Sequence[float], moment: float, wound: Sequence[float], parts: int = 4) -> Tip:
    """Return where a backbone ends.

    Parameters
    ----------
    backbone
        The backbone.
    force
        Along x and z of the end-effector, at its end, N.
    moment
        On the end-effector, toward x, N m.
    wound
        Length wound on the tendon toward x and on the other, m.
    parts
        In which the load is raised.
    """
    of = backbone
    s = np.linspace(0.0, of.length, 21)
    couple = of.offset * of.stiffness * (wound[0] - wound[1])
    start = couple / (of.rigidity / of.length + 2 * of.stiffness * of.offset**2)
    y = np.array([start * s / of.length, np.full_like(s, start / of.length * of.rigidity), 0 * s, s])
    end = np.array([start])
    raised = [0.0]

    def rates(_: np.ndarray, y: np.ndarray, end: np.ndarray) -> np.ndarray:
        fx, fz = raised[0] * np.asarray(force)
        x, z = fx * np.cos(end) + fz * np.sin(end), fz * np.cos(end) - fx * np.sin(end)
        return np.vstack([y[1] / of.rigidity, z * np.sin(y[0]) - x * np.cos(y[0]), np.sin(y[0]), np.cos(y[0])])

    def ends(at_base: np.ndarray, at_end: np.ndarray, end: np.ndarray) -> np.ndarray:
        angle = at_end[0]
        tensions = [
            max(of.pretension + of.stiffness * (length - side * of.offset * angle), 0.0)
            for side, length in zip((1, -1), wound, strict=True)
        ]
        across = moment + force[0] * of.end_effector_length
        held = of.offset * (tensions[0] - tensions[1]) + raised[0] * across
        return np.array([at_base[0], at_base[2], at_base[3], at_end[1] - held, angle - end[0]])

    for share in np.linspace(0.0, 1.0, parts + 1):
        raised[0] = share
        found = solve_bvp(rates, ends, s, y, p=end, tol=1e-8, max_nodes=20_000)
        if not found.success:
            raise ValueError(found.message)
        s, y, end = found.x, found.y, found.p
    return Tip(float(y[0, -1]), float(y[2, -1]), float(y[3, -1]))
