"""Which weights to hang on the load rig's two cables so that they make a force (Fig. 13).

Two cables run over a pulley on the rig's bar. What hangs on the loading cable more than on the counter cable turns the
bar so that the tip feels a positive force, one that opposes positive flexion; more on the counter cable turns it back.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from tenodesis.errors import DesignError
from tenodesis.units import STANDARD_GRAVITY

_GRID = 1e-6
"""Mass that all masses are whole multiples of, kg: that of the least weight of OIML R 111."""

_EXACT = 1e-9
"""Share that two masses may differ by and still be the same."""

_BASE = 1000
"""What sums of masses are carried at, so that the solver's tolerance of a whole number, 1e-6, stays far from one."""

_AS_WANTED = 5e-4
"""Share of the weight below which its error is not worth a word."""


class Pieces(Protocol):
    """Equal weights at hand: mass of each and its tolerance, kg, and how many there are."""

    @property
    def mass(self) -> float:
        """Mass of one, kg."""

    @property
    def count(self) -> int:
        """How many there are."""

    @property
    def tolerance(self) -> float:
        """Largest error of one's mass, kg."""


@dataclass(frozen=True)
class WeightSelection:
    """What hangs on the two cables: masses in kg, heaviest first, forces in N."""

    loading: tuple[float, ...]
    """On the cable that makes a positive tip force."""
    counter: tuple[float, ...]
    """On the other one."""
    wanted: float
    """Weight that the loading cable should have more, N."""
    tolerance: float
    """Largest error of the weight by the tolerances of all pieces that hang, N."""

    @property
    def difference(self) -> float:
        """Mass on the loading cable more than on the counter cable, kg."""
        return math.fsum((*self.loading, *(-mass for mass in self.counter)))

    @property
    def weight(self) -> float:
        """Weight on the loading cable more than on the counter cable, N: the twin's command of that name."""
        return self.difference * STANDARD_GRAVITY

    @property
    def error(self) -> float:
        """Weight more than wanted, N."""
        return self.weight - self.wanted

    @property
    def relative_error(self) -> float:
        """The error over the size of what is wanted; infinite for an error of nothing wanted."""
        if self.wanted:
            return self.error / abs(self.wanted)
        return math.copysign(math.inf, self.error) if self.error else 0.0

    @property
    def pieces(self) -> int:
        """Number of weights that hang."""
        return len(self.loading) + len(self.counter)

    @property
    def sentence(self) -> str:
        """What to hang where, and how near that comes, without a full stop."""
        cables = ", ".join(
            f"{_listed(masses)} on the {cable} cable"
            for cable, masses in (("loading", self.loading), ("counter", self.counter))
        )
        return f"{cables}: {self.weight:.4g} N, {self._nearness()}"

    def _nearness(self) -> str:
        off = self.relative_error
        if abs(off) < _AS_WANTED:
            return "as wanted"
        size = f"{abs(off):.1%}".replace("%", " %") if math.isfinite(off) else f"{abs(self.error):.3g} N"
        # A weight that pulls the other way is judged by its sign, not by its size.
        return f"{size} {'more' if off > 0 else 'less'} than wanted"


def select_weights(weight: float, weights: Sequence[Pieces], *, cable_mass: float) -> WeightSelection:
    """Return the pieces whose difference comes nearest to a weight, and of these the fewest.

    Parameters
    ----------
    weight
        Weight that the loading cable should have more than the counter cable, N; negative for a negative tip force.
    weights
        What there is to hang; masses count to the milligram.
    cable_mass
        Least mass on either cable, which keeps it taut, kg.

    Raises
    ------
    ValueError
        The weight is not finite, or the mass is negative or not finite.
    DesignError
        There are no weights, or too few to keep both cables taut.
    """
    if not math.isfinite(weight):
        raise ValueError(f"weight is {weight!r}; allowed is a finite force in N.")
    _check_cable_mass(cable_mass)
    problem = _Problem.of(weights, cable_mass)
    hung = problem.solve(abs(weight) / STANDARD_GRAVITY)
    loading, counter = (hung.heavier, hung.lighter) if weight >= 0 else (hung.lighter, hung.heavier)
    used = sum(one.tolerance * count for one, count in zip(weights, (loading + counter).tolist(), strict=True))
    return WeightSelection(_masses(weights, loading), _masses(weights, counter), weight, used * STANDARD_GRAVITY)


def least_difference(weights: Sequence[Pieces], cable_mass: float) -> float:
    """Return the least difference above zero of what hangs on two cables, kg: the step that forces can be made by.

    Parameters and errors are those of :func:`select_weights`; also, a DesignError where all differences are zero.
    """
    _check_cable_mass(cable_mass)
    problem = _Problem.of(weights, cable_mass)
    found = problem.nearest_made(1, 1)
    if found is None:
        raise DesignError(
            f"the weights, {problem.told_total}, make no difference between two cables with {problem.told_least} or "
            "more on each; allowed are more weights or a smaller cable_mass."
        )
    return found * problem.unit


def _check_cable_mass(cable_mass: float) -> None:
    if not 0 <= cable_mass < math.inf:
        raise ValueError(f"cable_mass is {cable_mass!r}; allowed is a mass of at least 0 kg.")


class _Hung(NamedTuple):
    """How many pieces of each mass hang on either cable, and their difference in units."""

    heavier: NDArray[np.int64]
    lighter: NDArray[np.int64]
    difference: int

    @property
    def pieces(self) -> int:
        return int((self.heavier + self.lighter).sum())


class _Sums(NamedTuple):
    """Sums of masses, digit by digit, and what they must be.

    Unknown are the counts on either cable, the digits of what the lighter cable has beyond its least mass, those of
    what the difference has beyond its bound, and what is carried in each sum.
    """

    matrix: NDArray[np.float64]
    right: NDArray[np.float64]
    places: int


