"""A tool's jaw angle from what its spindle tells: angle and torque, through an elastic transmission with friction.

The transmission is a tendon that is evenly elastic and rubs evenly along its way, cut into n equal pieces. Each contact
passes the torque on within its friction band and holds it inside (stick-slip); between contacts the tendon stretches.
With u[i] the torque past contact i, p the pretension and h the friction exponent, T = u + p is the tendon's tension
times the spindle's radius (Euler, Eytelwein):

    u[0]    slides on   torque -+ spindle friction              load-independent, at the spindle's bearing
    u[i]    slides on   (u[i-1] + p) e^(-+h/n) - p              and T ends at zero: a tendon cannot push
    jaw   = offset +- (ratio spindle + compliance mean(u))      mean by the trapezoidal rule

Nothing of the jaw is used but to fit.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from tenodesis import _core
from tenodesis.errors import IdentificationError
from tenodesis.identification.formats.measured import Measured
from tenodesis.identification.problem import Parameter, Trace
from tenodesis.instrument import Instrument
from tenodesis.signals import Array

DEFAULT_LAW = "capstan-constant"
CONTACTS = 8
"""Contacts that the transmission is cut into."""
SETTLING = 2.0
"""Time from the start in which the bench settles, s: the model runs through it, and no error is taken in it."""
INTERVAL = 0.01
"""Mean over which torque is smoothed, and the interval of the samples that are fitted, s."""
NOISE = 2 * math.pi / 4000 / math.sqrt(12)
"""Standard deviation of the jaw's encoder, rad: that of rounding to its 4000 counts."""

Offset: TypeAlias = Literal["shared", "run"]

_LEVEL_SPAN = 0.2
"""Time from the start whose mean torque friction is taken to have held before, s: the drive starts with a kick."""
_SPEED_SPAN = 0.1
"""Time over which the spindle's speed is taken, s."""
_LEAST = 200

_KINEMATICS = (
    Parameter("offset", "rad", 0.0, -50.0, 50.0, "Jaw angle at spindle angle zero without torque, common to all runs"),
    Parameter("ratio", "1", 1.0, 0.1, 5.0, "Jaw angle per spindle angle without torque"),
    Parameter("compliance", "rad/(N*m)", 1.0, 0.0, 20.0, "Jaw angle lost per torque all along the transmission"),
)
_START = Parameter(
    "start", "1", 0.2, 0.0, 1.0, "Where in its band friction holds as a run begins: 0 lower, 1 upper bound"
)
_BEARING = Parameter("spindle_friction", "N*m", 0.01, 0.0, 0.1, "Load-independent friction at the spindle")
_CAPSTAN = (
    Parameter("friction_exponent", "1", 0.5, 0.0, 3.0, "Friction coefficient times wrap angle all along the tendon"),
    Parameter("pretension", "N*m", 0.05, 0.0, 0.25, "Pretension of the tendon times the spindle's radius"),
)
_STRIBECK = (
    Parameter("static_excess", "1", 0.1, 0.0, 3.0, "By how much friction at rest exceeds friction in motion"),
    Parameter("stribeck_speed", "rad/s", 0.1, 0.005, 3.0, "Spindle speed at which that excess has fallen to 1/e"),
)
LAWS: Mapping[str, tuple[Parameter, ...]] = {
    "none": (),
    "coulomb": (
        _START,
        _BEARING,
        Parameter("sliding_friction", "N*m", 0.05, 0.0, 0.5, "Load-independent friction all along the tendon"),
    ),
    "capstan": (_START, *_CAPSTAN),
    "capstan-constant": (_START, _BEARING, *_CAPSTAN),
    "stribeck": (_START, _BEARING, *_CAPSTAN, *_STRIBECK),
    "bouc-wen": (
        Parameter("hysteresis_torque", "N*m", 0.05, 0.0, 0.5, "Friction torque far from a reversal"),
        Parameter("hysteresis_angle", "rad", 0.05, 0.001, 3.0, "Spindle angle over which friction reverses"),
        Parameter("hysteresis_shape", "1", 0.5, 0.0, 1.0, "Share of friction that a reversal meets at once (beta)"),
        Parameter("hysteresis_start", "1", 0.0, -1.0, 1.0, "Friction torque as a run begins over the full one"),
    ),
}
"""Parameters of each friction law, after those that all have."""


