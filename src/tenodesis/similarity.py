"""Elastic similarity of two instruments: what scales how, which groups match, and what the mismatch costs.

The paper calls the small instrument the model and the large one the prototype; a factor is prototype over model.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import nan
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tenodesis import statics
from tenodesis.instrument import Instrument
from tenodesis.query import FloatOrArray

GRID = (161, 61)
"""Handle angles and forces of the grid that similarity is judged on."""

_SAME = 1e-9
"""Relative difference up to which two groups count as equal."""


class Group(NamedTuple):
    """A dimensionless group of the quasi-static model and its value in both instruments."""

    name: str
    model: float
    prototype: float

    @property
    def ratio(self) -> float:
        """Prototype over model, NaN where the model's is zero."""
        return self.prototype / self.model if self.model else nan

    @property
    def matches(self) -> bool:
        """Whether the group is the same in both instruments."""
        return abs(self.prototype - self.model) <= _SAME * abs(self.model)


@dataclass(frozen=True)
class SimilarityError:
    """How far the prototype's output angle strays from the model's over the working range.

    Angles in deg, forces in N on the model. `handle_angle` (rad, length m) and `force` (N, length n) span the grid,
    `error` (deg, m by n) is prototype minus model, NaN where either has no equilibrium.
    """

    model_pretension: float
    prototype_pretension: float
    force_factor: float
    handle_angle: NDArray[np.float64]
    force: NDArray[np.float64]
    error: NDArray[np.float64]

    @property
    def largest(self) -> float:
        """Largest magnitude of the error, deg."""
        return float(np.nanmax(np.abs(self.error)))

    @property
    def rms(self) -> float:
        """Root mean square of the error, deg."""
        return float(np.sqrt(np.nanmean(self.error**2)))

    @property
    def quantile_95(self) -> float:
        """Magnitude that 95 % of the grid stays below, deg."""
        return float(np.nanquantile(np.abs(self.error), 0.95))

    @property
    def unsolved(self) -> float:
        """Share of the grid on which either instrument has no equilibrium."""
        return float(np.isnan(self.error).mean())

    @property
    def worst(self) -> tuple[float, float]:
        """Handle angle (rad) and force (N) of the largest error."""
        at = np.unravel_index(np.nanargmax(np.abs(self.error)), self.error.shape)
        return float(self.handle_angle[at[0]]), float(self.force[at[1]])


@dataclass(frozen=True)
class Comparison:
    """Two instruments side by side; :func:`compare` makes it."""

    model: Instrument
    prototype: Instrument
    largest_force: float
    """Largest force on the model, N, that similarity is judged at."""

    @cached_property
    def factors(self) -> dict[str, float]:
        """Scale factor of every dimension both instruments have, of stiffness, tension and force."""
        dimensions = {
            key: getattr(self.prototype, key) / getattr(self.model, key)
            for key in ("stem_diameter", "overall_length", *self.model.parameter_fields)
            if key not in ("given_stiffness", "pretension")
            and getattr(self.model, key, None)
            and getattr(self.prototype, key, None)
        }
        return dimensions | {
            "tendon_stiffness": self.prototype.tendon_stiffness / self.model.tendon_stiffness,
            "tension": self.tension_factor,
            "force": self.force_factor(),
            "flexural_stiffness": self.flexural_stiffness_factor(0.0),
        }

    @property
    def tension_factor(self) -> float:
        """Factor of tendon tension that keeps T / (k r) (Table II)."""
        return _tension_scale(self.prototype) / _tension_scale(self.model)

    def force_factor(self, output_angle: ArrayLike | None = None) -> FloatOrArray:
        """Return the factor of force for equal loss of dexterity at an output angle (rad), mid-range by default."""
        angle = self.model.output_range / 2 if output_angle is None else output_angle
        return statics.loss_of_dexterity(self.model, angle, 1.0) / statics.loss_of_dexterity(self.prototype, angle, 1.0)

    def flexural_stiffness_factor(self, output_angle: ArrayLike) -> FloatOrArray:
        """Return the factor of flexural stiffness at an output angle (rad)."""
        return statics.flexural_stiffness(self.prototype, output_angle) / statics.flexural_stiffness(
            self.model, output_angle
        )

    @cached_property
    def groups(self) -> tuple[Group, ...]:
        """The dimensionless groups of the frictionless quasi-static model, at forces scaled by the force factor."""
        model, prototype = _groups(self.model), _groups(self.prototype)
        forces = {
            "F/(kr)": (
                self.largest_force / _tension_scale(self.model),
                self.largest_force * self.force_factor() / _tension_scale(self.prototype),
            )
        }
        shared = {name: (model[name], prototype[name]) for name in model if name in prototype}
        return tuple(Group(name, *pair) for name, pair in (shared | forces).items())

    @cached_property
    def errors(self) -> Mapping[str, SimilarityError]:
        """Similarity error with the prototype's pretension scaled from the model's, and as its file has it."""
        return {"scaled": self.error(), "as used": self.error(pretension=self.prototype.pretension)}

    def error(
        self,
        *,
        pretension: float | None = None,
        force_factor: float | None = None,
        largest_force: float | None = None,
        grid: tuple[int, int] = GRID,
    ) -> SimilarityError:
        """Return how far the prototype strays from the model, by the full model and not by Θ alone.

        Parameters
        ----------
        pretension
            Pretension of the prototype, N; by default the model's times the tension factor.
        force_factor
            Factor of force; by default that of mid-range.
        largest_force
            Largest force on the model, N; by default that of the comparison.
        grid
            Number of handle angles, over the model's output range without load, and of forces, from zero on.
        """
        scaled = self.model.pretension * self.tension_factor if pretension is None else pretension
        factor = self.force_factor() if force_factor is None else force_factor
        reach = min(statics.reach(self.model), self.prototype.handle_range)
        handle = np.linspace(-reach, reach, grid[0])
        force = np.linspace(0.0, self.largest_force if largest_force is None else largest_force, grid[1])
        expected = statics.output_angle(self.model, handle[:, None], force)
        found = statics.output_angle(self.prototype.replace(pretension=scaled), handle[:, None], force * factor)
        return SimilarityError(self.model.pretension, scaled, factor, handle, force, np.degrees(found - expected))


