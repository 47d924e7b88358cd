"""A backbone in space as an inextensible Kirchhoff rod, by shooting; it shares nothing with arcs."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root
from scipy.spatial.transform import Rotation

_Z = np.array([0.0, 0.0, 1.0])
_TOLERANCE = 1e-9


class Rod(NamedTuple):
    """A straight rod with tendons that keep their places in its sections; SI."""

    length: float
    bending: float
    """E I, N m^2"""
    torsion: float
    """G J, N m^2; infinite: it does not twist."""
    tendons: np.ndarray
    """Places in the section at the near end and at the far end, (tendons, 4), m."""
    stiffness: float
    """Of a tendon, N/m"""
    pretension: float
    end_effector_length: float


class End(NamedTuple):
    """Where the rod ends: place (3,), m, rotation, and tensions, N."""

    place: np.ndarray
    rotation: Rotation
    tensions: np.ndarray


def end(rod: Rod, wrench: Sequence[float], wound: Sequence[float], parts: int = 4) -> End:
    """Return where a rod ends.

    Parameters
    ----------
    rod
        The rod, along z.
    wrench
        Force and moment on the end of the end-effector, in its axes, (6,), N and N m.
    wound
        Length wound on each tendon, m.
    parts
        In which load and strokes are raised.
    """
    lengths, load = np.asarray(wound, float), np.asarray(wrench, float)
    near, far = rod.tendons[:, :2], rod.tendons[:, 2:]
    yields = 1 / np.array([rod.bending, rod.bending, rod.torsion])

    def integrated(unknown: np.ndarray, share: float) -> tuple[np.ndarray, Rotation, np.ndarray, np.ndarray]:
        drawn = unknown[6:]
        tensions = np.maximum(rod.pretension + rod.stiffness * (share * lengths - drawn), 0.0)
        tip = Rotation.from_rotvec(unknown[3:6])
        force = tip.apply(share * load[:3])
        moment = tip.apply(share * (load[3:] + rod.end_effector_length * np.cross(_Z, load[:3])))

        def rates(s: float, y: np.ndarray) -> np.ndarray:
            place, (w, *v) = y[:3], y[3:7]
            v = np.array(v)
            x, z = (near + (far - near) * s / rod.length).T
            outer = moment + np.cross(unknown[:3] - place, force)
            # A vector of space, in the axes of the section.
            inner = outer - 2 * w * np.cross(v, outer) + 2 * np.cross(v, np.cross(v, outer))
            inner[0] -= tensions @ z
            inner[1] += tensions @ x
            turn = inner * yields
            along = _Z + 2 * w * np.cross(v, _Z) + 2 * np.cross(v, np.cross(v, _Z))
            return np.concatenate(
                [along, [-0.5 * v @ turn], 0.5 * (w * turn + np.cross(v, turn)), x * turn[1] - z * turn[0]]
            )

        start = np.concatenate([np.zeros(3), [1.0], np.zeros(3 + len(lengths))])
        y = solve_ivp(rates, (0.0, rod.length), start, "DOP853", rtol=1e-9, atol=1e-12).y[:, -1]
        return y[:3], Rotation.from_quat([*y[4:7], y[3]]), y[7:], tensions

    def missed(unknown: np.ndarray, share: float) -> np.ndarray:
        place, rotation, drawn, _ = integrated(unknown, share)
        apart = (rotation * Rotation.from_rotvec(unknown[3:6]).inv()).as_rotvec()
        scale = rod.length
        return np.concatenate([(place - unknown[:3]) / scale, apart, (drawn - unknown[6:]) / near.max()])

    at = np.concatenate([rod.length * _Z, np.zeros(3 + len(lengths))])
    for share in np.linspace(0.0, 1.0, parts + 1)[1:]:
        found = root(missed, at, (share,), tol=_TOLERANCE)
        if not found.success and np.abs(found.fun).max() > 1e3 * _TOLERANCE:
            raise ValueError(found.message)
        at = found.x
    place, rotation, _, tensions = integrated(at, 1.0)
    return End(place, rotation, tensions)
