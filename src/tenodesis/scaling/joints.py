"""Scale models of instruments of several joints: made similar by dimensions, then built from stock parts."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from tenodesis import statics
from tenodesis.errors import ArgumentError, DesignError, InstrumentError, NoSolutionError
from tenodesis.instrument import Crossing, FullForm, InstrumentLike, expanded
from tenodesis.run import Array
from tenodesis.scaling import catalogue as catalogues
from tenodesis.scaling.candidates import Wheel, gear_wheels, makeable
from tenodesis.scaling.catalogue import Catalogue, narrowed, parse_pins, same
from tenodesis.scaling.costs import Limit, LoadCells, Tally, finest_difference, nearest_spool, of_tension
from tenodesis.scaling.design import PREFERENCES, Preference
from tenodesis.scaling.parts import Encoder, LoadCell, Rod, Rope, Spool
from tenodesis.scaling.scale_model import (
    FittedWheel,
    Objectives,
    TestLoad,
    finest_encoder,
    of_sensors,
    with_tension_limit,
)
from tenodesis.scaling.sweep import Progress, levels, nondominated
from tenodesis.scaling.weights import select_weights
from tenodesis.similarity.joints import JointComparison, JointError, compare_joints
from tenodesis.statics import UsualLoad
from tenodesis.units import STANDARD_GRAVITY, quantity_of

LENGTHS = 24
"""Lengths of the tendons that are judged with each rope and each set of wheels."""
_NEAREST = 2
"""Wheels in stock that are judged for each radius, where the catalogue's are not turned to size."""
_MOST_WHEELS = 64
"""Sets of wheels that are judged for each factor."""
_FACTORS = 1.0, 20.0
"""Of length, where none is asked for."""
_LONGEST = (0.3, 1.5)
"""Overall length where no constraint bounds it, m."""
_OF_LOADS = (0.5, 1.0)
"""Shares of the loads of the working range that are test loads."""
_PAST = 0.02
"""Share of a joint's radius up to which a tendon's arm is a rounding of none."""
_PINS = ("factor", "overall_length", "rope", "load_cell", "spool_radius", "tendon_diameter")

# Exponents of length, stiffness and time.
_EXPONENTS: Mapping[str, tuple[int, int, int]] = {
    "m": (1, 0, 0),
    "N": (1, 1, 0),
    "N/m": (0, 1, 0),
    "N*m": (2, 1, 0),
    "N*m^2": (3, 1, 0),
    "N*s/m": (0, 1, 1),
    "N*m*s": (2, 1, 1),
    "kg": (0, 1, 2),
    "kg*m^2": (2, 1, 2),
    "s": (0, 0, 1),
    "Hz": (0, 0, -1),
    "m/s": (1, 0, -1),
}
_SCALED = ("joints", "tendons", "grip", "friction", "dynamics", "geometry", "conditions")
"""Tables that are scaled; drives, sensors and limits are those of the bench."""
_OF_ROPE = ("tendon_diameter", "tendon_modulus", "tendon_length", "breaking_load")
_OF_BENCH = ("control", "devices", "sources", "drives")
_SAME = 1e-9
_HAND = ("hand_stiffness", "hand_damping", "hand_inertia")


