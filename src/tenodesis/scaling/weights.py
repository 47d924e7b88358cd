"""The selection of weights for the load rig's two cables that give a force (Fig. 13).

Two cables run over a pulley on the rig's bar. More weight on the loading cable than on the counter cable turns the bar
such that the tip feels a positive force, one that opposes positive flexion; more on the counter cable, a negative one.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tenodesis.errors import ArgumentError, DesignError
from tenodesis.scaling.parts import Weight
from tenodesis.units import STANDARD_GRAVITY

_GRID = 1e-6
"""Resolution of all masses, kg: the smallest weight of OIML R 111."""

_EXACT = 1e-9
"""Relative difference up to which two masses count as equal."""

_BASE = 1000
"""Base of the digits of sums, small enough that the solver's integrality tolerance, 1e-6, cannot matter."""

_AS_WANTED = 5e-4
"""Relative error of the weight below which it is not mentioned."""


@dataclass(frozen=True)
class WeightSelection:
    """The weights on the two cables: masses in kg, heaviest first, forces in N."""

    loading: tuple[float, ...]
    """Masses on the cable that gives a positive tip force."""
    counter: tuple[float, ...]
    """Masses on the other cable."""
    wanted: float
    """Wanted difference in weight, loading minus counter cable, N."""
    tolerance: float
    """Largest error of the weight by the tolerances of all pieces, N."""

    @property
    def difference(self) -> float:
        """Mass on the loading cable minus that on the counter cable, kg."""
        return math.fsum((*self.loading, *(-mass for mass in self.counter)))

    @property
    def weight(self) -> float:
        """Weight on the loading cable minus that on the counter cable, N: the twin's command of that name."""
        return self.difference * STANDARD_GRAVITY

    @property
    def error(self) -> float:
        """Weight minus the wanted weight, N."""
        return self.weight - self.wanted

    @property
    def relative_error(self) -> float:
        """The error over the magnitude of the wanted weight; infinite for an error where none is wanted."""
        if self.wanted:
            return self.error / abs(self.wanted)
        return math.copysign(math.inf, self.error) if self.error else 0.0

    @property
    def pieces(self) -> int:
        """Number of weights on both cables."""
        return len(self.loading) + len(self.counter)

    @property
    def sentence(self) -> str:
        """The weights on each cable and their error, without a full stop."""
        cables = f"{_listed(self.loading)} on the loading cable, {_listed(self.counter)} on the counter cable"
        return f"{cables}: {self.weight:.4g} N, {self._error_text()}"

    def _error_text(self) -> str:
        off = self.relative_error
        if abs(off) < _AS_WANTED:
            return "as wanted"
        size = f"{abs(off):.1%}".replace("%", " %") if math.isfinite(off) else f"{abs(self.error):.3g} N"
        # Signed: more is more positive, also for a negative weight.
        return f"{size} {'more' if off > 0 else 'less'} than wanted"


def select_weights(weight: float, weights: Sequence[Weight], *, cable_mass: float) -> WeightSelection:
    """Return the weights whose difference is nearest to a wanted difference, with the fewest pieces.

    `weight` (N) is wanted on the loading cable more than on the counter cable, negative for a negative tip force;
    masses of the weights at hand count to the milligram; `cable_mass` (kg) is the least on either cable, which keeps it
    taut.

    Raises ValueError if the weight is not finite, or the mass is negative or not finite, and DesignError if there are
    no weights, or too few to keep both cables taut.
    """
    if not math.isfinite(weight):
        raise ArgumentError(key="weight", value=weight, allowed="a finite force in N")
    _check_cable_mass(cable_mass)
    problem = _Problem.of(weights, cable_mass)
    found = problem.solve(abs(weight) / STANDARD_GRAVITY)
    loading, counter = (found.heavier, found.lighter) if weight >= 0 else (found.lighter, found.heavier)
    used = sum(piece.tolerance * count for piece, count in zip(weights, (loading + counter).tolist(), strict=True))
    return WeightSelection(_masses(weights, loading), _masses(weights, counter), weight, used * STANDARD_GRAVITY)


