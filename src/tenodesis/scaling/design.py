"""Scale models: a design with its parts, objectives and test loads, and the Pareto front of designs."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple, TypeAlias, get_args, overload

import numpy as np
from numpy.typing import NDArray

from tenodesis import notebook
from tenodesis.errors import ArgumentError, DesignError, InstrumentError
from tenodesis.instrument import Instrument, InstrumentLike, as_instrument
from tenodesis.run import Array
from tenodesis.scaling import catalogue as catalogues
from tenodesis.scaling.candidates import COMBINATIONS, Candidates, Wheel
from tenodesis.scaling.catalogue import Catalogue
from tenodesis.scaling.costs import tip_force
from tenodesis.scaling.limits import limits
from tenodesis.scaling.parts import Encoder, LoadCell, Rod, Rope, Spool
from tenodesis.scaling.pins import narrowed, parse
from tenodesis.scaling.sweep import ERROR_STEP, RELATIVE_STEP, Progress, Sweep, exact_costs, sweep
from tenodesis.scaling.transfer_friction import carry_friction
from tenodesis.scaling.weights import WeightSelection, select_weights
from tenodesis.similarity import Comparison, compare
from tenodesis.similarity.parameters import field_of, value_of

Preference: TypeAlias = Literal["similarity", "resolution", "size", "margin", "balanced"]
PREFERENCES: tuple[Preference, ...] = get_args(Preference)

ObjectiveName: TypeAlias = Literal["similarity_error", "force_resolution", "overall_length", "tension_margin"]
Selection: TypeAlias = slice | Sequence[int] | Sequence[bool] | NDArray[np.integer] | NDArray[np.bool_]
"""Some designs of a front: a slice, indices, or a mask."""

_MOST_ROWS = 10
"""Designs of a front that notebooks show."""
SIMILAR_ENOUGH = 0.1
"""Similarity error, deg, below which designs count as equal."""


YIELD = 0.1
"""Share of the other objectives that may be given up to improve an objective."""


class Objectives(NamedTuple):
    """Objectives of a design; for the tension margin larger is better, for the others smaller is better."""

    similarity_error: float
    """Largest error over the working range, without friction, deg; a tip that snaps through counts as at its stop."""
    force_resolution: float
    """Smallest force on the real-size instrument, N, that weights can set and load cells can resolve."""
    overall_length: float
    """Length, m."""
    tension_margin: float
    """Breaking load over the largest tension."""

    @classmethod
    def of_costs(cls, costs: Array) -> "Objectives":
        """Return the objectives of costs as in :class:`Sweep`, shape (4,)."""
        error, resolution, length, inverse = costs.tolist()
        return cls(error, resolution, length, 1 / inverse)

    @property
    def costs(self) -> Array:
        """Their costs as in :class:`Sweep`, shape (4,)."""
        return np.array([*self[:3], 1 / self.tension_margin])


class Rival(NamedTuple):
    """A scale model that is at least as good in every objective."""

    objectives: Objectives
    made_of: str


class Choice(NamedTuple):
    """The parts a design is made of."""

    distal: Wheel
    proximal: Wheel
    rope: Rope
    rod: Rod | None
    load_cell: LoadCell
    encoder: Encoder | None
    spool: Spool


class TestLoad(NamedTuple):
    """A force on the real-size instrument (N), that on the scaled-up tip (N), and the weights for it."""

    real_force: float
    force: float
    weights: WeightSelection
    error: float
    """Force by the weights minus the wanted force, N on the real-size instrument."""


@dataclass(frozen=True)
class Design:
    """A scaled-up instrument with its parts, objectives, test loads and resolutions."""

    real_size: Instrument
    scaled_up: Instrument
    choice: Choice
    catalogue: Catalogue
    objectives: Objectives
    comparison: Comparison
    tests: tuple[TestLoad, ...]
    largest_tension: float
    """Largest tension over the working range, N."""
    angle_resolution: float
    """Resolution of the distal encoder, deg, the same for both instruments."""
    tension_resolution: float
    """Resolution of the load cells, N of real-size tension."""
    force_resolution: float
    """Resolution of the load cells, N at the real-size tip."""

    def __repr__(self) -> str:
        return f"<Design of {self.scaled_up.name!r}: {_in_words(self.objectives)}>"


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
            return _design(self.sweep, int(self.sweep.numbers[index]))
        rows = self._rows(index)
        return Front(replace(self.sweep, numbers=self.sweep.numbers[rows], costs=self.sweep.costs[rows]))

    def __iter__(self) -> Iterator[Design]:
        return (self[index] for index in range(len(self)))

    def __repr__(self) -> str:
        return f"<Front of {self._size}>"

    def _repr_html_(self) -> str:
        """Return a table for notebooks: objectives and main parts of the first designs."""
        rows = [
            (str(index), *(_shown(value) for value in one), self.described(index))
            for index, one in enumerate(self.objectives[:_MOST_ROWS])
        ]
        headings = ("design", *(f"{name}{f' [{unit.strip()}]' if unit else ''}" for name, unit in _OBJECTIVES), "parts")
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
    def real_size(self) -> Instrument:
        """The real-size instrument."""
        return self.sweep.real_size

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

    def ranked(self, prefer: Preference = "similarity") -> list[int]:
        """Return the indices of the designs that are best in the preferred objective, sorted by the others.

        Designs within 0.1 deg, or 1 %, of the best value count as best. Of these, or for "balanced" of all, the first
        is the one whose worst rank in all objectives is best. Raises ValueError if the preference is unknown.
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
        order: list[int] = np.flatnonzero(good)[np.lexsort((ranks.sum(axis=1), ranks.max(axis=1)))].tolist()
        return order

    def best(self, prefer: Preference = "similarity") -> int:
        """Return the index of the first design of :meth:`ranked`."""
        return self.ranked(prefer)[0]

    def described(self, index: int) -> str:
        """Return the main parts and lengths of a design in one line."""
        return _described(self.sweep.candidates, int(self.sweep.numbers[index]))

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
                made_of = _described(stage.candidates, int(stage.feasible[possible][row]))
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
    real_size = as_instrument(real_size, "real_size")
    if isinstance(combinations, bool) or not isinstance(combinations, int) or not 1 <= combinations <= 10**9:
        raise ArgumentError(key="combinations", value=combinations, allowed="an integer from 1 to 10**9")
    given = parse(pins or {})
    parts = narrowed(catalogues.load() if catalogue is None else catalogue, given)
    return Front(sweep(real_size.planar[0], parts, given, combinations=combinations, progress=progress))


