"""One scale model: its parts, objectives and test loads, and the instrument file that they make."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Any, Literal, NamedTuple, TypeVar

import numpy as np

from tenodesis.control.parameters import tension_limit
from tenodesis.errors import DesignError, InstrumentError
from tenodesis.instrument import Instrument, InstrumentLike, ShortForm, as_short_form
from tenodesis.run import ACROSS, COMPONENTS, Array
from tenodesis.scaling.candidates import Wheel
from tenodesis.scaling.catalogue import Catalogue
from tenodesis.scaling.costs import tip_force
from tenodesis.scaling.parts import Encoder, LoadCell, Rod, Rope, Spool
from tenodesis.scaling.sweep import Sweep
from tenodesis.scaling.transfer import carry_friction
from tenodesis.scaling.weights import WeightSelection, select_weights
from tenodesis.similarity import Comparison, compare
from tenodesis.similarity.parameters import field_of, value_of

_OVER_LARGEST = 1.05
_CELL_OVER_LIMIT = 1.1
_ROPE_OVER_LIMIT = 1.25

_Inst = TypeVar("_Inst", bound=Instrument)

OBJECTIVES = (
    ("similarity error", " deg"),
    ("force resolution", " N"),
    ("overall length", " m"),
    ("tension margin", ""),
)


def shown(value: float) -> str:
    """Return an objective's value as text."""
    return "below 0.001" if value < 1e-3 else f"{value:.4g}"


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

    def __str__(self) -> str:
        named = zip(OBJECTIVES, self, strict=True)
        return ", ".join(f"{name} {shown(value)}{unit}" for (name, unit), value in named)


_PARTS = {"gears": "gear", "pulleys": "pulley", "discs": "set of discs"}


class FittedWheel(NamedTuple):
    """Wheels of one size: where they are, and how many joints turn on them."""

    at: str
    wheel: Wheel
    kind: Literal["gears", "pulleys", "discs"]
    joints: int
    """0 of wheels that only tendons run over."""

    @property
    def part(self) -> str:
        """What it is, and where."""
        return f"{_PARTS[self.kind]}, {self.at}"

    @property
    def pieces(self) -> int:
        """A joint of gears has two of them."""
        return max(self.joints, 1) * (2 if self.kind == "gears" else 1)


class Choice(NamedTuple):
    """The parts a design is made of."""

    distal: Wheel
    proximal: Wheel
    rope: Rope
    rod: Rod | None
    load_cell: LoadCell
    encoder: Encoder | None
    spool: Spool

    @property
    def springs(self) -> tuple[tuple[str, float], ...]:
        """Springs in joints: none."""
        return ()


class TestLoad(NamedTuple):
    """A force on the real-size instrument (N), that on the scaled-up tip (N), and the weights for it."""

    real_force: float
    force: float
    weights: WeightSelection
    error: float
    """Force by the weights minus the wanted force, N on the real-size instrument."""
    direction: str
    """Component of the wrench at the tip, as fx or -fy, or grip_force."""

    @property
    def _component(self) -> tuple[str, float]:
        """Component that it is, and its value with its sign, N."""
        name = self.direction.removeprefix("-")
        return name, self.force if name == self.direction else -self.force

    @property
    def load(self) -> tuple[Array, float]:
        """Wrench (6,), N and N m, and grip force, N, on the scaled-up tip."""
        wrench = np.zeros(6)
        name, newton = self._component
        if name == "grip_force":
            return wrench, newton
        wrench[COMPONENTS.index(name)] = newton
        return wrench, 0.0

    @property
    def applied(self) -> dict[str, Any]:
        """Keys and values of a phase of a protocol under it."""
        name, newton = self._component
        value = f"{newton + 0.0:.9g} N"
        return {name: value} if name == "grip_force" else {"wrench": {name: value}}


@dataclass(frozen=True)
class Design:
    """A scaled-up instrument with its parts, objectives, test loads and resolutions."""

    real_size: ShortForm
    scaled_up: ShortForm
    choice: Choice
    catalogue: Catalogue
    objectives: Objectives
    comparison: Comparison
    tests: tuple[TestLoad, ...]
    largest_tension: float
    """Largest tension over the working range, N."""
    force_resolution: float
    """Resolution of the load cells, N at the real-size tip."""

    @property
    def bench(self) -> ShortForm:
        """The instrument that is tested on the bench: of two axes alike, the first."""
        return self.scaled_up.planar[0]

    @property
    def wheels(self) -> tuple[FittedWheel, ...]:
        """The wheels at both ends."""
        found = []
        for end, wheel in (("distal", self.choice.distal), ("proximal", self.choice.proximal)):
            is_backbone = self.scaled_up.joint_type == "continuum" and end == "distal"
            kind: Literal["gears", "pulleys", "discs"] = (
                "discs" if is_backbone else "pulleys" if wheel.module is None else "gears"
            )
            found.append(FittedWheel(f"{end} joint", wheel, kind, len(self.scaled_up.axes)))
        return tuple(found)

    @property
    def rods(self) -> tuple[tuple[str, Rod], ...]:
        """The rods of backbones, by joint."""
        return () if self.choice.rod is None else tuple((axis, self.choice.rod) for axis in self.scaled_up.axes)

    def built_as(self, inst: ShortForm) -> "Design":
        """Return the design with its instrument as it was built, which differs in its dynamics only."""
        compared = compare(self.real_size, inst, largest_force=self.comparison.largest_force)
        return replace(self, scaled_up=inst, comparison=compared)

    def __repr__(self) -> str:
        return f"<Design of {self.scaled_up.name!r}: {self.objectives}>"