def least_difference(weights: Sequence[Weight], cable_mass: float) -> float:
    """Return the smallest possible difference above zero between the two cables, kg: the resolution of the force.

    Parameters and errors are those of :func:`select_weights`; also, a DesignError where all differences are zero.
    """
    _check_cable_mass(cable_mass)
    problem = _Problem.of(weights, cable_mass)
    found = problem.nearest_possible(1, 1)
    if found is None:
        raise DesignError(
            f"the weights, {problem.total}, give no difference between two cables with {problem.least_mass} or more on "
            "each; use more weights or a smaller cable_mass.",
            key="cable_mass",
        )
    return found * problem.unit


def _check_cable_mass(cable_mass: float) -> None:
    if not 0 <= cable_mass < math.inf:
        raise ArgumentError(key="cable_mass", value=cable_mass, allowed="a mass of at least 0 kg")


class _Solution(NamedTuple):
    """Number of pieces of each mass on either cable, and their difference in units."""

    heavier: NDArray[np.int64]
    lighter: NDArray[np.int64]
    difference: int

    @property
    def pieces(self) -> int:
        return int((self.heavier + self.lighter).sum())


class _Sums(NamedTuple):
    """Linear equations for sums of masses, digit by digit.

    Unknown are the counts on either cable, the digits of the lighter cable's mass beyond its least one, those of the
    difference beyond its bound, and the carries of each sum.
    """

    matrix: NDArray[np.float64]
    right: NDArray[np.float64]
    places: int


