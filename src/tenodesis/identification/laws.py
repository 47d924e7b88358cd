"""Friction laws by name: what a contact passes on of a tendon's tension, or of the difference of an antagonistic pair.

A play-type law says between which bounds the tension behind a contact must lie; inside them the contact sticks and
holds what is there, on them it slides. Bouc-Wen, a rival without contact, has friction follow the tension smoothly.

| law | bounds of the tension behind | source |
|---|---|---|
| none | the tension itself | |
| coulomb | tension less and plus a constant | Coulomb |
| capstan | tension times exp of minus and plus the exponent | Euler, Eytelwein |
| capstan-constant | both of them | |
| stribeck | capstan, the exponent higher at rest by an excess that falls with speed | Stribeck |
| bouc-wen | none: tension less a hysteresis force | Wen 1976 |
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from tenodesis import _core
from tenodesis.errors import IdentificationError
from tenodesis.identification.problem import Parameter
from tenodesis.signals import Array


class Law(NamedTuple):
    """The unknowns of a friction law."""

    magnitudes: tuple[Parameter, ...]
    """How much friction there is: grows along the way and with the bend."""
    shapes: tuple[Parameter, ...]
    """How friction depends on motion, the same all along. Speed is in the model's own unit, `{speed}`."""


class Passed(NamedTuple):
    """What comes out of a contact, with its derivatives."""

    tension: Array
    """N, (n,): of the tendon, or of the agonist less the antagonist."""
    slopes: Array | None
    """By the law's parameters, magnitudes first, and by the logarithm of the antagonist's gain, (parameters + 1, n);
    None for bouc-wen."""


_EXPONENT = Parameter("exponent", "1", 0.5, 0.0, 4.0, "Friction coefficient times wrap angle")
_CONSTANT = Parameter("constant", "N", 1.0, 0.0, 20.0, "Friction that does not depend on the tension")

LAWS: Mapping[str, Law] = {
    "none": Law((), ()),
    "coulomb": Law((_CONSTANT,), ()),
    "capstan": Law((_EXPONENT,), ()),
    "capstan-constant": Law((_EXPONENT, _CONSTANT), ()),
    "stribeck": Law(
        (_EXPONENT,),
        (
            Parameter("static_excess", "1", 0.1, 0.0, 3.0, "By how much friction at rest exceeds friction in motion"),
            Parameter("stribeck_speed", "{speed}", 0.2, 0.01, 10.0, "Speed at which that excess has fallen to 1/e"),
        ),
    ),
    "bouc-wen": Law(
        (Parameter("hysteresis_force", "N", 1.0, 0.0, 20.0, "Friction far from a reversal"),),
        (
            Parameter("hysteresis_width", "N", 2.0, 0.05, 50.0, "Change of tension over which friction reverses"),
            Parameter("hysteresis_shape", "1", 0.5, 0.0, 1.0, "Share of friction that a reversal meets at once (beta)"),
        ),
    ),
}


def law_of(name: str) -> Law:
    """Return a friction law by its name.

    Raises
    ------
    IdentificationError
        There is no such law.
    """
    if name not in LAWS:
        raise IdentificationError(f"law is {name!r}; allowed are {', '.join(LAWS)}.")
    return LAWS[name]