class _Problem(NamedTuple):
    """How many pieces there are of each mass, and least mass of a cable, in whole units; a unit in kg."""

    masses: NDArray[np.int64]
    counts: NDArray[np.int64]
    least: int
    unit: float

    @classmethod
    def of(cls, weights: Sequence[Pieces], cable_mass: float) -> "_Problem":
        if not weights:
            raise DesignError("there are no weights to hang; allowed is a catalogue that has some.")
        masses = np.array([round(one.mass / _GRID) for one in weights], np.int64)
        if masses.min() < 1:
            raise DesignError(
                f"a weight has a mass of {min(one.mass for one in weights):g} kg; allowed is 1 mg or more."
            )
        counts = np.array([one.count for one in weights], np.int64)
        # The smaller the numbers, the faster they are solved for, and the surer.
        unit = int(np.gcd.reduce(masses))
        return cls(masses // unit, counts, math.ceil(cable_mass / (unit * _GRID) - _EXACT), unit * _GRID)

    @property
    def told_total(self) -> str:
        """All there is, for a sentence."""
        return f"{float(self.masses @ self.counts) * self.unit:.6g} kg in all"

    @property
    def told_least(self) -> str:
        """Least mass of a cable, for a sentence."""
        return f"{self.least * self.unit:.6g} kg"

    def solve(self, mass: float) -> _Hung:
        """Return what to hang for a difference (kg, not negative)."""
        target = mass / self.unit
        same = _EXACT * max(1.0, target)
        below, above = math.floor(target + same), math.ceil(target - same)
        # Most sets can make every difference, so that no search for the nearest is needed.
        found = self._fewest(_nearest((below, above), target, same))
        if found is None:
            sides = (self.nearest_made(below, -1), self.nearest_made(above, 1))
            found = self._fewest(_nearest([one for one in sides if one is not None], target, same))
        if found is None:
            raise DesignError(
                f"the weights, {self.told_total}, do not keep two cables taut with {self.told_least} on each; allowed "
                "are more weights or a smaller cable_mass."
            )
        return found

    def _fewest(self, differences: Iterable[int]) -> _Hung | None:
        """Return the fewest pieces that make one of some differences, None if none can be made."""
        made = (self._hung(one) for one in differences)
        return min((hung for hung in made if hung is not None), key=lambda hung: hung.pieces, default=None)

    def nearest_made(self, bound: int, side: int) -> int | None:
        """Return the difference from zero on nearest to a bound, not below it (side 1) or not above it (-1), if any."""
        sums, difference = self._sums(bound, side), bound
        # Place by place from the highest, since one cost of all places would have numbers too far apart.
        beyond = [_BASE - 1.0] * sums.places
        for place in reversed(range(sums.places)):
            cost = np.zeros(sums.matrix.shape[1])
            cost[2 * self.masses.size + sums.places + place] = 1.0
            found = self._optimum(cost, sums, beyond)
            if found is None:
                return None
            difference = found.difference
            beyond[place] = float(_digits(abs(difference - bound), sums.places)[place])
        # What is called the heavier cable may only be the lighter, and is then not known to be taut.
        return difference if difference >= 0 else None

    def _hung(self, difference: int) -> _Hung | None:
        """Return the fewest pieces that make a difference, and of these the lightest, whose inertia disturbs least."""
        sums = self._sums(difference, 1)
        share = self.masses / (2.0 * float(self.masses @ self.counts))
        cost = np.concatenate([np.tile(1 + share, 2), np.zeros(sums.matrix.shape[1] - 2 * self.masses.size)])
        return self._optimum(cost, sums, [0.0] * sums.places)

    def _sums(self, bound: int, side: int) -> _Sums:
        """Return what must hold of both sums: the difference is on one side of a bound, the lighter cable is taut.

        Sums of masses are made digit by digit, with what is carried from one to the next among the unknowns: with whole
        masses for coefficients, the solver's tolerance of what counts as whole would let small weights slip through.
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

    def _optimum(self, cost: NDArray[np.float64], sums: _Sums, beyond: Sequence[float]) -> _Hung | None:
        """Return the pieces of least cost whose sums are right, if any; digits beyond the bound have upper limits."""
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
        return _Hung(heavier, lighter, int(self.masses @ (heavier - lighter)))


def _digits(number: int, count: int = 0) -> list[int]:
    """Return the digits of a number, last first, filled up to a count."""
    digits: list[int] = []
    while number or len(digits) < max(count, 1):
        number, digit = divmod(number, _BASE)
        digits.append(digit)
    return digits


def _nearest(differences: Iterable[int], target: float, same: float) -> set[int]:
    """Return which differences are nearest to a target, up to what counts as the same."""
    off = {one: abs(one - target) for one in differences}
    return {one for one, far in off.items() if far <= min(off.values()) + same}


def _masses(weights: Sequence[Pieces], counts: NDArray[np.int64]) -> tuple[float, ...]:
    masses = (one.mass for one, count in zip(weights, counts.tolist(), strict=True) for _ in range(count))
    return tuple(sorted(masses, reverse=True))


def _listed(masses: tuple[float, ...]) -> str:
    parts = [(_mass(mass), len(list(same))) for mass, same in groupby(masses)]
    return " + ".join(text if count == 1 else f"{count} x {text}" for text, count in parts) or "nothing"


def _mass(mass: float) -> str:
    unit, size = next(((unit, size) for unit, size in (("kg", 1.0), ("g", 1e-3)) if mass >= size), ("mg", 1e-6))
    return f"{mass / size:.6g} {unit}"
