"""Which group causes the similarity error: what each one's mismatch does to the output angle at the others constant."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import nan
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tenodesis import statics
from tenodesis.instrument import Instrument
from tenodesis.similarity import loops
from tenodesis.similarity.frictionless import rms
from tenodesis.similarity.groups import SAME, groups_of
from tenodesis.similarity.loops import Place
from tenodesis.similarity.parameters import alone, field_of, tension_scale, value_of
from tenodesis.similarity.realisation import COUPLED, SEGMENTS, Realisation, friction_of, law_of_both

if TYPE_CHECKING:
    from tenodesis.similarity.comparison import Comparison

Array = NDArray[np.float64]
OnProgress: TypeAlias = Callable[[float, float], object] | None

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)
LOAD = "Theta"
MECHANISM = "joint type"


@dataclass(frozen=True)
class Cause:
    """What one group's mismatch contributes to the similarity error, deg."""

    name: str
    model: float
    prototype: float
    at_worst: float
    """Where the error is largest, with its sign."""
    rms: float
    """Over the whole grid."""

    @property
    def ratio(self) -> float:
        """Prototype over model, NaN where the model's is zero."""
        return self.prototype / self.model if self.model else nan


@dataclass(frozen=True)
class Causes:
    """The causes of a similarity error, the one that does most where the error is largest first; angles in deg.

    The remainder is what the sum of the causes leaves of the error: slack that sets in on the way, terms of higher
    order, and groups that no instrument of the model's mechanism can be given.
    """

    place: Place
    """Where the error is largest among the places where every contribution is known."""
    error: float
    error_rms: float
    causes: tuple[Cause, ...]
    remainder: float
    remainder_rms: float

    @property
    def worst(self) -> str:
        """Name of the group that does most where the error is largest."""
        return self.causes[0].name

    def __getitem__(self, name: str) -> Cause:
        """Return a cause by the name of its group.

        Raises
        ------
        KeyError
            There is no such cause.
        """
        for cause in self.causes:
            if cause.name == name:
                return cause
        raise KeyError(f"{name!r} is no cause; there are {', '.join(cause.name for cause in self.causes)}")


class _Way:
    """The way from the model to the prototype through the groups, with the load by its loss of dexterity."""

    def __init__(self, comparison: "Comparison", pretension: float | None, force_factor: float | None) -> None:
        scaled = comparison.scaled_pretension if pretension is None else pretension
        equal = float(comparison.force_factor())
        model, prototype = alone(comparison.model), alone(comparison.prototype.replace(pretension=scaled))
        ours, theirs = groups_of(model), groups_of(prototype)
        coupled = [name for name in COUPLED if name in ours] if comparison.same_mechanism else ["T_o/(kr)"]
        segments = SEGMENTS if comparison.same_mechanism else SEGMENTS[:1]
        self.model: dict[str, float] = {name: ours[name] for name in coupled}
        self.prototype: dict[str, float] = {name: theirs[name] for name in coupled}
        self.with_friction = (
            {name: ours[name] for name in segments} | friction_of(ours, theirs),
            {name: theirs[name] for name in segments} | friction_of(theirs, ours),
        )
        self.load_ratio = (equal if force_factor is None else force_factor) / equal
        self.angle = comparison.model.output_range / 2
        self.loss = float(statics.loss_of_dexterity(model, self.angle, 1.0))
        self.make = Realisation(model, law_of_both(model, prototype), min(model.handle_range, comparison.reach + 1e-9))

    def force(self, inst: Instrument, ratio: float, force: Array) -> Array:
        """Return the forces (N) that cost an instrument a ratio of what forces on the model (N) cost the model."""
        return force * (ratio * self.loss / float(statics.loss_of_dexterity(inst, self.angle, 1.0)))


def frictionless_causes(
    comparison: "Comparison",
    pretension: float | None,
    force_factor: float | None,
    largest_force: float | None,
    grid: tuple[int, int],
) -> Causes:
    """Return the causes of the frictionless error, by exact derivatives; :meth:`Comparison.causes` says more."""
    error = comparison.error(pretension=pretension, force_factor=force_factor, largest_force=largest_force, grid=grid)
    way = _Way(comparison, pretension, force_factor)
    parts: dict[str, Array] = {}
    for node, weight in zip((1 + _NODES) / 2, _WEIGHTS / 2, strict=True):
        for name, part in _derivatives(way, node, error.handle_angle[:, None], error.force).items():
            parts[name] = parts.get(name, 0.0) + weight * part
    if not comparison.same_mechanism:
        there = way.make.instrument(way.prototype)
        forces = way.force(there, way.load_ratio, error.force)
        own = statics.output_angle(there, error.handle_angle[:, None], forces)
        parts[MECHANISM] = np.degrees(error.prototype_angle - own)
    pairs = {name: (way.model[name], way.prototype[name]) for name in way.model}
    places = [[Place(float(h), float(f), True) for f in error.force] for h in error.handle_angle]
    return _causes(error.error, parts, pairs | _load(way, error.force), lambda at: places[at[0]][at[1]])


