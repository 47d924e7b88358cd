"""What a workshop asks of a scale model besides similarity: cost, size, time to get it, robustness to tolerances."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from tenodesis import statics
from tenodesis.errors import ArgumentError, DesignError
from tenodesis.instrument import ShortForm
from tenodesis.run import Array
from tenodesis.scaling.candidates import CUT_TO_ORDER, Wheel
from tenodesis.scaling.catalogue import Catalogue
from tenodesis.scaling.costs import limits
from tenodesis.scaling.design import Front, described
from tenodesis.scaling.scale_model import Design, Objectives, make, name_of
from tenodesis.scaling.sweep import Stage, exact_costs, nondominated

Objective: TypeAlias = Literal["cheapest", "smallest", "quickest", "robust"]
OBJECTIVES: tuple[Objective, ...] = get_args(Objective)

SIMILAR = 0.3
"""Similarity error as designed, deg, that all designs keep which are compared by these objectives."""
_MOST = 400  # designs that are judged for robustness, the best by the other objectives
_ROBUST_STEP = 0.01  # of every objective: differences below count as equal
_RADIUS, _LENGTH = 0.02e-3, 0.2e-3  # m, standard deviations: IT10 and ISO 2768-m, about
_STIFFNESS, _PRETENSION = 0.02, 0.01
_ANGLES, _FORCES = 9, (0.0, 0.5, 1.0)

# Relative costs, ours: 1 is one part turned to general tolerances.
_GEAR, _PER_DIAMETER = 0.3, 20.0
_PER_LENGTH, _ROPE = 1.5, 300.0
_PER_TORQUE, _MOTOR = 1.5, 4.0
_CELL_STEPS = 500.0
_ENCODERS = 1.0


class Practical(NamedTuple):
    """What a design takes; smaller is better."""

    cost: float
    """Of its parts, relative: 1 is one part turned to general tolerances."""
    overall_length: float
    """m."""
    waiting: float
    """Kinds of wheels and ropes that take weeks to get, and a tenth for every part to make; other parts are alike."""
    as_built: float
    """Similarity error, deg, that 95 % of the instruments built to usual tolerances keep, by linear propagation."""


@dataclass(frozen=True)
class PracticalFront:
    """The designs that no other beats in cost, length, waiting and robustness, among those similar enough."""

    front: Front
    stages: tuple[Stage, ...]
    places: tuple[tuple[int, int], ...]
    """Stage and number of every design."""
    practical: tuple[Practical, ...]
    exact: tuple[Objectives, ...]

    def __len__(self) -> int:
        return len(self.places)

    def __getitem__(self, index: int) -> Design:
        """Return a design. Raises DesignError if its weights cannot set a test force precisely enough."""
        stage, number = self.places[index]
        return make(self.front.sweep.at(self.stages[stage]), number)

    def described(self, index: int) -> str:
        """Return the main parts and lengths of a design in one line."""
        stage, number = self.places[index]
        return described(self.stages[stage].candidates, number)

    @cached_property
    def columns(self) -> Array:
        """The objectives of every design, shape (n, 4)."""
        return np.array(self.practical)

    def best(self, objective: Objective) -> int:
        """Return the index of the best design by an objective; of equal ones the cheapest, then the shortest.

        Raises ValueError if there is no such objective.
        """
        return self.ranked(objective)[0]

    def ranked(self, objective: Objective) -> list[int]:
        """Return the indices of all designs, the best by an objective first; raises ValueError if there is no such."""
        if objective not in OBJECTIVES:
            raise ArgumentError(key="objective", value=objective, allowed=f"one of {', '.join(OBJECTIVES)}")
        first = OBJECTIVES.index(objective)
        columns = self.columns
        # Values that differ by less than the step count as equal.
        own = np.round(np.log(np.maximum(columns[:, first], 1e-6)) / _ROBUST_STEP)
        order: list[int] = np.lexsort((columns[:, 1], columns[:, 0], own)).tolist()
        return order


def practical_front(front: Front) -> PracticalFront:
    """Return the front by cost, size, waiting and robustness, of all designs of a search that are similar enough.

    Similar enough are designs with an error of :data:`SIMILAR` or less over the full working range, or up to twice the
    least error where none is. Raises DesignError if none of them meets every limit.
    """
    sweep = front.sweep
    bound = max(SIMILAR, 2 * float(sweep.costs[:, 0].min()))
    places: list[tuple[int, int]] = []
    rows: list[Practical] = []
    exact: list[Objectives] = []
    for index, stage in enumerate(sweep.stages):
        near = np.flatnonzero(stage.lower[:, 0] <= bound)
        if not near.size:
            continue
        judge = sweep.judge(stage)
        columns = judge.columns(stage.feasible[near])
        parts = _by_parts(front, stage, stage.feasible[near], columns)
        few = _few(np.column_stack([*parts.T, columns["tendon_length"], 1 / columns["distal_radius"]]))
        numbers = stage.feasible[near][few]
        costs, allowed = exact_costs(judge, limits(sweep.catalogue, sweep.forces), numbers)
        for row in np.flatnonzero(allowed & (costs[:, 0] <= bound)):
            values = {name: float(column[few[row]]) for name, column in columns.items()}
            cost, waiting = parts[few[row]].tolist()
            built = _as_built(sweep.real_size, values, sweep.forces.largest)
            places.append((index, int(numbers[row])))
            rows.append(Practical(cost, values["tendon_length"], waiting, built))
            exact.append(Objectives.of_costs(costs[row]))
    if not places:
        raise DesignError(
            f"no scale model of {front.real_size.name} has a similarity error of {bound:.3g} deg or less over the full "
            "working range within every limit; choose by --prefer instead.",
            key="similarity_error",
            allowed=f"{bound:.3g} deg or less",
        )
    kept = nondominated(np.array([[round(value, 6) for value in row] for row in rows]))
    return PracticalFront(
        front, sweep.stages, tuple(places[n] for n in kept), tuple(rows[n] for n in kept), tuple(exact[n] for n in kept)
    )


def is_stock(catalogue: Catalogue, wheel: Wheel) -> bool:
    """Return whether a gear has a module and a number of teeth that dealers keep, as far as the catalogue says."""
    gears = catalogue.gears
    if gears is None or wheel.module is None:
        return False
    known = any(math.isclose(wheel.module, module, rel_tol=1e-9) for module in gears.stock_modules)
    return known and wheel.teeth in gears.stock_teeth


def _by_parts(front: Front, stage: Stage, numbers: NDArray[np.int64], columns: Mapping[str, Array]) -> Array:
    """Return cost and waiting of candidates by their parts, shape (n, 2)."""
    found, catalogue = stage.candidates, front.sweep.catalogue
    pair, rope, *_ = np.unravel_index(numbers, found.shape)
    joints = np.array([[_wheel(catalogue, front.real_size, wheel) for wheel in both] for both in found.pairs])
    wheels = joints.sum(axis=1)[pair]
    ropes = np.array([[_ROPE * one.diameter * 2, 0 if one.diameter >= 1e-3 else 1] for one in found.ropes])[rope]
    cells = [front.sweep.judge(stage).load_cell(tension) for tension in columns["largest_tension"]]
    steps = np.array([cell.range / cell.resolution for cell in cells])
    torque = columns["largest_tension"] * columns["spool_radius"]
    cost = (
        wheels[:, 0]
        + ropes[:, 0] * columns["tendon_length"]
        + _PER_LENGTH * columns["tendon_length"]
        + 2 * steps / _CELL_STEPS
        + 2 * (_MOTOR + _PER_TORQUE * torque)
        + 2 * _ENCODERS
    )
    made = wheels[:, 2] + 3  # two spools and the rig's pulley
    return np.column_stack([cost, wheels[:, 1] + ropes[:, 1] + made / 10])


def _wheel(catalogue: Catalogue, real_size: ShortForm, wheel: Wheel) -> tuple[float, float, float]:
    """Return the cost of a joint's wheels, kinds of parts among them that take weeks, and parts to make."""
    if wheel.module is None:
        return 1 + _PER_DIAMETER * 2 * wheel.radius, 0, 1
    stock = is_stock(catalogue, wheel)
    return 2 * (_GEAR + _PER_DIAMETER * 2 * wheel.tip_radius + (0 if stock else CUT_TO_ORDER)), 0 if stock else 1, 0


