"""What the models of the data sets share: one reference sensor, of which a model gives the readings; friction laws.

A law says by name how a contact transmits a tendon's tension, or the tension difference of a pair. A play-type law
gives the bounds of the tension behind a contact; inside them the contact sticks and holds its tension, on them it
slides. In Bouc-Wen, a rival without contact, friction follows the tension smoothly.

| law | bounds of the tension behind | source |
|---|---|---|
| none | the tension itself | |
| coulomb | tension less and plus a constant | Coulomb |
| capstan | tension times exp of minus and plus the exponent | Euler, Eytelwein |
| capstan-constant | both of them | |
| capstan-power | capstan, its exponent falling with a power of the tension | Howell 1953 |
| stribeck | capstan, the exponent higher at rest by an excess that falls with speed | Stribeck |
| bouc-wen | none: tension less a hysteresis force | Wen 1976 |

Numbers and tensions may be complex, for derivatives by complex steps (`problem.complex_step`): where a law has to
choose, it goes by the real part.
"""

from abc import abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, Generic, NamedTuple, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from tenodesis import _core
from tenodesis.errors import IdentificationError
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.identification.problem import Parameter, Problem, Trace, complex_step
from tenodesis.instrument import ShortForm
from tenodesis.run import Array

Values: TypeAlias = NDArray[Any]
"""Real or complex numbers, (n,)."""
Given: TypeAlias = Mapping[str, Any]
"""Real or complex numbers by the names of a law's parameters."""


class Law(NamedTuple):
    """The unknowns of a friction law."""

    magnitudes: tuple[Parameter, ...]
    """How much friction there is: grows along the way and with the bend."""
    shapes: tuple[Parameter, ...]
    """How friction depends on motion, the same all along. Speed is in the model's own unit, `{speed}`."""


_friction = partial(Parameter, group="friction")
_EXPONENT = _friction("exponent", "1", 0.5, 0.0, 4.0, "Friction coefficient times wrap angle")
_CONSTANT = _friction("constant", "N", 1.0, 0.0, 20.0, "Friction that does not depend on the tension")

LAWS: Mapping[str, Law] = {
    "none": Law((), ()),
    "coulomb": Law((_CONSTANT,), ()),
    "capstan": Law((_EXPONENT,), ()),
    "capstan-constant": Law((_EXPONENT, _CONSTANT), ()),
    "capstan-power": Law(
        (_EXPONENT._replace(meaning="Friction coefficient times wrap angle at a tension of 1 N"),),
        (_friction("load_index", "1", 0.9, 0.3, 1.0, "Power of the tension that friction grows with; 1 is capstan"),),
    ),
    "stribeck": Law(
        (_EXPONENT,),
        (
            _friction("static_excess", "1", 0.1, 0.0, 3.0, "By how much friction at rest exceeds friction in motion"),
            _friction("stribeck_speed", "{speed}", 0.2, 0.01, 10.0, "Speed at which that excess has fallen to 1/e"),
        ),
    ),
    "bouc-wen": Law(
        (_friction("hysteresis_force", "N", 1.0, 0.0, 20.0, "Friction far from a reversal"),),
        (
            _friction("hysteresis_width", "N", 2.0, 0.05, 50.0, "Change of tension over which friction reverses"),
            _friction("hysteresis_shape", "1", 0.5, 0.0, 1.0, "Share of friction that a reversal meets at once (beta)"),
        ),
    ),
}

_LEAST_TENSION = 1e-9
"""Tension below which the power law treats a tendon as slack, since its exponent has no limit there."""
_SMALL = 1e-4
"""Argument below which a logarithm is computed by its series."""


def check_law(name: str, laws: Collection[str] = LAWS) -> None:
    """Raise IdentificationError if there is no such law."""
    if name not in laws:
        raise IdentificationError(key="law", value=name, allowed=f"one of {', '.join(laws)}")


