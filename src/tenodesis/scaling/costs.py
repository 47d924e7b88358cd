"""Limits and costs of a scale model: what it must keep, and its error, resolution, length and margin."""

import math
from collections.abc import Callable, Mapping
from functools import cache, cached_property
from math import log, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tenodesis import _core, statics
from tenodesis.errors import DesignError
from tenodesis.instrument import ShortForm
from tenodesis.run import Array
from tenodesis.scaling.candidates import Candidates
from tenodesis.scaling.catalogue import Catalogue, Constraints
from tenodesis.scaling.parts import LoadCell, Spool, Weight
from tenodesis.scaling.weights import least_difference
from tenodesis.similarity import GRID
from tenodesis.similarity.parameters import value_of
from tenodesis.threads import threads
from tenodesis.units import STANDARD_GRAVITY

Columns = Mapping[str, Array]
"""Parameters and results of some scale models by name, with the rope's breaking load and the larger wheel's size."""


class Limit(NamedTuple):
    """A limit: its constraint, requirement, amount and unit, and amount and bound of every scale model."""

    key: str
    requires: str
    amount_is: str
    unit: str
    compute: Callable[[Columns], tuple[Array, Array | float]]

    def met(self, columns: Columns) -> NDArray[np.bool_]:
        """Return which scale models meet it."""
        amount, bound = self.compute(columns)
        # A length pinned to its bound may differ by rounding.
        return np.asarray(amount <= bound + 1e-12 * np.abs(bound))


class Forces(NamedTuple):
    """The largest force at which scale models are judged, and the test forces; N, real-size."""

    largest: float
    tests: tuple[float, ...]


def forces_of(real_size: ShortForm, catalogue: Catalogue) -> Forces:
    """Return the forces at which a scale model is judged and tested, N on the real-size instrument.

    Raises DesignError if a test force exceeds the largest force.
    """
    constraints = catalogue.constraints
    tests = constraints.test_forces or real_size.conditions.forces or (1.0,)
    largest = constraints.largest_force or max(real_size.conditions.forces, default=max(tests))
    if max(tests) > largest:
        raise DesignError(
            f"test_forces go up to {max(tests):g} N and largest_force is {largest:g} N, which contradict each other; "
            "test forces must not exceed the largest force.",
            key="test_forces",
            value=tests,
            allowed=f"forces up to {largest:g} N",
        )
    return Forces(largest, tuple(tests))


def of_tension(catalogue: Catalogue) -> tuple[Limit, ...]:
    """Return the limits of tension and similarity, which scale models of one joint and of several have."""
    constraints = catalogue.constraints
    widest = max(cell.range for cell in catalogue.load_cells)
    torque, error = (
        math.inf if bound is None else bound for bound in (constraints.spool_torque, constraints.similarity_error)
    )
    return (
        Limit(
            "tension_margin",
            f"no rope breaks: a breaking load of {constraints.tension_margin:g} times the largest tension",
            "breaking load needed",
            "N",
            lambda c: (constraints.tension_margin * c["largest_tension"], c["breaking_load"]),
        ),
        Limit(
            "load_cell_margin",
            f"a load cell with a range of {constraints.load_cell_margin:g} times the largest tension",
            "range needed",
            "N",
            lambda c: (constraints.load_cell_margin * c["largest_tension"], widest),
        ),
        Limit(
            "spool_torque",
            f"the drives hold the largest tension with {torque:g} N*m",
            "torque needed",
            "N*m",
            lambda c: (c["largest_tension"] * c["spool_radius"], torque),
        ),
        Limit(
            "similarity_error",
            f"the output angles differ by at most {math.degrees(error):.3g} deg",
            "largest difference",
            "rad",
            lambda c: (c["largest_error"], error),
        ),
    )


