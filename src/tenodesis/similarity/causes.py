"""Causes of the similarity error: the effect of each group's mismatch on the output angle, the others constant."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import nan
from typing import TypeAlias

import numpy as np

from tenodesis import statics
from tenodesis.errors import ArgumentError
from tenodesis.instrument import ShortForm
from tenodesis.magnitude import rms_of_finite
from tenodesis.run import Array
from tenodesis.similarity import loops
from tenodesis.similarity.frictionless import SimilarityError
from tenodesis.similarity.groups import SAME, groups_of
from tenodesis.similarity.loops import LoopPoint
from tenodesis.similarity.pair import SimilarPair
from tenodesis.similarity.parameters import field_of, tension_scale, value_of
from tenodesis.similarity.realisation import COUPLED, SEGMENTS, Realisation, friction_of, law_of_both

OnProgress: TypeAlias = Callable[[float, float], object] | None

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)
LOAD = "Theta"
MECHANISM = "joint type"


@dataclass(frozen=True)
class Cause:
    """Contribution of a group's mismatch to the similarity error, deg."""

    name: str
    real_size: float
    scaled_up: float
    at_worst: float
    """At the place of the largest error, with its sign."""
    rms: float
    """Over the grid."""

    @property
    def ratio(self) -> float:
        """Scaled-up over real-size, NaN where the real-size value is zero."""
        return self.scaled_up / self.real_size if self.real_size else nan


@dataclass(frozen=True)
class Causes:
    """The causes of a similarity error, sorted by their contribution where the error is largest; angles in deg.

    The remainder is the error minus the sum of the causes: slack that sets in along the path, terms of higher order,
    and groups that an instrument of the real-size mechanism cannot have.
    """

    place: LoopPoint
    """Point of the largest error, among those where every contribution is known."""
    error: float
    error_rms: float
    causes: tuple[Cause, ...]
    remainder: float
    remainder_rms: float

    @property
    def worst(self) -> str:
        """Name of the group with the largest contribution where the error is largest."""
        return self.causes[0].name

    def __getitem__(self, name: str) -> Cause:
        """Return a cause by the name of its group; raises KeyError if there is no such cause."""
        for cause in self.causes:
            if cause.name == name:
                return cause
        raise KeyError(f"{name!r} is not a cause; causes are {', '.join(cause.name for cause in self.causes)}")


class GroupPath:
    """The straight path from the real-size to the scaled-up groups, with the load given by its loss of dexterity."""

    def __init__(self, pair: SimilarPair, pretension: float | None, force_factor: float | None) -> None:
        scaled = pair.scaled_pretension if pretension is None else pretension
        equal = float(pair.force_factor())
        real_size, scaled_up = pair.real_size.planar[0], pair.scaled_up.replace(pretension=scaled).planar[0]
        ours, theirs = groups_of(real_size), groups_of(scaled_up)
        coupled = [name for name in COUPLED if name in ours] if pair.same_mechanism else ["T_o/(kr)"]
        segments = SEGMENTS if pair.same_mechanism else SEGMENTS[:1]
        self.real_size: dict[str, float] = {name: ours[name] for name in coupled}
        self.scaled_up: dict[str, float] = {name: theirs[name] for name in coupled}
        self.with_friction = (
            {name: ours[name] for name in segments} | friction_of(ours, theirs),
            {name: theirs[name] for name in segments} | friction_of(theirs, ours),
        )
        self.same_mechanism = pair.same_mechanism
        self.load_ratio = (equal if force_factor is None else force_factor) / equal
        self.angle = pair.real_size.output_range / 2
        self.loss = float(statics.loss_of_dexterity(real_size, self.angle, 1.0))
        self.make = Realisation(
            real_size, law_of_both(real_size, scaled_up), min(real_size.handle_range, pair.reach + 1e-9)
        )

    def force(self, inst: ShortForm, ratio: float, force: Array) -> Array:
        """Return forces (N) with a ratio times the loss of dexterity that the given forces (N) cause at real size."""
        return force * (ratio * self.loss / float(statics.loss_of_dexterity(inst, self.angle, 1.0)))


def frictionless_causes(path: GroupPath, error: SimilarityError) -> Causes:
    """Return the causes of the frictionless error, by exact derivatives; see :meth:`Comparison.causes`."""
    parts: dict[str, Array] = {}
    for node, weight in zip((1 + _NODES) / 2, _WEIGHTS / 2, strict=True):
        for name, part in _derivatives(path, node, error.handle_angle[:, None], error.force).items():
            parts[name] = parts.get(name, 0.0) + weight * part
    if not path.same_mechanism:
        end = path.make.instrument(path.scaled_up)
        forces = path.force(end, path.load_ratio, error.force)
        expected = statics.output_angle(end, error.handle_angle[:, None], forces)
        parts[MECHANISM] = np.degrees(error.scaled_up_angle - expected)
    pairs = {name: (path.real_size[name], path.scaled_up[name]) for name in path.real_size}

    def point(row: np.intp, force: np.intp) -> LoopPoint:
        return LoopPoint(float(error.handle_angle[row]), float(error.force[force]), True)

    return _causes(error.error, parts, pairs | _load(path, error.force), point)


