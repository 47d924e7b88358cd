"""Parameters that the recordings identify, singly or in combination, and recordings that would identify more."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from tenodesis.identification.problem import Parameter, Problem, scales
from tenodesis.identification.uncertainty import Uncertainty
from tenodesis.run import Array

IDENTIFIABLE_SHARE = 1 / 8
"""Of its scale, below which a parameter's standard deviation must be: the interval then rules out half its range."""
_TAKES_PART = 0.3
"""Of a direction's largest component, in standard deviations, below which a parameter takes no part in it."""
_TIED = 0.9
"""Correlation above which an identifiable parameter belongs to a combination that is not."""
_CLOSE = 0.03
_MOVE = 0.2
"""Of a value, by which parameters are moved to see which of two descriptions of a combination holds."""
_LARGEST_EXPONENT = 4
_LARGEST_POWER = 1e3
"""Beyond it, of a power law, one of the two parameters alone is meant, and the power overflows."""


@dataclass(frozen=True)
class Combination:
    """Parameters that are not identifiable separately."""

    names: tuple[str, ...]
    changes: tuple[float, ...]
    """Changes in SI that together hardly change the readings, up to a factor."""
    known: str | None
    """Function of them that is identifiable all the same: a product, a ratio, a sum."""
    sentence: str


@dataclass(frozen=True)
class Identifiability:
    """Which of the fitted parameters the recordings identify."""

    singular_values: Array
    """Of the Jacobian in standard deviations over scales, corrected: its inverse squares are variances."""
    identifiable: dict[str, bool]
    combinations: tuple[Combination, ...]
    at_bound: dict[str, str]
    """The bound, lower or upper, of parameters that are on it at the optimum."""
    statements: tuple[str, ...]


def is_identifiable(one: Parameter, std: float) -> bool:
    """Return whether a parameter of a standard deviation, SI, is identifiable about its start."""
    return bool(std < IDENTIFIABLE_SHARE * scales([one], np.array([one.start]))[0])


Cost = Callable[[Array], float]
"""Sum of squared changes of the residuals, of values of all parameters."""


def examine(
    problem: Problem, free: Sequence[int], values: Array, *, scale: Array, found: Uncertainty, change: Cost
) -> Identifiability:
    """Return which of the free parameters are identifiable, and which only in combination.

    `values` (parameters,) are the optimum, `scale` (free parameters,) the units of the changes, `found` is the
    uncertainty there; `change` maps values to the sum of squared changes of the residuals.
    """
    parameters = [problem.parameters[index] for index in free]
    identifiable = {one.name: bool(std < IDENTIFIABLE_SHARE) for one, std in zip(parameters, found.std, strict=True)}
    variances, directions = linalg.eigh(found.covariance)
    weak = variances > IDENTIFIABLE_SHARE**2
    size = np.sqrt(np.diag(found.full))[:, None]
    open_ = _sparse(np.concatenate([found.unseen, directions[:, weak]], axis=1) / size) * size
    known = np.array(list(identifiable.values()))
    combinations = tuple(
        _combination(problem, free, values, direction * scale, part=part, std=found.std * scale, change=change)
        for direction in open_.T
        if (part := _taking_part(direction / size[:, 0], known, found.correlation)).size
    )
    at_bound = {
        one.name: side
        for one, value in zip(parameters, values[list(free)].tolist(), strict=True)
        for side, bound in (("lower", one.lower), ("upper", one.upper))
        if value == bound
    }
    statements = [one.sentence for one in combinations]
    for one in parameters:
        if one.name in at_bound:
            bound = getattr(one, at_bound[one.name])
            beyond = "lower" if at_bound[one.name] == "lower" else "higher"
            statements.append(
                f"{one.name} is at its {at_bound[one.name]} bound {bound:.6g}{_unit(one)}: its best value may be "
                f"{beyond}; its interval has one side only."
            )
    named = {name for one in combinations for name in one.names}
    for one, std, width in zip(parameters, found.std, scale, strict=True):
        if not identifiable[one.name] and one.name not in named:
            statements.append(
                f"{one.name} is not identifiable from the recordings (standard deviation "
                f"{std * width:.3g}{_unit(one)}): it depends on several others."
            )
    # an unseen direction has no variance here, but for rounding, also below 0; eigenvalues ascend: these come first
    unseen = found.unseen.shape[1]
    sizes = np.concatenate([1 / np.sqrt(np.abs(variances[unseen:])), np.zeros(unseen)])
    return Identifiability(sizes, identifiable, combinations, at_bound, tuple(statements))


def _sparse(basis: Array) -> Array:
    """Return directions of the same space, each with as few parameters as its pivots allow, largest component 1."""
    if basis.shape[1] == 0:
        return basis
    _, _, pivots = linalg.qr(basis.T, pivoting=True, mode="economic")
    reduced = basis @ linalg.inv(basis[pivots[: basis.shape[1]]])
    return np.asarray(reduced / np.abs(reduced).max(axis=0), dtype=np.float64)


def _taking_part(direction: Array, known: NDArray[np.bool_], correlation: Array) -> NDArray[np.intp]:
    """Return which parameters make up a direction, in standard deviations: none where all are identifiable."""
    strength = np.where(known, 0, np.abs(direction))
    if not strength.any():
        return np.zeros(0, dtype=np.intp)
    strong = np.abs(direction) >= _TAKES_PART * strength.max()
    tied = np.abs(correlation[int(np.argmax(strength))]) >= _TIED
    return np.flatnonzero(strong & (~known | tied))


