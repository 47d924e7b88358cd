"""A flexible endoscopic manipulator's joint moved by an antagonistic sheathed pair of tendons: its files and its model.

Baek, Nho et al., ViO-Com, IEEE RA-L 2021. A text file without column names whose name has the sheath's bend in degrees.
The output angle is the reference: a model may use it for fitting only.

The model gives the output angle from the command and both proximal tensions, by two balances. The elongation balance:
the command winds one tendon in and pays the other out, less what the tendons stretch. The moment balance: the joint is
a spring that the difference of the distal tensions bends. The model is their weighted sum, the weights within the
coefficients:

    angle = (1 + reach_per_bend bend)(ratio command - compliance d(0))
            - sheath_compliance mean(d) + bending_compliance d(1)

d(s) is the difference of the tendons' tensions a share s along the way: d(0) is measured, and behind friction it is a
stick-slip state. The tendons slip by the same length, one forward and one back, so that one state stands for both: it
stays while no bound is met, and is pushed by them,

    T1 e^(-Y s) - T2 e^(Y s) <= d(s) <= T1 e^(Y s) - T2 e^(-Y s),   Y = exponent + exponent_per_bend bend

(capstan; other friction laws have other bounds). Before the first sample the joint is at rest and straight, d = 0.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from tenodesis.errors import IdentificationError
from tenodesis.identification.datasets.reference import (
    LAWS,
    Given,
    ReferenceProblem,
    ReferenceSeries,
    Values,
    pass_on,
    without_instrument,
)
from tenodesis.identification.formats.csv import read_rows
from tenodesis.identification.formats.measured import GRAM_FORCE, MeasuredRun, Raw, Source, Unit, checksum, spread_of
from tenodesis.identification.problem import Parameter
from tenodesis.identification.registry import Format
from tenodesis.run import Array

# The files.

COLUMNS = 6
MOST_BEND = 1080.0
"""Highest bend that a file's name may say, deg."""

_LEAST_ANGLE = math.radians(2)
_LEAST_TENSION = 0.2
_TENSION_JUMP = 2.0
"""Off the rows around, N: the fastest release falls by less in 25 ms."""
_ANGLE_JUMP = math.radians(10)

SOURCE = Source(
    repository="nhoyh/hysteresis_compensation_ROS",
    commit="7c00843fba4d03cbe67da9244237019a9057799e",
    folder="optimization/selected",
    licence="none stated: for local verification only, not to be copied or passed on",
    citation="Baek, Nho et al., ViO-Com, IEEE RA-L 2021",
    checksums={
        "0.txt": "a84927e587796bd5a7e9e0cc3d198d253e6cd301d405cf93ee78b4019b1ad335",
        "60.txt": "603d77e47baafe9940a544b0fe9934df8b4829de1d74408aedfd741703d74657",
        "120.txt": "ac08e929f6702ea3dfa8ce050a1eed079bcb85d5810d7b1c218a17ee874d1a68",
        "180.txt": "1cf8517d9e3833dfa1d362a0dbacaa5e9fc7ef53da253c9cc430f7bc2b1d9cbc",
        "240.txt": "fe219e0106a4de75882869e6e23ceda84478fe63279de12716475d46c1f2d4a3",
    },
)


def load(path: Path) -> MeasuredRun:
    """Return a recording of the pair.

    Columns: commanded_angle, output_angle (rad), agonist_tension, antagonist_tension (N), and the bend of the file's
    name as sheath_bend (rad). Rows of the same time are what sensors read while the clock was held: their mean is
    taken.

    Raises IdentificationError if the file cannot be read, its name is no bend, its units fit none that are known, or
    its samples cannot be used.
    """
    bend = _bend(path)
    rows = read_rows(path, COLUMNS)
    raw = Raw(
        path.name,
        rows[:, 0],
        {
            "commanded_angle": rows[:, 1],
            "output_angle": rows[:, 3],
            "agonist_tension": rows[:, 4],
            "antagonist_tension": rows[:, 5],
        },
    )
    raw.finite()
    raw.enough()
    _to_si(raw)
    _without_outliers(raw)
    raw.averaged()
    raw.clock()
    # a value that the sensor held for all rows of one time is an outlier among the means only
    _without_outliers(raw)
    for column in _TENSIONS:
        raw.saturated(column, may_rest_at_zero=True)
    raw.tension(*_TENSIONS)
    raw.frozen(("output_angle",), "commanded_angle")
    raw.frozen(_TENSIONS, "commanded_angle", may_rest_at_zero=True)
    raw.enough()
    raw.gaps()
    raw.columns["sheath_bend"] = np.full(raw.time.size, math.radians(bend))
    raw.note(f"sheath bend {bend:g} deg, from the file's name")
    sha = checksum(path)
    published = SOURCE.published(sha)
    if published is not None and _bend(Path(published)) != bend:
        raw.note(
            f"the file's name gives a sheath bend of {bend:g} deg, but its bytes are those published as {published}, "
            f"of {_bend(Path(published)):g} deg"
        )
    return raw.done(SOURCE, sha)


