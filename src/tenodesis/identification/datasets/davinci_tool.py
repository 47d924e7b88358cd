"""A da Vinci tool on a bench that measures angle and torque at its spindle and at its jaw: its files and its model.

O'Neill, Stephens and Kowalewski, IEEE RA-L 3(4):3027-3034, 2018. A text file without column names; lines of % are a
header. The jaw's columns are the reference: a model may use them for fitting only.

The model gives the jaw angle from the spindle's angle and torque, through an elastic transmission with friction: a
tendon of even stiffness and friction along its length, cut into n equal pieces. Each contact passes the torque on
within its friction band and holds it inside (stick-slip); between contacts the tendon stretches. With u[i] the torque
past contact i, p the pretension and h the friction exponent, T = u + p is the tendon's tension times the spindle's
radius (Euler, Eytelwein):

    u[0]    slides on   torque -+ spindle friction              load-independent, at the spindle's bearing
    u[i]    slides on   (u[i-1] + p) e^(-+h/n) - p              and T ends at zero: a tendon cannot push
    jaw   = offset +- (ratio spindle + compliance mean(u))      mean by the trapezoidal rule

(capstan; other friction laws have other bounds.)
"""

import math
from collections.abc import Collection, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from tenodesis.identification.datasets.reference import (
    Given,
    ReferenceProblem,
    ReferenceSeries,
    Values,
    band,
    held,
    hysteresis,
    without_instrument,
)
from tenodesis.identification.force.model import INTERVAL, causal_mean, settled, signs_of
from tenodesis.identification.formats.csv import read_rows
from tenodesis.identification.formats.measured import MeasuredRun, Raw, Source, Unit, checksum
from tenodesis.identification.problem import Parameter
from tenodesis.identification.registry import Format
from tenodesis.run import Array

# The files.

COLUMNS = 10
TORQUE_PER_COUNT = 3.9811e-5
"""N*m per count of both torque sensors."""
SPINDLE_COUNTS = 8192
"""Counts of the spindle's encoder per turn."""
JAW_COUNTS = 4000
"""Counts of the jaw's encoder per turn."""
MOST_COUNTS = 1500
MOST_SPINDLE = MOST_COUNTS * 2 * math.pi / SPINDLE_COUNTS
"""Distance of the spindle from its median above which a row is corrupt, rad; the encoder's zero depends on the tool."""

_TURN = 2 * math.pi
_JUMP = math.radians(5)
"""Off the rows around, rad: the bench turns by less than 2 degrees in a millisecond even when its drive runs away."""
_TORQUE_JUMP = 0.04
"""Off the rows around, N*m."""
_LEAST_ANGLE = math.radians(1)
_LEAST_TORQUE = 2e-3

SOURCE = Source(
    repository="MRDLab/mis-tool-characterization",
    commit="03658b2ccefef9adceebc38dd4a17bd6e190cd2e",
    folder="data/Tool_4_Maryland_L_4",
    licence="database ODbL 1.0, contents DbCL 1.0 (attribution, share-alike)",
    citation="O'Neill, Stephens, Kowalewski, IEEE RA-L 3(4):3027-3034, 2018",
    checksums={
        "00.TXT": "796f89cb5e4469d590ae78db7a2a504ca0673f939c0255c00b1421b70d05ce62",
        "01.TXT": "70eac4b90f92cb1005fa9507af7001edec4251c75b3a67de40e1175d168d2145",
        "02.TXT": "dc180d55e1b28d10db893d8d779a386e8447e3fc992210251de330925898b4fd",
        "03.TXT": "5da7dff6ff951697b4c587d0f9c9a853673cc7e724ed6a04a4960d5b6a9977f4",
        "04.TXT": "48cbd949a66420f20ce3f000c3be2d4cfc97c1c77535317746aa161683ee4736",
        "05.TXT": "ced7f47ff1c4d83305965af8e02a283bc9ed0f7e33a241f4fdf1ccfa346d4ecf",
        "06.TXT": "629b0c36f20f7d9db84610dff0afc1f3f294207c90cb8694742991bb94a971c3",
        "07.TXT": "c106c87ae325d0e88c247001b097f828c7cb6bb69bf3dde84affe691e2c43c0b",
        "08.TXT": "863717442bbc86bb2e5d03370c97b67f1180a0f1859f6cfb6655d710de57288b",
        "09.TXT": "741b6c4986201b6cbf8c84748288685e38b6768079bcbe72f934ba67774b472b",
        "30.TXT": "da6d50c9ce180160a646f6aa7188646c54133c7c9eecae3579e105b64a96151c",
        "34.TXT": "b60e8b792b68e27b875780edd98455c0a5db2ca12bf070d53e250c814dad26d6",
        "38.TXT": "a1a0db39064e1a3c12d3e41b122135bf42e06f290518d2225f35979a08c8c257",
    },
)