def name_of(real_size: InstrumentLike) -> str:
    """Return the name of an instrument's scale model."""
    real_size = as_instrument(real_size, "real_size")
    return f"{real_size.name[:50]}-scaled-up"


_OBJECTIVES = (
    ("similarity error", " deg"),
    ("force resolution", " N"),
    ("overall length", " m"),
    ("tension margin", ""),
)


def rivals_text(front: Front, objectives: Objectives) -> str:
    """Return, as the end of a sentence, by how much other scale models are better."""
    rivals = front.rivals(objectives)
    if not rivals:
        return f"no scale model beats this one in everything: it is on the front. {_trades(front, objectives)}"
    best = rivals[0]
    gains = ", ".join(
        f"{name} {_shown(other)} instead of {_shown(own)}{unit}"
        for (name, unit), other, own in zip(_OBJECTIVES, best.objectives, objectives, strict=True)
    )
    count = f"{len(rivals)} scale models are" if rivals[1:] else "one scale model is"
    return (
        f"{count} as good or better in everything; the most similar one has {gains} ({best.made_of}). "
        f"{_trades(front, objectives)}"
    )


def _in_words(objectives: Objectives) -> str:
    named = zip(_OBJECTIVES, objectives, strict=True)
    return ", ".join(f"{name} {_shown(value)}{unit}" for (name, unit), value in named)


