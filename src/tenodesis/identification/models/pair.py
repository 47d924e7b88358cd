"""Output angle of a flexible joint moved by an antagonistic sheathed pair, from command and both proximal tensions.

Two things are known of the angle. The elongation balance: the command winds one tendon in and pays the other out, less
what the tendons stretch. And the moment balance: the joint is a spring that the difference of the distal tensions
bends. The model is their weighted sum, the weights within the coefficients:

    angle = (1 + reach_per_bend bend)(ratio command - compliance d(0))
            - sheath_compliance mean(d) + bending_compliance d(1)

d(s) is the difference of the tendons' tensions a share s along the way: d(0) is measured, and behind friction it is a
stick-slip state. The tendons slip by the same length, one forward and one back, so that one state stands for both: it
stays while no bound is met, and is pushed by them,

    T1 e^(-Y s) - T2 e^(Y s) <= d(s) <= T1 e^(Y s) - T2 e^(-Y s),   Y = exponent + exponent_per_bend bend

(capstan; other friction laws have other bounds). Before the first sample the joint is at rest and straight, d = 0.
Nothing of the output angle is used but to fit.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tenodesis.errors import IdentificationError
from tenodesis.identification.formats.measured import Measured
from tenodesis.identification.laws import law_of, pass_on
from tenodesis.identification.problem import Parameter, Trace
from tenodesis.instrument import Instrument
from tenodesis.signals import Array

DEFAULT_LAW = "capstan"
SECTIONS = 6
"""Places along the sheath at which its stretch is taken."""
NOISE = math.radians(0.1)
"""Standard deviation of the output angle's sensor, rad."""

_KINEMATICS = (
    Parameter("ratio", "1", 1.0, 0.0, 5.0, "Output angle per commanded angle, with the weight of the elongation"),
    Parameter(
        "reach_per_bend", "1/rad", 0.0, -0.18, 0.18, "Growth with the bend of the share of the command that arrives"
    ),
    Parameter("antagonist_gain", "1", 1.0, 0.5, 2.0, "Gain and moment arm of the antagonist's side over the agonist's"),
)
_STIFFNESS = (
    Parameter("compliance", "rad/N", 0.05, 0.0, 1.0, "Angle lost per tension difference before the sheath"),
    Parameter("sheath_compliance", "rad/N", 0.05, 0.0, 1.0, "Angle lost per tension difference along the sheath"),
    Parameter("bending_compliance", "rad/N", 0.1, 0.0, 1.0, "Angle that the distal tension difference bends the joint"),
)
_START_EXPONENT, _START_PER_BEND = 0.5, 0.1


@dataclass(frozen=True)
class Series:
    """One run, each (n,); rad, N, rad/s."""

    time: Array
    command: Array
    agonist: Array
    antagonist: Array
    speed: Array
    output: Array
    bend: float


class _Difference(NamedTuple):
    """Tension difference behind friction, (n,), and its derivatives by friction's parameters and the gain."""

    value: Array
    slopes: Array | None


