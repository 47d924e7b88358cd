"""Every scale model that parts and lengths allow: numbered, with parameters computed on demand."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tenodesis import statics
from tenodesis.errors import DesignError
from tenodesis.instrument import PARAMETERS, ShortForm
from tenodesis.run import Array
from tenodesis.scaling.catalogue import Catalogue, Constraints, missing, same
from tenodesis.scaling.parts import Rod, Rope
from tenodesis.similarity.parameters import field_of, value_of

COMBINATIONS = 1_000_000
"""Default number of scale models of a search, which sets how finely free lengths are divided."""

_FEWEST_LEVELS = 3
_MOST_LEVELS = 200
_RESOLUTION = 1e-3  # m, of lengths made in a workshop
_END_EFFECTOR_RESOLUTION = 1e-4  # m; this length decides the similarity
_TURNED = 1e-5  # m, to which the radius of a turned part is given
CUT_TO_ORDER = 2.0
"""Cost of a gear cut to order beyond one in stock, relative to a part turned to general tolerances; ours."""
_NO_UNDERCUT = 17
"""Least number of teeth of a gear with 20 degrees pressure angle that is not undercut."""


class Wheel(NamedTuple):
    """A gear or pulley: pitch radius (m), and for a gear its module (m) and number of teeth."""

    radius: float
    module: float | None = None
    teeth: int | None = None

    @property
    def tip_radius(self) -> float:
        """Outer radius, m: for a gear, pitch radius plus module."""
        return self.radius + (self.module or 0.0)


_Parts: TypeAlias = tuple[ShortForm, tuple[tuple[Wheel, Wheel], ...], tuple[Rope, ...], tuple[Rod | None, ...], float]
"""The first fields of :class:`Candidates`: the instrument, pairs, ropes, rods and pretension."""


@dataclass(frozen=True)
class Candidates:
    """The scale models of an instrument that a catalogue allows, before any limit except the ratio of radii.

    Lengths in m; the last of a pair's end-effector lengths is the most similar one within the constraints.
    """

    real_size: ShortForm
    pairs: tuple[tuple[Wheel, Wheel], ...]
    """Distal and proximal wheels."""
    ropes: tuple[Rope, ...]
    rods: tuple[Rod | None, ...]
    pretension: float
    """As pinned, N; NaN for the scaled pretension of the real-size instrument."""
    overall_lengths: Array
    between: Array
    """End-effector lengths common to all pairs."""
    end_effector_lengths: Array
    """By pair and level."""
    handle_lengths: Array
    """By overall length: the same share as at real size, within the constraints, since sheath friction acts there."""

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """Number of pairs, ropes, rods, overall lengths and end-effector lengths."""
        return (
            len(self.pairs),
            len(self.ropes),
            len(self.rods),
            self.overall_lengths.size,
            self.end_effector_lengths.shape[1],
        )

    def __len__(self) -> int:
        return math.prod(self.shape)

    def columns(self, numbers: NDArray[np.int64]) -> dict[str, Array]:
        """Return the core's parameters of some candidates, by name, without those that do not apply."""
        pair, rope, rod, length, level = np.unravel_index(numbers, self.shape)
        distal = np.array([one.radius for one, _ in self.pairs])[pair]
        columns = {
            "distal_radius": distal,
            "proximal_radius": np.array([one.radius for _, one in self.pairs])[pair],
            "handle_length": self.handle_lengths[length],
            "end_effector_length": self.end_effector_lengths[pair, level],
            "tendon_modulus": np.array([one.modulus for one in self.ropes])[rope],
            "tendon_diameter": np.array([one.diameter for one in self.ropes])[rope],
            "tendon_length": self.overall_lengths[length],
        }
        if "backbone_length" in self.real_size.parameter_fields.values():
            scale = distal / value_of(self.real_size, "distal_radius")
            columns["backbone_length"] = scale * value_of(self.real_size, "backbone_length")
            columns["backbone_rigidity"] = np.array([one.rigidity for one in self.rods if one is not None])[rod]
        return columns

    def rows(self, columns: Mapping[str, Array]) -> Array:
        """Return columns as the core's rows of parameters."""
        count = columns["distal_radius"].size
        rows = np.full((count, len(PARAMETERS)), np.nan)
        for name, values in columns.items():
            rows[:, PARAMETERS.index(name)] = values
        return rows

    def parts(self, number: int) -> tuple[tuple[Wheel, Wheel], Rope, Rod | None]:
        """Return the wheels (distal, proximal), the rope and the backbone of a candidate."""
        pair, rope, rod, _, _ = np.unravel_index(number, self.shape)
        return self.pairs[pair], self.ropes[rope], self.rods[rod]

    def chunks(self, size: int) -> Iterator[NDArray[np.int64]]:
        """Yield the numbers of all candidates in chunks of a size."""
        for begin in range(0, len(self), size):
            yield np.arange(begin, min(begin + size, len(self)), dtype=np.int64)