def limits(catalogue: Catalogue, forces: Forces) -> tuple[Limit, ...]:
    """Return the limits that a catalogue's constraints and parts set."""
    constraints = catalogue.constraints
    rho, largest = constraints.cable_pulley_radius, max(forces.tests)
    masses = sum(weight.mass * weight.count for weight in catalogue.weights)
    step = finest_difference(catalogue)
    least_radius = min((encoder.least_distal_radius for encoder in catalogue.encoders), default=0.0)
    # A constraint that is not given is met by any scale model.
    bed = min(constraints.print_bed or (math.inf,))
    return (
        Limit(
            "handle_range",
            "the handle's range bends the unloaded tip less far than its joint can go",
            "an unloaded bend at the end of the handle's range, over the joint's limit, of",
            "%",
            lambda c: (c["unloaded_limit"], 1 - 1e-9),
        ),
        Limit(
            "lengths",
            "joints, end-effector and handle fit into the overall length",
            "their length",
            "m",
            lambda c: (c["end_effector_length"] + c["handle_length"] + c["joints_span"], c["tendon_length"]),
        ),
        *of_tension(catalogue),
        Limit(
            "weights",
            f"weights for the largest test force, {largest:g} N on the real-size instrument",
            "mass to hang",
            "kg",
            lambda c: (
                max(forces.tests) * c["force_factor"] * c["rig_arm"] / rho / STANDARD_GRAVITY
                + 2 * constraints.cable_mass,
                masses,
            ),
        ),
        Limit(
            "force_tolerance",
            f"weights fine enough for the smallest test force, {min(forces.tests):g} N on the real-size instrument, "
            f"to {100 * constraints.force_tolerance:g} %",
            "force of half the lightest weight",
            "N",
            lambda c: (
                0.5 * step * STANDARD_GRAVITY * rho / c["rig_arm"],
                constraints.force_tolerance * min(forces.tests) * c["force_factor"],
            ),
        ),
        Limit(
            "encoders",
            "a distal encoder fits",
            "distal radius needed",
            "m",
            lambda c: (np.full_like(c["distal_radius"], least_radius), c["distal_radius"]),
        ),
        Limit(
            "print_bed",
            f"the largest wheel fits on the print bed's {1e3 * bed:g} mm",
            "its diameter",
            "m",
            lambda c: (2 * c["largest_wheel"], bed),
        ),
    )


def finest_difference(catalogue: Catalogue) -> float:
    """Return the smallest possible difference in mass between the two cables, kg."""
    return _finest(catalogue.weights, catalogue.constraints.cable_mass)


@cache
def _finest(weights: tuple[Weight, ...], cable_mass: float) -> float:
    return least_difference(weights, cable_mass=cable_mass)


