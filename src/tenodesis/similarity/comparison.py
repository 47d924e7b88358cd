"""Two instruments side by side: factors, groups, the similarity error of three kinds, and its causes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import degrees
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from tenodesis import statics
from tenodesis.instrument import Instrument
from tenodesis.similarity import loops
from tenodesis.similarity.causes import Causes, OnProgress, causes_at_rest, frictionless_causes
from tenodesis.similarity.frictionless import GRID, SimilarityError
from tenodesis.similarity.groups import Group, groups_of, groups_under_load, paired, unit_of_time
from tenodesis.similarity.loops import LoopError
from tenodesis.similarity.parameters import tension_scale, value_of
from tenodesis.statics.query import FloatOrArray

Measure: TypeAlias = Literal["largest", "rms"]

COARSE = (41, 16)
"""Grid of what takes many errors."""

_LEAST_COVERED = 0.5
_SEARCHED = np.geomspace(0.5, 2.0, 41)


@dataclass(frozen=True)
class Comparison:
    """Two instruments side by side; :func:`compare` makes it."""

    model: Instrument
    prototype: Instrument
    largest_force: float
    """Largest force on the model, N, that similarity is judged at."""

    @property
    def same_mechanism(self) -> bool:
        """Whether both have the same joint type."""
        return self.model.joint_type == self.prototype.joint_type

    @cached_property
    def reach(self) -> float:
        """Handle angle of the model, rad, up to which both can be judged: its working range, as far as both reach."""
        whole = statics.reach(self.model)
        if self.same_mechanism:
            return min(whole, self.prototype.handle_range)
        bent = statics.output_angle(self.prototype, self.prototype.handle_range)
        if bent >= statics.output_angle(self.model, whole):
            return whole
        return float(statics.handle_angle(self.model, bent))

    @property
    def covered(self) -> float:
        """Share of the model's working range, by unloaded output angle, that both can be judged over."""
        ends = statics.output_angle(self.model, np.array([self.reach, statics.reach(self.model)]))
        return float(ends[0] / ends[1])

    def prototype_handle_angle(self, handle_angle: ArrayLike) -> FloatOrArray:
        """Return the prototype's handle angle that stands for one of the model's, rad, within :attr:`reach`.

        Two instruments of one joint type are compared at equal handle angles; of two, at equal unloaded output angles,
        since the mechanisms' kinematics differ (eq. 18).
        """
        if self.same_mechanism:
            return handle_angle
        bent = statics.output_angle(self.model, handle_angle)
        end = statics.output_angle(self.prototype, self.prototype.handle_range)
        return statics.handle_angle(self.prototype, np.clip(bent, -end, end))

    @cached_property
    def factors(self) -> dict[str, float]:
        """Scale factor of every dimension both instruments have, and of what is done to and by them (Tables I and II).

        `length` is the distal radius's, `torque` that of moments on the tip (2 k r^2, eq. 16), `handle_torque` tension
        times proximal radius, `motor_stroke` that of tendon lengths, `time` that of sqrt(J / kappa). Angles of handle
        and tip have the factor 1, spools turn by stroke over their radius.
        """
        dimensions = {
            key: getattr(self.prototype, key) / getattr(self.model, key)
            for key in ("stem_diameter", "overall_length", *self.model.parameter_fields)
            if key not in ("given_stiffness", "pretension")
            and getattr(self.model, key, None)
            and getattr(self.prototype, key, None)
        }
        stiffness = float(self.flexural_stiffness_factor(0.0))
        spool = self.length_factor * self.model.drives.spool_radius / self.prototype.drives.spool_radius
        return dimensions | {
            "tendon_stiffness": self.prototype.tendon_stiffness / self.model.tendon_stiffness,
            "tension": self.tension_factor,
            "force": float(self.force_factor()),
            "flexural_stiffness": stiffness,
            "length": self.length_factor,
            "torque": stiffness,
            "handle_torque": self.tension_factor * self._factor_of("proximal_radius"),
            "motor_stroke": self.length_factor,
            "spool_angle": spool,
            "spool_velocity": spool / self.time_factor,
            "time": self.time_factor,
        }

    @property
    def length_factor(self) -> float:
        """Factor of the distal radius, which tendon lengths scale by."""
        return self._factor_of("distal_radius")

    @property
    def time_factor(self) -> float:
        """Factor of time, by which the straight tips swing alike."""
        return unit_of_time(self.prototype) / unit_of_time(self.model)

    @property
    def scaled_pretension(self) -> float:
        """Pretension of the prototype that keeps the model's T_o / (k r), N."""
        return self.model.pretension * self.tension_factor

    def _factor_of(self, parameter: str) -> float:
        return value_of(self.prototype, parameter) / value_of(self.model, parameter)

    @property
    def tension_factor(self) -> float:
        """Factor of tendon tension that keeps T / (k r) (Table II)."""
        return tension_scale(self.prototype) / tension_scale(self.model)

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
        """The dimensionless groups of the whole model, at forces and times scaled by their factors."""
        force, angle, time = self.largest_force, self.model.output_range / 2, unit_of_time(self.model)
        theirs = (force * float(self.force_factor()), angle, time * self.time_factor)
        model = groups_of(self.model) | groups_under_load(self.model, force, angle, time)
        return paired(model, groups_of(self.prototype) | groups_under_load(self.prototype, *theirs))

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
        scaled = self.scaled_pretension if pretension is None else pretension
        factor = self.force_factor() if force_factor is None else force_factor
        handle = np.linspace(-self.reach, self.reach, grid[0])
        force = np.linspace(0.0, self.largest_force if largest_force is None else largest_force, grid[1])
        expected = statics.output_angle(self.model, handle[:, None], force)
        prototype = self.prototype.replace(pretension=scaled)
        found = statics.output_angle(prototype, self.prototype_handle_angle(handle)[:, None], force * factor)
        error = np.degrees(found - expected)
        return SimilarityError(
            self.model.pretension, scaled, factor, handle, force, error, expected, found, prototype.output_stop
        )

    def error_at_rest(
        self,
        *,
        pretension: float | None = None,
        force_factor: float | None = None,
        forces: Sequence[float] | None = None,
    ) -> LoopError:
        """Return the error with friction at rest, while the handle flexes and extends under constant forces.

        Both are what their files say, without mismatch, with a handle that is where it is told to be; of two axes, the
        first. The loops start at the straight handle, where the force is put on.

        Parameters
        ----------
        pretension, force_factor
            As for :meth:`error`.
        forces
            Constant forces on the model, N; by default five, from none to the largest, up to that of the comparison,
            that both hold through the whole cycle. A tip that is lost under a given one leaves NaN from there on, and
            counts in `unsolved`; `largest_force` of the result is the largest that both hold.

        Raises
        ------
        ValueError
            A force is not finite.
        """
        return loops.error_at_rest(self, pretension, force_factor, forces)

    def cycle_error(
        self,
        *,
        pretension: float | None = None,
        force_factor: float | None = None,
        forces: Sequence[float] | None = None,
        speed: float = loops.SPEED,
    ) -> LoopError:
        """Return the error of the true output angle in time, over a hysteresis cycle on the dynamic twin.

        The prototype's time is the model's times the time factor, so that its handle is that much slower; rows are
        compared one by one. A tip that snaps through comes to rest at its stop. Other parameters and the result, which
        holds both loops, are those of :meth:`error_at_rest`.

        Parameters
        ----------
        speed
            Speed of the model's handle, rad/s.

        Raises
        ------
        ValueError
            A force is not finite, or the speed is not positive.
        """
        if not (np.isfinite(speed) and speed > 0):
            raise ValueError(f"speed is {speed!r}; allowed is a speed above 0 rad/s.")
        return loops.cycle_error(self, pretension, force_factor, forces, speed)

    def causes(
        self,
        *,
        friction: bool = False,
        pretension: float | None = None,
        force_factor: float | None = None,
        largest_force: float | None = None,
        grid: tuple[int, int] = COARSE,
        forces: Sequence[float] | None = None,
        progress: OnProgress = None,
    ) -> Causes:
        """Return which groups cause the error, each one's mismatch at the others constant.

        The basis is R/r, l_d/r at equal loss of dexterity, that loss (Theta, at mid-range), T_o/(kr) and a continuum's
        two groups; with friction also the compliance shares and the groups of friction. A change of l_d/r or of the
        backbone rescales the force for equal Theta, as one does on the bench: otherwise l_d/r and F/(kr) would do
        nothing but cancel (eqs. 15 to 17).

        Without friction, exact derivatives of the output angle by each group are summed up along the straight way
        from the model's groups to the prototype's, so that small mismatches and large ones are told alike and the
        contributions add up to the error but for the quadrature at the onset of slack. With friction, they are central
        differences of the twin at rest about the middle of that way. Between two joint types only T_o/(kr), Theta and
        friction are told apart; the rest is the mechanism's, under "joint type".

        Parameters
        ----------
        friction
            Explain :meth:`error_at_rest` instead of :meth:`error`.
        pretension, force_factor, largest_force, grid
            As for :meth:`error`; the last two without friction.
        forces
            As for :meth:`error_at_rest`.
        progress
            Called with friction, with how many groups are done and how many there are.

        Raises
        ------
        ValueError
            No load is held by both.
        """
        if friction:
            return causes_at_rest(self, pretension, force_factor, forces, progress)
        return frictionless_causes(self, pretension, force_factor, largest_force, grid)

    def best_force_factor(
        self,
        measure: Measure = "largest",
        *,
        pretension: float | None = None,
        largest_force: float | None = None,
        grid: tuple[int, int] = COARSE,
    ) -> float:
        """Return the factor of force that makes the frictionless error least over the working range.

        A prototype that snaps through counts as standing at its stop, so that losing the tip is no way to a small
        error. The factor of :meth:`force_factor` is exact at mid-range alone.

        Parameters
        ----------
        measure
            What is made least: the "largest" or the "rms" error.
        pretension, largest_force, grid
            As for :meth:`error`.

        Raises
        ------
        ValueError
            The measure is unknown.
        """
        if measure not in ("largest", "rms"):
            raise ValueError(f"measure is {measure!r}; allowed are largest and rms.")
        from scipy.optimize import minimize_scalar  # noqa: PLC0415 - slow to load, and seldom needed

        middle = float(self.force_factor())

        def cost(logarithm: float) -> float:
            error = self.error(
                pretension=pretension,
                force_factor=middle * float(np.exp(logarithm)),
                largest_force=largest_force,
                grid=grid,
            )
            return error.largest_snapped if measure == "largest" else error.rms_snapped

        # Snapping through makes the cost jump, so that the valley is found before it is walked down.
        logarithms = np.log(_SEARCHED)
        least = int(np.argmin([cost(one) for one in logarithms]))
        bounds = logarithms[max(least - 1, 0)], logarithms[min(least + 1, logarithms.size - 1)]
        found = minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 1e-7})
        return middle * float(np.exp(found.x))