def enlarged(inst: InstrumentLike, length: float, stiffness: float) -> FullForm:
    """Return an instrument with all lengths and all stiffnesses of tendons times a factor each, exactly similar.

    Forces get the factor of length times that of stiffness, moments the square of the former besides; links of the same
    material are heavier by the cube of the length, from which the factor of time follows. Drives, sensors and limits
    stay as they are by default.
    """
    inst = expanded(inst)
    by = (length, stiffness, math.sqrt(length**3 / stiffness))
    values: dict[str, Any] = dict.fromkeys(_OF_ROPE + _OF_BENCH)
    values |= {
        "name": f"{inst.name[:50]}-scaled-up",
        "description": f"Scale model of {inst.name}, lengths times {length:.4g}"[:200],
    }
    for key in ("stem_diameter", "stem_length", "spool_radius", "tendon_length", "pretension"):
        if getattr(inst, key) is not None:
            values[key] = getattr(inst, key) * _factor("N" if key == "pretension" else "m", by)
    for name in _SCALED:
        given = inst.as_given(name)
        if isinstance(given, tuple):
            values[name] = [_times(one, by) for one in given]
        elif given is not None:
            values[name] = _times(given, by)
    values["dynamics"].setdefault("natural_frequency", inst.dynamics.natural_frequency / by[2])
    stiffnesses = inst.stiffnesses * stiffness
    values["tendon_stiffness"] = float(stiffnesses[0])
    for table, tendon, own in zip(values["tendons"], inst.as_given("tendons"), stiffnesses, strict=True):
        table.pop("stiffness", None)
        alike = tendon.length is None and math.isclose(own, stiffnesses[0], rel_tol=_SAME)
        if tendon.stiffness_by_tension is None and not alike:
            table["stiffness"] = float(own)
    return inst.replace(**values)


def _factor(unit: str, by: tuple[float, float, float]) -> float:
    exponents = _EXPONENTS.get(unit, (0, 0, 0))
    return math.prod(base**exponent for base, exponent in zip(by, exponents, strict=True))


def _times(table: BaseModel, by: tuple[float, float, float]) -> dict[str, Any]:
    """Return the given values of a table, in SI, with each times the factor of its dimension."""
    values: dict[str, Any] = {}
    for name, field in type(table).model_fields.items():
        value = getattr(table, name)
        if value is None or name not in table.model_fields_set:
            continue
        quantity = quantity_of(field)
        key = field.alias or name
        if isinstance(value, BaseModel):
            values[key] = _times(value, by)
        elif isinstance(value, tuple) and value and isinstance(value[0], BaseModel):
            values[key] = [_times(one, by) for one in value]
        elif quantity is None or name in _HAND:
            values[key] = value
        else:
            factor = _factor(quantity.unit, by)
            values[key] = [one * factor for one in value] if isinstance(value, tuple) else value * factor
    return values


class WheelSet(NamedTuple):
    """The wheels of a scale model."""

    factor: float
    """Of length."""
    radii: tuple[float, ...]
    """By the distinct radii of the real-size instrument, m."""
    to_size: bool
    """Whether pulleys that stock lacks are turned to size."""
    error: float = math.nan
    """Largest over the working range without friction, deg, once it is judged."""


class JointChoice(NamedTuple):
    """The parts that a design is made of."""

    wheels: tuple[FittedWheel, ...]
    to_size: bool
    rope: Rope
    rods: tuple[tuple[str, Rod], ...]
    """By backbone."""
    springs: tuple[tuple[str, float], ...]
    """Stiffness of the springs in joints, N m/rad, which no catalogue has: to be made."""
    load_cell: LoadCell
    encoder: Encoder | None
    spool: Spool