@dataclass(frozen=True)
class Series:
    """What the model reads of a run, and the jaw angle it is compared with, each (1 + n,); rad, N*m, rad/s.

    The first sample is before the run: the torque it began from.
    """

    time: Array
    spindle: Array
    torque: Array
    """By the sign in which it mostly works against its load."""
    speed: Array
    jaw: Array
    counted: slice
    """Samples after the bench has settled."""


class Signs(NamedTuple):
    """How the sensors' signs go together, by the training runs."""

    load: float
    """Sign of the spindle's mean torque."""
    jaw: float
    """Whether the jaw turns with the spindle's sensor (1) or against it (-1)."""


class _Pace(NamedTuple):
    factor: Array
    """Friction over that in motion, (n,)."""
    of_factor: Array | None
    """Its derivatives, (parameters, n)."""


class Tool:
    """A tool with its recordings.

    Parameters
    ----------
    train, test
        Recordings with spindle_angle, spindle_torque and jaw_angle; the signs of the sensors come from train.
    law
        Friction law, a key of `LAWS`.
    offset
        shared: one offset of the jaw's encoder for all runs, so that none of a test run's jaw angles is used. run: each
        run's error is taken less its own mean over the run, as if its encoder had been set apart.
    contacts
        Contacts that the transmission is cut into.

    Raises
    ------
    IdentificationError
        There is no such law, or a recording is too short.
    """

    def __init__(
        self,
        train: Sequence[Measured],
        test: Sequence[Measured] = (),
        *,
        law: str = DEFAULT_LAW,
        offset: Offset = "shared",
        contacts: int = CONTACTS,
    ) -> None:
        if law not in LAWS:
            raise IdentificationError(f"law is {law!r}; allowed are {', '.join(LAWS)}.")
        if offset not in ("shared", "run"):
            raise IdentificationError(f"offset is {offset!r}; allowed are shared, run.")
        if contacts < 1:
            raise IdentificationError(f"contacts is {contacts}; allowed is a whole number of at least 1.")
        if not train:
            raise IdentificationError("train is empty; allowed is at least one recording.")
        self.law, self.offset, self.contacts = law, offset, contacts
        self.signs = _signs(train)
        recordings = [*train, *test]
        self.runs = tuple(one.name for one in recordings)
        self.parameters = (*(_KINEMATICS if offset == "shared" else _KINEMATICS[1:]), *LAWS[law])
        self._names = tuple(one.name for one in self.parameters)
        self._full = [_series(one, self.signs) for one in recordings]
        self._thin = [_thinned(one) for one in self._full]

    @property
    def groups(self) -> dict[str, tuple[str, ...]]:
        """Names of parameters by group."""
        return {
            "friction": tuple(one.name for one in LAWS[self.law]),
            "stiffness": ("compliance",),
            "kinematics": tuple(one.name for one in self.parameters if one.name in ("offset", "ratio")),
        }

    def residuals(self, values: Array, run: int) -> Array:
        """Return measured minus modelled jaw angle every 10 ms, (n,), in standard deviations of the encoder."""
        return self._errors(values, self._thin[run]) / NOISE

    def jacobian(self, values: Array, run: int) -> Array:
        """Return the derivatives of the residuals, (n, parameters)."""
        series = self._thin[run]
        given = dict(zip(self._names, values.tolist(), strict=True))
        slopes = np.zeros((len(self.parameters), series.time.size))
        mean = np.zeros((len(self.parameters), series.time.size))
        torque = np.zeros(series.time.size)
        for section, slope in self._sections(given, series, slopes):
            torque += section
            mean += slope
        out = given["compliance"] * self.signs.load * mean
        out[self._names.index("compliance")] += self.signs.load * torque
        out[self._names.index("ratio")] += series.spindle
        out *= self.signs.jaw
        if self.offset == "shared":
            out[self._names.index("offset")] += 1
        out = out[:, series.counted]
        if self.offset == "run":
            out = out - out.mean(axis=1, keepdims=True)
        return np.ascontiguousarray(-out.T / NOISE)

    def errors(self, values: Array, run: int) -> dict[str, Array]:
        """Return measured minus modelled jaw angle at all samples after settling, deg."""
        return {"output_angle_deg": np.degrees(self._errors(values, self._full[run]))}

    def predict(self, values: Array, run: int) -> Array:
        """Return the modelled jaw angle at all samples, (n,), rad, by nothing but the run's proximal signals."""
        return self._model(values, self._full[run])[1:]

    def traces(self, values: Array, run: int) -> dict[str, Trace]:
        """Return measured and modelled jaw angle at all samples after settling, deg."""
        series = self._full[run]
        measured = series.jaw[series.counted]
        model = measured - self._errors(values, series)
        return {"output_angle_deg": Trace(series.time[series.counted], np.degrees(measured), np.degrees(model))}

    def sample_time(self, run: int) -> float:
        """Return the time between the samples that are fitted, s."""
        return float(np.median(np.diff(self._thin[run].time[1:])))

    def advice(self, names: Sequence[str]) -> str | None:
        """Return which recording would tell these parameters apart."""
        asked = set(names)
        if asked & {"friction_exponent", "pretension", "spindle_friction", "sliding_friction"}:
            return "Record runs at more loads at the jaw, the highest several times the lowest, each with reversals."
        if "start" in asked or "hysteresis_start" in asked:
            return "Nothing is lost: how a run began matters only up to its first reversal."
        if asked & {"ratio", "offset", "compliance"}:
            return "Record the same motion at several loads at the jaw, over a larger angle."
        return None

    def _errors(self, values: Array, series: Series) -> Array:
        error: Array = (series.jaw - self._model(values, series))[series.counted]
        return error - error.mean() if self.offset == "run" else error

    def _model(self, values: Array, series: Series) -> Array:
        given = dict(zip(self._names, values.tolist(), strict=True))
        torque = sum((section for section, _ in self._sections(given, series, None)), np.zeros(series.time.size))
        turned = given["ratio"] * series.spindle + given["compliance"] * self.signs.load * torque
        return np.asarray(self.signs.jaw * turned + given.get("offset", 0.0), dtype=np.float64)

    def _sections(
        self, given: Mapping[str, float], series: Series, slopes: Array | None
    ) -> Iterator[tuple[Array, Array]]:
        """Yield what each section adds to the mean torque, (n,), and its derivatives, (parameters, n), from zeros."""
        none = np.zeros(0)
        torque = series.torque
        if self.law == "none":
            yield torque, none if slopes is None else slopes
        elif self.law == "bouc-wen":
            full, width, beta, start = (given[one.name] for one in LAWS[self.law])
            share, of_shape = _bouc_wen(width, beta, start, -self.signs.load * series.spindle)
            if slopes is not None:
                slopes = slopes.copy()
                slopes[-len(LAWS[self.law]) :] = -np.vstack([share, full * of_shape])
            yield torque - full * share, none if slopes is None else slopes
        else:
            pace = self._pace(given, series, slopes)
            for contact in range(self.contacts + 1):
                torque, slopes = self._pass(given, torque, slopes, contact, pace)
                # the tendon reaches from the bearing to the last contact: a half of its pieces' length at either end
                weight = (1 if 0 < contact < self.contacts else 0.5) / self.contacts
                yield weight * torque, none if slopes is None else weight * slopes

    def _pace(self, given: Mapping[str, float], series: Series, slopes: Array | None) -> _Pace:
        """Return friction at each sample over that in motion (Stribeck)."""
        one = np.ones(series.time.size)
        if self.law != "stribeck":
            return _Pace(one, None if slopes is None else np.zeros_like(slopes))
        share = (series.speed / given["stribeck_speed"]) ** 2
        falling = np.exp(-share)
        factor = one + given["static_excess"] * falling
        if slopes is None:
            return _Pace(factor, None)
        of_factor = np.zeros_like(slopes)
        of_factor[self._names.index("static_excess")] = falling
        of_factor[self._names.index("stribeck_speed")] = (
            given["static_excess"] * falling * 2 * share / given["stribeck_speed"]
        )
        return _Pace(factor, of_factor)

    def _pass(
        self, given: Mapping[str, float], torque: Array, slopes: Array | None, contact: int, pace: _Pace
    ) -> tuple[Array, Array | None]:
        """Return the torque past a contact, and its derivatives, from those before it."""
        lower, of_lower = self._bound(given, torque, slopes, contact, pace, sign=-1.0)
        upper, of_upper = self._bound(given, torque, slopes, contact, pace, sign=1.0)
        start = given["start"]
        held = float(lower[0] + start * (upper[0] - lower[0]))
        source = np.empty(lower.size, dtype=np.int64)
        _core.play(lower, upper, held, source)
        # where each sample's torque stands among: where the run started, all lower bounds, all upper bounds
        place = np.where(source < 0, -source, np.where(source > 0, source + lower.size, 0))
        passed = np.concatenate([[held], lower, upper])[place]
        if of_lower is None or of_upper is None:
            return passed, None
        of_held = of_lower[:, :1] + start * (of_upper[:, :1] - of_lower[:, :1])
        of_held[self._names.index("start")] += upper[0] - lower[0]
        return passed, np.concatenate([of_held, of_lower, of_upper], axis=1)[:, place]

    def _bound(
        self,
        given: Mapping[str, float],
        torque: Array,
        slopes: Array | None,
        contact: int,
        pace: _Pace,
        *,
        sign: float,
    ) -> tuple[Array, Array | None]:
        """Return the least (sign -1) or most (1) torque that a contact can hold, and its derivatives."""
        bearing, share = float(contact == 0), float(contact > 0) / self.contacts
        constant = bearing * given.get("spindle_friction", 0.0) + share * given.get("sliding_friction", 0.0)
        exponent = share * given.get("friction_exponent", 0.0)
        pretension = given.get("pretension", 0.0)
        gain = np.exp(sign * exponent * pace.factor)
        tension = torque + pretension + sign * constant * pace.factor
        # a law that knows no tension knows no slack
        taut = tension > 0 if "pretension" in given else np.ones(tension.size, dtype=bool)
        bound = np.where(taut, tension * gain, 0.0) - pretension
        if slopes is None or pace.of_factor is None:
            return bound, None
        of_tension = slopes + sign * constant * pace.of_factor
        of_exponent = sign * exponent * pace.of_factor
        for name, row, value in (
            ("spindle_friction", of_tension, sign * bearing * pace.factor),
            ("sliding_friction", of_tension, sign * share * pace.factor),
            ("pretension", of_tension, 1.0),
            ("friction_exponent", of_exponent, sign * share * pace.factor),
        ):
            if name in given:
                row[self._names.index(name)] += value
        of_bound = np.where(taut, gain * (of_tension + tension * of_exponent), 0.0)
        if "pretension" in given:
            of_bound[self._names.index("pretension")] -= 1
        return bound, of_bound


