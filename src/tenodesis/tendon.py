"""A tendon with friction between spool and tip, by the core's return mapping.

Tensions in N, lengths in m, stiffness in N/m; friction exponents are coefficient times wrap angle.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tenodesis import _core
from tenodesis.errors import ArgumentError
from tenodesis.instrument.hardware import MOST_EXPONENT

__all__ = ["TRANSMISSION", "FarEnd", "Tendon", "TendonRun", "far_end", "transmit"]

Array = NDArray[np.float64]


class TendonRun(NamedTuple):
    """Tensions, length, loss and residual of a tendon, one value per step, each of shape (n,)."""

    proximal: Array
    """Tension at the spool, N."""
    distal: Array
    """Tension at the tip, N."""
    wound: Array
    """Length wound in at the spool, m."""
    dissipated: Array
    """Energy lost to friction in the step, J."""
    residual: Array
    """Largest violation of the friction law at any contact, N."""


def transmit(tension: ArrayLike, exponent: float, gain: float = 1.0, initial: float | None = None) -> Array:
    """Return the distal tension of a contact for a measured sequence of proximal tension, N.

    The far end is held, so that its tension stays while the contact sticks and follows on the band's edge, a factor
    exp(exponent) below or above, while it slides (Euler, Eytelwein).

    Parameters
    ----------
    tension
        Proximal tension, N, shape (n,); negative values count as slack.
    exponent
        Friction coefficient times wrap angle, dimensionless.
    gain
        Gain of the distal load cell over the proximal one.
    initial
        Distal tension before the first sample, N; by default the first proximal one.

    Returns
    -------
    array
        Distal tension, N, shape (n,).

    Raises
    ------
    ValueError
        An argument is not finite, the exponent is negative, or a gain is not positive.
    """
    series = _series("tension", tension)
    _check("exponent", exponent, 0.0, MOST_EXPONENT)
    _check("gain", gain, 1e-9, 1e9)
    held = float(max(series[0], 0.0)) if initial is None and series.size else initial or 0.0
    _check("initial", held, 0.0, 1e9)
    out: Array = np.empty((1, series.size))
    _core.transmit(series, exponent, gain, held, out)
    distal: Array = out[0]
    return distal


TRANSMISSION: Mapping[str, float] = MappingProxyType(
    {
        "torque_constant": 0.0,
        "drive_friction": 0.0,
        "drive_friction_slope": 0.0,
        "load_friction": 0.0,
        "viscous": 0.0,
        "heat_loss": 0.0,
        "heat_time": 60.0,
        "speed_time": 0.1,
        "drive_play": math.radians(0.5),
        "torque_offset": 0.0,
        "ratio": 1.0,
        "torque_ratio": 1.0,
        "near_compliance": 0.0,
        "compliance": 0.0,
        "far_compliance": 0.0,
        "near_stiffness": 0.0,
        "far_stiffness": 0.0,
        "near_friction": 0.0,
        "friction_exponent": 0.0,
        "pretension": 0.0,
        "joint_friction": 0.0,
        "play": math.radians(1),
    }
)
"""Parameters of a transmission (rad, N·m, A, s) and their values where none is given: rigid, without friction or drive.

The first nine are of motor and gearbox; `far_end.hpp` defines all.
"""


class FarEnd(NamedTuple):
    """Far end of a transmission by its near end, one value per sample, each of shape (n,)."""

    angle: Array
    """rad, without the zero of its sensor."""
    torque: Array
    """N·m."""
    hidden_angle: Array
    """How far friction may hide the angle, rad, of the opposite sign to that of the torque."""
    hidden_torque: Array
    """How far friction may hide the torque, N·m: where contacts have not slipped since they last reversed."""
    near_torque: Array
    """Torque of the near end's shaft, which a current gives, N·m."""


def far_end(
    parameters: Mapping[str, float],
    angle: ArrayLike,
    *,
    torque: ArrayLike | None = None,
    current: ArrayLike | None = None,
    time_step: float = 1e-3,
) -> FarEnd:
    """Return angle and torque at the far end of a tendon transmission from its near end's, by the core's estimator.

    Parameters
    ----------
    parameters
        Parameters by their names in `TRANSMISSION`.
    angle
        Angle of the near end's shaft from the middle of its travel, positive as the tendon is pulled, rad, shape (n,).
    torque, current
        Torque of that shaft, N·m, or current of its motor, A, shape (n,): one of them.
    time_step
        Time between samples, s.

    Raises
    ------
    ValueError
        A parameter is unknown, a value is not finite, shapes differ, both or neither of torque and current are given,
        or current is without a torque constant.
    """
    for name, value in parameters.items():
        if name not in TRANSMISSION:
            raise ArgumentError(key="parameters", value=name, allowed=f"names of {', '.join(TRANSMISSION)}")
        _check(f"parameters[{name!r}]", value, -1e9, 1e9)
    if (torque is None) == (current is None):
        raise ArgumentError("torque and current are both or neither given; give one of them.", key="torque")
    given = {**TRANSMISSION, **parameters}
    if current is None:
        given["torque_constant"] = 0.0
    elif not given["torque_constant"] > 0:
        allowed = "above 0 N*m/A for a current"
        raise ArgumentError(key="parameters['torque_constant']", value=given["torque_constant"], allowed=allowed)
    near = _series("angle", angle)
    signal = _series("current" if torque is None else "torque", current if torque is None else torque)  # type: ignore[arg-type]
    if signal.size != near.size:
        name = "current" if torque is None else "torque"
        raise ArgumentError(key=name, value=f"of {signal.size} samples", allowed=f"of {near.size}, those of angle")
    _check("time_step", time_step, 1e-9, 1e6)
    out = np.empty((5, near.size))
    _core.far_end(np.array([given[name] for name in _core.transmission_parameters()]), near, signal, time_step, out)
    return FarEnd(*out)


