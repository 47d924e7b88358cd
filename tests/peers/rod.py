"""A backbone in space as an inextensible Kirchhoff rod, by shooting; it shares nothing with arcs."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

_Z = np.array([0.0, 0.0, 1.0])
_STEPS = 16
"""Of the classical Runge-Kutta rule along the rod."""
_BY = 1e-6
"""Difference by which slopes are taken; the rule's error is the same for both, so that only rounding is amplified."""
_SETTLED = 1e-9
_MOST_STEPS = 15


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
    """Where the rod ends: place (3,), m, unit quaternion w, x, y, z, and tensions, N."""

    place: np.ndarray
    rotation: np.ndarray
    tensions: np.ndarray


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the vector product of (..., 3) arrays; of these small ones NumPy's takes three times as long."""
    return np.asarray(a[..., [1, 2, 0]] * b[..., [2, 0, 1]] - a[..., [2, 0, 1]] * b[..., [1, 2, 0]])


def turned(rotation: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Return vectors (..., 3) turned by unit quaternions (..., 4)."""
    w, v = rotation[..., :1], rotation[..., 1:]
    twice = 2 * _cross(v, vector)
    return np.asarray(vector + w * twice + _cross(v, twice))


def _back(rotation: np.ndarray) -> np.ndarray:
    return rotation * [1, -1, -1, -1]


def _times(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    w = a[..., :1] * b[..., :1] - (a[..., 1:] * b[..., 1:]).sum(-1, keepdims=True)
    return np.concatenate([w, a[..., :1] * b[..., 1:] + b[..., :1] * a[..., 1:] + _cross(a[..., 1:], b[..., 1:])], -1)


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
    scale = np.concatenate([np.full(3, rod.length), np.ones(3), np.full(len(lengths), near.max())])

    def integrated(guess: np.ndarray, share: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the far end, (n, 7 + tendons), and the tensions, where it is guessed to be in place and turn."""
        unknown = guess * scale
        tensions = np.maximum(rod.pretension + rod.stiffness * (share * lengths - unknown[:, 6:]), 0.0)
        half = unknown[:, 3:6] / 2
        tip = np.concatenate([np.sqrt(np.maximum(1 - (half**2).sum(1, keepdims=True), 0.0)), half], 1)
        force = turned(tip, share * load[:3])
        moment = turned(tip, share * (load[3:] + rod.end_effector_length * _cross(_Z, load[:3])))

        def rates(s: float, y: np.ndarray) -> np.ndarray:
            rotation = y[:, 3:7] / np.linalg.norm(y[:, 3:7], axis=1, keepdims=True)
            x, z = (near + (far - near) * s / rod.length).T
            inner = turned(_back(rotation), moment + _cross(unknown[:, :3] - y[:, :3], force))
            inner[:, 0] -= tensions @ z
            inner[:, 1] += tensions @ x
            turn = inner * yields
            spin = 0.5 * _times(rotation, np.pad(turn, ((0, 0), (1, 0))))
            drawn = turn[:, 1:2] * x - turn[:, :1] * z
            return np.concatenate([turned(rotation, _Z), spin, drawn], 1)

        y = np.zeros((len(guess), 7 + len(lengths)))
        y[:, 3] = 1.0
        h = rod.length / _STEPS
        for s in h * np.arange(_STEPS):
            one = rates(s, y)
            two = rates(s + h / 2, y + h / 2 * one)
            three = rates(s + h / 2, y + h / 2 * two)
            four = rates(s + h, y + h * three)
            y = y + h / 6 * (one + 2 * two + 2 * three + four)
        y[:, 3:7] /= np.linalg.norm(y[:, 3:7], axis=1, keepdims=True)
        return y, tensions

    def missed(guess: np.ndarray, share: float) -> np.ndarray:
        y, _ = integrated(guess, share)
        return np.concatenate([y[:, :3], 2 * y[:, 4:7], y[:, 7:]], 1) / scale - guess

    at = np.concatenate([_Z, np.zeros(3 + len(lengths))])
    for share in np.linspace(0.0, 1.0, parts + 1)[1:]:
        at = _solved(lambda x, p=share: missed(x, p), at)
    y, tensions = integrated(at[None], 1.0)
    return End(y[0, :3], y[0, 3:7], tensions[0])


def _solved(missed: Callable[[np.ndarray], np.ndarray], at: np.ndarray) -> np.ndarray:
    """Return where all of a function vanishes, by Newton's iteration with steps that are halved until it falls."""
    moves = _BY * np.eye(len(at))
    off = missed(at[None])[0]
    for _ in range(_MOST_STEPS):
        if np.abs(off).max() < _SETTLED:
            return at
        apart = missed(np.concatenate([at + moves, at - moves]))
        step = np.linalg.solve((apart[: len(at)] - apart[len(at) :]).T / (2 * _BY), -off)
        shares = 0.5 ** np.arange(12)
        tried = missed(at + shares[:, None] * step)
        best = int(np.argmin(np.linalg.norm(tried, axis=1)))
        at, off = at + shares[best] * step, tried[best]
    raise ValueError(f"the rod's end is {np.abs(off).max():.3g} off")