def load(path: Path) -> MeasuredRun:
    """Return a recording of a da Vinci tool, as :func:`read`."""
    return read(path, SOURCE)


def read(path: Path, source: Source) -> MeasuredRun:
    """Return a recording of the bench.

    Columns: spindle_angle, jaw_angle (rad), spindle_torque, jaw_torque (N*m), motor_current (A), by the signs of the
    file; the last two are as they were measured, for the model here does not take them. The first seconds, in which the
    bench settles, are kept: a model with memory needs them.

    Raises IdentificationError if the file cannot be read, its units fit none that are known, or its samples cannot be
    used.
    """
    rows = read_rows(path, COLUMNS)
    raw = Raw(
        path.name,
        rows[:, 0],
        {
            "spindle_angle": rows[:, 1],
            "spindle_torque": rows[:, 2],
            "motor_current": rows[:, 3],
            "jaw_angle": rows[:, 4],
            "jaw_torque": rows[:, 5],
        },
    )
    raw.finite()
    raw.enough()
    raw.clock()
    for column, counts in (("spindle_angle", SPINDLE_COUNTS), ("jaw_angle", JAW_COUNTS)):
        raw.unit(_angle(counts), column)
        raw.excited(column, _LEAST_ANGLE, "rad")
    # the jaw's torque may well be constant: it is the load
    raw.unit(_TORQUE, "spindle_torque", "jaw_torque")
    raw.excited("spindle_torque", _LEAST_TORQUE, "N*m")
    spindle = raw.columns["spindle_angle"]
    limit = f"{MOST_COUNTS} counts, {math.degrees(MOST_SPINDLE):.3g} deg"
    raw.drop(np.abs(spindle - np.median(spindle)) > MOST_SPINDLE, f"corrupt (the spindle over {limit}, off its median)")
    for column, jump in (("spindle_angle", _JUMP), ("jaw_angle", _JUMP), ("spindle_torque", _TORQUE_JUMP)):
        raw.outliers(column, jump)
    raw.saturated("spindle_torque")
    raw.enough()
    raw.gaps()
    return raw.done(source, checksum(path))


def _angle(counts: int) -> tuple[Unit, ...]:
    return (
        Unit("counts", _TURN / counts, _LEAST_ANGLE / _TURN * counts, counts / 2, integer=True),
        # neither the spindle nor the jaw turns by half a turn, so that the two cannot be taken for one another
        Unit("rad", 1.0, _LEAST_ANGLE, math.pi, integer=False),
        Unit("deg", math.radians(1), 5, 180, integer=False),
    )


_TORQUE = (
    Unit("counts", TORQUE_PER_COUNT, _LEAST_TORQUE / TORQUE_PER_COUNT, 1 / TORQUE_PER_COUNT, integer=True),
    Unit("N*m", 1.0, _LEAST_TORQUE, 1.0, integer=False),
    Unit("mN*m", 1e-3, 1e3 * _LEAST_TORQUE, 1e3, integer=False),
)


# The model.

DEFAULT_LAW = "capstan-constant"
CONTACTS = 8
"""Contacts that the transmission is cut into."""
NOISE = 2 * math.pi / 4000 / math.sqrt(12)
"""Standard deviation of the jaw's encoder, rad: that of rounding to its 4000 counts."""

_LEVEL_SPAN = 0.2
"""Time from the start whose mean torque is assumed to have acted before it, s; the drive starts with a kick."""
_SPEED_SPAN = 0.1
"""Time over which the spindle's speed is taken, s."""
_OFFSET = math.radians(30)
"""Largest difference of the jaw's offset from that of a plane through the recordings, rad."""
_RATIO, _COMPLIANCE = (0.1, 5.0), (0.1, 4.0)
"""What such a plane is believed: 1 and rad/(N*m)."""