def causes_at_rest(path: GroupPath, error: loops.LoopError, progress: OnProgress) -> Causes:
    """Return the causes of the error at rest, by central differences; see :meth:`Comparison.causes`."""
    start, end = (
        groups | friction for groups, friction in zip((path.real_size, path.scaled_up), path.with_friction, strict=True)
    )
    differ = [name for name in start if abs(end[name] - start[name]) > SAME * abs(start[name])]
    middle = {name: (start[name] + end[name]) / 2 for name in start}
    ratio = (1 + path.load_ratio) / 2
    parts: dict[str, Array] = {name: np.zeros_like(error.error) for name in [*start, LOAD]}
    total = len(differ) + 1 + (not path.same_mechanism)
    for done, name in enumerate(differ):
        low, high = (_at_rest(path, middle | {name: groups[name]}, ratio, error) for groups in (start, end))
        parts[name] = np.degrees(high - low)
        _report(progress, done + 1, total)
    if abs(path.load_ratio - 1) > SAME:
        low, high = (_at_rest(path, middle, load, error) for load in (1.0, path.load_ratio))
        parts[LOAD] = np.degrees(high - low)
    _report(progress, len(differ) + 1, total)
    if not path.same_mechanism:
        parts[MECHANISM] = np.degrees(error.scaled_up_angle - _at_rest(path, end, path.load_ratio, error))
        _report(progress, total, total)
    pairs = {name: (start[name], end[name]) for name in start}
    return _causes(error.error, parts, pairs | _load(path, error.force), error.point)


def _derivatives(path: GroupPath, node: float, handle: Array, force: Array) -> dict[str, Array]:
    """Return each group's contribution per length of the path, deg, at a share of it."""
    groups = {name: (1 - node) * path.real_size[name] + node * path.scaled_up[name] for name in path.real_size}
    inst = path.make.instrument(groups)
    ratio = 1 + node * (path.load_ratio - 1)
    forces = path.force(inst, ratio, force)
    loss = float(statics.loss_of_dexterity(inst, path.angle, 1.0))
    changes = _changes(inst)
    loaded = sorted({key for name in ("l_d/r", "L_b/r", "EI/(k r^2 L_b)") for key in changes.get(name, {})})
    every = sorted({key for name in path.real_size for key in changes[name]} | set(loaded))
    by = statics.gradient("output_angle", inst, handle, forces, wrt=[*every, "force"])
    loss_by = statics.gradient("loss_of_dexterity", inst, path.angle, 1.0, wrt=loaded)
    parts = {}
    for name in path.real_size:
        length = path.scaled_up[name] - path.real_size[name]
        direct = sum(by[key] * change for key, change in changes[name].items())
        # The force changes too, so that the loss of dexterity at mid-range stays the same.
        rescaled = sum(loss_by.get(key, 0.0) * change for key, change in changes[name].items()) / loss
        parts[name] = np.degrees((direct - by["force"] * forces * rescaled) * length)
    parts[LOAD] = np.degrees(by["force"] * forces / ratio * (path.load_ratio - 1))
    return parts


def _changes(inst: ShortForm) -> dict[str, dict[str, float]]:
    """Return the derivatives of an instrument's keys by each group, the others constant."""
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


def _at_rest(path: GroupPath, groups: Mapping[str, float], ratio: float, error: loops.LoopError) -> Array:
    inst = path.make.instrument(groups)
    motion = loops.motion_at_rest(float(error.handle_angle.max()))
    nominal = loops.nominal(inst, motion.time_step)
    return loops.loops(nominal, motion, motion.handle_angle, path.force(inst, ratio, error.force), quasi_static=True)


def _load(path: GroupPath, force: Array) -> dict[str, tuple[float, float]]:
    largest = path.loss * float(force.max())
    return {LOAD: (largest, largest * path.load_ratio)}


def _causes(
    error: Array,
    parts: Mapping[str, Array],
    pairs: Mapping[str, tuple[float, float]],
    point: Callable[[np.intp, np.intp], LoopPoint],
) -> Causes:
    known = np.where(np.isfinite(sum(parts.values())), error, np.nan)
    if np.isnan(known).all():
        raise ArgumentError(
            "no load is held by both instruments and by those between them; use smaller forces.", key="forces"
        )
    at = np.unravel_index(np.nanargmax(np.abs(known)), known.shape)
    remainder = known - sum(parts.values())
    causes = [
        Cause(name, *pairs.get(name, (nan, nan)), float(part[at]), rms_of_finite(part)) for name, part in parts.items()
    ]
    causes.sort(key=lambda cause: (-abs(cause.at_worst), -cause.rms))
    whole, rest = rms_of_finite(known), rms_of_finite(remainder)
    return Causes(point(*at), float(error[at]), whole, tuple(causes), float(remainder[at]), rest)


def _report(progress: OnProgress, done: float, total: float) -> None:
    if progress is not None:
        progress(done, total)
