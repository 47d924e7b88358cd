"""Friction laws by name: transmission of a tendon's tension, or of the tension difference of a pair, by a contact.

A play-type law gives the bounds of the tension behind a contact; inside them the contact sticks and
holds its tension, on them it slides. In Bouc-Wen, a rival without contact, friction follows the tension smoothly.

| law | bounds of the tension behind | source |
|---|---|---|
| none | the tension itself | |
| coulomb | tension less and plus a constant | Coulomb |
| capstan | tension times exp of minus and plus the exponent | Euler, Eytelwein |
| capstan-constant | both of them | |
| capstan-power | capstan, its exponent falling with a power of the tension | Howell 1953 |
| stribeck | capstan, the exponent higher at rest by an excess that falls with speed | Stribeck |
| bouc-wen | none: tension less a hysteresis force | Wen 1976 |

Every law passes on derivatives by whatever its numbers and the tension carry them.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from tenodesis import _core
from tenodesis.errors import IdentificationError
from tenodesis.identification.datasets.dual_numbers import Dual, Operand, joined, number
from tenodesis.identification.problem import Parameter
from tenodesis.run import Array


class Law(NamedTuple):
    """The unknowns of a friction law."""

    magnitudes: tuple[Parameter, ...]
    """How much friction there is: grows along the way and with the bend."""
    shapes: tuple[Parameter, ...]
    """How friction depends on motion, the same all along. Speed is in the model's own unit, `{speed}`."""


_EXPONENT = Parameter("exponent", "1", 0.5, 0.0, 4.0, "Friction coefficient times wrap angle")
_CONSTANT = Parameter("constant", "N", 1.0, 0.0, 20.0, "Friction that does not depend on the tension")