def candidates(
    real_size: ShortForm, catalogue: Catalogue, pins: Mapping[str, Any], combinations: int = COMBINATIONS
) -> Candidates:
    """Return about `combinations` scale models that a catalogue, narrowed to pins (SI units), allows for an instrument.

    Raises DesignError if the catalogue lacks parts, or no two wheels have the ratio of the radii.
    """
    catalogue.refuse_incomplete(real_size.joint_type)
    constraints = catalogue.constraints
    pairs = _pairs(real_size, catalogue, pins)
    rods: tuple[Rod | None, ...] = catalogue.rods if real_size.joint_type == "continuum" else (None,)
    levels = _lengths_levels(constraints, combinations / (len(pairs) * len(catalogue.ropes) * len(rods)))
    pretension = pins.get("pretension", math.nan)
    return _with_lengths((real_size, pairs, catalogue.ropes, rods, pretension), constraints, levels)


def finer(found: Candidates, catalogue: Catalogue, numbers: NDArray[np.int64], combinations: int) -> Candidates:
    """Return about `combinations` candidates with the parts of given candidates and a finer division of lengths."""
    pair, rope, rod, *_ = np.unravel_index(numbers, found.shape)
    pairs = tuple(found.pairs[i] for i in np.unique(pair))
    ropes = tuple(found.ropes[i] for i in np.unique(rope))
    rods = tuple(found.rods[i] for i in np.unique(rod))
    levels = _lengths_levels(catalogue.constraints, combinations / (len(pairs) * len(ropes) * len(rods)))
    parts = (found.real_size, pairs, ropes, rods, found.pretension)
    return _with_lengths(parts, catalogue.constraints, max(levels - found.overall_lengths.size, 2), among=found)


def _lengths_levels(constraints: Constraints, combinations: float) -> int:
    ranges = (constraints.overall_length, constraints.end_effector_length)
    free = [one[0] != one[1] for one in ranges if one is not None]
    return int(np.clip(np.ceil(combinations ** (1 / max(sum(free), 1))), _FEWEST_LEVELS, _MOST_LEVELS))


def _with_lengths(parts: _Parts, constraints: Constraints, levels: int, among: Candidates | None = None) -> Candidates:
    real_size, pairs, *_ = parts
    distal = np.array([wheel.radius for wheel, _ in pairs])
    overall = _overall(real_size, constraints.overall_length, distal, levels)
    between = _between(constraints.end_effector_length, levels)
    if among is not None:
        overall = np.unique(np.concatenate([overall, among.overall_lengths]))
        between = np.unique(np.concatenate([between, among.between]))
    similar = distal * (value_of(real_size, "end_effector_length") / value_of(real_size, "distal_radius"))
    nearest = _made(similar, constraints.end_effector_length, _END_EFFECTOR_RESOLUTION)[:, None]
    handle = overall * real_size.handle_length / (real_size.tendon_length or real_size.overall_length)
    return Candidates(
        *parts,
        overall,
        between,
        np.concatenate([np.tile(between, (len(pairs), 1)), nearest], axis=1),
        _made(handle, constraints.handle_length),
    )


def _overall(real_size: ShortForm, limits: tuple[float, float] | None, distal: Array, levels: int) -> Array:
    if limits is None:
        scale = np.unique(distal / value_of(real_size, "distal_radius"))
        return np.linspace(scale[0], scale[-1], min(levels, scale.size)) * real_size.overall_length
    return np.unique(_made(np.linspace(*limits, levels), limits))


