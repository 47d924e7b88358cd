"""Distal tension of one sheathed tendon from the proximal one: a friction law, and the gain between the two load cells.

The far end is held, so that its tension stays while the sheath sticks: distal = gain * (what the law passes on).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tenodesis.errors import IdentificationError
from tenodesis.identification.dual import Dual, unknowns
from tenodesis.identification.formats.measured import Measured
from tenodesis.identification.laws import law_of, pass_on
from tenodesis.identification.problem import Parameter, Trace
from tenodesis.identification.uncertainty import LossName
from tenodesis.instrument import Instrument
from tenodesis.run import Array

DEFAULT_LAW = "capstan-power"
DEFAULT_LOSS: LossName = "soft_l1"
"""The far end is let go and drawn by hand at times: there the model has no part in what the distal cell shows."""
NOISE = 0.02
"""Standard deviation of the distal load cell, N."""

_GAIN = Parameter("gain", "1", 1.0, 0.3, 2.0, "Gain of the distal load cell over the proximal one")


@dataclass(frozen=True)
class Series:
    """One run, each (n,); s, N, N/s."""

    time: Array
    proximal: Array
    rate: Array
    distal: Array


class Sheath:
    """A sheathed tendon with its recordings.

    Parameters
    ----------
    recordings
        With proximal_tension and distal_tension.
    law
        Friction law, a key of `tenodesis.identification.laws.LAWS`.

    Raises
    ------
    IdentificationError
        There is no such law, or no recording.
    """

    def __init__(self, recordings: Sequence[Measured], *, law: str = DEFAULT_LAW) -> None:
        found = law_of(law)
        if not recordings:
            raise IdentificationError("train is empty; allowed is at least one recording.")
        self.law = law
        self.runs = tuple(one.name for one in recordings)
        self._series = [_series(one) for one in recordings]
        friction = [
            *found.magnitudes,
            *(_in_unit(one, self._series[0].rate) for one in found.shapes),
        ]
        self.parameters = (_GAIN, *friction)
        self._names = tuple(one.name for one in self.parameters)
        self.groups = {"friction": tuple(one.name for one in friction), "stiffness": (), "kinematics": ("gain",)}

    def residuals(self, values: Array, run: int) -> Array:
        """Return measured minus modelled distal tension, (n,), in standard deviations of its load cell."""
        return (self._series[run].distal - self.distal_tension(values, run)) / NOISE

    def jacobian(self, values: Array, run: int) -> Array:
        """Return the derivatives of the residuals, (n, parameters)."""
        return np.ascontiguousarray(-self._model(values, run, exact=True).slopes.T / NOISE)

    def distal_tension(self, values: Array, run: int) -> Array:
        """Return what the distal load cell would show, N, (n,)."""
        return self._model(values, run, exact=False).value

    def errors(self, values: Array, run: int) -> dict[str, Array]:
        """Return measured minus modelled distal tension, N."""
        return {"tension_N": self._series[run].distal - self.distal_tension(values, run)}

    def traces(self, values: Array, run: int) -> dict[str, Trace]:
        """Return measured and modelled distal tension, N."""
        series = self._series[run]
        return {"tension_N": Trace(series.time, series.distal, self.distal_tension(values, run))}

    def sample_time(self, run: int) -> float:
        """Return the time between samples, s."""
        return float(np.median(np.diff(self._series[run].time)))

    def advice(self, names: Sequence[str]) -> str | None:
        """Return which recording would tell these parameters apart."""
        if "gain" in names:
            return "Pull and release far enough that the tendon slides both ways: the band's two edges tell the gain."
        return "Record reversals at several tensions, the highest several times the lowest."

    def _model(self, values: Array, run: int, *, exact: bool) -> Dual:
        given, series = unknowns(self._names, values, exact=exact), self._series[run]
        start = float(series.proximal[0])
        return given["gain"] * pass_on(self.law, given, series.proximal, speed=series.rate, start=start)


def problem(train: Sequence[Measured], test: Sequence[Measured], *, law: str, instrument: Instrument | None) -> Sheath:
    """Return the model with its recordings, those of train first.

    Raises
    ------
    IdentificationError
        There is no such law, no recording, or an instrument is given, which the sheath is not.
    """
    if instrument is not None:
        raise IdentificationError("instrument is given; a tendon-sheath recording is of a tendon without one.")
    return Sheath([*train, *test], law=law)


def _in_unit(one: Parameter, rate: Array) -> Parameter:
    """Return a parameter in the sheath's unit of speed, N/s, a speed starting at the usual one of a recording."""
    if "{speed}" not in one.unit:
        return one
    usual = float(np.clip(np.median(np.abs(rate)), one.lower, one.upper))
    return one._replace(unit=one.unit.format(speed="N/s"), start=usual)


def _series(one: Measured) -> Series:
    proximal = np.maximum(one["proximal_tension"], 0.0)
    return Series(one.time, proximal, np.gradient(proximal, one.time), one["distal_tension"])