class Tendon:
    """An elastic tendon through any number of contacts with friction, which keeps its state between calls.

    Parameters
    ----------
    stiffness
        Stiffness of the entire tendon, N/m, all segments alike, or of every segment, from the spool.
    exponents
        Friction exponent of every contact, from the spool.
    constant
        Load-independent friction of every contact, N.
    viscous
        Viscous friction of every contact, N·s/m.
    pretension
        Tension everywhere at the start, N.

    Raises
    ------
    ValueError
        A value is not finite or not allowed, or there is not one segment more than contacts.
    """

    def __init__(
        self,
        stiffness: float | Sequence[float],
        exponents: Sequence[float],
        *,
        constant: float = 0.0,
        viscous: float = 0.0,
        pretension: float = 0.0,
    ) -> None:
        contacts = _series("exponents", exponents)
        if not contacts.size:
            raise ArgumentError(key="exponents", value=exponents, allowed="one exponent per contact, at least one")
        for index, exponent in enumerate(contacts):
            _check(f"exponents[{index}]", float(exponent), 0.0, MOST_EXPONENT)
        given = np.atleast_1d(np.asarray(stiffness, float))
        segments = np.full(contacts.size + 1, given[0] * (contacts.size + 1)) if np.ndim(stiffness) == 0 else given
        if segments.size != contacts.size + 1:
            raise ArgumentError(
                f"stiffness has {segments.size} segments and exponents {contacts.size} contacts; it must be one "
                "segment more than contacts, or one number for the entire tendon.",
                key="stiffness",
                value=stiffness,
                allowed=f"{contacts.size + 1} stiffnesses, or one",
            )
        for index, segment in enumerate(segments):
            _check(f"stiffness[{index}]", float(segment), 1e-6, 1e15)
        for name, value in (("constant", constant), ("viscous", viscous), ("pretension", pretension)):
            _check(name, value, 0.0, 1e9)
        self._core = _core.Tendon(segments.tolist(), contacts.tolist(), constant, viscous, pretension)
        self.most_sweeps = 0
        """Largest number of passes that a step has taken."""

    @property
    def tensions(self) -> Array:
        """Tension of every segment now, from the spool, N, shape (contacts + 1,)."""
        return np.array(self._core.tension)

    @property
    def slips(self) -> Array:
        """Length that has slipped past every contact toward the spool, m, shape (contacts,)."""
        return np.array(self._core.slip)

    def wind(self, wound: ArrayLike, drawn: ArrayLike = 0.0, *, time_step: float = 1e-3) -> TendonRun:
        """Step over lengths wound in at the spool while the far end is pulled away.

        Parameters
        ----------
        wound
            Length wound in since the start, m, shape (n,).
        drawn
            Length by which the far end has been drawn away, m, shape (n,) or a number.
        time_step
            Time between steps, s; only viscous friction depends on it.

        Raises
        ------
        ValueError
            A value is not finite, shapes differ, or the time step is not positive.
        """
        return self._run("wound", wound, drawn, time_step, by_tension=False)

    def pull(self, tension: ArrayLike, drawn: ArrayLike = 0.0, *, time_step: float = 1e-3) -> TendonRun:
        """Step over tensions at the spool (N, shape (n,)) while the far end is pulled away.

        Other parameters and errors are those of :meth:`wind`; tensions must not be negative.
        """
        return self._run("tension", tension, drawn, time_step, by_tension=True)

    def _run(self, name: str, spool: ArrayLike, drawn: ArrayLike, time_step: float, *, by_tension: bool) -> TendonRun:
        series = _series(name, spool)
        if by_tension and series.size and series.min() < 0:
            at = int(np.argmin(series))
            raise ArgumentError(key=f"{name}[{at}]", value=float(series[at]), allowed="a tension of at least 0 N")
        tip = _series("drawn", np.broadcast_to(np.asarray(drawn, float), series.shape).copy())
        _check("time_step", time_step, 1e-9, 1e6)
        out = np.empty((5, series.size))
        self.most_sweeps = max(self.most_sweeps, self._core.run(series, tip, by_tension, time_step, out))
        return TendonRun(*out)


def _series(name: str, values: ArrayLike) -> Array:
    array = np.ascontiguousarray(values, dtype=float)
    if array.ndim != 1:
        raise ArgumentError(f"{name} has shape {array.shape}; it must be (n,).", key=name, value=array.shape)
    wrong = np.flatnonzero(~np.isfinite(array))
    if wrong.size:
        raise ArgumentError(key=f"{name}[{wrong[0]}]", value=float(array[wrong[0]]), allowed="a finite number")
    return array


def _check(name: str, value: float, low: float, high: float) -> None:
    if not (np.isfinite(value) and low <= value <= high):
        raise ArgumentError(key=name, value=value, allowed=f"a number from {low:g} to {high:g}")


def __dir__() -> list[str]:
    return sorted(__all__)