def _between(limits: tuple[float, float] | None, levels: int) -> Array:
    """Return the end-effector lengths to try besides the most similar length."""
    if limits is None or limits[0] == limits[1]:
        return np.empty(0)
    return np.unique(_made(np.linspace(*limits, levels - 1), limits, _END_EFFECTOR_RESOLUTION))


def _made(lengths: Array, limits: tuple[float, float] | None, resolution: float = _RESOLUTION) -> Array:
    """Return lengths rounded to the workshop's resolution within their range; those without a range unchanged."""
    if limits is None:
        return lengths
    made: Array = np.clip(np.round(lengths / resolution) * resolution, *limits)
    return made


def _pairs(real_size: ShortForm, catalogue: Catalogue, pins: Mapping[str, Any]) -> tuple[tuple[Wheel, Wheel], ...]:
    wheels = _wheels(real_size, catalogue)
    distal_field, proximal_field = (field_of(real_size, f"{which}_radius") for which in ("distal", "proximal"))
    foreign = [key for key in pins if key.endswith(("_radius", "_offset")) and key not in (
        distal_field, proximal_field, "spool_radius")]  # fmt: skip
    if foreign:
        raise DesignError(
            f"{foreign[0]} is pinned, but {real_size.name} has joint_type {real_size.joint_type}; "
            f"its radii are {distal_field} and {proximal_field}.",
            key=foreign[0],
            allowed=f"{distal_field} or {proximal_field}",
        )
    free = _free(real_size, catalogue)
    distals = _pinned(wheels, distal_field, pins, catalogue, free)
    proximals = _pinned(wheels, proximal_field, pins, catalogue, free)
    small, large = value_of(real_size, "distal_radius"), value_of(real_size, "proximal_radius")
    factor = catalogue.constraints.factor
    if factor is not None:
        low, high = (bound * small * (1 + sign * 1e-9) for bound, sign in zip(factor, (-1, 1), strict=True))
        within = [one for one in distals if low <= one.radius <= high]
        if not within:
            raise DesignError(_no_radius(real_size, catalogue, distals, factor), key=distal_field)
        distals = within
    tolerance = catalogue.constraints.ratio_tolerance
    pairs: dict[tuple[float, float], tuple[Wheel, Wheel]] = {}
    nearest = (math.inf, math.nan)
    radius = np.array([one.radius for one in proximals])
    for one in distals:
        off = radius / one.radius / (large / small) - 1
        nearest = min(nearest, (float(np.abs(off).min()), float(radius[np.abs(off).argmin()] / one.radius)))
        for index in np.flatnonzero(np.abs(off) <= tolerance + 1e-12):
            other = proximals[index]
            size = (round(one.radius, 12), round(other.radius, 12))
            if size not in pairs or makeable((one, other)) < makeable(pairs[size]):
                pairs[size] = (one, other)
        exact = round(one.radius * large / small / _TURNED) * _TURNED
        # Turned to size anyway, a wheel may as well have the exact ratio.
        if proximal_field not in pins and free[0] <= exact <= free[1]:
            pairs.setdefault((round(one.radius, 12), round(exact, 12)), (one, Wheel(exact)))
    if not pairs:
        if distal_field in pins and proximal_field in pins:
            raise DesignError(
                f"{distal_field} and {proximal_field} are pinned to R/r = {nearest[1]:.6g}, which is "
                f"{100 * nearest[0]:.3g} % off the {large / small:.6g} of {real_size.name}; "
                f"ratio_tolerance is {100 * tolerance:g} %.",
                key="ratio_tolerance",
                value=tolerance,
            )
        raise DesignError(
            f"no two wheels of catalogue {catalogue.name} have R/r = {large / small:.6g} of {real_size.name} within "
            f"ratio_tolerance = {tolerance:g}; the nearest have {nearest[1]:.6g} ({100 * nearest[0]:.2g} % off): to "
            f"take them, give a file with [constraints] ratio_tolerance = {math.ceil(100 * nearest[0]) / 100:g} as a "
            f"further --catalogue, which costs {_cost_of_ratio(real_size, nearest[1] * small):.2g} deg of output angle"
            f"{_cut_to_order(catalogue, large / small, tolerance)}.",
            key="ratio_tolerance",
            value=tolerance,
        )
    return tuple(pairs[size] for size in sorted(pairs))