@dataclass(frozen=True)
class JointDesign:
    """A scaled-up instrument of several joints with its parts and objectives."""

    real_size: FullForm
    scaled_up: FullForm
    choice: JointChoice
    catalogue: Catalogue
    objectives: Objectives
    largest_tension: float
    """Largest tension over the working range, N."""

    @cached_property
    def comparison(self) -> JointComparison:
        """Both instruments, with the loads of the working range."""
        return compare_joints(self.real_size, self.scaled_up)

    @property
    def bench(self) -> FullForm:
        """The instrument that is tested on the bench."""
        return self.scaled_up

    @property
    def wheels(self) -> tuple[FittedWheel, ...]:
        """The wheels of all sizes."""
        return self.choice.wheels

    @property
    def rods(self) -> tuple[tuple[str, Rod], ...]:
        """The rods of backbones, by joint."""
        return self.choice.rods

    @cached_property
    def tests(self) -> tuple[TestLoad, ...]:
        """Every load of the working range, and its half, by weights on two cables that pull at the tip."""
        factors, cable = self.comparison.factors, self.catalogue.constraints.cable_mass
        found = []
        for load in self.comparison.loads:
            of_jaws = not load.wrench.any()
            factor = factors["grip_force" if of_jaws else "force"]
            sign = "-" if load.wrench.sum() < 0 else ""
            for share in _OF_LOADS:
                force = share * load.size
                weights = select_weights(force * factor, self.catalogue.weights, cable_mass=cable)
                direction = "grip_force" if of_jaws else f"{sign}f{load.name}"
                found.append(TestLoad(force, weights.weight, weights, weights.error / factor, direction))
        return tuple(found)

    @cached_property
    def error(self) -> JointError:
        """As designed, without friction."""
        return self.comparison.error(pretensions=self.scaled_up.pretensions)

    @cached_property
    def error_at_rest(self) -> JointError:
        """As designed, with friction at rest."""
        return self.comparison.error_at_rest(pretensions=self.scaled_up.pretensions)

    def __repr__(self) -> str:
        return f"<JointDesign of {self.scaled_up.name!r}: {self.objectives}>"


@dataclass(frozen=True)
class JointFront:
    """The Pareto front of scale models, sorted by their similarity error."""

    real_size: FullForm
    catalogue: Catalogue
    sets: tuple[WheelSet, ...]
    rods: tuple[Rod, ...]
    rows: NDArray[np.int64]
    """Set of wheels, rope and rod of the designs on the front, (designs, 3)."""
    stiffness: Array
    """Factor of the tendons' stiffness, (designs,)."""
    costs: Array
    """As :attr:`tenodesis.scaling.Objectives.costs`, (designs, 4)."""
    tensions: Array
    """Largest over the working range, (designs,), N."""
    examined: int
    """Number of scale models judged."""
    feasible: int
    """Number of those that met every constraint."""

    def __len__(self) -> int:
        return len(self.rows)

    def __repr__(self) -> str:
        return f"<JointFront of {len(self)} designs for {self.real_size.name!r}, of {self.examined} judged>"

    @cached_property
    def objectives(self) -> tuple[Objectives, ...]:
        """The objectives of every design."""
        return tuple(Objectives.of_costs(row) for row in self.costs)

    def ranked(self, prefer: Preference = "similarity") -> list[int]:
        """Return the indices of the designs, the best by a preference first.

        Of equal ones, the first has the least tension times length over the factor: a larger one is less sensitive.

        Raises ValueError if the preference is unknown.
        """
        if prefer not in PREFERENCES:
            raise ArgumentError(key="prefer", value=prefer, allowed=f"one of {', '.join(PREFERENCES)}")
        ranks = np.argsort(np.argsort(levels(self.costs), axis=0, kind="stable"), axis=0)
        first = ranks.max(axis=1) if prefer == "balanced" else levels(self.costs)[:, PREFERENCES.index(prefer)]
        factors = np.array([self.sets[row[0]].factor for row in self.rows])
        return [int(n) for n in np.lexsort((self.tensions * self.costs[:, 2] / factors, first))]

    def best(self, prefer: Preference = "similarity") -> int:
        """Return the index of the first design of :meth:`ranked`."""
        return self.ranked(prefer)[0]

    def described(self, index: int) -> str:
        """Return the main parts of a design in one line."""
        wheels, rope, _ = self.rows[index]
        one = self.sets[wheels]
        made = "to size" if one.to_size else "in stock"
        return f"x {one.factor:.4g}, wheels {made}, {self.catalogue.ropes[rope].name}"

    def __getitem__(self, index: int) -> JointDesign:
        wheels, rope, rod = self.rows[index]
        return _built(self, index, self.sets[wheels], self.catalogue.ropes[rope], self.rods[rod] if self.rods else None)

    @property
    def in_stock(self) -> WheelSet | None:
        """The most similar set of wheels of those that are all in stock; None if there is none."""
        return min((one for one in self.sets if not one.to_size), key=lambda one: one.error, default=None)

    def table(self) -> dict[str, list[Any]]:
        """Return objectives and parts of all designs, by column."""
        found: dict[str, list[Any]] = {
            "similarity error [deg]": [one.similarity_error for one in self.objectives],
            "force resolution [N real-size]": [one.force_resolution for one in self.objectives],
            "overall length [mm]": [1e3 * one.overall_length for one in self.objectives],
            "tension margin": [one.tension_margin for one in self.objectives],
            "factor": [self.sets[row[0]].factor for row in self.rows],
            "wheels": ["to size" if self.sets[row[0]].to_size else "in stock" for row in self.rows],
            "rope": [self.catalogue.ropes[row[1]].name for row in self.rows],
        }
        if self.rods:
            found["rod"] = [self.rods[row[2]].name for row in self.rows]
        return found


