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

import numpy as np

from tenodesis.errors import IdentificationError
from tenodesis.identification.dual import Dual, Operand, number, unknowns
from tenodesis.identification.formats.measured import Measured
from tenodesis.identification.laws import law_of, pass_on
from tenodesis.identification.problem import Parameter, Trace
from tenodesis.instrument import Instrument
from tenodesis.run import Array

DEFAULT_LAW = "capstan"
SECTIONS = 6
"""Places along the sheath at which its stretch is taken."""
NOISE = math.radians(0.1)
"""Standard deviation of the output angle's sensor, rad."""

_KINEMATICS = (
    Parameter("ratio", "1", 1.0, 0.3, 3.0, "Output angle per commanded angle, with the weight of the elongation"),
    Parameter(
        "reach_per_bend", "1/rad", 0.0, -0.18, 0.18, "Growth with the bend of the share of the command that arrives"
    ),
    Parameter(
        "antagonist_gain", "1", 1.0, 2 / 3, 1.5, "Gain and moment arm of the antagonist's side over the agonist's"
    ),
)
_STIFFNESS = (
    Parameter("compliance", "rad/N", 0.05, 0.0, 1.0, "Angle lost per tension difference before the sheath"),
    Parameter("sheath_compliance", "rad/N", 0.05, 0.0, 1.0, "Angle lost per tension difference along the sheath"),
    Parameter("bending_compliance", "rad/N", 0.1, 0.0, 1.0, "Angle that the distal tension difference bends the joint"),
)
_PER_BEND = "_per_bend"
_START_EXPONENT, _START_PER_BEND = 0.5, 0.1
_MOST_EXPONENT, _MOST_PER_BEND = 1.5, 0.3
"""With more, next to nothing passes, and a search finds no way back."""


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
    trained
        How many of the recordings, the first ones, are fitted; all unless told. Whether anything may grow with the
        bend is told by theirs.

    Raises
    ------
    IdentificationError
        There is no such law, no recording, or no section.
    """

    def __init__(
        self,
        recordings: Sequence[Measured],
        *,
        law: str = DEFAULT_LAW,
        sections: int = SECTIONS,
        trained: int | None = None,
    ) -> None:
        found = law_of(law)
        if not recordings:
            raise IdentificationError("train is empty; allowed is at least one recording.")
        if sections < 1:
            raise IdentificationError(f"sections is {sections}; allowed is a whole number of at least 1.")
        self.law, self.sections = law, sections
        self.runs = tuple(one.name for one in recordings)
        self._series = [_series(one) for one in recordings]
        self._magnitudes = tuple(one.name for one in found.magnitudes)
        self._shapes = tuple(one.name for one in found.shapes)
        # at one bend only, nothing is told of how anything grows with it
        self._bends = len({one.bend for one in self._series[:trained]}) > 1
        kinematics = tuple(one for one in _KINEMATICS if self._bends or not one.name.endswith(_PER_BEND))
        friction = [
            *(part for one in found.magnitudes for part in _with_bend(one, several=self._bends)),
            *(one._replace(unit=one.unit.format(speed="rad/s")) for one in found.shapes),
        ]
        # without friction the tension is the same everywhere, and only the sum of the three compliances can be told
        stiffness = _STIFFNESS if law != "none" else _STIFFNESS[:1]
        self.parameters = (*kinematics, *stiffness, *friction)
        self._names = tuple(one.name for one in self.parameters)
        self.groups = {
            "friction": tuple(one.name for one in friction),
            "stiffness": tuple(one.name for one in stiffness),
            "kinematics": tuple(one.name for one in kinematics),
        }

    def residuals(self, values: Array, run: int) -> Array:
        """Return measured minus modelled output angle, (n,), in standard deviations of its sensor."""
        return (self._series[run].output - self.output_angle(values, run)) / NOISE

    def jacobian(self, values: Array, run: int) -> Array:
        """Return the derivatives of the residuals, (n, parameters)."""
        return np.ascontiguousarray(-self._model(values, run, exact=True).slopes.T / NOISE)

    def output_angle(self, values: Array, run: int) -> Array:
        """Return the modelled output angle, rad, (n,)."""
        return self._model(values, run, exact=False).value

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
        if any(name.endswith(_PER_BEND) for name in names):
            return "Record the same motion at three or more bends of the sheath, far apart."
        if set(names) & set(self.groups["friction"]):
            return "Record reversals at several amplitudes, and at a second pretension."
        return "Record the same motion with the joint held fast, which leaves the tendons' stretch alone."

    def _model(self, values: Array, run: int, *, exact: bool) -> Dual:
        given, series = unknowns(self._names, values, exact=exact), self._series[run]
        reach = 1 + given.get("reach_per_bend", number(0.0)) * series.bend
        antagonist = given["antagonist_gain"] * series.antagonist
        entering = given["ratio"] * series.command - given["compliance"] * (series.agonist - antagonist)
        if self.law == "none":
            return reach * entering
        places = (np.arange(self.sections) + 0.5) / self.sections
        along = [self._behind(given, series, antagonist, float(place)) for place in places]
        stretch = sum(along[1:], along[0]) * (1 / self.sections)
        bent = given["bending_compliance"] * self._behind(given, series, antagonist, 1.0)
        return reach * entering - given["sheath_compliance"] * stretch + bent

    def _behind(self, given: Mapping[str, Dual], series: Series, antagonist: Dual, share: float) -> Dual:
        """Return the tension difference a share along the way."""
        friction: dict[str, Operand] = {
            name: share * (given[name] + given.get(_per_bend(name), number(0.0)) * series.bend)
            for name in self._magnitudes
        }
        friction |= {name: given[name] for name in self._shapes}
        return pass_on(self.law, friction, number(series.agonist), antagonist, speed=series.speed)


def problem(train: Sequence[Measured], test: Sequence[Measured], *, law: str, instrument: Instrument | None) -> Pair:
    """Return the model with its recordings, those of train first.

    Raises
    ------
    IdentificationError
        There is no such law, no recording, or an instrument is given, which the pair is not.
    """
    if instrument is not None:
        raise IdentificationError("instrument is given; an endoscope-pair recording is of a joint without one.")
    return Pair([*train, *test], law=law, trained=len(train))


def _per_bend(name: str) -> str:
    return f"{name}{_PER_BEND}"


def _with_bend(one: Parameter, *, several: bool) -> tuple[Parameter, ...]:
    """Return a magnitude of friction, with several bends that at none and its growth with the bend."""
    capstan = one.name == "exponent"
    where = "sheath straight" if several else "at the recordings' bend"
    own = one._replace(
        start=_START_EXPONENT if capstan else one.start,
        upper=_MOST_EXPONENT if capstan and several else one.upper,
        meaning=f"{one.meaning}, all along the way, {where}",
    )
    growth = Parameter(
        _per_bend(one.name),
        "1/rad" if one.unit == "1" else f"{one.unit}/rad",
        _START_PER_BEND if capstan else 0.1 * one.start,
        0.0,
        _MOST_PER_BEND if capstan else one.upper / 4,
        f"Growth of {one.name} with the sheath's bend",
    )
    return (own, growth) if several else (own,)


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