class Tally:
    """Counts how many scale models meet each limit and each pair of limits, to find contradictions."""

    def __init__(self, limits: tuple[Limit, ...]) -> None:
        self._limits = limits
        self._both = np.zeros((len(limits), len(limits)), np.int64)
        nowhere = (np.inf, np.nan, np.nan)
        self._nearest: list[tuple[float, float, float]] = [nowhere] * len(limits)
        self._alone: list[tuple[float, float, float]] = [nowhere] * len(limits)
        self._failed = np.zeros_like(self._both)
        self._examined = 0

    def feasible(self, columns: Columns) -> NDArray[np.bool_]:
        """Count some scale models and return which of them meet every limit."""
        met = np.array([limit.met(columns) for limit in self._limits])
        counted = met.astype(np.float64)  # exact up to 2**53, and a product that BLAS does
        self._both += (counted @ counted.T).astype(np.int64)
        self._examined += met.shape[1]
        failures = (~met).sum(axis=0)
        if failures.size and failures.min() > 0:
            self._fall_short(columns, met, failures)
        return np.asarray(failures == 0)

    def _fall_short(self, columns: Columns, met: NDArray[np.bool_], failures: NDArray[np.int64]) -> None:
        """Keep how close scale models of which none meets every limit come to each, and which pairs they fail."""
        two = (~met[:, failures == 2]).astype(np.float64)
        self._failed += (two @ two.T).astype(np.int64)
        for n, limit in enumerate(self._limits):
            amount, bound = np.broadcast_arrays(*limit.compute(columns))
            short = amount / np.maximum(np.abs(bound), np.finfo(float).tiny)
            for kept, allowed in (
                (self._nearest, np.isfinite(short)),
                (self._alone, np.isfinite(short) & (failures == ~met[n])),
            ):
                if allowed.any():
                    at = int(np.argmin(np.where(allowed, short, np.inf)))
                    kept[n] = min(kept[n], (float(short[at]), float(amount[at]), float(bound[at])))

    def unmeetable(self) -> Limit | None:
        """Return the first limit that no scale model meets, whatever the others do."""
        met = self._both.diagonal()
        return next((limit for n, limit in enumerate(self._limits) if not met[n]), None)

    def nearest(self, limit: Limit) -> str:
        """Return a phrase on how close scale models come to a limit that none meets."""
        _, amount, bound = self._nearest[self._limits.index(limit)]
        at_most = "it must stay below" if limit.unit == "%" else "the bound is"
        return (
            f"the nearest of {self._examined} scale models has {limit.amount_is} {_text(amount, limit.unit)}; "
            f"{at_most} {_text(bound, limit.unit)}"
        )

    def contradiction(self) -> DesignError:
        """Return the error that names the limit, or the two limits, that cannot be met."""
        alone = self.unmeetable()
        if alone is not None:
            return DesignError(
                f"{alone.key} cannot be met: {alone.requires}; {self.nearest(alone)}; {_remedy(alone.key)}.",
                key=alone.key,
                allowed=alone.requires,
            )
        met = self._both.diagonal()
        for i, one in enumerate(self._limits):
            for j, other in enumerate(self._limits[:i]):
                if not self._both[i, j]:
                    remedies = [
                        f" With all others kept, {self._best(n, self._alone)}: relax {_option(self._limits[n].key)}."
                        for n in (j, i)
                        if np.isfinite(self._alone[n][0])
                    ]
                    return DesignError(
                        f"{other.key} and {one.key} contradict each other: of {self._examined} scale models {met[j]} "
                        f"meet the one ({other.requires}), {met[i]} the other ({one.requires}), and none "
                        f"both.{''.join(remedies)}",
                        key=other.key,
                        allowed=other.requires,
                    )
        nearly = [(best[0], n) for n, best in enumerate(self._alone) if np.isfinite(best[0])]
        scarce = [n for n in range(len(self._limits)) if met[n] < self._examined]
        values = "; ".join(self._best(n, self._nearest) for n in scarce)
        if nearly:
            n = min(nearly)[1]
            rival = max((one for one in scarce if one != n), key=lambda one: self._examined - met[one])
            remedy = (
                f"with all the others kept, {self._best(n, self._alone)}: {self._limits[n].key} conflicts most with "
                f"{self._limits[rival].key}; relax {_option(self._limits[n].key)}"
            )
        else:
            pair = divmod(int(np.triu(self._failed, 1).argmax()), len(self._limits))
            remedy = " and ".join(self._limits[n].key for n in pair) + " keep most models out together; relax "
            remedy += " and ".join(_option(self._limits[n].key) for n in pair)
        return DesignError(
            f"no scale model of {self._examined} meets all limits, though any two can be met. Best value of each, "
            f"whatever the others: {values}. {remedy[0].upper()}{remedy[1:]}.",
            key="limits",
        )

    def _best(self, n: int, among: list[tuple[float, float, float]]) -> str:
        """Return a phrase on the best amount of a limit, and its bound."""
        limit, (_, amount, bound) = self._limits[n], among[n]
        return f"{limit.key}, {limit.amount_is} {_text(amount, limit.unit)} (bound {_text(bound, limit.unit)})"