def compare(model: Instrument, prototype: Instrument, *, largest_force: float | None = None) -> Comparison:
    """Compare a scaled-up instrument with the one it stands for.

    Parameters
    ----------
    model
        The instrument that is meant, in the paper's words the model.
    prototype
        The one that is built, in the paper's words the prototype.
    largest_force
        Largest tangential force on the model, N; by default the largest of its conditions, else 1 N.

    Returns
    -------
    Comparison
        Its `factors`, `groups` and `errors` (in deg).

    Raises
    ------
    ValueError
        The two have different joint types, or the force is not positive.
    TypeError
        One is not an instrument.
    """
    for argument, inst in (("model", model), ("prototype", prototype)):
        if not isinstance(inst, Instrument):
            raise TypeError(f"{argument} is {inst!r}; allowed is an instrument, as tenodesis.load gives it.")
    if model.joint_type != prototype.joint_type:
        raise ValueError(
            f"prototype has joint_type {prototype.joint_type}, model {model.joint_type}; "
            "allowed are two instruments of the same joint type."
        )
    force = max(model.conditions.forces, default=1.0) if largest_force is None else largest_force
    if not isinstance(force, int | float) or not (np.isfinite(force) and force > 0):
        raise ValueError(f"largest_force is {force!r}; allowed is a force above 0 N.")
    return Comparison(model, prototype, force)


def _distal_radius(inst: Instrument) -> float:
    return _parameter(inst, "distal_radius")


def _parameter(inst: Instrument, parameter: str) -> float:
    field = next(field for field, name in inst.parameter_fields.items() if name == parameter)
    return float(getattr(inst, field))


def _tension_scale(inst: Instrument) -> float:
    """Return k r, the tension that stretches a tendon by the distal radius, N."""
    return inst.tendon_stiffness * _distal_radius(inst)


def _groups(inst: Instrument) -> dict[str, float]:
    distal, proximal = _distal_radius(inst), _parameter(inst, "proximal_radius")
    groups = {
        "R/r": proximal / distal,
        "l_d/r": inst.end_effector_length / distal,
        "l_p/R": inst.handle_length / proximal,
        "T_o/(kr)": inst.pretension / _tension_scale(inst),
    }
    if inst.joint_type == "continuum":
        length, rigidity = _parameter(inst, "backbone_length"), _parameter(inst, "backbone_rigidity")
        groups |= {
            "L_b/r": length / distal,
            "EI/(k r^2 L_b)": rigidity / (inst.tendon_stiffness * distal**2 * length),
        }
    return groups