def _cost_of_ratio(real_size: ShortForm, proximal: float) -> float:
    """Return the similarity error, deg, of another proximal radius (m) at real size, where the working range ends."""
    end = statics.reach(real_size)
    other = real_size.replace(**{field_of(real_size, "proximal_radius"): proximal})
    angles = [float(statics.output_angle(one, np.array([end]))[0]) for one in (real_size, other)]
    return abs(math.degrees(angles[1] - angles[0]))


def _cut_to_order(catalogue: Catalogue, ratio: float, tolerance: float) -> str:
    """Return the end of a sentence: which gears beyond the catalogue's, cut to order, would have a ratio."""
    gears = catalogue.gears
    if gears is None:
        return ""
    least, most = gears.teeth
    small = next((n for n in range(least, most + 1) if abs(round(n * ratio) / n / ratio - 1) <= tolerance), None)
    if small is None:
        return ""
    return (
        f"; or have two proximal gears of {round(small * ratio)} teeth cut to order for the distal ones of "
        f"{small}, which "
        f"costs weeks and about {2 * CUT_TO_ORDER:g} turned parts: give [gears] teeth = [{least}, "
        f"{max(most, round(small * ratio))}]"
    )


def _free(real_size: ShortForm, catalogue: Catalogue) -> tuple[float, float]:
    """Return the least and largest radius (m) to which pulleys can be made; (inf, -inf) if they cannot."""
    radii = [one.radius for one in catalogue.pulleys if one.to_size and real_size.joint_type != "tendon-gear"]
    return min(radii, default=math.inf), max(radii, default=-math.inf)


def _no_radius(
    real_size: ShortForm, catalogue: Catalogue, distals: Sequence[Wheel], factor: tuple[float, float]
) -> str:
    small = value_of(real_size, "distal_radius")
    low, high = factor
    asked = f"factor = {low:g}" if low == high else f"factor from {low:g} to {high:g}"
    near = min(distals, key=lambda one: max(low * small - one.radius, one.radius - high * small))
    return (
        f"{asked} needs a distal radius of {1e3 * low * small:.6g}"
        f"{'' if low == high else f' to {1e3 * high * small:.6g}'} mm, which no wheel of catalogue {catalogue.name} "
        f"has; the nearest has {1e3 * near.radius:.6g} mm (factor {near.radius / small:.6g})."
    )


def _wheels(real_size: ShortForm, catalogue: Catalogue) -> list[Wheel]:
    if real_size.joint_type != "tendon-gear":
        return [Wheel(pulley.radius) for pulley in catalogue.pulleys]
    if catalogue.gears is None:
        raise DesignError(
            f"catalogue {catalogue.name} has no gears, which {real_size.name} needs.",
            key="gears",
            allowed="in the catalogue",
        )
    return gear_wheels(catalogue)


def gear_wheels(catalogue: Catalogue) -> list[Wheel]:
    """Return all gears of a catalogue."""
    if catalogue.gears is None:
        return []
    least, most = catalogue.gears.teeth
    return [
        Wheel(module * teeth / 2, module, teeth)
        for module in catalogue.gears.modules
        for teeth in range(least, most + 1)
    ]


def _pinned(
    wheels: list[Wheel], field: str, pins: Mapping[str, Any], catalogue: Catalogue, free: tuple[float, float]
) -> list[Wheel]:
    if field not in pins:
        return wheels
    found = [one for one in wheels if same(one.radius, pins[field])]
    if not found and free[0] <= pins[field] <= free[1]:
        found = [Wheel(pins[field])]
    if not found:
        raise missing(field, pins[field], [one.radius for one in wheels], catalogue)
    return found


def makeable(wheels: Sequence[Wheel]) -> tuple[Any, ...]:
    """Return the order of preference of wheels with the same radii: no undercut, equal modules, coarser teeth."""
    undercut = sum(wheel.teeth is not None and wheel.teeth < _NO_UNDERCUT for wheel in wheels)
    modules = [wheel.module for wheel in wheels]
    return undercut, len(set(modules)) > 1, *(-(module or 0.0) for module in modules)