def compare(model: Instrument, prototype: Instrument, *, largest_force: float | None = None) -> Comparison:
    """Compare a scaled-up instrument with the one it stands for.

    Parameters
    ----------
    model
        The instrument that is meant, in the paper's words the model.
    prototype
        The one that is built, in the paper's words the prototype; it may be of another joint type.
    largest_force
        Largest tangential force on the model, N; by default the largest of its conditions, else 1 N.

    Returns
    -------
    Comparison
        Its `factors`, `groups`, errors (in deg) and their `causes`. Of an instrument with two axes it is the first.

    Raises
    ------
    ValueError
        The prototype reaches less than half of the model's working range, or the force is not positive.
    TypeError
        One is not an instrument.
    """
    for argument, inst in (("model", model), ("prototype", prototype)):
        if not isinstance(inst, Instrument):
            raise TypeError(f"{argument} is {inst!r}; allowed is an instrument, as tenodesis.load gives it.")
    force = max(model.conditions.forces, default=1.0) if largest_force is None else largest_force
    if not isinstance(force, int | float) or not (np.isfinite(force) and force > 0):
        raise ValueError(f"largest_force is {force!r}; allowed is a force above 0 N.")
    comparison = Comparison(model, prototype, force)
    if comparison.covered < _LEAST_COVERED:
        whole = degrees(statics.output_angle(model, statics.reach(model)))
        raise ValueError(
            f"prototype reaches {comparison.covered * whole:.4g} deg of the model's working range of {whole:.4g} deg; "
            "allowed is a prototype that reaches at least half of it: a larger handle_range or proximal radius."
        )
    return comparison