def _option(key: str) -> str:
    """Return a phrase on the option that relaxes a limit."""
    if key in Constraints.model_fields:
        return f"{key} in [constraints] of a file given to --catalogue"
    if key == "lengths":
        return "overall_length, by --pin or in [constraints] of a file given to --catalogue"
    return "handle_range of the instrument" if key == "handle_range" else f"{key} of a file given to --catalogue"


def _remedy(key: str) -> str:
    """Return a phrase on what to do about a limit that nothing meets."""
    return "give the instrument a smaller handle_range" if key == "handle_range" else f"relax {_option(key)}"


def _text(amount: float, unit: str) -> str:
    if unit == "m":
        return f"{1e3 * amount:.4g} mm"
    if unit == "rad":
        return f"{math.degrees(amount):.4g} deg"
    if unit == "%":
        return f"{100 * amount:.3g} %"
    return f"{amount:.4g} {unit}"


FINDINGS = tuple(_core.findings())
"""Results of the core for a scale model, in its order."""

COARSE = (8, 8)
"""Number of handle angles and of forces at which every combination is judged."""


class Points(NamedTuple):
    """Handle angles (rad) and forces (N) on the real-size instrument, each of shape (n,)."""

    handle_angle: Array
    force: Array

    def target(self, real_size: ShortForm) -> _core.SimilarityTarget:
        """Return the reference by which the core judges scale models: equal loss of dexterity at mid-range."""
        at_angle = real_size.output_range / 2
        return _core.SimilarityTarget(
            real_size.spec, self.handle_angle.tolist(), self.force.tolist(), at_angle, real_size.output_stop
        )


class WorkingGrid(NamedTuple):
    """All points of the grid at which the instrument has an equilibrium, and a few of them with the same extent."""

    fine: Points
    coarse: Points