class Pair:
    """A pair with its recordings.

    Parameters
    ----------
    recordings
        With commanded_angle, output_angle, agonist_tension, antagonist_tension and a constant sheath_bend.
    law
        Friction law, a key of `tenodesis.identification.laws.LAWS`.
    sections
        Places along the sheath at which its stretch is taken.

    Raises
    ------
    IdentificationError
        There is no such law, no recording, or no section.
    """

    def __init__(self, recordings: Sequence[Measured], *, law: str = DEFAULT_LAW, sections: int = SECTIONS) -> None:
        unknowns = law_of(law)
        if not recordings:
            raise IdentificationError("train is empty; allowed is at least one recording.")
        if sections < 1:
            raise IdentificationError(f"sections is {sections}; allowed is a whole number of at least 1.")
        self.law, self.sections = law, sections
        self.runs = tuple(one.name for one in recordings)
        self._series = [_series(one) for one in recordings]
        self._magnitudes = tuple(one.name for one in unknowns.magnitudes)
        self._shapes = tuple(one.name for one in unknowns.shapes)
        friction = [
            *(part for one in unknowns.magnitudes for part in _with_bend(one)),
            *(one._replace(unit=one.unit.format(speed="rad/s")) for one in unknowns.shapes),
        ]
        # without friction the tension is the same everywhere, and only the sum of the three compliances can be told
        stiffness = _STIFFNESS if law != "none" else _STIFFNESS[:1]
        self.parameters = (*_KINEMATICS, *stiffness, *friction)
        self._names = tuple(one.name for one in self.parameters)
        self.groups = {
            "friction": tuple(one.name for one in friction),
            "stiffness": tuple(one.name for one in stiffness),
            "kinematics": tuple(one.name for one in _KINEMATICS),
        }

    def residuals(self, values: Array, run: int) -> Array:
        """Return measured minus modelled output angle, (n,), in standard deviations of its sensor."""
        return (self._series[run].output - self.output_angle(values, run)) / NOISE

    def jacobian(self, values: Array, run: int) -> Array | None:
        """Return the derivatives of the residuals, (n, parameters); None for bouc-wen, which has none exact here."""
        if self.law == "bouc-wen":
            return None
        given, series = self._given(values), self._series[run]
        reach, difference, stretch, bending = self._parts(given, series)
        gain = given["antagonist_gain"]
        entering = given["ratio"] * series.command - given["compliance"] * difference
        out = {
            "ratio": reach * series.command,
            "reach_per_bend": series.bend * entering,
            "antagonist_gain": reach * given["compliance"] * series.antagonist,
            "compliance": -reach * difference,
        }
        if stretch.slopes is not None and bending.slopes is not None:
            soft, bent = given.get("sheath_compliance", 0.0), given.get("bending_compliance", 0.0)
            out["sheath_compliance"], out["bending_compliance"] = -stretch.value, bending.value
            behind = bent * bending.slopes - soft * stretch.slopes
            names = [part for one in self._magnitudes for part in (one, _per_bend(one))]
            out |= dict(zip((*names, *self._shapes), behind[:-1], strict=True))
            out["antagonist_gain"] = out["antagonist_gain"] + behind[-1] / gain
        return np.column_stack([-out[name] / NOISE for name in self._names])

    def output_angle(self, values: Array, run: int) -> Array:
        """Return the modelled output angle, rad, (n,)."""
        given, series = self._given(values), self._series[run]
        reach, difference, stretch, bending = self._parts(given, series)
        entering = given["ratio"] * series.command - given["compliance"] * difference
        behind = given.get("bending_compliance", 0.0) * bending.value
        return np.asarray(reach * entering - given.get("sheath_compliance", 0.0) * stretch.value + behind)

    def errors(self, values: Array, run: int) -> dict[str, Array]:
        """Return measured minus modelled output angle, deg."""
        return {"output_angle_deg": np.degrees(self._series[run].output - self.output_angle(values, run))}

    def traces(self, values: Array, run: int) -> dict[str, Trace]:
        """Return measured and modelled output angle, deg."""
        series = self._series[run]
        model = np.degrees(self.output_angle(values, run))
        return {"output_angle_deg": Trace(series.time, np.degrees(series.output), model)}

    def sample_time(self, run: int) -> float:
        """Return the time between samples, s."""
        return float(np.median(np.diff(self._series[run].time)))

    def advice(self, names: Sequence[str]) -> str | None:
        """Return which recording would tell these parameters apart."""
        if any(name.endswith("_per_bend") for name in names):
            return "Record the same motion at three or more bends of the sheath, far apart."
        if set(names) & set(self.groups["friction"]):
            return "Record reversals at several amplitudes, and at a second pretension."
        return "Record the same motion with the joint held fast, which leaves the tendons' stretch alone."

    def _given(self, values: Array) -> dict[str, float]:
        return dict(zip(self._names, values.tolist(), strict=True))

    def _parts(self, given: Mapping[str, float], series: Series) -> tuple[float, Array, _Difference, _Difference]:
        """Return the share that reaches the sheath, and the tension difference before, along and behind it."""
        reach = 1 + given["reach_per_bend"] * series.bend
        difference = series.agonist - given["antagonist_gain"] * series.antagonist
        if self.law == "none":
            return reach, difference, _Difference(difference, None), _Difference(difference, None)
        places = (np.arange(self.sections) + 0.5) / self.sections
        along = [self._behind(given, series, float(place)) for place in places]
        stretch = np.mean([one.value for one in along], axis=0)
        slopes = [one.slopes for one in along if one.slopes is not None]
        mean = np.asarray(np.mean(slopes, axis=0)) if slopes else None
        return reach, difference, _Difference(stretch, mean), self._behind(given, series, 1.0)

    def _behind(self, given: Mapping[str, float], series: Series, share: float) -> _Difference:
        """Return the tension difference a share along the way."""
        friction = {name: share * (given[name] + given[_per_bend(name)] * series.bend) for name in self._magnitudes}
        friction |= {name: given[name] for name in self._shapes}
        passed = pass_on(
            self.law, friction, series.agonist, given["antagonist_gain"] * series.antagonist, speed=series.speed
        )
        if passed.slopes is None:
            return _Difference(passed.tension, None)
        count = len(self._magnitudes)
        by_magnitude = [share * factor * row for row in passed.slopes[:count] for factor in (1.0, series.bend)]
        return _Difference(passed.tension, np.array([*by_magnitude, *passed.slopes[count:]]))


def problem(train: Sequence[Measured], test: Sequence[Measured], *, law: str, instrument: Instrument | None) -> Pair:
    """Return the model with its recordings, those of train first.

    Raises
    ------
    IdentificationError
        There is no such law, no recording, or an instrument is given, which the pair is not.
    """
    if instrument is not None:
        raise IdentificationError("instrument is given; an endoscope-pair recording is of a joint without one.")
    return Pair([*train, *test], law=law)


def _per_bend(name: str) -> str:
    return f"{name}_per_bend"


def _with_bend(one: Parameter) -> tuple[Parameter, Parameter]:
    """Return a magnitude of friction at no bend and its growth with the bend."""
    start = _START_EXPONENT if one.name == "exponent" else one.start
    unit = "1/rad" if one.unit == "1" else f"{one.unit}/rad"
    return (
        one._replace(start=start, meaning=f"{one.meaning}, all along the way, sheath straight"),
        Parameter(
            _per_bend(one.name),
            unit,
            _START_PER_BEND if one.name == "exponent" else 0.1 * one.start,
            0.0,
            one.upper / 4,
            f"Growth of {one.name} with the sheath's bend",
        ),
    )


def _series(one: Measured) -> Series:
    command = one["commanded_angle"]
    return Series(
        one.time,
        command,
        np.maximum(one["agonist_tension"], 0.0),
        np.maximum(one["antagonist_tension"], 0.0),
        np.gradient(command, one.time),
        one["output_angle"],
        float(one["sheath_bend"][0]),
    )