class _Problem(NamedTuple):
    """Masses, their counts, and the least mass on a cable, as integer multiples of a unit (kg)."""

    masses: NDArray[np.int64]
    counts: NDArray[np.int64]
    least: int
    unit: float

    @classmethod
    def of(cls, weights: Sequence[Weight], cable_mass: float) -> "_Problem":
        if not weights:
            raise DesignError(
                "there are no weights to hang; use a catalogue that has some.", key="weights", allowed="some"
            )
        masses = np.array([round(one.mass / _GRID) for one in weights], np.int64)
        if masses.min() < 1:
            raise DesignError(
                key="mass", value=min(one.mass for one in weights), allowed="at least 1 mg, of every weight"
            )
        counts = np.array([one.count for one in weights], np.int64)
        # Small integers are solved for faster and more reliably.
        unit = int(np.gcd.reduce(masses))
        return cls(masses // unit, counts, math.ceil(cable_mass / (unit * _GRID) - _EXACT), unit * _GRID)

    @property
    def total(self) -> str:
        """Mass of all weights, for a sentence."""
        return f"{float(self.masses @ self.counts) * self.unit:.6g} kg in all"

    @property
    def least_mass(self) -> str:
        """Least mass on a cable, for a sentence."""
        return f"{self.least * self.unit:.6g} kg"

    def solve(self, mass: float) -> _Solution:
        """Return the pieces for a difference (kg, not negative)."""
        target = mass / self.unit
        same = _EXACT * max(1.0, target)
        below, above = math.floor(target + same), math.ceil(target - same)
        # Most sets give every difference, so that no search for the nearest is needed.
        found = self._fewest(_nearest((below, above), target, same))
        if found is None:
            sides = (self.nearest_possible(below, -1), self.nearest_possible(above, 1))
            found = self._fewest(_nearest([one for one in sides if one is not None], target, same))
        if found is None:
            raise DesignError(
                f"the weights, {self.total}, do not keep two cables taut with {self.least_mass} on each; use more "
                "weights or a smaller cable_mass.",
                key="cable_mass",
            )
        return found

    def _fewest(self, differences: Iterable[int]) -> _Solution | None:
        """Return the fewest pieces that give any of these differences, None if none is possible."""
        solutions = (self._lightest(difference) for difference in differences)
        return min((one for one in solutions if one is not None), key=lambda one: one.pieces, default=None)

    def nearest_possible(self, bound: int, side: int) -> int | None:
        """Return the possible difference, at least zero, nearest to a bound: from above (side 1) or from below (-1)."""
        sums, difference = self._sums(bound, side), bound
        # Digit by digit from the highest: a single cost of all digits would be badly scaled.
        beyond = [_BASE - 1.0] * sums.places
        for place in reversed(range(sums.places)):
            cost = np.zeros(sums.matrix.shape[1])
            cost[2 * self.masses.size + sums.places + place] = 1.0
            found = self._optimum(cost, sums, beyond)
            if found is None:
                return None
            difference = found.difference
            beyond[place] = float(_digits(abs(difference - bound), sums.places)[place])
        # With a negative difference the cables are swapped, and the lighter one is not known to be taut.
        return difference if difference >= 0 else None

    def _lightest(self, difference: int) -> _Solution | None:
        """Return the fewest pieces that give a difference, and of these the lightest, with the least inertia."""
        sums = self._sums(difference, 1)
        share = self.masses / (2.0 * float(self.masses @ self.counts))
        cost = np.concatenate([np.tile(1 + share, 2), np.zeros(sums.matrix.shape[1] - 2 * self.masses.size)])
        return self._optimum(cost, sums, [0.0] * sums.places)

    def _sums(self, bound: int, side: int) -> _Sums:
        """Return the equations of both sums: the difference is on one side of a bound, the lighter cable is taut.

        Sums are made digit by digit, with the carries among the unknowns: with masses as coefficients, small weights
        would be lost in the solver's integrality tolerance.
        """
        places = len(_digits(max(int(self.masses @ self.counts), bound, self.least)))
        by_mass = np.array([_digits(int(mass), places) for mass in self.masses], float).T
        carry = np.eye(places, places - 1, -1) - _BASE * np.eye(places, places - 1)
        none, one, unmoved, uncarried = np.zeros(by_mass.shape), np.eye(places), np.zeros((places, places)), 0 * carry
        matrix = np.block(
            [
                [by_mass, -by_mass, unmoved, -side * one, carry, uncarried],
                [none, by_mass, -one, unmoved, uncarried, carry],
            ]
        )
        return _Sums(matrix, np.array([*_digits(bound, places), *_digits(self.least, places)], float), places)

    def _optimum(self, cost: NDArray[np.float64], sums: _Sums, beyond: Sequence[float]) -> _Solution | None:
        """Return the pieces of least cost that satisfy the equations, if any; `beyond` bounds the digits beyond."""
        from scipy.optimize import Bounds, LinearConstraint, milp  # noqa: PLC0415 - takes half a second

        kinds, carried = self.masses.size, 2 * sums.places - 2
        of_a_kind = np.hstack([np.eye(kinds), np.eye(kinds), np.zeros((kinds, 2 * sums.places + carried))])
        most = 2.0 * float(self.counts.sum()) + 2
        upper = [np.tile(self.counts, 2), np.full(sums.places, _BASE - 1.0), np.array(beyond), np.full(carried, most)]
        lower = [np.zeros(2 * kinds + 2 * sums.places), np.full(carried, -most)]
        found = milp(
            cost,
            integrality=np.ones(cost.size, np.int64),
            bounds=Bounds(np.concatenate(lower), np.concatenate(upper)),
            constraints=[
                LinearConstraint(sums.matrix, sums.right, sums.right),
                LinearConstraint(of_a_kind, 0, self.counts),
            ],
            options={"mip_rel_gap": 0.0},
        )
        if found.x is None:
            return None
        counts = np.rint(found.x).astype(np.int64)
        heavier, lighter = counts[:kinds], counts[kinds : 2 * kinds]
        return _Solution(heavier, lighter, int(self.masses @ (heavier - lighter)))


def _digits(number: int, count: int = 0) -> list[int]:
    """Return the digits of a number, last first, padded with zeros to a count."""
    digits: list[int] = []
    while number or len(digits) < max(count, 1):
        number, digit = divmod(number, _BASE)
        digits.append(digit)
    return digits


def _nearest(differences: Iterable[int], target: float, same: float) -> set[int]:
    """Return the differences nearest to a target, including those equal within a tolerance."""
    off = {one: abs(one - target) for one in differences}
    return {one for one, far in off.items() if far <= min(off.values()) + same}


def _masses(weights: Sequence[Weight], counts: NDArray[np.int64]) -> tuple[float, ...]:
    masses = (piece.mass for piece, count in zip(weights, counts.tolist(), strict=True) for _ in range(count))
    return tuple(sorted(masses, reverse=True))


def _listed(masses: tuple[float, ...]) -> str:
    parts = [(_mass(mass), len(list(same))) for mass, same in groupby(masses)]
    return " + ".join(text if count == 1 else f"{count} x {text}" for text, count in parts) or "nothing"


def _mass(mass: float) -> str:
    unit, size = next(((unit, size) for unit, size in (("kg", 1.0), ("g", 1e-3)) if mass >= size), ("mg", 1e-6))
    return f"{mass / size:.6g} {unit}"