def working_range(real_size: ShortForm, largest_force: float) -> WorkingGrid:
    """Return the points at which scale models are judged, up to a force (N) and over the range of output angles.

    The few points are among the many: up to the largest force held at each of their handle angles, and the point of
    the largest tension. Errors and tensions over them are lower bounds of those over all.
    """
    reach = statics.reach(real_size)
    handle = np.linspace(-reach, reach, GRID[0])
    force = np.linspace(0.0, largest_force, GRID[1])
    held = np.isfinite(statics.output_angle(real_size, handle[:, None], force))
    rows, columns = np.nonzero(held)
    chosen = [
        (row, column)
        for row in _evenly(np.unique(rows), COARSE[0])
        for column in _evenly(columns[rows == row], COARSE[1])
    ]
    # Replaces one of the many points without a force.
    chosen[COARSE[1] * (COARSE[0] // 2)] = _most_strained(real_size, handle, force)
    few = tuple(np.array(chosen).T)
    return WorkingGrid(Points(handle[rows], force[columns]), Points(handle[few[0]], force[few[1]]))


def _evenly(numbers: Array, count: int) -> list[int]:
    return [int(numbers[round(at)]) for at in np.linspace(0, numbers.size - 1, count)]


def _most_strained(real_size: ShortForm, handle: Array, force: Array) -> tuple[int, int]:
    tensions = statics.tensions(real_size, handle[:, None], force)
    largest = np.fmax(tensions.agonist, tensions.antagonist)
    row, column = np.unravel_index(int(np.nanargmax(largest)), largest.shape)
    return int(row), int(column)


class LoadCells:
    """The load cells of a catalogue: for a largest tension, the finest of those with a sufficient range."""

    def __init__(self, catalogue: Catalogue) -> None:
        cells = sorted(catalogue.load_cells, key=lambda cell: (cell.range, cell.resolution))
        self._margin = catalogue.constraints.load_cell_margin
        self._ranges = np.array([cell.range for cell in cells])
        # More tension never selects a finer one.
        self._finest = [min(cells[n:], key=lambda cell: cell.resolution) for n in range(len(cells))]

    def of(self, tension: float) -> LoadCell:
        """Return the load cell for a largest tension, N."""
        return self._finest[int(self._places(np.array([tension]))[0])]

    def resolution(self, tension: Array) -> Array:
        """Return the resolutions, N, of those for largest tensions, N."""
        return np.array([cell.resolution for cell in self._finest])[self._places(tension)]

    def _places(self, tension: Array) -> NDArray[np.int64]:
        needed = self._margin * tension * (1 - 1e-12)
        return np.asarray(np.minimum(np.searchsorted(self._ranges, needed), len(self._ranges) - 1))


class Judge:
    """Computes parameters, results and costs of scale models by number; see :class:`Sweep` for the costs."""

    def __init__(self, found: Candidates, catalogue: Catalogue, span: WorkingGrid) -> None:
        self._candidates = found
        self._span = span
        self._catalogue = catalogue
        self._cells = LoadCells(catalogue)
        self._largest_wheel = np.array([max(wheel.tip_radius for wheel in pair) for pair in found.pairs])
        self._breaking_load = np.array([rope.breaking_load for rope in found.ropes])
        spool = found.real_size.drives.spool_radius / value_of(found.real_size, "distal_radius")
        self._spools = [nearest_spool(catalogue, spool * pair[0].radius) for pair in found.pairs]

    @cached_property
    def _coarse(self) -> _core.SimilarityTarget:
        return self._span.coarse.target(self._candidates.real_size)

    @cached_property
    def _fine(self) -> _core.SimilarityTarget:
        return self._span.fine.target(self._candidates.real_size)

    def columns(self, numbers: NDArray[np.int64], *, fine: bool = False) -> dict[str, Array]:
        """Return parameters and results of scale models by name, at few or all points of the working range."""
        columns = self._candidates.columns(numbers)
        rows = self._candidates.rows(columns)
        found = np.empty((numbers.size, len(FINDINGS)))
        pretension = np.full(numbers.size, self._candidates.pretension)
        (self._fine if fine else self._coarse).judge(rows, pretension, found, threads())
        pair, rope, *_ = np.unravel_index(numbers, self._candidates.shape)
        extra = {
            "largest_wheel": self._largest_wheel[pair],
            "spool_radius": np.array([spool.radius for spool in self._spools])[pair],
            "breaking_load": self._breaking_load[rope],
        }
        return columns | dict(zip(FINDINGS, found.T, strict=True)) | extra

    def spool(self, number: int) -> Spool:
        """Return the spool of a scale model whose angles are closest to those of the real-size spool."""
        return self._spools[int(np.unravel_index(number, self._candidates.shape)[0])]

    def load_cell(self, largest_tension: float) -> LoadCell:
        """Return the load cell for a largest tension (N)."""
        return self._cells.of(largest_tension)

    def costs(self, columns: Mapping[str, Array]) -> Array:
        """Return the costs of scale models, shape (n, 4)."""
        resolution = self._cells.resolution(columns["largest_tension"])
        return np.column_stack(
            [
                np.degrees(columns["largest_error"]),
                np.maximum(self._weight_step(columns), tip_force(resolution, columns)),
                columns["tendon_length"],
                columns["largest_tension"] / columns["breaking_load"],
            ]
        )

    def _weight_step(self, columns: Mapping[str, Array]) -> Array:
        rho = self._catalogue.constraints.cable_pulley_radius
        finest = finest_difference(self._catalogue)
        step: Array = finest * STANDARD_GRAVITY * rho / columns["rig_arm"] / columns["force_factor"]
        return step


def tip_force(tension_resolution: Any, columns: Mapping[str, Any]) -> Any:
    """Return the smallest force at the real-size tip (N) that two load cells of a resolution (N) detect.

    `columns` holds the tension difference per tip force and the force factor, by name.
    """
    return sqrt(2) * tension_resolution / columns["tension_per_force"] / columns["force_factor"]


def nearest_spool(catalogue: Catalogue, radius: float) -> Spool:
    """Return the spool of a catalogue that is closest to a radius, m."""
    return min(catalogue.spools, key=lambda one: abs(log(one.radius / radius)))