def pass_on(
    name: str,
    given: Given,
    tension: Values,
    against: Values | None = None,
    *,
    speed: Array | None = None,
    start: float = 0.0,
) -> Values:
    """Return the tension behind a contact, or the tension difference of a pair that moves as one, N.

    The tendons of a pair slip by the same length, one forward and one back: the contact holds their difference between
    the least of the agonist less the most of the antagonist and the most less the least.

    Tension, and that of the antagonist if there is one (`against`), are before the contact, N, (n,); `start` is behind
    it before the first sample, N. Only stribeck needs the speed of the motion, (n,). Raises IdentificationError if
    there is no such law.
    """
    check_law(name)
    if name == "bouc-wen":
        moved = tension if against is None else tension - against
        shape = (given[one] for one in ("hysteresis_width", "hysteresis_shape"))
        return np.asarray(moved - given["hysteresis_force"] * hysteresis(moved, *shape))
    least, most = band(name, given, tension, speed=speed)
    if against is not None:
        lower, upper = band(name, given, against, speed=speed)
        least, most = least - upper, most - lower
    return held(least, most, start)


def band(
    name: str, given: Given, tension: Values, *, speed: Array | None = None, slack: bool = True
) -> tuple[Values, Values]:
    """Return the least and the most tension that a contact of a play-type law can hold behind it.

    Only stribeck needs the speed of the motion. With `slack` no bound is below zero: a tendon cannot push.
    """
    found = []
    for sign in (-1.0, 1.0):
        bound = tension
        if name == "capstan-power":
            bound = _power(tension, sign * given["exponent"], 1 - given["load_index"])
        elif "exponent" in given:
            bound = tension * np.exp(sign * given["exponent"] * _pace(given, speed))
        bound = bound + sign * given.get("constant", 0.0)
        found.append(np.where(bound.real > 0, bound, 0.0) if slack else bound)
    return found[0], found[1]


def held(lower: Values, upper: Values, start: Any) -> Values:
    """Return a play element (stick-slip): constant until a bound pushes it, from its value before the first sample."""
    count = lower.size
    source = np.empty(count, dtype=np.int64)
    _core.play(np.ascontiguousarray(lower.real), np.ascontiguousarray(upper.real), float(np.real(start)), source)
    # where each sample stands among: the start, all lower bounds, all upper bounds
    place = np.where(source < 0, -source, np.where(source > 0, source + count, 0))
    return np.concatenate([[start], lower, upper])[place]


def hysteresis(moved: Values, width: Any, beta: Any, start: Any = 0.0) -> Values:
    """Return friction relative to full sliding friction: Wen 1976 with exponent 1 and beta + gamma = 1.

    Solved exactly within each step. Friction follows what has moved, a tension or an angle: it reverses over its
    `width`, and a reversal meets a share `beta` of it at once; `start` is its value before the first step.
    """
    steps = np.diff(moved)
    signs = np.copysign(1.0, steps.real)
    ways = signs * steps / width
    found = [start]
    # by whether a step goes against the friction before it, or with it
    rates = (2 * beta - 1, 1.0)
    kept, grown = zip(*((np.exp(-rate * ways), _grown(rate, ways)) for rate in rates), strict=True)
    choices = zip(signs.tolist(), *(one.tolist() for one in (*kept, *grown)), strict=True)
    for sign, *(kept_against, kept_along, grown_against, grown_along) in choices:
        against = found[-1].real * sign <= 0
        found.append(
            (kept_against if against else kept_along) * found[-1] + sign * (grown_against if against else grown_along)
        )
    return np.array(found)


def _grown(rate: Any, ways: Values) -> Values:
    """Return (1 - exp(-rate way)) / rate, by its series where that is small."""
    small = np.abs(rate * ways) < _SMALL
    safe = np.where(small, 1.0, rate)
    series = ways * (1 - rate * ways / 2 * (1 - rate * ways / 3))
    return np.asarray(np.where(small, series, -np.expm1(-safe * ways) / safe))


def _pace(given: Given, speed: Array | None) -> Any:
    """Return friction over that in motion."""
    if "static_excess" not in given or speed is None:
        return 1.0
    return 1.0 + given["static_excess"] * np.exp(-((speed / given["stribeck_speed"]) ** 2))