def _few(columns: Array) -> NDArray[np.int64]:
    """Return the rows that are worth a closer look: those that no other beats, at most a few hundred evenly spread."""
    step = np.log1p(_ROBUST_STEP)
    rows = nondominated(np.round(np.log(np.maximum(columns, 1e-6)) / step))
    if rows.size <= _MOST:
        return rows
    best = [int(rows[columns[rows, n].argmin()]) for n in range(columns.shape[1])]
    spread = rows[np.linspace(0, rows.size - 1, _MOST).round().astype(int)]
    return np.unique([*best, *spread.tolist()]).astype(np.int64)


def as_built(front: Front, index: int) -> float:
    """Return the error, deg, that 95 % of a design of a front keep with usual tolerances."""
    sweep = front.sweep
    columns = sweep.judge(sweep.stages[-1]).columns(sweep.numbers[index : index + 1])
    values = {name: float(column[0]) for name, column in columns.items()}
    return _as_built(front.real_size, values, sweep.forces.largest)


def _as_built(real_size: ShortForm, values: Mapping[str, float], largest: float) -> float:
    """Return 1.96 standard deviations of the output angle, deg, by its derivatives, up to a real-size force, N."""
    named = real_size.parameter_fields.items()
    fields: dict[str, Any] = {field: values[name] for field, name in named if name in values}
    length = fields.pop("tendon_length")
    fields |= {"overall_length": length, "tendon_length": None, "tendon_stiffness": None, "overrides": None}
    inst = real_size.replace(**fields, name=name_of(real_size), dynamics=None, mismatch=None, control=None)
    handle = np.linspace(0, 1, _ANGLES)[:, None] * min(statics.reach(inst), statics.reach(real_size))
    force = np.array(_FORCES) * largest * values["force_factor"]
    widths: dict[str, float] = {
        **{key: _RADIUS for key in inst.parameter_fields if key.endswith(("_radius", "_offset"))},
        **{key: _LENGTH for key in ("end_effector_length", "backbone_length") if key in inst.parameter_fields},
        "tendon_modulus": _STIFFNESS * (inst.tendon_modulus or 0.0),
        "pretension": _PRETENSION * inst.pretension,
    }
    variance = np.zeros((_ANGLES, force.size))
    for key, width in widths.items():
        size = getattr(inst, key)
        high, low = (
            statics.output_angle(inst.replace(**{key: size + sign * width}), handle, force) for sign in (0.5, -0.5)
        )
        variance += np.nan_to_num((high - low) ** 2, nan=math.pi**2)
    return float(np.degrees(1.96 * np.sqrt(variance.max())))