def causes_at_rest(
    comparison: "Comparison",
    pretension: float | None,
    force_factor: float | None,
    forces: Sequence[float] | None,
    progress: OnProgress,
) -> Causes:
    """Return the causes of the error at rest, by central differences; :meth:`Comparison.causes` says more."""
    error = comparison.error_at_rest(pretension=pretension, force_factor=force_factor, forces=forces)
    way = _Way(comparison, pretension, force_factor)
    start, end = (own | more for own, more in zip((way.model, way.prototype), way.with_friction, strict=True))
    differ = [name for name in start if abs(end[name] - start[name]) > SAME * abs(start[name])]
    middle = {name: (start[name] + end[name]) / 2 for name in start}
    ratio = (1 + way.load_ratio) / 2
    parts: dict[str, Array] = {name: np.zeros_like(error.error) for name in [*start, LOAD]}
    total = len(differ) + 1 + (not comparison.same_mechanism)
    for done, name in enumerate(differ):
        low, high = (_at_rest(way, middle | {name: one[name]}, ratio, error) for one in (start, end))
        parts[name] = np.degrees(high - low)
        _tell(progress, done + 1, total)
    if abs(way.load_ratio - 1) > SAME:
        low, high = (_at_rest(way, middle, one, error) for one in (1.0, way.load_ratio))
        parts[LOAD] = np.degrees(high - low)
    _tell(progress, len(differ) + 1, total)
    if not comparison.same_mechanism:
        parts[MECHANISM] = np.degrees(error.prototype_angle - _at_rest(way, end, way.load_ratio, error))
        _tell(progress, total, total)
    pairs = {name: (start[name], end[name]) for name in start}

    def place(at: tuple[int, ...]) -> Place:
        return Place(float(error.handle_angle[at[1]]), float(error.force[at[0]]), bool(error.flexing[at[1]]))

    return _causes(error.error, parts, pairs | _load(way, error.force), place)


def _derivatives(way: _Way, node: float, handle: Array, force: Array) -> dict[str, Array]:
    """Return what each group contributes per length of the way, deg, at a share of it."""
    groups = {name: (1 - node) * way.model[name] + node * way.prototype[name] for name in way.model}
    inst = way.make.instrument(groups)
    ratio = 1 + node * (way.load_ratio - 1)
    forces = way.force(inst, ratio, force)
    loss = float(statics.loss_of_dexterity(inst, way.angle, 1.0))
    changes = _changes(inst)
    loaded = sorted({key for name in ("l_d/r", "L_b/r", "EI/(k r^2 L_b)") for key in changes.get(name, {})})
    every = sorted({key for name in way.model for key in changes[name]} | set(loaded))
    by = statics.gradient("output_angle", inst, handle, forces, wrt=[*every, "force"])
    loss_by = statics.gradient("loss_of_dexterity", inst, way.angle, 1.0, wrt=loaded)
    parts = {}
    for name in way.model:
        length = way.prototype[name] - way.model[name]
        direct = sum(by[key] * change for key, change in changes[name].items())
        # The force follows so that the loss of dexterity at mid-range stays.
        rescaled = sum(loss_by.get(key, 0.0) * change for key, change in changes[name].items()) / loss
        parts[name] = np.degrees((direct - by["force"] * forces * rescaled) * length)
    parts[LOAD] = np.degrees(by["force"] * forces / ratio * (way.load_ratio - 1))
    return parts


def _changes(inst: Instrument) -> dict[str, dict[str, float]]:
    """Return how fast each key of an instrument changes with each group, the others constant."""
    radius, stiffness = value_of(inst, "distal_radius"), inst.tendon_stiffness
    changes = {
        "R/r": {field_of(inst, "proximal_radius"): radius},
        "l_d/r": {"end_effector_length": radius},
        "T_o/(kr)": {"pretension": tension_scale(inst)},
    }
    if inst.joint_type == "continuum":
        length, rigidity = (field_of(inst, name) for name in ("backbone_length", "backbone_rigidity"))
        backbone = value_of(inst, "backbone_length")
        bending = value_of(inst, "backbone_rigidity") / backbone
        changes |= {
            "L_b/r": {length: radius, rigidity: bending * radius},
            "EI/(k r^2 L_b)": {rigidity: stiffness * radius**2 * backbone},
        }
    return changes


def _at_rest(way: _Way, groups: Mapping[str, float], ratio: float, error: loops.LoopError) -> Array:
    inst = way.make.instrument(groups)
    path = loops.path_at_rest(float(error.handle_angle.max()))
    made = loops.judged(inst, path.time_step)
    return loops.loops(made, path, path.handle_angle, way.force(inst, ratio, error.force), quasi_static=True)


def _load(way: _Way, force: Array) -> dict[str, tuple[float, float]]:
    largest = way.loss * float(force.max())
    return {LOAD: (largest, largest * way.load_ratio)}


def _causes(
    error: Array,
    parts: Mapping[str, Array],
    pairs: Mapping[str, tuple[float, float]],
    place: Callable[[tuple[int, ...]], Place],
) -> Causes:
    known = np.where(np.isfinite(sum(parts.values())), error, np.nan)
    if np.isnan(known).all():
        raise ValueError("no load is held by both instruments and by those between them; allowed are smaller forces.")
    at = tuple(int(i) for i in np.unravel_index(np.nanargmax(np.abs(known)), known.shape))
    remainder = known - sum(parts.values())
    causes = [Cause(name, *pairs.get(name, (nan, nan)), float(part[at]), rms(part)) for name, part in parts.items()]
    causes.sort(key=lambda cause: (-abs(cause.at_worst), -cause.rms))
    return Causes(place(at), float(error[at]), rms(known), tuple(causes), float(remainder[at]), rms(remainder))


def _tell(progress: OnProgress, done: float, total: float) -> None:
    if progress is not None:
        progress(done, total)