def pass_on(
    name: str,
    given: Mapping[str, float],
    tension: Array,
    against: Array | None = None,
    *,
    speed: Array | None = None,
    start: float = 0.0,
) -> Passed:
    """Return what a contact passes on of a tendon's tension, or of the difference of a pair that moves as one.

    The tendons of a pair slip by the same length, one forward and one back: the contact holds their difference between
    the least of the agonist less the most of the antagonist and the most less the least.

    Parameters
    ----------
    name
        Of the law.
    given
        Its parameters by name.
    tension, against
        Before the contact, N, (n,); of the antagonist if there is one.
    speed
        Of the motion, (n,); only stribeck asks for it.
    start
        What is behind the contact before the first sample, N.

    Raises
    ------
    IdentificationError
        There is no such law.
    """
    law = law_of(name)
    names = tuple(one.name for one in (*law.magnitudes, *law.shapes))
    if name == "bouc-wen":
        return Passed(_bouc_wen(given, tension if against is None else tension - against), None)
    pace = _pace(name, given, np.zeros(tension.size) if speed is None else speed)
    lower = _bound(names, given, tension, pace, -1.0)
    upper = _bound(names, given, tension, pace, 1.0)
    least, of_least = lower.value, lower.slopes
    most, of_most = upper.value, upper.slopes
    if against is not None:
        lower, upper = _bound(names, given, against, pace, -1.0), _bound(names, given, against, pace, 1.0)
        least, most = least - upper.value, most - lower.value
        of_least, of_most = _against(of_least, upper, against), _against(of_most, lower, against)
    source = np.empty(tension.size, dtype=np.int64)
    _core.play(least, most, start, source)
    # where each sample stands among: the start, all lower bounds, all upper bounds
    place = np.where(source < 0, -source, np.where(source > 0, source + tension.size, 0))
    held = np.zeros((of_least.shape[0], 1))
    return Passed(
        np.concatenate([[start], least, most])[place], np.concatenate([held, of_least, of_most], axis=1)[:, place]
    )


class _Pace(NamedTuple):
    factor: Array
    """Friction over that in motion, (n,)."""
    slopes: Mapping[str, Array]


class _Bound(NamedTuple):
    value: Array
    slopes: Array
    """By the law's parameters, and a last row of zeros for the antagonist's gain."""
    by_tension: Array


def _pace(name: str, given: Mapping[str, float], speed: Array) -> _Pace:
    one = np.ones(speed.size)
    if name != "stribeck":
        return _Pace(one, {})
    width, excess = given["stribeck_speed"], given["static_excess"]
    share = (speed / width) ** 2
    falling = np.exp(-share)
    return _Pace(
        one + excess * falling, {"static_excess": falling, "stribeck_speed": excess * falling * 2 * share / width}
    )


def _bound(names: tuple[str, ...], given: Mapping[str, float], tension: Array, pace: _Pace, sign: float) -> _Bound:
    """Return the least (sign -1) or most (1) tension behind a contact: never below zero, a tendon cannot push."""
    exponent = given.get("exponent", 0.0)
    gain = np.exp(sign * exponent * pace.factor)
    value = tension * gain + sign * given.get("constant", 0.0)
    taut = value > 0
    slopes = np.zeros((len(names) + 1, tension.size))
    for row, name in enumerate(names):
        if name == "exponent":
            slopes[row] = sign * pace.factor * gain * tension
        elif name == "constant":
            slopes[row] = sign
        else:
            slopes[row] = sign * exponent * pace.slopes[name] * gain * tension
    return _Bound(np.where(taut, value, 0.0), np.where(taut, slopes, 0.0), np.where(taut, gain, 0.0))


def _against(slopes: Array, bound: _Bound, tension: Array) -> Array:
    out = slopes - bound.slopes
    out[-1] -= bound.by_tension * tension
    return out


def _bouc_wen(given: Mapping[str, float], tension: Array) -> Array:
    """Return tension less hysteresis: exponent 1 and beta + gamma = 1, solved exactly within each step."""
    width, beta, state = given["hysteresis_width"], given["hysteresis_shape"], 0.0
    states = [state]
    for step in np.diff(tension).tolist():
        rate = 2 * beta - 1 if state * step <= 0 else 1.0
        way = abs(step) / width
        grown = way if abs(rate * way) < 1e-9 else -math.expm1(-rate * way) / rate
        state = math.exp(-rate * way) * state + math.copysign(grown, step)
        states.append(state)
    return np.asarray(tension - given["hysteresis_force"] * np.array(states))