def design_joints(
    real_size: InstrumentLike,
    catalogue: Catalogue | None = None,
    *,
    pins: Mapping[str, Any] | None = None,
    progress: Progress = lambda *_: None,
) -> JointFront:
    """Find the Pareto front of scale models of an instrument of several joints, sorted by their similarity error.

    All that follows from dimensions is exact: link lengths, pretensions, springs and loads. Judged are sets of wheels
    in stock about each factor, and to size where the catalogue has these, each by the statics without friction over the
    working range of :class:`tenodesis.similarity.JointComparison`; ropes and the tendons' lengths, or ropes and rods of
    backbones, which set the factor of stiffness.

    Parameters
    ----------
    real_size
        The real-size instrument.
    catalogue
        Parts and constraints; by default the standard catalogue.
    pins
        Fixed choices: factor, overall_length, rope, tendon_diameter, load_cell, spool_radius.
    progress
        Called with the name of the step, the amount done and the total.

    Raises
    ------
    DesignError
        A pin is not one of these or names no part, or no scale model meets the constraints.
    """
    real = expanded(real_size)
    given = parse_pins(pins or {})
    for key in given:
        if key not in _PINS:
            raise DesignError(
                f"{key} cannot be pinned for {real.name}; keys that can are {', '.join(_PINS)}.",
                key=key,
                allowed=", ".join(_PINS),
            )
    parts = narrowed(catalogues.load() if catalogue is None else catalogue, given)
    for kind in ("ropes", "load_cells", "spools", "weights"):
        if not getattr(parts, kind):
            raise DesignError(f"catalogue {parts.name} has no {kind.replace('_', ' ')}.", key=kind)
    return _JointSearch(real, parts).front(progress)


