"""Two instruments: the range of their comparison, the scale factors, and the groups."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from tenodesis import statics
from tenodesis.instrument import ShortForm
from tenodesis.similarity.groups import Group, groups_of, groups_under_load, paired, unit_of_time
from tenodesis.similarity.parameters import tension_scale, value_of
from tenodesis.statics.query import FloatOrArray


@dataclass(frozen=True)
class SimilarPair:
    """A real-size instrument and its scaled-up model, with the factors between them."""

    real_size: ShortForm
    scaled_up: ShortForm
    largest_force: float
    """Largest force on the real-size instrument, N, at which similarity is judged."""

    @property
    def same_mechanism(self) -> bool:
        """Whether both have the same joint type."""
        return self.real_size.joint_type == self.scaled_up.joint_type

    @cached_property
    def reach(self) -> float:
        """Real-size handle angle, rad, up to which both can be compared: the working range as far as both reach."""
        return self.common_range(statics.reach(self.real_size))

    def common_range(self, limit: float) -> float:
        """Return the largest real-size handle angle up to a limit that the scaled-up one reaches as well, rad."""
        if self.same_mechanism:
            return min(limit, self.scaled_up.handle_range)
        bent = statics.output_angle(self.scaled_up, self.scaled_up.handle_range)
        if bent >= statics.output_angle(self.real_size, limit):
            return limit
        return float(statics.handle_angle(self.real_size, bent))

    @property
    def covered(self) -> float:
        """Share of the real-size working range, by unloaded output angle, over which both can be compared."""
        ends = statics.output_angle(self.real_size, np.array([self.reach, statics.reach(self.real_size)]))
        return float(ends[0] / ends[1])

    def scaled_up_handle_angle(self, handle_angle: ArrayLike) -> FloatOrArray:
        """Return the scaled-up handle angle for a real-size handle angle, rad, within :attr:`reach`.

        Instruments of the same joint type are compared at equal handle angles; of different joint types, at equal
        unloaded output angles, since their kinematics differ (eq. 18).
        """
        if self.same_mechanism:
            return handle_angle
        bent = statics.output_angle(self.real_size, handle_angle)
        end = statics.output_angle(self.scaled_up, self.scaled_up.handle_range)
        return statics.handle_angle(self.scaled_up, np.clip(bent, -end, end))

    @cached_property
    def factors(self) -> dict[str, float]:
        """Scale factor of every dimension both instruments have, and of forces, motions and time (Tables I and II).

        `length` is the factor of the distal radius, `torque` that of moments on the tip (2 k r^2, eq. 16),
        `handle_torque` that of tension times proximal radius, `motor_stroke` that of tendon lengths, `time` that of
        sqrt(J / kappa). Angles of handle and tip have the factor 1; spools turn by stroke over their radius.
        """
        dimensions = {
            key: getattr(self.scaled_up, key) / getattr(self.real_size, key)
            for key in ("stem_diameter", "overall_length", *self.real_size.parameter_fields)
            if key not in ("given_stiffness", "pretension")
            and getattr(self.real_size, key, None)
            and getattr(self.scaled_up, key, None)
        }
        stiffness = float(self.flexural_stiffness_factor(0.0))
        spool = self.length_factor * self.real_size.drives.spool_radius / self.scaled_up.drives.spool_radius
        return dimensions | {
            "tendon_stiffness": self.scaled_up.tendon_stiffness / self.real_size.tendon_stiffness,
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
        """Factor of the distal radius, by which tendon lengths scale."""
        return self._factor_of("distal_radius")

    @property
    def time_factor(self) -> float:
        """Factor of time, that of the straight tips' periods."""
        return unit_of_time(self.scaled_up) / unit_of_time(self.real_size)

    @property
    def scaled_pretension(self) -> float:
        """Pretension of the scaled-up instrument, N, that keeps the real-size T_o / (k r)."""
        return self.real_size.pretension * self.tension_factor

    def _factor_of(self, parameter: str) -> float:
        return value_of(self.scaled_up, parameter) / value_of(self.real_size, parameter)

    @property
    def tension_factor(self) -> float:
        """Factor of tendon tension that keeps T / (k r) (Table II)."""
        return tension_scale(self.scaled_up) / tension_scale(self.real_size)

    def force_factor(self, output_angle: ArrayLike | None = None) -> FloatOrArray:
        """Return the force factor for equal loss of dexterity at an output angle (rad), mid-range by default."""
        angle = self.real_size.output_range / 2 if output_angle is None else output_angle
        return statics.loss_of_dexterity(self.real_size, angle, 1.0) / statics.loss_of_dexterity(
            self.scaled_up, angle, 1.0
        )

    def flexural_stiffness_factor(self, output_angle: ArrayLike) -> FloatOrArray:
        """Return the factor of flexural stiffness at an output angle (rad)."""
        return statics.flexural_stiffness(self.scaled_up, output_angle) / statics.flexural_stiffness(
            self.real_size, output_angle
        )

    @cached_property
    def groups(self) -> tuple[Group, ...]:
        """The dimensionless groups of both instruments, at forces and times scaled by their factors."""
        force, angle, time = self.largest_force, self.real_size.output_range / 2, unit_of_time(self.real_size)
        theirs = (force * float(self.force_factor()), angle, time * self.time_factor)
        real_size = groups_of(self.real_size) | groups_under_load(self.real_size, force, angle, time)
        return paired(real_size, groups_of(self.scaled_up) | groups_under_load(self.scaled_up, *theirs))
