"""What the recordings tell: which parameters, of which others only a combination, and what would tell more."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from tenodesis.identification.problem import Parameter, Problem, WithAdvice
from tenodesis.identification.uncertainty import Spread
from tenodesis.run import Array

TOLD = 1 / 8
"""A parameter is told where its standard deviation is below this share of its scale: half its range is ruled out."""
_TAKES_PART = 0.3
"""Share of a direction's largest component, in standard deviations, below which a parameter takes no part in it."""
_BOUND_UP = 0.9
"""Correlation above which a parameter that is told still belongs to a combination that is not."""
_CLOSE = 0.03
_MOVE = 0.2
"""How far, as a share of a value, the two readings of a combination are told apart."""
_LARGEST_EXPONENT = 4


@dataclass(frozen=True)
class Combination:
    """Parameters that the recordings cannot tell apart."""

    names: tuple[str, ...]
    changes: tuple[float, ...]
    """Changes in SI that the sensors hardly see together, up to a factor."""
    known: str | None
    """What is known of them all the same: a product, a ratio, a sum."""
    sentence: str


@dataclass(frozen=True)
class Identifiability:
    """Which of the fitted parameters the recordings tell."""

    singular_values: Array
    """Of the Jacobian in standard deviations over scales, corrected: its inverse squares are variances."""
    identifiable: dict[str, bool]
    combinations: tuple[Combination, ...]
    at_bound: dict[str, str]
    """The bound, lower or upper, of parameters that the fit left on it."""
    statements: tuple[str, ...]


Cost = Callable[[Array], float]
"""Sum of squared changes of the residuals, of values of all parameters."""


def examine(
    problem: Problem, free: Sequence[int], values: Array, *, scale: Array, found: Spread, change: Cost
) -> Identifiability:
    """Return which of the free parameters are told, and which only together.

    Parameters
    ----------
    problem
        The model with its recordings.
    free
        Indices of the fitted parameters.
    values
        The optimum, shape (parameters,).
    scale
        What changes are measured by, shape (free parameters,).
    found
        The uncertainty there.
    change
        How much residuals change at other values.
    """
    parameters = [problem.parameters[index] for index in free]
    identifiable = {one.name: bool(std < TOLD) for one, std in zip(parameters, found.std, strict=True)}
    variances, directions = linalg.eigh(found.covariance)
    blind = found.blind
    weak = variances > TOLD**2
    size = np.sqrt(np.diag(found.full))[:, None]
    open_ = _sparse(np.concatenate([blind, directions[:, weak]], axis=1) / size) * size
    told = np.array(list(identifiable.values()))
    combinations = tuple(
        _combination(problem, free, values, direction * scale, part=part, std=found.std * scale, change=change)
        for direction in open_.T
        if (part := _taking_part(direction / size[:, 0], told, found.correlation)).size
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
            wanted = "less" if at_bound[one.name] == "lower" else "more"
            statements.append(
                f"{one.name} is at its {at_bound[one.name]} bound {bound:.6g} {one.unit}: the recordings ask for no "
                f"{'more' if wanted == 'less' else 'less'}, if not for {wanted}; its interval has one side only."
            )
    named = {name for one in combinations for name in one.names}
    for one, std, width in zip(parameters, found.std, scale, strict=True):
        if not identifiable[one.name] and one.name not in named:
            statements.append(
                f"The recordings leave {one.name} open by {std * width:.3g} {one.unit} (standard deviation): "
                "it leans on several others."
            )
    # a blind direction has no variance of its own here; eigenvalues rise, so that these come first
    sizes = np.concatenate([1 / np.sqrt(variances[blind.shape[1] :]), np.zeros(blind.shape[1])])
    return Identifiability(sizes, identifiable, combinations, at_bound, tuple(statements))


def _sparse(basis: Array) -> Array:
    """Return directions of the same space, each with as few parameters as its pivots allow, largest component 1."""
    if basis.shape[1] == 0:
        return basis
    _, _, pivots = linalg.qr(basis.T, pivoting=True, mode="economic")
    reduced = basis @ linalg.inv(basis[pivots[: basis.shape[1]]])
    return np.asarray(reduced / np.abs(reduced).max(axis=0), dtype=np.float64)


def _taking_part(direction: Array, told: NDArray[np.bool_], correlation: Array) -> NDArray[np.intp]:
    """Return which parameters make up a direction, in standard deviations: none where all are told."""
    strength = np.where(told, 0, np.abs(direction))
    if not strength.any():
        return np.zeros(0, dtype=np.intp)
    strong = np.abs(direction) >= _TAKES_PART * strength.max()
    tied = np.abs(correlation[int(np.argmax(strength))]) >= _BOUND_UP
    return np.flatnonzero(strong & (~told | tied))


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
        one, open_by = taking[0], float(std[part[0]])
        extent = (
            "no sample depends on it"
            if not math.isfinite(open_by)
            else f"they leave it open by {open_by:.3g} {one.unit} (standard deviation)"
        )
        sentence = f"The recordings do not tell {one.name} ({one.meaning}): {extent}."
    else:
        if len(taking) == 2:
            known = _reading(taking, [free[index] for index in part], changes, values, change)
        moves = ", ".join(
            f"{one.name} by {_signed(step, one)}" for one, step in zip(taking, _together(taking, changes), strict=True)
        )
        rest = f"only {known} is known" if known else f"moving {moves} together changes hardly anything they see"
        sentence = f"The recordings do not tell {_listed(names)} apart: {rest}."
    told = problem.advice(names) if isinstance(problem, WithAdvice) else None
    if told is None and len(taking) == 1:
        told = f"A protocol would tell it in which {taking[0].meaning} changes what the sensors see."
    elif told is None:
        others = "other" if len(names) == 2 else "others"
        told = f"A protocol in which one acts without the {others} would, or holding one of them at a known value."
    return Combination(names, tuple(changes), known, f"{sentence} {told}")


def _together(taking: Sequence[Parameter], changes: Sequence[float]) -> list[float]:
    """Return changes sized so that the first is a tenth of its range."""
    factor = (taking[0].upper - taking[0].lower) / 10 / abs(changes[0])
    return [one * factor for one in changes]


def _signed(step: float, one: Parameter) -> str:
    return f"{step:+.3g}" + ("" if one.unit in {"", "1"} else f" {one.unit}")


def _listed(names: Sequence[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else names[0]


def _reading(
    taking: Sequence[Parameter], places: Sequence[int], changes: Sequence[float], values: Array, change: Cost
) -> str | None:
    """Return what is known of two parameters: of a power law and a weighted sum, the one that stays so farther away."""
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

    if at > 0 and beside > 0:
        exponent = -(step / at) / (other / beside)
        law = _power_law(first.name, second.name, exponent)
        readings.append((worst(lambda share: (at * (1 + share), beside * (1 + share) ** (-1 / exponent))), law))
    weight = -step / other
    if first.unit == second.unit:
        reach = max(abs(at), abs(beside), 1e-3 * (first.upper - first.lower))
        told = _weighted(first.name, second.name, weight)
        readings.append((worst(lambda share: (at + share * reach, beside - share * reach / weight)), told))
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