class _JointSearch:
    """What is judged of the scale models of an instrument."""

    def __init__(self, real: FullForm, catalogue: Catalogue) -> None:
        self.real, self.catalogue = real, catalogue
        self.sizes = _sizes(real)
        self.backbones = [
            joint for joint in real.as_given("joints") if joint.backbone_rigidity and joint.place == "tip"
        ]
        self.rods: tuple[Rod, ...] = catalogue.rods if self.backbones else ()
        if self.backbones and not self.rods:
            raise DesignError(f"catalogue {catalogue.name} has no rods, which {real.name} needs.", key="rods")
        self.own = compare_joints(real, real)
        states = self.own.states
        equilibrium = statics.chain.equilibrium(
            real,
            states.handle[:, np.newaxis] if states.handle.shape[1] else 0.0,
            states.wrench,
            grip_force=states.grip_force,
            strokes=states.strokes[:, np.newaxis],
        )
        self.largest_tension = float(np.nanmax(np.asarray(equilibrium.tensions)))
        self.tension_per_force = _tension_per_force(real, self.own.loads)

    def front(self, progress: Progress) -> JointFront:
        """Return the Pareto front of all that meet the constraints."""
        sets, forces = self._wheels(progress)
        errors = np.array([one.error for one in sets])
        limits = self.catalogue.constraints
        ropes = self.catalogue.ropes
        factor = np.array([one.factor for one in sets])
        area = np.array([rope.rigidity for rope in ropes])
        softest = float(self.real.stiffnesses.min())
        if self.rods:
            rigidity = np.array([rod.rigidity for rod in self.rods])
            own = self.backbones[0].backbone_rigidity or math.nan
            stiffness = rigidity / (factor[:, np.newaxis, np.newaxis] ** 3 * own)
            stiffness = np.broadcast_to(stiffness, (len(sets), len(ropes), len(self.rods)))
            length = area[:, np.newaxis] / (stiffness * softest)
        else:
            least, most = limits.overall_length or _LONGEST
            lengths = np.unique(np.geomspace(least, most, LENGTHS))
            stiffness = area[:, np.newaxis] / (lengths * softest) * np.ones((len(sets), 1, 1))
            length = np.broadcast_to(lengths, stiffness.shape)
        shape = stiffness.shape
        by_set = (slice(None), np.newaxis, np.newaxis)
        tension = self.largest_tension * stiffness * factor[by_set]
        breaking = np.array([rope.breaking_load for rope in ropes])[:, np.newaxis]
        resolution = LoadCells(self.catalogue).resolution(tension)
        own_spool = self.real.own_drives.spool_radius
        spool = np.array([nearest_spool(self.catalogue, own_spool * one.factor).radius for one in sets])
        step = finest_difference(self.catalogue) * STANDARD_GRAVITY
        columns = {
            "largest_error": np.radians(errors[by_set]),
            "tendon_length": length,
            "largest_tension": tension,
            "breaking_load": breaking,
            "spool_radius": spool[by_set],
        }
        costs = np.stack(
            [
                np.broadcast_to(errors[by_set], shape),
                np.maximum(
                    step / (forces[by_set] * stiffness),
                    resolution / (self.tension_per_force * stiffness * factor[by_set]),
                ),
                length,
                tension / breaking,
            ],
            axis=-1,
        )
        tally = Tally((*of_tension(self.catalogue), *_of_length(limits.overall_length)))
        met = tally.feasible({name: np.broadcast_to(one, shape).ravel() for name, one in columns.items()}).reshape(
            shape
        )
        if not met.any():
            raise tally.contradiction()
        rows = np.argwhere(met)
        kept = nondominated(levels(costs[met]))
        kept = kept[np.argsort(costs[met][kept, 0], kind="stable")]
        return JointFront(
            self.real,
            self.catalogue,
            sets,
            self.rods,
            rows[kept],
            stiffness[met][kept],
            costs[met][kept],
            tension[met][kept],
            met.size,
            int(met.sum()),
        )

    def _wheels(self, progress: Progress) -> tuple[tuple[WheelSet, ...], Array]:
        """Return sets of wheels within the constraints, judged, and their factors of force by that of stiffness."""
        sets, forces = [], []
        low, high = self.catalogue.constraints.factor or _FACTORS
        wanted = list(self._sets(low, high))
        for done, one in enumerate(wanted):
            progress("judging wheels", done, len(wanted))
            if (judged := self._judged(one)) is not None:
                sets.append(judged[0])
                forces.append(judged[1])
        progress("judging wheels", len(wanted), len(wanted))
        if not sets:
            raise self._no_wheels(low, high)
        return tuple(sets), np.array(forces)

    def _judged(self, one: WheelSet) -> tuple[WheelSet, float] | None:
        """Return a set with its error, and its factor of force by that of stiffness; None if it makes no model."""
        try:
            model = with_wheels(enlarged(self.real, one.factor, 1.0), self.real, one)
            pair = compare_joints(self.own.working, model)
            error = pair.error()
        except (InstrumentError, NoSolutionError, ArgumentError):
            return None
        if error.unsolved > self.own_unsolved:
            return None
        return one._replace(error=float(error.largest.max())), pair.factors["force"]

    def _no_wheels(self, low: float, high: float) -> DesignError:
        """Return the error that no factor from low to high has wheels, with the nearest factors that have."""
        middle = math.sqrt(low * high)
        others = sorted(self._sets(*_FACTORS), key=lambda one: abs(math.log(one.factor / middle)))
        sides = ([one for one in others if (one.factor < middle) == below] for below in (True, False))
        near = [next((one.factor for one in side if self._judged(one) is not None), None) for side in sides]
        found = " and ".join(f"{one:.4g}" for one in near if one is not None)
        why = f"its radii are {', '.join(f'{1e3 * one.radius:.4g} mm' for one in self.sizes)}"
        if (limits := self.catalogue.constraints.end_effector_length) and not self._lengths_fit(middle):
            why = f"the end-effector must be {1e3 * limits[0]:g} to {1e3 * limits[1]:g} mm long"
        asked = f"{low:g} to {high:g}" if high > low else f"{low:g}"
        return DesignError(
            f"no wheels of catalogue {self.catalogue.name} make a scale model of {self.real.name} with a factor of "
            f"{asked}: {why}; the nearest factors with wheels: {found or 'none'}.",
            key="factor",
            value=(low, high),
            allowed=found,
        )

    @cached_property
    def own_unsolved(self) -> float:
        """Share of the working points that the real-size instrument itself does not hold."""
        return self.own.error().unsolved + 0.02

    def _sets(self, low: float, high: float) -> Iterator[WheelSet]:
        """Yield sets of wheels: about each factor, from low to high, with which a wheel is in stock, and to size."""
        limits = self.catalogue.constraints
        stock = {kind: _stock(self.catalogue, kind) for kind in {size.kind for size in self.sizes}}
        for kind, radii in stock.items():
            if not len(radii):
                raise DesignError(
                    f"catalogue {self.catalogue.name} has no {kind}, which {self.real.name} needs.", key=kind
                )
        to_size = any(size.kind == "pulleys" for size in self.sizes) and any(
            one.to_size for one in self.catalogue.pulleys
        )
        factors = sorted({radius / size.radius for size in self.sizes for radius in stock[size.kind]})
        if low == high:
            factors = [low]
        bed = min(limits.print_bed or (math.inf,)) / 2
        for factor in factors:
            sizes = [factor * size.radius for size in self.sizes]
            if not (
                low * (1 - _SAME) <= factor <= high * (1 + _SAME) and self._lengths_fit(factor) and max(sizes) <= bed
            ):
                continue
            near = []
            for size, wanted in zip(self.sizes, sizes, strict=True):
                ordered = stock[size.kind][np.argsort(np.abs(np.log(stock[size.kind] / wanted)), kind="stable")]
                if size.kind == "gears":
                    ordered = ordered[np.abs(ordered / wanted - 1) <= limits.ratio_tolerance][:1]
                near.append(ordered[:_NEAREST])
            if not all(len(ordered) for ordered in near):
                continue
            if to_size:
                kinds = [size.kind == "gears" for size in self.sizes]
                exact = (ordered[0] if gear else one for gear, ordered, one in zip(kinds, near, sizes, strict=True))
                yield WheelSet(factor, tuple(map(float, exact)), to_size=True)
            for chosen in itertools.islice(itertools.product(*near), _MOST_WHEELS):
                yield WheelSet(factor, tuple(map(float, chosen)), to_size=False)

    def _lengths_fit(self, factor: float) -> bool:
        limits = self.catalogue.constraints.end_effector_length
        ends = [joint.end_effector_length for joint in self.real.tip_joints if joint.end_effector_length]
        low, high = limits or (0.0, math.inf)
        return all(low * (1 - _SAME) <= factor * one <= high * (1 + _SAME) for one in ends)