def _to_si(raw: Raw) -> None:
    own = raw.unit(_ANGLE, "commanded_angle", advice="write it in deg")
    raw.excited("commanded_angle", _LEAST_ANGLE, "rad")
    # the output is most likely in the command's unit, and in another only where it then moves little more than that
    commanded = spread_of(raw.columns["commanded_angle"])
    units = [
        one._replace(least=_LEAST_ANGLE / one.scale)
        if one.name == own
        else one._replace(most=_MOST_RATIO * commanded / one.scale)
        for one in sorted(_ANGLE, key=lambda one: one.name != own)
    ]
    raw.unit(units, "output_angle", advice="write it in deg")
    raw.excited("output_angle", _LEAST_ANGLE, "rad")
    raw.unit(_TENSION, *_TENSIONS, advice="write both in N")
    for column in _TENSIONS:
        raw.excited(column, _LEAST_TENSION, "N")


def _without_outliers(raw: Raw) -> None:
    for column in raw.columns:
        raw.outliers(column, _TENSION_JUMP if column in _TENSIONS else _ANGLE_JUMP)


def _bend(path: Path) -> float:
    """Return the only number in a file's name that can be the bend: marked as such, or separate from other text."""
    # what follows a dot is an extension unless it is the rest of a number
    stem = path.name if re.match(r"\.\d", path.suffix) else path.stem
    name = _COPY.sub("", stem)
    marked = [before or behind for before, behind in _MARKED.findall(name)]
    alone = [part for part in _BETWEEN.split(name) if _NUMBER.fullmatch(part)]
    found = marked or alone
    advice = f"it must hold one number from 0 to {MOST_BEND:g}, in degrees, such as 120.txt or bend120_day2.txt"
    if len(set(map(float, found))) > 1:
        raise IdentificationError(
            f"{path.name}: the name {stem!r} leaves open which number is the sheath's bend; {advice}",
            key="path",
            value=path,
            allowed=advice,
        )
    if not found or not 0 <= float(found[0]) <= MOST_BEND:
        raise IdentificationError(
            f"{path.name}: the name {stem!r} is no sheath bend; {advice}", key="path", value=path, allowed=advice
        )
    return float(found[0])


_TENSIONS = ("agonist_tension", "antagonist_tension")
_MOST_RATIO = 1.2
"""Ratio of the output's motion to the command's above which they are in different units."""
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
_MARKED = re.compile(
    r"(?:bend(?:ing)?|sheath)[\s_=-]*(\d+(?:\.\d+)?)|(\d+(?:\.\d+)?)(?:bend|[\s_-]*(?:deg|°))", re.IGNORECASE
)
_COPY = re.compile(r"\s*\(\d+\)$")
_BETWEEN = re.compile(r"[\s_,;]+|(?<=[^\s_,;])-")

_ANGLE = (
    Unit("deg", math.radians(1), 5, 400),
    Unit("rad", 1.0, _LEAST_ANGLE, 4.9, integer=False),
)
_TENSION = (
    Unit("N", 1.0, _LEAST_TENSION, 100),
    # no range in which these two could be taken for N; where they could be for one another neither is
    Unit("gram-force", GRAM_FORCE, 1.5 / GRAM_FORCE, 60 / GRAM_FORCE),
    Unit("mN", 1e-3, 1500, 60e3),
)


# The model.

DEFAULT_LAW = "capstan"
SECTIONS = 6
"""Places along the sheath at which its stretch is taken."""
NOISE = math.radians(0.1)
"""Standard deviation of the output angle's sensor, rad."""

_kinematic = partial(Parameter, group="kinematics")
_elastic = partial(Parameter, group="stiffness")
_KINEMATICS = (
    _kinematic("ratio", "1", 1.0, 0.3, 3.0, "Output angle per commanded angle, with the weight of the elongation"),
    _kinematic(
        "reach_per_bend", "1/rad", 0.0, -0.18, 0.18, "Growth with the bend of the share of the command that arrives"
    ),
    _kinematic(
        "antagonist_gain", "1", 1.0, 2 / 3, 1.5, "Gain and moment arm of the antagonist's side over the agonist's"
    ),
)
_STIFFNESS = (
    _elastic("compliance", "rad/N", 0.05, 0.0, 1.0, "Angle lost per tension difference before the sheath"),
    _elastic("sheath_compliance", "rad/N", 0.05, 0.0, 1.0, "Angle lost per tension difference along the sheath"),
    _elastic("bending_compliance", "rad/N", 0.1, 0.0, 1.0, "Angle that the distal tension difference bends the joint"),
)
_PER_BEND = "_per_bend"
_START_EXPONENT, _START_PER_BEND = 0.5, 0.1
_MOST_EXPONENT, _MOST_PER_BEND = 1.5, 0.3
"""With more, next to nothing passes, and a search finds no way back."""


