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
from tenodesis.instrument import Instrument
from tenodesis.quantity import STANDARD_GRAVITY

_GRID = 1e-6
"""Mass that all masses are whole multiples of, kg: that of the least weight of OIML R 111."""

_EXACT = 1e-9
"""Share that two masses may differ by and still be the same."""

_BASE = 1000
"""What sums of masses are carried at, so that the solver's tolerance of a whole number, 1e-6, stays far from one."""

_NOTHING: NDArray[np.float64] = np.zeros(0)

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
class Hanging:
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


def hang(weight: float, weights: Sequence[Pieces], *, cable_mass: float) -> Hanging:
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
    if not 0 <= cable_mass < math.inf:
        raise ValueError(f"cable_mass is {cable_mass!r}; allowed is a mass of at least 0 kg.")
    problem = _Problem.of(weights, cable_mass)
    hung = problem.solve(abs(weight) / STANDARD_GRAVITY)
    loading, counter = (hung.heavier, hung.lighter) if weight >= 0 else (hung.lighter, hung.heavier)
    used = sum(one.tolerance * count for one, count in zip(weights, (loading + counter).tolist(), strict=True))
    return Hanging(_masses(weights, loading), _masses(weights, counter), weight, used * STANDARD_GRAVITY)


def hang_all(forces: Iterable[float], weights: Sequence[Pieces], *, cable_mass: float) -> tuple[Hanging, ...]:
    """Return what to hang for each of several weights (N), one after another; otherwise as :func:`hang`."""
    return tuple(hang(force, weights, cable_mass=cable_mass) for force in forces)


def cable_weight(inst: Instrument, force: float, pulley_radius: float) -> float:
    """Return the weight on the loading cable more than on the other that makes a tip force (Fig. 13), all in N and m.

    Raises
    ------
    ValueError
        The radius at which the cables act is not positive.
    """
    return force / _leverage(inst, pulley_radius)


def tip_force(inst: Instrument, weight: float, pulley_radius: float) -> float:
    """Return the tip force that a weight makes; the inverse of :func:`cable_weight`, with the same errors."""
    return weight * _leverage(inst, pulley_radius)


def _leverage(inst: Instrument, pulley_radius: float) -> float:
    if not 0 < pulley_radius < math.inf:
        raise ValueError(f"pulley_radius is {pulley_radius!r}; allowed is a length above 0 m.")
    return pulley_radius / inst.rig_arm


class _Hung(NamedTuple):
    """How many pieces of each mass hang on either cable, and their difference in units."""

    heavier: NDArray[np.int64]
    lighter: NDArray[np.int64]
    difference: int

    @property
    def pieces(self) -> int:
        return int((self.heavier + self.lighter).sum())


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

    def solve(self, mass: float) -> _Hung:
        """Return what to hang for a difference (kg, not negative)."""
        target = mass / self.unit
        same = _EXACT * max(1.0, target)
        below, above = math.floor(target + same), math.ceil(target - same)
        # Most sets can make every difference, so that no search for the nearest is needed.
        found = self._fewest(_nearest((below, above), target, same))
        if found is None:
            sides = (self._extreme(-1.0, (-math.inf, below)), self._extreme(1.0, (above, math.inf)))
            found = self._fewest(_nearest([one for one in sides if one is not None], target, same))
        if found is None:
            total, least = float(self.masses @ self.counts) * self.unit, self.least * self.unit
            raise DesignError(
                f"the weights, {total:.6g} kg in all, do not keep two cables taut with {least:.6g} kg "
                "on each; allowed are more weights or a smaller cable_mass."
            )
        return found

    def _fewest(self, differences: Iterable[int]) -> _Hung | None:
        """Return the fewest pieces that make one of some differences, None if none can be made."""
        made = (self._hung(one) for one in differences)
        return min((hung for hung in made if hung is not None), key=lambda hung: hung.pieces, default=None)

    def _extreme(self, sign: float, limits: tuple[float, float]) -> int | None:
        """Return the least difference within limits, or with a negative sign the largest; None if there is none."""
        none = np.zeros(self.masses.size)
        rows = ((self.masses, -self.masses), (self.masses, none), (none, self.masses))
        matrix = np.array([np.concatenate(row) for row in rows], float)
        lower = np.array([limits[0], self.least, self.least])
        upper = np.array([limits[1], math.inf, math.inf])
        found = self._optimum(sign * matrix[0], (matrix, lower, upper))
        return None if found is None else found.difference

    def _hung(self, difference: int) -> _Hung | None:
        """Return the fewest pieces that make a difference, and of these the lightest, whose inertia disturbs least.

        Sums of masses are made digit by digit, with what is carried from one to the next among the unknowns: with whole
        masses for coefficients, the solver's tolerance of what counts as whole would let small weights slip through.
        """
        digits = len(_digits(max(int(self.masses @ self.counts), difference, self.least)))
        by_mass = np.array([_digits(int(mass), digits) for mass in self.masses], float).T
        carry = np.eye(digits, digits - 1, -1) - _BASE * np.eye(digits, digits - 1)
        none, spare, unmoved = np.zeros(by_mass.shape), np.eye(digits), np.zeros((digits, digits))
        uncarried = np.zeros(carry.shape)
        # Unknown beside the counts: what the lighter cable has beyond its least mass, and what is carried in each sum.
        sums = np.block(
            [
                [by_mass, -by_mass, unmoved, carry, uncarried],
                [none, by_mass, -spare, uncarried, carry],
            ]
        )
        wanted = np.array([*_digits(difference, digits), *_digits(self.least, digits)], float)
        share = self.masses / (2.0 * float(self.masses @ self.counts))
        cost = np.concatenate([np.tile(1 + share, 2), np.zeros(sums.shape[1] - 2 * self.masses.size)])
        most = 2.0 * float(self.counts.sum()) + 2
        lower = np.concatenate([np.zeros(digits), np.full(2 * digits - 2, -most)])
        upper = np.concatenate([np.full(digits, _BASE - 1.0), np.full(2 * digits - 2, most)])
        return self._optimum(cost, (sums, wanted, wanted), lower, upper)

    def _optimum(
        self,
        cost: NDArray[np.float64],
        sums: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]],
        lower: NDArray[np.float64] = _NOTHING,
        upper: NDArray[np.float64] = _NOTHING,
    ) -> _Hung | None:
        """Return the pieces of least cost whose sums are right, if any; unknowns beside their counts have bounds."""
        from scipy.optimize import Bounds, LinearConstraint, milp  # noqa: PLC0415 - takes half a second

        kinds = self.masses.size
        of_a_kind = np.hstack([np.eye(kinds), np.eye(kinds), np.zeros((kinds, lower.size))])
        found = milp(
            cost,
            integrality=np.ones(cost.size, np.int64),
            bounds=Bounds(
                np.concatenate([np.zeros(2 * kinds), lower]), np.concatenate([np.tile(self.counts, 2), upper])
            ),
            constraints=[LinearConstraint(*sums), LinearConstraint(of_a_kind, 0, self.counts)],
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