_friction = partial(Parameter, group="friction")
_START = _friction(
    "start", "1", 0.2, 0.0, 1.0, "Friction at the start of a run, within its band: 0 lower, 1 upper bound"
)
_BEARING = _friction("spindle_friction", "N*m", 0.01, 0.0, 0.05, "Load-independent friction at the spindle")
_CAPSTAN = (
    _friction("friction_exponent", "1", 0.5, 0.0, 2.0, "Friction coefficient times wrap angle all along the tendon"),
    _friction("pretension", "N*m", 0.05, 0.0, 0.15, "Pretension of the tendon times the spindle's radius"),
)
_STRIBECK = (
    _friction("static_excess", "1", 0.1, 0.0, 3.0, "By how much friction at rest exceeds friction in motion"),
    _friction("stribeck_speed", "rad/s", 0.1, 0.005, 3.0, "Spindle speed at which that excess has fallen to 1/e"),
)
LAWS: Mapping[str, tuple[Parameter, ...]] = {
    "none": (),
    "coulomb": (
        _START,
        _BEARING,
        _friction("sliding_friction", "N*m", 0.05, 0.0, 0.5, "Load-independent friction all along the tendon"),
    ),
    "capstan": (_START, *_CAPSTAN),
    "capstan-constant": (_START, _BEARING, *_CAPSTAN),
    "capstan-power": (
        _START,
        _BEARING,
        *_CAPSTAN,
        _friction("load_index", "1", 0.9, 0.3, 1.0, "Power of the tension that friction grows with; 1 is capstan"),
    ),
    "stribeck": (_START, _BEARING, *_CAPSTAN, *_STRIBECK),
    "bouc-wen": (
        _friction("hysteresis_torque", "N*m", 0.05, 0.0, 0.5, "Friction torque far from a reversal"),
        _friction("hysteresis_angle", "rad", 0.05, 0.001, 3.0, "Spindle angle over which friction reverses"),
        _friction("hysteresis_shape", "1", 0.5, 0.0, 1.0, "Share of friction that a reversal meets at once (beta)"),
        _friction("hysteresis_start", "1", 0.0, -1.0, 1.0, "Friction torque at the start of a run, over full friction"),
    ),
}
"""Parameters of each friction law, after those that all have."""
_SHAPES = ("load_index", "static_excess", "stribeck_speed")


@dataclass(frozen=True, kw_only=True)
class ToolSeries(ReferenceSeries):
    """What the model reads of a run, and the jaw angle it is compared with, each (1 + n,); rad, N*m, rad/s.

    The first sample is before the run: the torque it began from. Those after the bench has settled count.
    """

    spindle: Array
    torque: Array
    """By the sign in which it mostly works against its load."""
    speed: Array
    pitch: float = 0.0
    """Of the wrist, rad."""


class Tool(ReferenceProblem[ToolSeries]):
    """A tool with its recordings of spindle_angle, spindle_torque and jaw_angle, fitted every 10 ms.

    The signs of the sensors come from `train`; the law is a key of `LAWS`, and the transmission is cut into `contacts`.
    Raises IdentificationError if there is no such law, or a recording is too short.
    """

    key, scale, noise = "output_angle_deg", math.degrees(1), NOISE
    advised: ClassVar[Sequence[tuple[Set[str], str]]] = (
        (
            {"friction_exponent", "pretension", "spindle_friction", "sliding_friction"},
            "Record runs at more loads at the jaw, the highest several times the lowest, each with reversals.",
        ),
        (
            {"start", "hysteresis_start"},
            "Nothing is lost: how a run began matters only up to its first reversal.",
        ),
        ({"ratio", "offset", "compliance"}, "Record the same motion at several loads at the jaw, over a larger angle."),
    )

    def __init__(
        self,
        train: Sequence[MeasuredRun],
        test: Sequence[MeasuredRun] = (),
        *,
        law: str = DEFAULT_LAW,
        contacts: int = CONTACTS,
        laws: Collection[str] = LAWS,
    ) -> None:
        super().__init__(train, test, law=law, laws=laws, contacts=contacts)
        self.contacts = contacts
        # of the spindle's torque under load, and whether the jaw turns with the spindle
        self.load, self.jaw = signs_of(train)
        self.full = [_series(one, self.load) for one in (*train, *test)]
        self.fitted = [_thinned(one) for one in self.full]
        self.parameters = (*_kinematics(self.fitted[: len(train)], self.load, self.jaw), *LAWS[law])

    def predict(self, values: Array, run: int) -> Array:
        """Return the modelled jaw angle at all samples, (n,), rad, without the one before the run."""
        return super().predict(values, run)[1:]

    def modelled(self, values: Values, series: ToolSeries) -> Values:
        """Return the jaw angle by the model, (1 + n,), rad."""
        given = self.given(values, series)
        turned = given["ratio"] * series.spindle + self.load * given["compliance"] * self._mean(given, series)
        return np.asarray(self.jaw * turned + given["offset"])

    def _mean(self, given: Given, series: ToolSeries) -> Values:
        """Return the mean torque along the transmission, (n,)."""
        torque = series.torque
        if self.law == "none":
            return torque
        if self.law == "bouc-wen":
            full, width, beta, start = (given[one.name] for one in LAWS[self.law])
            return np.asarray(torque - full * hysteresis(-self.load * series.spindle, width, beta, start))
        # a law without tension has no slack
        slack = "pretension" in given
        pretension = given.get("pretension", 0.0)
        bearing = {"constant": given.get("spindle_friction", 0.0)}
        # the tendon reaches from the bearing to the last contact: a half of its pieces' length at either end
        passed = [behind("coulomb", bearing, torque + pretension, given["start"], series.speed, slack=slack)]
        along = self._along(given)
        for _ in range(self.contacts):
            passed.append(behind(self.law, along, passed[-1], given["start"], series.speed, slack=slack))
        return np.asarray(sum(one + other for one, other in pairwise(passed)) * (0.5 / self.contacts) - pretension)

    def _along(self, given: Given) -> dict[str, Any]:
        """Return the friction of a contact along the tendon, by the names of its law."""
        friction = {name: given[name] for name in _SHAPES if name in given}
        for name, ours in (("exponent", "friction_exponent"), ("constant", "sliding_friction")):
            if ours in given:
                friction[name] = given[ours] * (1 / self.contacts)
        return friction