@dataclass(frozen=True, kw_only=True)
class EndoscopeSeries(ReferenceSeries):
    """A run with its output angle, each (n,); rad, N, rad/s."""

    command: Array
    agonist: Array
    antagonist: Array
    speed: Array
    bend: float


class EndoscopePair(ReferenceProblem[EndoscopeSeries]):
    """A pair with its recordings of commanded_angle, output_angle, both tensions and a constant sheath_bend.

    The law is a key of `LAWS`; the sheath's stretch is taken at so many `sections` along it. Parameters may grow with
    the bend where those of `train` differ. Raises IdentificationError if there is no such law, recording or section.
    """

    key, scale, noise = "output_angle_deg", math.degrees(1), NOISE

    def __init__(
        self,
        train: Sequence[MeasuredRun],
        test: Sequence[MeasuredRun] = (),
        *,
        law: str = DEFAULT_LAW,
        sections: int = SECTIONS,
    ) -> None:
        super().__init__(train, test, law=law, sections=sections)
        self.sections, found = sections, LAWS[law]
        self.full = self.fitted = [_series(one) for one in (*train, *test)]
        self._magnitudes = tuple(one.name for one in found.magnitudes)
        self._shapes = tuple(one.name for one in found.shapes)
        # at one bend only, growth with the bend is not identifiable
        self._bends = len({one.bend for one in self.fitted[: len(train)]}) > 1
        kinematics = tuple(one for one in _KINEMATICS if self._bends or not one.name.endswith(_PER_BEND))
        friction = [
            *(part for one in found.magnitudes for part in _with_bend(one, several=self._bends)),
            *(one._replace(unit=one.unit.format(speed="rad/s")) for one in found.shapes),
        ]
        # without friction the tension is the same everywhere, and only the sum of the three compliances is identifiable
        stiffness = _STIFFNESS if law != "none" else _STIFFNESS[:1]
        self.parameters = (*kinematics, *stiffness, *friction)

    def advice(self, names: Sequence[str]) -> str | None:
        """Return which recording would make these parameters identifiable."""
        if any(name.endswith(_PER_BEND) for name in names):
            return "Record the same motion at three or more bends of the sheath, far apart."
        if set(names) & set(self.groups["friction"]):
            return "Record reversals at several amplitudes, and at a second pretension."
        return "Record the same motion with the joint held fast, which leaves the tendons' stretch alone."

    def modelled(self, values: Values, series: EndoscopeSeries) -> Values:
        """Return the output angle by the model, (n,), rad."""
        given = self.given(values, series)
        reach = 1 + given.get("reach_per_bend", 0.0) * series.bend
        antagonist = given["antagonist_gain"] * series.antagonist
        entering = given["ratio"] * series.command - given["compliance"] * (series.agonist - antagonist)
        if self.law == "none":
            return np.asarray(reach * entering)
        places = (np.arange(self.sections) + 0.5) / self.sections
        stretch = sum(self._behind(given, series, antagonist, place) for place in places.tolist()) / self.sections
        bent = given["bending_compliance"] * self._behind(given, series, antagonist, 1.0)
        return np.asarray(reach * entering - given["sheath_compliance"] * stretch + bent)

    def _behind(self, given: Given, series: EndoscopeSeries, antagonist: Values, share: float) -> Values:
        """Return the tension difference a share along the way."""
        friction = {
            name: share * (given[name] + given.get(_per_bend(name), 0.0) * series.bend) for name in self._magnitudes
        }
        friction |= {name: given[name] for name in self._shapes}
        return pass_on(self.law, friction, series.agonist, antagonist, speed=series.speed)


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
        one.group,
    )
    return (own, growth) if several else (own,)


def _series(one: MeasuredRun) -> EndoscopeSeries:
    command = one["commanded_angle"]
    return EndoscopeSeries(
        time=one.time,
        reference=one["output_angle"],
        command=command,
        agonist=np.maximum(one["agonist_tension"], 0.0),
        antagonist=np.maximum(one["antagonist_tension"], 0.0),
        speed=np.gradient(command, one.time),
        bend=float(one["sheath_bend"][0]),
    )


problem = without_instrument(EndoscopePair, "an endoscope-pair recording is of a joint without one")
FORMAT = Format(load, problem, laws=tuple(LAWS), law=DEFAULT_LAW)