class _Size(NamedTuple):
    kind: str
    radius: float


def _sizes(inst: FullForm) -> list[_Size]:
    """Return the distinct wheels of an instrument, that of the first joint at its tip first."""
    found: dict[_Size, None] = {}
    joints = sorted(inst.as_given("joints"), key=lambda joint: joint.place != "tip")
    for joint in joints:
        found.setdefault(_Size("gears" if joint.mechanism == "tendon-gear" else "pulleys", joint.radius))
    for tendon in inst.as_given("tendons"):
        for crossing in tendon.route:
            if _has_wheel(inst, crossing):
                found.setdefault(_Size("pulleys", crossing.radius or 0.0))
    return list(found)


def _has_wheel(inst: FullForm, crossing: Crossing) -> bool:
    """Return whether a tendon runs over a wheel of its own there, and not past the joint's middle."""
    joint = next(one for one in inst.as_given("joints") if one.name == crossing.joint)
    return bool(crossing.radius and crossing.radius > _PAST * joint.radius)


def _stock(catalogue: Catalogue, kind: str) -> Array:
    """Return the radii of wheels, m."""
    if kind == "pulleys":
        return np.array(sorted(pulley.radius for pulley in catalogue.pulleys))
    return np.unique([one.radius for one in gear_wheels(catalogue)])