LAWS: Mapping[str, Law] = {
    "none": Law((), ()),
    "coulomb": Law((_CONSTANT,), ()),
    "capstan": Law((_EXPONENT,), ()),
    "capstan-constant": Law((_EXPONENT, _CONSTANT), ()),
    "capstan-power": Law(
        (_EXPONENT._replace(meaning="Friction coefficient times wrap angle at a tension of 1 N"),),
        (Parameter("load_index", "1", 0.9, 0.3, 1.0, "Power of the tension that friction grows with; 1 is capstan"),),
    ),
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

_LEAST_TENSION = 1e-9
"""Tension below which the power law treats a tendon as slack, since its exponent has no limit there."""
_SMALL = 1e-4
"""Argument below which a logarithm is computed by its series."""


def law_of(name: str) -> Law:
    """Return a friction law by its name; raises IdentificationError if there is none."""
    if name not in LAWS:
        raise IdentificationError(key="law", value=name, allowed=f"one of {', '.join(LAWS)}")
    return LAWS[name]


def pass_on(
    name: str,
    given: Mapping[str, Operand],
    tension: Operand,
    against: Operand | None = None,
    *,
    speed: Array | None = None,
    start: Operand = 0.0,
) -> Dual:
    """Return the tension behind a contact, or the tension difference of a pair that moves as one, N.

    The tendons of a pair slip by the same length, one forward and one back: the contact holds their difference between
    the least of the agonist less the most of the antagonist and the most less the least.

    Tension, and that of the antagonist if there is one (`against`), are before the contact, N, (n,); `start` is behind
    it before the first sample, N. Only stribeck needs the speed of the motion, (n,). Raises IdentificationError if
    there is no such law.
    """
    law_of(name)
    before = number(tension)
    if name == "bouc-wen":
        moved = before if against is None else before - number(against)
        shape = (given[one] for one in ("hysteresis_width", "hysteresis_shape"))
        return moved - given["hysteresis_force"] * hysteresis(moved, *shape)
    least, most = band(name, given, before, speed=speed)
    if against is not None:
        lower, upper = band(name, given, number(against), speed=speed)
        least, most = least - upper, most - lower
    return held(least, most, number(start))


def band(
    name: str, given: Mapping[str, Operand], tension: Dual, *, speed: Array | None = None, slack: bool = True
) -> tuple[Dual, Dual]:
    """Return the least and the most tension that a contact of a play-type law can hold behind it.

    Only stribeck needs the speed of the motion. With `slack` no bound is below zero: a tendon cannot push.
    """
    found = []
    for sign in (-1.0, 1.0):
        bound = tension
        if name == "capstan-power":
            bound = _power(tension, sign * number(given["exponent"]), 1 - number(given["load_index"]))
        elif "exponent" in given:
            bound = tension * (sign * number(given["exponent"]) * _pace(given, speed)).exp()
        if "constant" in given:
            bound = bound + sign * number(given["constant"])
        found.append(bound.above(0.0) if slack else bound)
    return found[0], found[1]


def held(lower: Dual, upper: Dual, start: Dual) -> Dual:
    """Return a play element (stick-slip): constant until a bound pushes it, from its value before the first sample.

    Its derivative is that of the bound which pushed last.
    """
    count = lower.value.size
    source = np.empty(count, dtype=np.int64)
    _core.play(np.ascontiguousarray(lower.value), np.ascontiguousarray(upper.value), float(start.value[0]), source)
    # where each sample stands among: the start, all lower bounds, all upper bounds
    place = np.where(source < 0, -source, np.where(source > 0, source + count, 0))
    return joined([start, lower, upper]).taken(place)


def hysteresis(moved: Dual, width: Operand, beta: Operand, start: Operand = 0.0) -> Dual:
    """Return friction relative to full sliding friction: Wen 1976 with exponent 1 and beta + gamma = 1.

    Solved exactly within each step. Friction follows what has moved, a tension or an angle: it reverses over its
    `width`, and a reversal meets a share `beta` of it at once; `start` is its value before the first step.
    """
    wide, shape, state = number(width), number(beta), number(start)
    steps = np.diff(moved.value)
    ways = np.abs(steps) / wide.value[0]
    against_rate = 2 * float(shape.value[0]) - 1
    states = [float(state.value[0])]
    for step, way in zip(steps.tolist(), ways.tolist(), strict=True):
        rate = against_rate if states[-1] * step <= 0 else 1.0
        grown = way if abs(rate * way) < _SMALL**2 else -math.expm1(-rate * way) / rate
        states.append(math.exp(-rate * way) * states[-1] + math.copysign(grown, step))
    value = np.array(states)

    before, sign = value[:-1], np.copysign(1.0, steps)
    against = before * steps <= 0
    rates = np.where(against, against_rate, 1.0)
    kept = np.exp(-rates * ways)
    small = np.abs(rates * ways) < _SMALL
    safe = np.where(small, 1.0, rates)
    by_rate = np.where(small, -0.5 * ways**2, (ways * kept * safe - (1 - kept)) / safe**2)
    by_way = (sign - rates * before) * kept
    by_shape = np.where(against, 2 * (sign * by_rate - ways * kept * before), 0.0)
    of_way = sign / wide.value * np.diff(np.broadcast_to(moved.slopes, (*moved.slopes.shape[:1], value.size)))
    pushed = by_way * (of_way - ways / wide.value * wide.slopes) + by_shape * shape.slopes
    rows = np.broadcast_shapes(pushed.shape[:1], state.slopes.shape[:1])[0]
    slopes = np.empty((value.size, rows))
    slopes[0] = state.slopes[:, 0]
    for index, (share, add) in enumerate(zip(kept.tolist(), pushed.T, strict=True)):
        slopes[index + 1] = share * slopes[index] + add
    return Dual(value, slopes.T)


def _pace(given: Mapping[str, Operand], speed: Array | None) -> Operand:
    """Return friction over that in motion."""
    if "static_excess" not in given or speed is None:
        return 1.0
    share = speed / number(given["stribeck_speed"])
    return 1.0 + number(given["static_excess"]) * (-(share * share)).exp()


def _power(tension: Dual, exponent: Dual, less: Dual) -> Dual:
    """Return a tension behind a contact whose friction grows with its power 1 - `less`.

    dT/ds = exponent T^(1 - less) over the way, solved from one end to the other:
    T^less = T(0)^less + less exponent. At less = 0 it is Euler's.
    """
    taut = tension.above(_LEAST_TENSION)
    log = taut.mapped(np.log(taut.value), 1 / taut.value)
    grade = exponent * (-(less * log)).exp()
    # log(1 + less grade) / less, which stands for the exponent
    share = less.value * grade.value
    ends = share <= -1
    share = np.where(ends, 0.0, share)
    small = np.abs(share) < _SMALL
    safe = np.where(small, 1.0, less.value)
    over = np.where(small, grade.value * (1 - share / 2 + share**2 / 3), np.log1p(share) / safe)
    by_less = np.where(small, grade.value**2 * (-0.5 + 2 / 3 * share), (grade.value / (1 + share) - over) / safe)
    passed = taut * Dual(over, by_less * less.slopes + grade.slopes / (1 + share)).exp()
    return Dual(np.where(ends, 0.0, passed.value), np.where(ends, 0.0, passed.slopes))
