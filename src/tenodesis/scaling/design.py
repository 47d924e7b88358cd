"""Scale models: a design with its parts, objectives and test loads, and the Pareto front of designs."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple, TypeAlias, get_args, overload

import numpy as np
from numpy.typing import NDArray

from tenodesis import notebook
from tenodesis.errors import ArgumentError
from tenodesis.instrument import InstrumentLike, ShortForm, as_short_form
from tenodesis.run import Array
from tenodesis.scaling import catalogue as catalogues
from tenodesis.scaling.candidates import COMBINATIONS, Candidates
from tenodesis.scaling.catalogue import Catalogue, narrowed, parse_pins
from tenodesis.scaling.costs import limits
from tenodesis.scaling.scale_model import OBJECTIVES, Design, Objectives, make, shown
from tenodesis.scaling.sweep import ERROR_STEP, RELATIVE_STEP, Progress, Sweep, exact_costs, sweep

Preference: TypeAlias = Literal["similarity", "resolution", "size", "margin", "balanced"]
PREFERENCES: tuple[Preference, ...] = get_args(Preference)

ObjectiveName: TypeAlias = Literal["similarity_error", "force_resolution", "overall_length", "tension_margin"]
Selection: TypeAlias = slice | Sequence[int] | Sequence[bool] | NDArray[np.integer] | NDArray[np.bool_]
"""Some designs of a front: a slice, indices, or a mask."""

_MOST_ROWS = 10
"""Designs of a front that notebooks show."""
SIMILAR_ENOUGH = 0.1
"""Similarity error, deg, below which designs count as equal."""


_HARDLY_MORE = 1.05
"""Ratio of tension times length below which two designs count as equally light to build."""
YIELD = 0.1
"""Share of the other objectives that may be given up to improve an objective."""


class Rival(NamedTuple):
    """A scale model that is at least as good in every objective."""

    objectives: Objectives
    made_of: str


@dataclass(frozen=True)
class Front:
    """The Pareto front of designs, sorted by their similarity error.

    Designs count as different by 0.01 deg of similarity error, or 1 % of another objective.
    """

    sweep: Sweep

    def __len__(self) -> int:
        return int(self.sweep.numbers.size)

    @overload
    def __getitem__(self, index: int) -> Design: ...
    @overload
    def __getitem__(self, index: "Selection") -> "Front": ...
    def __getitem__(self, index: "int | Selection") -> "Design | Front":
        """Return a design of the front; or by a slice, a mask or indices as in NumPy, a front of those designs.

        Raises IndexError if there is no such design, and DesignError if its weights cannot set a test force precisely
        enough.
        """
        if isinstance(index, int | np.integer):
            return make(self.sweep, int(self.sweep.numbers[index]))
        rows = self._rows(index)
        return Front(replace(self.sweep, numbers=self.sweep.numbers[rows], costs=self.sweep.costs[rows]))

    def __iter__(self) -> Iterator[Design]:
        return (self[index] for index in range(len(self)))

    def __repr__(self) -> str:
        return f"<Front of {self._size}>"

    def _repr_html_(self) -> str:
        """Return a table for notebooks: objectives and main parts of the first designs."""
        rows = [
            (str(index), *(shown(value) for value in one), self.described(index))
            for index, one in enumerate(self.objectives[:_MOST_ROWS])
        ]
        headings = ("design", *(f"{name}{f' [{unit.strip()}]' if unit else ''}" for name, unit in OBJECTIVES), "parts")
        more = f"; the first {_MOST_ROWS}" if len(self) > _MOST_ROWS else ""
        return notebook.table(f"Front of {self._size}{more}", headings, rows)

    @property
    def _size(self) -> str:
        designs = "one design" if len(self) == 1 else f"{len(self)} designs"
        return f"{designs} for {self.real_size.name!r}, of {self.examined} judged"

    def _rows(self, index: "Selection") -> NDArray[np.int64]:
        if isinstance(index, slice):
            return np.arange(len(self))[index]
        wanted = np.asarray(index)
        rows: NDArray[np.int64] = np.arange(len(self))[wanted if wanted.size else wanted.astype(np.int64)]
        return rows

    def sorted_by(self, objective: ObjectiveName) -> "Front":
        """Return this front sorted by an objective, the best first. Raises ValueError if there is no such objective."""
        if objective not in Objectives._fields:
            raise ArgumentError(key="objective", value=objective, allowed=f"one of {', '.join(Objectives._fields)}")
        order = np.argsort(self.sweep.costs[:, Objectives._fields.index(objective)], kind="stable")
        return self[order]

    @property
    def real_size(self) -> ShortForm:
        """The real-size instrument."""
        return self.sweep.real_size

    @property
    def costs(self) -> Array:
        """Costs of the designs as of :attr:`Objectives.costs`, (designs, 4)."""
        return self.sweep.costs

    @property
    def examined(self) -> int:
        """Number of scale models judged."""
        return self.sweep.examined

    @property
    def feasible(self) -> int:
        """Number of those that met every constraint."""
        return self.sweep.feasible

    @cached_property
    def objectives(self) -> tuple[Objectives, ...]:
        """The objectives of every design."""
        return tuple(Objectives.of_costs(row) for row in self.sweep.costs)

    @cached_property
    def _largest_tensions(self) -> Array:
        """Largest tension of every design over the working range, N."""
        judge = self.sweep.judge(self.sweep.stages[-1])
        return judge.columns(self.sweep.numbers, fine=True)["largest_tension"]

    def ranked(self, prefer: Preference = "similarity") -> list[int]:
        """Return the indices of the designs that are best in the preferred objective, sorted by the others.

        Designs within 0.1 deg, or 1 %, of the best value count as best. Of these come first those within 5 % of the
        least product of largest tension and overall length, so that no more tension is taken than similarity needs; of
        these, or for "balanced" of all, the first is the one whose worst rank in all objectives is best. Raises
        ValueError if the preference is unknown.
        """
        if prefer not in PREFERENCES:
            raise ArgumentError(key="prefer", value=prefer, allowed=f"one of {', '.join(PREFERENCES)}")
        costs = self.sweep.costs
        good = np.ones(len(costs), bool)
        if prefer != "balanced":
            column = PREFERENCES.index(prefer)
            least = costs[:, column].min()
            good = costs[:, column] <= (max(least, SIMILAR_ENOUGH) if column == 0 else least * 1.01)
        ranks = np.column_stack([_ranks(costs[good][:, column]) for column in range(4)])
        strain = self._largest_tensions[good] * costs[good, 2]
        heavier = np.zeros(len(ranks), bool) if prefer == "balanced" else strain > _HARDLY_MORE * strain.min()
        order: list[int] = np.flatnonzero(good)[np.lexsort((ranks.sum(axis=1), ranks.max(axis=1), heavier))].tolist()
        return order

    def best(self, prefer: Preference = "similarity") -> int:
        """Return the index of the first design of :meth:`ranked`."""
        return self.ranked(prefer)[0]

    def described(self, index: int) -> str:
        """Return the main parts and lengths of a design in one line."""
        return described(self.sweep.candidates, int(self.sweep.numbers[index]))

    def rivals(self, objectives: Objectives) -> list[Rival]:
        """Return all judged scale models that dominate given objectives, the most similar first.

        They are as good in every objective and better in one; they need not be on the front.
        """
        costs = objectives.costs
        # Equal up to rounding is as good.
        bound = costs * (1 + 1e-9) + 1e-12
        found = []
        for stage in self.sweep.stages:
            possible = np.flatnonzero((stage.lower <= bound).all(axis=1))
            if not possible.size:
                continue
            judge = self.sweep.judge(stage)
            exact, allowed = exact_costs(
                judge, limits(self.sweep.catalogue, self.sweep.forces), stage.feasible[possible]
            )
            better = (exact < costs * (1 - 1e-9) - 1e-12).any(axis=1)
            good = allowed & (exact <= bound).all(axis=1) & better
            for row in np.flatnonzero(good):
                made_of = described(stage.candidates, int(stage.feasible[possible][row]))
                found.append(Rival(Objectives.of_costs(exact[row]), made_of))
        # A scale model may have been judged in both stages.
        return sorted(set(found))

    def table(self) -> dict[str, list[Any]]:
        """Return objectives, parts and lengths (mm) of all designs, by column."""
        rows = [_row(self.sweep.candidates, int(number)) for number in self.sweep.numbers]
        made = {key: [row[key] for row in rows] for key in rows[0]}
        judged = {
            "similarity error [deg]": [one.similarity_error for one in self.objectives],
            "force resolution [N real-size]": [one.force_resolution for one in self.objectives],
            "overall length [mm]": [1e3 * one.overall_length for one in self.objectives],
            "tension margin": [one.tension_margin for one in self.objectives],
        }
        return judged | made


def design(
    real_size: InstrumentLike,
    catalogue: Catalogue | None = None,
    *,
    pins: Mapping[str, Any] | None = None,
    combinations: int = COMBINATIONS,
    progress: Progress = lambda *_: None,
) -> Front:
    """Find the Pareto front of an instrument's scale models, sorted by their similarity error.

    Parameters
    ----------
    real_size
        The real-size instrument; of two axes, the first.
    catalogue
        Parts and constraints; by default the standard catalogue.
    pins
        Fixed choices, in SI units or as text: lengths, radii, ``factor``, ``rope``, ``pretension`` ...
    combinations
        Approximate number of scale models to judge.
    progress
        Called with the name of the step, the amount done and the total.

    Raises
    ------
    DesignError
        A pin names no part, or no scale model meets the constraints; the message names the contradiction.
    """
    real_size = as_short_form(real_size, "real_size")
    if isinstance(combinations, bool) or not isinstance(combinations, int) or not 1 <= combinations <= 10**9:
        raise ArgumentError(key="combinations", value=combinations, allowed="an integer from 1 to 10**9")
    given = parse_pins(pins or {})
    parts = narrowed(catalogues.load() if catalogue is None else catalogue, given)
    return Front(sweep(real_size.planar[0], parts, given, combinations=combinations, progress=progress))


def rivals_text(front: Front, objectives: Objectives) -> str:
    """Return, as the end of a sentence, by how much other scale models are better."""
    rivals = front.rivals(objectives)
    if not rivals:
        return f"no scale model beats this one in everything: it is on the front. {_trades(front, objectives)}"
    best = rivals[0]
    gains = ", ".join(
        f"{name} {shown(other)} instead of {shown(own)}{unit}"
        for (name, unit), other, own in zip(OBJECTIVES, best.objectives, objectives, strict=True)
    )
    count = f"{len(rivals)} scale models are" if rivals[1:] else "one scale model is"
    return (
        f"{count} as good or better in everything; the most similar one has {gains} ({best.made_of}). "
        f"{_trades(front, objectives)}"
    )


def _trades(front: Front, objectives: Objectives) -> str:
    """Return in words how good each objective can be on the front if the others may be slightly worse."""
    costs = objectives.costs
    gains = []
    for column, (name, unit) in enumerate(OBJECTIVES):
        others = [n for n in range(4) if n != column]
        within = (front.sweep.costs[:, others] <= costs[others] * (1 + YIELD)).all(axis=1)
        best = front.sweep.costs[within, column].min(initial=costs[column])
        resolution = ERROR_STEP if column == 0 else costs[column] * RELATIVE_STEP
        if best < costs[column] - resolution:
            value, own = (1 / one if column == 3 else one for one in (best, costs[column]))
            gains.append(f"{name} {shown(value)} instead of {shown(own)}{unit}")
    if not gains:
        return f"Giving up {100 * YIELD:g} % of the others gains nothing."
    return f"Giving up {100 * YIELD:g} % of the others, one can have " + ", or ".join(gains) + "."


def _row(found: Candidates, number: int) -> dict[str, Any]:
    (distal, proximal), rope, rod = found.parts(number)
    columns = {name: float(values[0]) for name, values in found.columns(np.array([number])).items()}
    row: dict[str, Any] = {}
    for name, wheel in (("distal", distal), ("proximal", proximal)):
        row[f"{name} radius [mm]"] = 1e3 * wheel.radius
        if wheel.module is not None:
            row |= {f"{name} module [mm]": 1e3 * wheel.module, f"{name} teeth": wheel.teeth}
    row |= {"rope": rope.name, "end-effector length [mm]": 1e3 * columns["end_effector_length"]}
    row["handle length [mm]"] = 1e3 * columns["handle_length"]
    if rod is not None:
        row |= {"rod": rod.name, "backbone length [mm]": 1e3 * columns["backbone_length"]}
    return row


def described(found: Candidates, number: int) -> str:
    """Return the main parts and lengths of a scale model in one line, by its number."""
    row = _row(found, number)
    return f"r {row['distal radius [mm]']:.4g} mm, l_d {row['end-effector length [mm]']:.4g} mm, {row['rope']}"


def _ranks(values: Array) -> Array:
    """Return the rank of every value from 0 to 1; equal values share the lowest."""
    ordered = np.sort(values)
    places: Array = np.searchsorted(ordered, values) / max(values.size - 1, 1)
    return places