def _power(tension: Values, exponent: Any, less: Any) -> Values:
    """Return a tension behind a contact whose friction grows with its power 1 - `less`.

    dT/ds = exponent T^(1 - less) over the way, solved from one end to the other:
    T^less = T(0)^less + less exponent. At less = 0 it is Euler's.
    """
    taut = np.where(tension.real > _LEAST_TENSION, tension, _LEAST_TENSION)
    grade = exponent * np.exp(-less * np.log(taut))
    # log(1 + less grade) / less, which stands for the exponent
    share = less * grade
    ends = share.real <= -1
    share = np.where(ends, 0.0, share)
    small = np.abs(share) < _SMALL
    safe = np.where(small, 1.0, less)
    over = np.where(small, grade * (1 - share / 2 + share**2 / 3), np.log1p(share) / safe)
    return np.asarray(np.where(ends, 0.0, taut * np.exp(over)))


@dataclass(frozen=True, kw_only=True)
class ReferenceSeries:
    """What a model reads of a run, and the reference that it is compared with, each (n,)."""

    time: Array
    """s."""
    reference: Array
    first: int = 0
    """Sample from which on errors count."""


_Series = TypeVar("_Series", bound=ReferenceSeries)
_Problem = TypeVar("_Problem", bound=Problem)


class ReferenceProblem(Problem, Generic[_Series]):
    """A model of one reference sensor, with its recordings as they are fitted and in full."""

    key: ClassVar[str]
    """Name of the errors, their unit last."""
    scale: ClassVar[float] = 1.0
    """Of that unit, per SI unit."""
    noise: ClassVar[float]
    """Standard deviation of the reference sensor, SI."""
    fitted: Sequence[_Series]
    full: Sequence[_Series]

    def __init__(
        self,
        train: Sequence[MeasuredRun],
        test: Sequence[MeasuredRun],
        *,
        law: str,
        laws: Collection[str] = LAWS,
        **numbers: int,
    ) -> None:
        """Check law and numbers of pieces, and that there are recordings to train on; raises IdentificationError."""
        check_law(law, laws)
        for name, number in numbers.items():
            if number < 1:
                raise IdentificationError(key=name, value=number, allowed="an integer of at least 1")
        if not train:
            raise IdentificationError("train is empty; it must hold at least one recording.", key="train")
        self.law = law
        self.runs = tuple(one.name for one in (*train, *test))

    def given(self, values: Values, series: _Series) -> dict[str, Any]:
        """Return the parameters by name as they are for a run."""
        return dict(zip((one.name for one in self.parameters), values, strict=True))

    @abstractmethod
    def modelled(self, values: Values, series: _Series) -> Values:
        """Return the reference by the model, (n,); it is complex where values are, for exact derivatives."""

    def predict(self, values: Array, run: int) -> Array:
        """Return the modelled reference at all samples, (n,), by nothing but the run's proximal signals."""
        return self.modelled(values, self.full[run])

    def residuals(self, values: Array, run: int) -> Array:
        """Return measured minus modelled reference, (n,), in standard deviations of its sensor."""
        return self._errors(values, self.fitted[run]) / self.noise

    def jacobian(self, values: Array, run: int) -> Array:
        """Return the derivatives of the residuals, (n, parameters)."""
        series = self.fitted[run]
        return -complex_step(lambda at: self.modelled(at, series)[series.first :], values) / self.noise

    def errors(self, values: Array, run: int) -> dict[str, Array]:
        """Return measured minus modelled reference at all samples that count."""
        return {self.key: self.scale * self._errors(values, self.full[run])}

    def traces(self, values: Array, run: int) -> dict[str, Trace]:
        """Return measured and modelled reference at all samples that count."""
        series = self.full[run]
        measured = series.reference[series.first :]
        model = measured - self._errors(values, series)
        return {self.key: Trace(series.time[series.first :], self.scale * measured, self.scale * model)}

    def sample_time(self, run: int) -> float:
        """Return the time between the samples that are fitted, s."""
        series = self.fitted[run]
        return float(np.median(np.diff(series.time[series.first :])))

    def _errors(self, values: Array, series: _Series) -> Array:
        return (series.reference - self.modelled(values, series))[series.first :]


def without_instrument(model: Callable[..., _Problem], recorded: str) -> Callable[..., _Problem]:
    """Return how recordings become a model that refuses an instrument, of which `recorded` says why it has none."""

    def problem(
        train: Sequence[MeasuredRun], test: Sequence[MeasuredRun], *, law: str, instrument: ShortForm | None
    ) -> _Problem:
        if instrument is not None:
            raise IdentificationError(f"instrument is given; it must be left out: {recorded}.", key="instrument")
        return model(train, test, law=law)

    return problem
