"""What a sensor's converter leaves of its noise and rounding: errors anew in every sample, and errors that last."""

import math
from typing import NamedTuple

from tenodesis.instrument import Instrument

_HARMONICS = 49


class Converter(NamedTuple):
    """A sensor with its converter, in the unit of its readings."""

    noise: float
    resolution: float

    @property
    def lasting(self) -> tuple[float, ...]:
        """Variance of the error that noise does not dither away, where a signal rests, by harmonic.

        Rounding comes at a random place of the converter's step (Widrow and Kollár 2008, ch. 5).
        """
        turns = [2 * math.pi * harmonic for harmonic in range(1, _HARMONICS + 1)]
        return tuple(
            2 * (self.resolution / turn) ** 2 * math.exp(-((turn * self.noise / self.resolution) ** 2))
            for turn in turns
        )

    @property
    def fresh(self) -> float:
        """Variance of the error that is another one in every sample."""
        return self.noise**2 + self.resolution**2 / 12 - sum(self.lasting)

    @property
    def deviation(self) -> float:
        """Standard deviation of a reading."""
        return math.hypot(self.noise, self.resolution / math.sqrt(12))

    def mean(self, samples: int) -> float:
        """Return the standard deviation of a mean of so many samples."""
        return math.sqrt(sum(self.lasting) + self.fresh / samples)


def encoder(inst: Instrument) -> Converter:
    """Return the encoder of an instrument's joints, rad."""
    sensors = inst.sensors
    return Converter(sensors.encoder_noise, sensors.encoder_range / 2**sensors.encoder_bits)


def load_cell(inst: Instrument) -> Converter:
    """Return an instrument's load cell, N."""
    sensors = inst.sensors
    return Converter(sensors.load_cell_noise, 2 * sensors.load_cell_range / 2**sensors.load_cell_bits)