def name_of(real_size: InstrumentLike) -> str:
    """Return the name of an instrument's scale model."""
    real_size = as_short_form(real_size, "real_size")
    return f"{real_size.name[:50]}-scaled-up"


def make(found: Sweep, number: int) -> Design:
    """Return a scale model of a sweep, by its number.

    Raises DesignError if its weights cannot set a test force precisely enough.
    """
    judge = found.judge(found.stages[-1])
    columns = judge.columns(np.array([number]), fine=True)
    values = {name: float(column[0]) for name, column in columns.items()}
    wheels, rope, rod = found.candidates.parts(number)
    choice = Choice(
        *wheels,
        rope,
        rod,
        judge.load_cell(values["largest_tension"]),
        finest_encoder(found.catalogue, values["distal_radius"]),
        judge.spool(number),
    )
    tests = tuple(weights_for(found.catalogue, force, values, found.real_size.axes[0]) for force in found.forces.tests)
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
        float(tip_force(choice.load_cell.resolution, values)),
    )


def finest_encoder(catalogue: Catalogue, radius: float) -> Encoder | None:
    """Return the finest encoder that fits a distal radius, m."""
    fitting = [encoder for encoder in catalogue.encoders if encoder.least_distal_radius <= radius * (1 + 1e-9)]
    return min(fitting, key=lambda one: (one.resolution, one.noise), default=None)


def weights_for(catalogue: Catalogue, force: float, values: Mapping[str, float], axis: str = "yaw") -> TestLoad:
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
            f"{100 * error / force:+.2g} % or {error:+.2g} N on the real-size instrument.",
            key="weights",
            value=error,
            allowed=f"within force_tolerance, {constraints.force_tolerance:g}",
        )
    return TestLoad(force, weights.weight * lever, weights, error, f"-{ACROSS[axis]}")


def _scaled_up(found: Sweep, choice: Choice, values: Mapping[str, float], tests: Sequence[TestLoad]) -> ShortForm:
    real_size, constraints = found.real_size, found.catalogue.constraints
    changes: dict[str, Any] = {
        field: values[parameter] for field, parameter in real_size.parameter_fields.items() if parameter in values
    }
    length = changes.pop("tendon_length")
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
        **of_sensors(choice.load_cell, choice.encoder),
        "drives.spool_radius": choice.spool.radius,
    }
    changes["sources"] = _sources(found, choice, changes)
    try:
        scaled_up = real_size.replace(**changes)
        scaled_up = with_tension_limit(scaled_up, values["largest_tension"])
        return carry_friction(real_size, scaled_up) if real_size.friction.law != "none" else scaled_up
    except InstrumentError as problem:
        raise DesignError(
            f"the scale model is not a valid instrument: {problem}",
            key=problem.key,
            value=problem.value,
            allowed=problem.allowed,
        ) from None


def of_sensors(cell: LoadCell, encoder: Encoder | None) -> dict[str, Any]:
    """Return the keys of an instrument file that its sensors set."""
    counts = 2 * cell.range / cell.resolution
    found = {
        "sensors.load_cell_range": cell.range,
        "sensors.load_cell_bits": min(max(math.ceil(math.log2(counts)), 4), 32),
    }
    if encoder is not None:
        found |= {f"sensors.encoder_{key}": getattr(encoder, key) for key in ("bits", "range", "noise")}
    return found


def with_tension_limit(scaled_up: _Inst, largest: float) -> _Inst:
    """Return an instrument whose controller reaches a plan's largest tension (N), as far as cells and ropes let it."""
    default, wanted = tension_limit(scaled_up), _OVER_LARGEST * largest
    room = min(
        scaled_up.sensors.load_cell_range / _CELL_OVER_LIMIT, (scaled_up.breaking_load or inf) / _ROPE_OVER_LIMIT
    )
    if default >= min(wanted, room):
        return scaled_up
    sources = {**scaled_up.sources, "control.tension_limit": "5 % above the plan's largest tension"}
    return scaled_up.replace(**{"control.tension_limit": min(wanted, room), "sources": sources})


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