def problem(train: Sequence[Measured], test: Sequence[Measured], *, law: str, instrument: Instrument | None) -> Tool:
    """Return the model with its recordings, those of train first.

    Raises
    ------
    IdentificationError
        There is no such law, a recording is too short, or an instrument is given, which the tool is not.
    """
    if instrument is not None:
        raise IdentificationError("instrument is given; a davinci-tool recording is of a tool without instrument file.")
    return Tool(train, test, law=law)


def _bouc_wen(width: float, beta: float, start: float, turned: Array) -> tuple[Array, Array]:
    """Return friction over the full one along a turning spindle, (n,), and its derivatives by the three, (3, n).

    Wen 1976 with exponent 1 and beta + gamma = 1, solved exactly by step.
    """
    state, of_width, of_beta, of_start = start, 0.0, 0.0, 1.0
    out = [(state, of_width, of_beta, of_start)]
    for step in np.diff(turned).tolist():
        sign, way = math.copysign(1.0, step), abs(step) / width
        against = state * step <= 0
        rate = 2 * beta - 1 if against else 1.0
        kept = math.exp(-rate * way)
        if abs(rate * way) < 1e-6:
            grown, of_rate = way, -0.5 * way * way
        else:
            grown, of_rate = (1 - kept) / rate, (way * kept * rate - (1 - kept)) / rate**2
        nearer = (rate * state - sign) * kept * way / width
        of_width = kept * of_width + nearer
        of_beta = kept * of_beta + (2 * (sign * of_rate - way * kept * state) if against else 0.0)
        of_start *= kept
        state = kept * state + sign * grown
        out.append((state, of_width, of_beta, of_start))
    found = np.array(out).T
    return found[0], found[1:]