def _shown(value: float) -> str:
    return "below 0.001" if value < 1e-3 else f"{value:.4g}"


def _trades(front: Front, objectives: Objectives) -> str:
    """Return in words how good each objective can be on the front if the others may be slightly worse."""
    costs = objectives.costs
    gains = []
    for column, (name, unit) in enumerate(_OBJECTIVES):
        others = [n for n in range(4) if n != column]
        within = (front.sweep.costs[:, others] <= costs[others] * (1 + YIELD)).all(axis=1)
        best = front.sweep.costs[within, column].min(initial=costs[column])
        resolution = ERROR_STEP if column == 0 else costs[column] * RELATIVE_STEP
        if best < costs[column] - resolution:
            value, own = (1 / one if column == 3 else one for one in (best, costs[column]))
            gains.append(f"{name} {_shown(value)} instead of {_shown(own)}{unit}")
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


def _described(found: Candidates, number: int) -> str:
    row = _row(found, number)
    return f"r {row['distal radius [mm]']:.4g} mm, l_d {row['end-effector length [mm]']:.4g} mm, {row['rope']}"


def _ranks(values: Array) -> Array:
    """Return the rank of every value from 0 to 1; equal values share the lowest."""
    ordered = np.sort(values)
    places: Array = np.searchsorted(ordered, values) / max(values.size - 1, 1)
    return places


def _design(found: Sweep, number: int) -> Design:
    judge = found.judge(found.stages[-1])
    columns = judge.columns(np.array([number]), fine=True)
    values = {name: float(column[0]) for name, column in columns.items()}
    wheels, rope, rod = found.candidates.parts(number)
    choice = Choice(
        *wheels,
        rope,
        rod,
        judge.load_cell(values["largest_tension"]),
        _encoder(found.catalogue, values["distal_radius"]),
        judge.spool(number),
    )
    tests = tuple(weights_for(found.catalogue, force, values) for force in found.forces.tests)
    scaled_up = _scaled_up(found, choice, values, tests)
    comparison = compare(found.real_size, scaled_up, largest_force=found.forces.largest)
    return Design(
        found.real_size,
        scaled_up,
        choice,
        found.catalogue,
        Objectives.of_costs(judge.costs(columns)[0]),
        comparison,
        tests,
        values["largest_tension"],
        math.degrees(scaled_up.sensors.encoder_range / 2**scaled_up.sensors.encoder_bits),
        choice.load_cell.resolution / comparison.tension_factor,
        float(tip_force(choice.load_cell.resolution, values)),
    )


def _encoder(catalogue: Catalogue, radius: float) -> Encoder | None:
    """Return the finest encoder that fits."""
    fitting = [encoder for encoder in catalogue.encoders if encoder.least_distal_radius <= radius * (1 + 1e-9)]
    return min(fitting, key=lambda one: (one.range / 2**one.bits, one.noise), default=None)


def weights_for(catalogue: Catalogue, force: float, values: Mapping[str, float]) -> TestLoad:
    """Return the weights for a force (N) on the real-size instrument, from the rig arm (m) and force factor by name.

    Raises DesignError, which names the closest set, if the weights do not come close enough.
    """
    constraints = catalogue.constraints
    lever = constraints.cable_pulley_radius / values["rig_arm"]
    wanted = force * values["force_factor"]
    weights = select_weights(wanted / lever, catalogue.weights, cable_mass=constraints.cable_mass)
    error = weights.error * lever / values["force_factor"]
    if abs(error) > constraints.force_tolerance * force:
        raise DesignError(
            f"the weights of catalogue {catalogue.name} cannot set {force:g} N on the real-size instrument to "
            f"force_tolerance = {100 * constraints.force_tolerance:g} %: the nearest is {weights.sentence}, "
            f"{100 * error / force:+.2g} % or {error:+.2g} N on the real-size instrument."
        )
    return TestLoad(force, weights.weight * lever, weights, error)


