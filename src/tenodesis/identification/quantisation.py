"""Errors of a noisy sensor behind a converter of finite resolution: independent errors, and persistent rounding."""

import math
from collections.abc import Iterator
from typing import NamedTuple

from tenodesis.instrument import ShortForm

_HARMONICS = 49
_NEGLIGIBLE = 1e-4
"""Variance of a rounding error, over that of a reading, below which it is left out."""


class QuantisedSensor(NamedTuple):
    """A sensor with its converter, in the unit of its readings."""

    noise: float
    """Standard deviation."""
    resolution: float
    """Step of the converter."""

    @property
    def rounding_variances(self) -> tuple[float, ...]:
        """Variance, by harmonic, of the rounding error that persists while a signal rests, as far as noise leaves it.

        Rounding comes at a random place of the converter's step (Widrow and Kollár 2008, ch. 5).
        """
        turns = [2 * math.pi * harmonic for harmonic in range(1, _HARMONICS + 1)]
        return tuple(
            2 * (self.resolution / turn) ** 2 * math.exp(-((turn * self.noise / self.resolution) ** 2))
            for turn in turns
        )

    @property
    def independent_variance(self) -> float:
        """Variance of the error that is independent from sample to sample."""
        return self.noise**2 + self.resolution**2 / 12 - sum(self.rounding_variances)

    @property
    def deviation(self) -> float:
        """Standard deviation of a reading."""
        return math.hypot(self.noise, self.resolution / math.sqrt(12))

    def deviation_of_mean(self, samples: int) -> float:
        """Return the standard deviation of a mean of some samples of a signal at rest."""
        return math.sqrt(sum(self.rounding_variances) + self.independent_variance / samples)

    def harmonics(self, variance: float) -> Iterator[tuple[float, float]]:
        """Yield wave number and variance of the rounding errors that are significant beside a given variance."""
        for harmonic, size in enumerate(self.rounding_variances, 1):
            if size > _NEGLIGIBLE * variance:
                yield 2 * math.pi * harmonic / self.resolution, size


def encoder(inst: ShortForm) -> QuantisedSensor:
    """Return the encoder of an instrument's joints, rad."""
    sensors = inst.sensors
    return QuantisedSensor(sensors.encoder_noise, sensors.encoder_range / 2**sensors.encoder_bits)


def load_cell(inst: ShortForm) -> QuantisedSensor:
    """Return an instrument's load cell, or its motor's current as tension, N."""
    return QuantisedSensor(inst.tension_sensor.noise, inst.tension_sensor.resolution)