def with_wheels(model: FullForm, real: FullForm, wheels: WheelSet) -> FullForm:
    """Return an instrument that is enlarged from another one with its wheels."""
    sizes = _sizes(real)
    by_size = dict(zip(sizes, wheels.radii, strict=True))
    if all(same(made, wheels.factor * size.radius) for size, made in by_size.items()):
        return model
    joints = [joint.model_dump(exclude_unset=True) for joint in model.as_given("joints")]
    for table, joint in zip(joints, real.as_given("joints"), strict=True):
        table["radius"] = by_size[_Size("gears" if joint.mechanism == "tendon-gear" else "pulleys", joint.radius)]
    tendons = [tendon.model_dump(exclude_unset=True) for tendon in model.as_given("tendons")]
    for table, tendon in zip(tendons, real.as_given("tendons"), strict=True):
        for row, crossing in zip(table["route"], tendon.route, strict=True):
            if _has_wheel(real, crossing):
                row["radius"] = by_size[_Size("pulleys", crossing.radius or 0.0)]
    return model.replace(joints=joints, tendons=tendons)


def _tension_per_force(real: FullForm, loads: Sequence[UsualLoad]) -> float:
    """Return the change of all tensions by force at the tip, root of squares, least over the loads' directions."""
    forces = [one for one in loads if one.wrench.any()]
    small = np.array([1e-2 * one.wrench for one in forces])
    handle = np.zeros(len(real.handle_joints))
    rest = np.asarray(statics.chain.tensions(real, handle))
    under = np.asarray(statics.chain.tensions(real, handle, small))
    rates = np.linalg.norm(under - rest, axis=1) / np.linalg.norm(small, axis=1)
    return float(rates[rates > _SAME].min())


def _of_length(bounds: tuple[float, float] | None) -> tuple[Limit, ...]:
    """Return the limits of the tendons' length that a rod sets, m."""
    if bounds is None:
        return ()
    low, high = bounds
    return (
        Limit(
            "overall_length",
            f"tendons of at least {1e3 * low:g} mm",
            "the least length",
            "m",
            lambda c: (np.full_like(c["tendon_length"], low), c["tendon_length"]),
        ),
        Limit(
            "overall_length",
            f"tendons of at most {1e3 * high:g} mm",
            "the tendons' length",
            "m",
            lambda c: (c["tendon_length"], high),
        ),
    )


