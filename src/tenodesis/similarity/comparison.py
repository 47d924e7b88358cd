"""The comparison of two instruments: factors, groups, the similarity error of three kinds, and its causes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import degrees

import numpy as np

from tenodesis import statics
from tenodesis.errors import ArgumentError
from tenodesis.instrument import InstrumentLike, as_short_form
from tenodesis.similarity import causes, loops
from tenodesis.similarity.causes import Causes, OnProgress
from tenodesis.similarity.frictionless import GRID, SimilarityError
from tenodesis.similarity.loops import LoopError
from tenodesis.similarity.pair import SimilarPair

COARSE = (41, 16)
"""Grid of methods that evaluate the error many times."""

_LEAST_COVERED = 0.5


@dataclass(frozen=True)
class Comparison(SimilarPair):
    """A pair of instruments with the similarity errors between them and their causes; :func:`compare` makes it."""

    def __repr__(self) -> str:
        factors = f"force factor {self.force_factor():.4g}, tension factor {self.tension_factor:.4g}"
        names = f"{self.real_size.name!r} and {self.scaled_up.name!r}"
        return f"<Comparison of {names} up to {self.largest_force:g} N: {factors}>"

    @cached_property
    def errors(self) -> Mapping[str, SimilarityError]:
        """Similarity error with the scaled real-size pretension, and with that of the scaled-up file."""
        return {"scaled": self.error(), "as used": self.error(pretension=self.scaled_up.pretension)}

    def error(
        self,
        *,
        pretension: float | None = None,
        force_factor: float | None = None,
        largest_force: float | None = None,
        grid: tuple[int, int] = GRID,
    ) -> SimilarityError:
        """Return the difference in output angle without friction, by the full quasi-static model and not by Θ alone.

        Parameters
        ----------
        pretension
            Pretension of the scaled-up instrument, N; by default the real-size one times the tension factor.
        force_factor
            Factor of force; by default that of mid-range.
        largest_force
            Largest force on the real-size instrument, N; by default that of the comparison.
        grid
            Number of handle angles, over the real-size output range without load, and of forces, from zero on.
        """
        scaled = self.scaled_pretension if pretension is None else pretension
        factor = float(self.force_factor()) if force_factor is None else force_factor
        handle = np.linspace(-self.reach, self.reach, grid[0])
        force = np.linspace(0.0, self.largest_force if largest_force is None else largest_force, grid[1])
        expected = statics.output_angle(self.real_size, handle[:, None], force)
        scaled_up = self.scaled_up.replace(pretension=scaled)
        found = statics.output_angle(scaled_up, self.scaled_up_handle_angle(handle)[:, None], force * factor)
        error = np.degrees(found - expected)
        return SimilarityError(
            self.real_size.pretension, scaled, factor, handle, force, error, expected, found, scaled_up.output_stop
        )

    def error_at_rest(
        self,
        *,
        pretension: float | None = None,
        force_factor: float | None = None,
        forces: Sequence[float] | None = None,
    ) -> LoopError:
        """Return the error with friction at rest, while the handle flexes and extends under constant forces.

        Both instruments are as in their files, without mismatch and with a handle that follows its command exactly; of
        two axes, the first. The loops start at the straight handle, where the force is applied.

        Parameters
        ----------
        pretension, force_factor
            As for :meth:`error`.
        forces
            Constant forces on the real-size instrument, N; by default five, from none to the largest, up to that of
            the comparison, that both hold through the full cycle. A tip that is lost under a given force leaves NaN
            from there on, and counts in `unsolved`; `largest_force` of the result is the largest that both hold.

        Raises
        ------
        ValueError
            A force is not finite.
        """
        return loops.loop_error(
            self,
            loops.motion_at_rest(self.reach),
            pretension=pretension,
            force_factor=force_factor,
            forces=forces,
            quasi_static=True,
        )

    def cycle_error(
        self,
        *,
        pretension: float | None = None,
        force_factor: float | None = None,
        forces: Sequence[float] | None = None,
        speed: float = loops.SPEED,
    ) -> LoopError:
        """Return the error of the true output angle in time, over a hysteresis cycle on the dynamic twin.

        The scaled-up handle moves slower by the time factor; rows are compared one by one. A tip that snaps through
        comes to rest at its stop. Other parameters and the result, which contains both loops, are those of
        :meth:`error_at_rest`.

        Parameters
        ----------
        speed
            Speed of the real-size handle, rad/s.

        Raises
        ------
        ValueError
            A force is not finite, or the speed is not positive.
        """
        if not (np.isfinite(speed) and speed > 0):
            raise ArgumentError(key="speed", value=speed, allowed="a speed above 0 rad/s")
        return loops.loop_error(
            self,
            loops.motion_in_time(self, speed),
            pretension=pretension,
            force_factor=force_factor,
            forces=forces,
            quasi_static=False,
        )

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
        """Return which groups cause the error, each by its mismatch with the others constant.

        The groups are R/r, l_d/r at equal loss of dexterity, that loss (Theta, at mid-range), T_o/(kr) and a
        continuum's two groups; with friction also the compliance shares and the groups of friction. A change of l_d/r
        or of the backbone rescales the force for equal Theta, as one does on the bench: otherwise the contributions of
        l_d/r and F/(kr) would cancel (eqs. 15 to 17).

        Without friction, exact derivatives of the output angle by each group are integrated along the straight path
        from the real-size groups to the scaled-up ones. Contributions of small and of large mismatches then add up to
        the error, except for the quadrature error at the onset of slack. With friction, they are central differences
        of the twin at rest about the middle of that path. Between two joint types only T_o/(kr), Theta and friction
        can be separated; the rest is attributed to the mechanism, as "joint type".

        Parameters
        ----------
        friction
            Explain :meth:`error_at_rest` instead of :meth:`error`.
        pretension, force_factor, largest_force, grid
            As for :meth:`error`; the last two without friction.
        forces
            As for :meth:`error_at_rest`.
        progress
            With friction, called with the number of groups done and their total.

        Raises
        ------
        ValueError
            No load is held by both.
        """
        path = causes.GroupPath(self, pretension, force_factor)
        given = {"pretension": pretension, "force_factor": force_factor}
        if friction:
            return causes.causes_at_rest(path, self.error_at_rest(forces=forces, **given), progress)
        return causes.frictionless_causes(path, self.error(largest_force=largest_force, grid=grid, **given))


def compare(real_size: InstrumentLike, scaled_up: InstrumentLike, *, largest_force: float | None = None) -> Comparison:
    """Compare a scaled-up instrument with the real-size instrument that it models.

    They may have different joint types; of two axes the first is taken. The largest tangential force is on the
    real-size instrument, N; by default the largest of its conditions, else 1 N.

    Raises
    ------
    ValueError
        The scaled-up instrument reaches less than half of the real-size working range, or the force is not positive.
    TypeError
        One is not an instrument.
    """
    real_size, scaled_up = as_short_form(real_size, "real_size"), as_short_form(scaled_up, "scaled_up")
    force = max(real_size.conditions.forces, default=1.0) if largest_force is None else largest_force
    if not isinstance(force, int | float) or not (np.isfinite(force) and force > 0):
        raise ArgumentError(key="largest_force", value=force, allowed="a force above 0 N")
    comparison = Comparison(real_size, scaled_up, force)
    if comparison.covered < _LEAST_COVERED:
        full = degrees(statics.output_angle(real_size, statics.reach(real_size)))
        raise ArgumentError(
            f"scaled_up reaches {comparison.covered * full:.4g} deg of the real-size working range of {full:.4g} deg; "
            "it must reach at least half of it: use a larger handle_range or proximal radius.",
            key="scaled_up",
        )
    return comparison