def _combination(
    problem: Problem,
    free: Sequence[int],
    values: Array,
    direction: Array,
    *,
    part: NDArray[np.intp],
    std: Array,
    change: Cost,
) -> Combination:
    taking = [problem.parameters[free[index]] for index in part]
    changes = direction[part].tolist()
    names = tuple(one.name for one in taking)
    known = None
    if len(taking) == 1:
        one, deviation = taking[0], float(std[part[0]])
        extent = (
            f"its standard deviation is {deviation:.3g}{_unit(one)}"
            if math.isfinite(deviation)
            else "no sample depends on it"
        )
        sentence = f"{one.name} ({one.meaning}) is not identifiable from the recordings: {extent}."
    else:
        if len(taking) == 2:
            known = _reading(taking, [free[index] for index in part], changes, values, change)
        moves = ", ".join(
            f"{one.name} by {step:+.3g}{_unit(one)}"
            for one, step in zip(taking, _together(taking, changes), strict=True)
        )
        rest = f"only {known} is" if known else f"changing {moves} together hardly changes the readings"
        sentence = f"{listed(names)} are not identifiable separately from the recordings: {rest}."
    advice = problem.advice(names)
    if advice is None and len(taking) == 1:
        advice = f"A protocol would identify it in which {taking[0].meaning} changes the readings."
    elif advice is None:
        others = "other" if len(names) == 2 else "others"
        advice = (
            f"A protocol in which one acts without the {others} would identify them, or holding one at a known value."
        )
    return Combination(names, tuple(changes), known, f"{sentence} {advice}")


def _together(taking: Sequence[Parameter], changes: Sequence[float]) -> list[float]:
    """Return changes sized so that the first is a tenth of its range."""
    factor = (taking[0].upper - taking[0].lower) / 10 / abs(changes[0])
    return [one * factor for one in changes]


def _unit(one: Parameter) -> str:
    """Return the unit of a parameter to follow a number, empty for a plain number."""
    return "" if one.unit in {"", "1"} else f" {one.unit}"


def listed(names: Sequence[str]) -> str:
    """Return names as part of a sentence: a, b and c."""
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else names[0]


def _reading(
    taking: Sequence[Parameter], places: Sequence[int], changes: Sequence[float], values: Array, change: Cost
) -> str | None:
    """Return the function of two parameters that is identifiable: a power law or a weighted sum.

    Of these two, it is the one along which residuals change less farther away.
    """
    (first, second), (step, other) = taking, changes
    at, beside = (float(values[place]) for place in places)
    readings: list[tuple[float, str]] = []

    def moved(new_first: float, new_second: float) -> float:
        there = values.copy()
        there[places[0]], there[places[1]] = new_first, new_second
        return change(there)

    def worst(curve: Callable[[float], tuple[float, float]]) -> float:
        both = [curve(share) for share in (-_MOVE, _MOVE)]
        inside = [
            (one, two) for one, two in both if first.lower <= one <= first.upper and second.lower <= two <= second.upper
        ]
        return max((moved(one, two) for one, two in inside), default=math.inf)

    exponent = -(step / at) / (other / beside) if at > 0 and beside > 0 else 0.0
    if abs(exponent) > 1 / _LARGEST_POWER:
        law = _power_law(first.name, second.name, exponent)
        readings.append((worst(lambda share: (at * (1 + share), beside * (1 + share) ** (-1 / exponent))), law))
    weight = -step / other
    if first.unit == second.unit:
        reach = max(abs(at), abs(beside), 1e-3 * (first.upper - first.lower))
        combined = _weighted(first.name, second.name, weight)
        readings.append((worst(lambda share: (at + share * reach, beside - share * reach / weight)), combined))
    fitting = [one for one in readings if math.isfinite(one[0])]
    return min(fitting)[1] if fitting else None


def _power_law(first: str, second: str, exponent: float) -> str:
    """Return first · second^exponent in words, where the exponent is a small fraction."""
    near = Fraction(exponent).limit_denominator(_LARGEST_EXPONENT)
    if near != 0 and abs(near.numerator) <= _LARGEST_EXPONENT and abs(float(near) - exponent) < _CLOSE * abs(exponent):
        one, two = near.denominator, near.numerator
        if (one, two) == (1, 1):
            return f"the product {first} · {second}"
        if (one, two) == (1, -1):
            return f"the ratio {first} / {second}"
        sign = "·" if two > 0 else "/"
        return f"{_power(first, one)} {sign} {_power(second, abs(two))}"
    return f"{first} · {second}^{exponent:.2f}"


def _power(name: str, exponent: int) -> str:
    return name if exponent == 1 else f"{name}^{exponent}"


def _weighted(first: str, second: str, weight: float) -> str:
    if abs(weight - 1) < _CLOSE:
        return f"the sum {first} + {second}"
    if abs(weight + 1) < _CLOSE:
        return f"the difference {first} - {second}"
    return f"{first} {'+' if weight > 0 else '-'} {abs(weight):.3g} {second}"