def _signs(train: Sequence[Measured]) -> Signs:
    load = float(np.concatenate([one["spindle_torque"] for one in train]).mean())
    turned = sum(
        float(np.mean((one["spindle_angle"] - one["spindle_angle"].mean()) * (one["jaw_angle"]))) for one in train
    )
    return Signs(math.copysign(1.0, load), math.copysign(1.0, turned))


def _series(one: Measured, signs: Signs) -> Series:
    """Return a run at all samples, torque and speed smoothed over what has gone before."""
    window = max(1, round(INTERVAL / one.sample_time))
    span = max(1, round(_SPEED_SPAN / one.sample_time))
    spindle = one["spindle_angle"]
    before = np.maximum(np.arange(len(one)) - span, 0)
    passed = np.maximum(one.time - one.time[before], one.sample_time)
    first = int(np.searchsorted(one.time, one.time[0] + SETTLING))
    if len(one) - first < _LEAST:
        raise IdentificationError(
            f"{one.name} has {max(len(one) - first, 0)} samples after the first {SETTLING:g} s, in which the bench "
            f"settles; at least {_LEAST} are needed."
        )
    torque = signs.load * one["spindle_torque"]
    level = float(torque[one.time < one.time[0] + _LEVEL_SPAN].mean())
    return Series(
        np.append(one.time[0] - one.sample_time, one.time),
        np.append(spindle[0], spindle),
        np.append(level, _causal_mean(torque, window)),
        np.append(0.0, (spindle - spindle[before]) / passed),
        np.append(one["jaw_angle"][0], one["jaw_angle"]),
        slice(1 + first, None),
    )


def _thinned(one: Series) -> Series:
    """Return every so many samples, each the mean over what it stands for; the one before the run stays."""
    step = max(1, round(INTERVAL / float(np.median(np.diff(one.time)))))

    def block(values: Array) -> Array:
        run = values[1:]
        means = run[: run.size // step * step].reshape(-1, step).mean(axis=1)
        return np.append(values[0], means)

    return Series(
        block(one.time),
        block(one.spindle),
        np.append(one.torque[0], one.torque[step::step]),
        np.append(one.speed[0], one.speed[step::step]),
        block(one.jaw),
        slice(1 + -(-(one.counted.start - 1) // step), None),
    )


def _causal_mean(values: Array, window: int) -> Array:
    total = np.concatenate([[0.0], np.cumsum(values)])
    end = np.arange(1, values.size + 1)
    begin = np.maximum(end - window, 0)
    return np.asarray((total[end] - total[begin]) / (end - begin), dtype=np.float64)