def _scaled_up(found: Sweep, choice: Choice, values: Mapping[str, float], tests: Sequence[TestLoad]) -> Instrument:
    real_size, constraints = found.real_size, found.catalogue.constraints
    changes: dict[str, Any] = {
        field: values[parameter] for field, parameter in real_size.parameter_fields.items() if parameter in values
    }
    length = changes.pop("tendon_length")
    counts = 2 * choice.load_cell.range / choice.load_cell.resolution
    factor = values["distal_radius"] / value_of(real_size, "distal_radius")
    changes |= {
        "name": name_of(real_size),
        "description": f"Scale model of {real_size.name}, distal radius times {factor:.4g}"[:200],
        "overall_length": length,
        "tendon_length": None,
        "tendon_stiffness": None,
        "stem_diameter": real_size.stem_diameter and real_size.stem_diameter * factor,
        "pretension": values["pretension"],
        "breaking_load": choice.rope.breaking_load,
        "overrides": None,
        "dynamics": None,
        "mismatch": None,
        "control": None,
        "conditions": {
            "forces": tuple(test.force for test in tests if test.force > 0),
            "cycles": real_size.conditions.cycles,
            "sampling_rate": real_size.conditions.sampling_rate,
            "cable_pulley_radius": constraints.cable_pulley_radius,
        },
        "sensors.load_cell_range": choice.load_cell.range,
        "sensors.load_cell_bits": min(max(math.ceil(math.log2(counts)), 4), 32),
    }
    if choice.encoder is not None:
        changes |= {
            "sensors.encoder_bits": choice.encoder.bits,
            "sensors.encoder_range": choice.encoder.range,
            "sensors.encoder_noise": choice.encoder.noise,
        }
    changes["drives.spool_radius"] = choice.spool.radius
    changes["sources"] = _sources(found, choice, changes)
    try:
        scaled_up = real_size.replace(**changes)
        return carry_friction(real_size, scaled_up) if real_size.friction.law != "none" else scaled_up
    except InstrumentError as problem:
        raise DesignError(f"the scale model is not a valid instrument: {problem}") from None


def _sources(found: Sweep, choice: Choice, changes: Mapping[str, Any]) -> dict[str, str]:
    real_size, name = found.real_size, found.catalogue.name
    sources = {
        field_of(real_size, "distal_radius"): _made_of(choice.distal),
        field_of(real_size, "proximal_radius"): _made_of(choice.proximal),
        "tendon_diameter": choice.rope.name,
        "tendon_modulus": f"{choice.rope.name}: {choice.rope.source}",
        "breaking_load": f"{choice.rope.name}: {choice.rope.source}",
        "pretension": "as pinned" if not math.isnan(found.candidates.pretension) else "scaled by k r",
        "overall_length": f"tenodesis scale, catalogue {name}",
        "end_effector_length": f"tenodesis scale, catalogue {name}",
        "handle_length": f"tenodesis scale, catalogue {name}",
        "conditions.forces": "equal loss of dexterity, as set by the weights",
        "conditions.cable_pulley_radius": f"catalogue {name}",
        "output_range": f"as {real_size.name}",
        "handle_range": f"as {real_size.name}",
        "sensors.load_cell_range": f"{choice.load_cell.name}: {choice.load_cell.source}",
    }
    if choice.rod is not None:
        sources["backbone_rigidity"] = f"{choice.rod.name}: {choice.rod.source}"
        sources["backbone_length"] = "scaled by r"
    if choice.encoder is not None:
        sources["sensors.encoder_bits"] = f"{choice.encoder.name}: {choice.encoder.source}"
    if changes["stem_diameter"]:
        sources["stem_diameter"] = "scaled by r"
    return sources


def _made_of(wheel: Wheel) -> str:
    return "pulley" if wheel.module is None else f"module {1e3 * wheel.module:g} mm, {wheel.teeth} teeth"