def _built(front: JointFront, index: int, wheels: WheelSet, rope: Rope, rod: Rod | None) -> JointDesign:
    """Return a design of a front with its instrument."""
    real, catalogue = front.real_size, front.catalogue
    stiffness, tension = float(front.stiffness[index]), float(front.tensions[index])
    objectives = front.objectives[index]
    cell = LoadCells(catalogue).of(tension)
    spool = nearest_spool(catalogue, real.own_drives.spool_radius * wheels.factor)
    model = with_wheels(enlarged(real, wheels.factor, stiffness), real, wheels)
    encoder = finest_encoder(catalogue, min(joint.radius for joint in model.tip_joints))
    area = rope.rigidity
    length = area / float(model.stiffnesses.min())
    changes: dict[str, Any] = {}
    rods = []
    for joint in model.as_given("joints"):
        rigidity = joint.backbone_rigidity or 0.0
        if rod is not None and rigidity:
            one = min(catalogue.rods, key=lambda rod: abs(math.log(rod.rigidity / rigidity)))
            changes[f"joints.{joint.name}.backbone_rigidity"] = one.rigidity
            rods.append((joint.name, one))
        if joint.place == "handle" and joint.end_effector_length and real.tendon_length:
            # The handle keeps its share of the tendons' compliance, where the sheath's friction acts.
            hand = joint.end_effector_length * length / (wheels.factor * real.tendon_length)
            changes[f"joints.{joint.name}.end_effector_length"] = hand
    for tendon, own in zip(model.as_given("tendons"), model.stiffnesses.tolist(), strict=True):
        alike = tendon.stiffness_by_tension is not None or math.isclose(area / own, length, rel_tol=_SAME)
        changes[f"tendons.{tendon.name}.stiffness"] = None
        changes[f"tendons.{tendon.name}.length"] = None if alike else area / own
    changes |= {
        "tendon_stiffness": None,
        "tendon_diameter": rope.diameter,
        "tendon_modulus": rope.modulus,
        "tendon_length": length,
        "breaking_load": rope.breaking_load,
        **of_sensors(cell, encoder),
        "spool_radius": spool.radius,
        "sources": {
            "joints.radius": "tenodesis scale: " + ("turned to size" if wheels.to_size else "wheels in stock"),
            "joints": f"tenodesis scale: {real.name}, lengths times {wheels.factor:.6g}",
            "tendon_diameter": f"{rope.name}: {rope.source}"[:400],
            "pretension": "tenodesis scale: scaled by k r",
        },
    }
    if model.stem_length is not None:
        changes["stem_length"] = max(length - (wheels.factor * _beyond_stem(real)), 0.1 * length)
    scaled = with_tension_limit(model.replace(**changes), tension)
    fitted = tuple(_fitted(real, catalogue, size, made) for size, made in zip(_sizes(real), wheels.radii, strict=True))
    springs = tuple((joint.name, joint.stiffness) for joint in scaled.tip_joints if joint.stiffness)
    choice = JointChoice(fitted, wheels.to_size, rope, tuple(rods), springs, cell, encoder, spool)
    return JointDesign(real, scaled, choice, catalogue, objectives, tension)


def _beyond_stem(real: FullForm) -> float:
    """Return the length of joints and ends beyond the stem at both ends, m."""
    along = sum(joint.offset + joint.chord + (joint.end_effector_length or 0.0) for joint in real.joints)
    return float(along)


def _fitted(real: FullForm, catalogue: Catalogue, size: _Size, radius: float) -> FittedWheel:
    """Return wheels of a radius, m, with what is at them: joints, and tendons that run over one."""
    joints = [
        joint
        for joint in real.as_given("joints")
        if _Size("gears" if joint.mechanism == "tendon-gear" else "pulleys", joint.radius) == size
    ]
    over = sorted(
        {
            f"{tendon.name} over {crossing.joint}"
            for tendon in real.as_given("tendons")
            for crossing in tendon.route
            if crossing.radius and size == _Size("pulleys", crossing.radius)
        }
    )
    at = ", ".join([*(joint.name for joint in joints), *over])
    if size.kind == "gears":
        wheel = min(
            (one for one in gear_wheels(catalogue) if same(one.radius, radius)), key=lambda one: makeable([one])
        )
        return FittedWheel(at, wheel, "gears", len(joints))
    backbones = bool(joints) and all(joint.mechanism == "continuum" for joint in joints)
    return FittedWheel(at, Wheel(radius), "discs" if backbones else "pulleys", len(joints))