def behind(law: str, friction: Given, tension: Values, start: Any, speed: Array, *, slack: bool) -> Values:
    """Return the tension behind a contact whose run begins somewhere in its band."""
    lower, upper = band(law, friction, tension, speed=speed, slack=slack)
    return held(lower, upper, lower[0] + start * (upper[0] - lower[0]))


def _kinematics(train: Sequence[ToolSeries], load: float, jaw: float) -> tuple[Parameter, ...]:
    """Return the parameters that act without friction, which start where a plane through the training runs has them."""
    columns = [
        np.column_stack([np.ones(one.time.size), jaw * one.spindle, jaw * load * one.torque])[one.first :]
        for one in train
    ]
    reference = np.concatenate([one.reference[one.first :] for one in train])
    offset, ratio, compliance = np.linalg.lstsq(np.vstack(columns), reference)[0].tolist()
    ratio, compliance = float(np.clip(ratio, *_RATIO)), float(np.clip(compliance, *_COMPLIANCE))
    at_zero = "Jaw angle at spindle angle zero without torque, common to all runs"
    along, lost = "Jaw angle per spindle angle without torque", "Jaw angle lost per torque all along the transmission"
    return (
        Parameter("offset", "rad", offset, offset - _OFFSET, offset + _OFFSET, at_zero, "kinematics"),
        Parameter("ratio", "1", ratio, ratio / 2, 2 * ratio, along, "kinematics"),
        Parameter("compliance", "rad/(N*m)", compliance, 0.0, 5 * compliance, lost, "stiffness"),
    )


def _series(one: MeasuredRun, load: float) -> ToolSeries:
    """Return a run at all samples, torque and speed smoothed by a causal filter."""
    window = max(1, round(INTERVAL / one.sample_time))
    span = max(1, round(_SPEED_SPAN / one.sample_time))
    spindle = one["spindle_angle"]
    before = np.maximum(np.arange(len(one)) - span, 0)
    passed = np.maximum(one.time - one.time[before], one.sample_time)
    torque = load * one["spindle_torque"]
    level = float(torque[one.time < one.time[0] + _LEVEL_SPAN].mean())
    return ToolSeries(
        time=np.append(one.time[0] - one.sample_time, one.time),
        reference=np.append(one["jaw_angle"][0], one["jaw_angle"]),
        first=1 + int(np.argmax(settled(one))),
        spindle=np.append(spindle[0], spindle),
        torque=np.append(level, causal_mean(torque, window)),
        speed=np.append(0.0, (spindle - spindle[before]) / passed),
        pitch=float(one.columns["wrist_pitch"][0]) if "wrist_pitch" in one.columns else 0.0,
    )


def _thinned(one: ToolSeries) -> ToolSeries:
    """Return the run at the fitted interval, each sample a mean over it; the sample before the run is kept."""
    step = max(1, round(INTERVAL / float(np.median(np.diff(one.time)))))

    def block(values: Array) -> Array:
        run = values[1:]
        means = run[: run.size // step * step].reshape(-1, step).mean(axis=1)
        return np.append(values[0], means)

    return ToolSeries(
        time=block(one.time),
        reference=block(one.reference),
        first=1 + -(-(one.first - 1) // step),
        spindle=block(one.spindle),
        torque=np.append(one.torque[0], one.torque[step::step]),
        speed=np.append(one.speed[0], one.speed[step::step]),
        pitch=one.pitch,
    )


problem = without_instrument(Tool, "a davinci-tool recording is of a tool without instrument file")
FORMAT = Format(load, problem, laws=tuple(LAWS), law=DEFAULT_LAW)
