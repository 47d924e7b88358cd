"""A tool read from its near end: its signals and parameters, what it predicts of its far end, and how reliably."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tenodesis.errors import IdentificationError
from tenodesis.identification.formats.measured import MeasuredRun, Raw
from tenodesis.run import Array
from tenodesis.tendon import TRANSMISSION, FarEnd, far_end

Signal: TypeAlias = Literal["torque", "current"]
"""What is measured at the near end besides its angle."""
SIGNALS: tuple[Signal, ...] = ("torque", "current")

SETTLING = 2.0
"""Time from the start in which the bench settles, s: estimated, but not counted."""
INTERVAL = 0.01
"""Mean over which torque is taken, s."""
FITTED_INTERVAL = 0.02
"""Between the samples that are fitted, s."""
CURRENT_INTERVAL = 0.05
"""Mean over which the current is taken, several periods of the drive's vibration, s."""
RUNAWAY = 6.0
"""Speed of the near end above which its drive has run away, rad/s: not fitted."""
LEAST_CURRENT = 5e-3
"""Spread below which a motor's current says nothing, A."""
_AROUND = 0.5
"""Time before and after a runaway that is not fitted, s."""
_LEAST = 200
_COLUMNS = ("spindle_angle", "spindle_torque", "motor_current", "jaw_angle", "jaw_torque")
_CURRENT_JUMP = 1.0
"""Off the rows around, A."""


class ForceBench(NamedTuple):
    """How the sensors of a bench go together, by the recordings that a model was fitted to."""

    load: float
    """Sign of the spindle's torque under load."""
    jaw: float
    """Whether the jaw turns with the spindle (1) or against it (-1)."""
    current: float
    """Sign of the motor's current in the direction of the load."""
    jaw_load: float
    """Sign of the jaw's torque under load."""
    middle: float
    """Middle of the spindle's travel, rad."""


@dataclass(frozen=True, kw_only=True)
class Series:
    """A run by common signs, each (n,): angles in rad, torques in N m, current in A."""

    name: str
    time: Array
    angle: Array
    """Of the near end from the middle of its travel, positive as the tendon is pulled."""
    torque: Array
    current: Array
    far_angle: Array
    """Of the jaw, as measured."""
    far_torque: Array
    pitch: float | None
    """Of the wrist, rad; None if it was not recorded, as it did not change between recordings."""
    counted: NDArray[np.bool_]
    """Samples of which errors count."""
    fitted: NDArray[np.bool_]
    """Samples that are fitted: those, without a drive that has run away."""

    @property
    def step(self) -> float:
        """Time between samples, s."""
        return float(np.median(np.diff(self.time)))


def checked(run: MeasuredRun, signal: Signal) -> MeasuredRun:
    """Return a recording whose signals can be used, without samples at the limits of a sensor.

    Raises IdentificationError if a column is missing, or the motor's current is saturated or does not change.
    """
    for name in _COLUMNS:
        if name not in run.columns and (name != "motor_current" or signal == "current"):
            raise IdentificationError(
                f"{run.name} has no {name.replace('_', ' ')}, which an estimate from {signal} is fitted to or checked "
                f"with; it has {', '.join(run.columns)}.",
                key=name,
            )
    if signal == "torque":
        return run
    raw = Raw(run.name, run.time, run.columns)
    raw.excited("motor_current", LEAST_CURRENT, "A")
    raw.outliers("motor_current", _CURRENT_JUMP)
    raw.saturated("motor_current")
    return MeasuredRun(run.name, raw.time, raw.columns, (*run.notes, *raw.notes), run.source, run.checksum)


def signs_of(runs: Sequence[MeasuredRun]) -> tuple[float, float]:
    """Return the sign of the spindle's torque under load, and whether the jaw turns with the spindle (1 or -1)."""
    load = math.copysign(1.0, float(np.concatenate([run["spindle_torque"] for run in runs]).mean()))
    return load, math.copysign(1.0, _joint(runs, "spindle_angle", "jaw_angle"))


def bench_of(runs: Sequence[MeasuredRun]) -> ForceBench:
    """Return how the sensors of recordings go together; raises IdentificationError if there are none."""
    if not runs:
        raise IdentificationError("train is empty; it must hold at least one recording.", key="train")
    load, jaw = signs_of(runs)
    low, high = np.quantile(np.concatenate([run["spindle_angle"] for run in runs]), (0.01, 0.99))
    has_current = all("motor_current" in run.columns for run in runs)
    return ForceBench(
        load,
        jaw,
        load * math.copysign(1.0, _joint(runs, "motor_current", "spindle_torque")) if has_current else load,
        math.copysign(1.0, sum(float(run["jaw_torque"].mean()) for run in runs)),
        float(low + high) / 2,
    )


def _joint(runs: Sequence[MeasuredRun], one: str, other: str) -> float:
    return sum(float(np.mean((run[one] - run[one].mean()) * run[other])) for run in runs)


def settled(run: MeasuredRun) -> NDArray[np.bool_]:
    """Return the samples of which errors count; raises IdentificationError if they are too few."""
    counted = np.asarray(run.time >= run.time[0] + SETTLING)
    if counted.sum() < _LEAST:
        raise IdentificationError(
            f"{run.name} has {int(counted.sum())} samples after the first {SETTLING:g} s, in which the bench settles; "
            f"at least {_LEAST} are needed.",
            key="samples",
            value=int(counted.sum()),
            allowed=f"at least {_LEAST}",
        )
    return counted


def series_of(run: MeasuredRun, bench: ForceBench, *, interval: float | None = None) -> Series:
    """Return a run by a bench's signs, signals as causal means, at all samples or at an interval (s).

    Raises IdentificationError if it is too short.
    """
    step = run.sample_time
    short = max(1, round(INTERVAL / step))
    every = 1 if interval is None else max(1, round(interval / step))
    angle = -bench.load * (run["spindle_angle"] - bench.middle)
    counted = settled(run)
    fast = np.abs(angle - np.concatenate([np.repeat(angle[0], short), angle[:-short]])) > RUNAWAY * short * step
    around = max(1, round(_AROUND / step))
    near_fast = np.convolve(fast, np.ones(2 * around + 1), "same") > 0.5
    current = run.columns.get("motor_current", np.zeros(len(run)))
    long = max(1, round(CURRENT_INTERVAL / step))
    means = every > 1

    def reference(values: Array) -> Array:
        return (causal_mean(values, every) if means else values)[every - 1 :: every]

    pick = slice(every - 1, None, every)
    return Series(
        name=run.name,
        time=run.time[pick],
        angle=angle[pick],
        torque=causal_mean(bench.load * run["spindle_torque"], short)[pick],
        current=causal_mean(bench.current * current, long)[pick],
        far_angle=reference(run["jaw_angle"]),
        far_torque=reference(bench.jaw_load * run["jaw_torque"]),
        pitch=float(run["wrist_pitch"][0]) if "wrist_pitch" in run.columns else None,
        counted=counted[pick],
        fitted=(counted & ~near_fast)[pick],
    )


def causal_mean(values: Array, window: int) -> Array:
    """Return the mean of each value and those before it within a window, (n,)."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    end = np.arange(1, values.size + 1)
    begin = np.maximum(end - window, 0)
    return np.asarray((total[end] - total[begin]) / (end - begin), dtype=np.float64)


class Unknown(NamedTuple):
    """A parameter with its prior over tools, a normal distribution within bounds, in SI units."""

    name: str
    unit: str
    start: float
    spread: float
    """Standard deviation between tools."""
    lower: float
    upper: float
    group: str
    meaning: str


_FAR = 1e3

TOOL: Final = (
    Unknown("angle_offset", "rad", 0.0, 1.0, -_FAR, _FAR, "offset", "Jaw angle at the middle of the spindle's travel"),
    Unknown("torque_offset", "N*m", 0.0, 0.03, -1.0, 1.0, "offset", "Spindle torque without load in mid-travel"),
    Unknown("ratio", "1", 1.0, 0.2, 0.1, 5.0, "kinematics", "Jaw angle per spindle angle"),
    Unknown("torque_ratio", "1", 1.0, 0.1, 0.1, 5.0, "kinematics", "Jaw torque per torque of the tendon"),
    Unknown("near_compliance", "rad/(N*m)", 0.1, 0.2, 0.0, 5.0, "stiffness", "Compliance before the tendon's friction"),
    Unknown("compliance", "rad/(N*m)", 0.5, 0.5, 0.0, 5.0, "stiffness", "Compliance all along the tendon's friction"),
    Unknown("far_compliance", "rad/(N*m)", 0.5, 0.5, 0.0, 5.0, "stiffness", "Compliance behind the tendon's friction"),
    Unknown("near_stiffness", "N*m/rad", 0.0, 0.02, -0.2, 0.5, "stiffness", "What springs back at the spindle"),
    Unknown("far_stiffness", "N*m/rad", 0.0, 0.02, -0.2, 0.5, "stiffness", "What springs back at the jaw"),
    Unknown("near_friction", "N*m", 0.01, 0.02, 0.0, 0.3, "friction", "Load-independent friction at the spindle"),
    Unknown("friction_exponent", "1", 0.5, 0.2, 0.0, 3.0, "friction", "Friction coefficient times wrap angle"),
    Unknown("joint_friction", "N*m", 0.005, 0.01, 0.0, 0.2, "friction", "Load-independent friction at the jaw"),
    Unknown("pretension", "N*m", 0.05, 0.04, 0.0, 0.5, "pretension", "Pretension times the spindle's radius"),
    Unknown("play", "rad", 0.05, 0.03, 0.005, 0.3, "slip", "Motion by which a contact counts as slipping"),
)
WRIST: Final = (
    Unknown("coupling", "1", 0.0, 1.0, -2.0, 2.0, "wrist", "Jaw angle by pitch, the spindle held"),
    Unknown("bend_growth", "1/rad", 0.3, 0.5, 0.0, 3.0, "wrist", "Growth of friction and compliance with the bend"),
)
DRIVE: Final = (
    Unknown("torque_constant", "N*m/A", 1.0, 0.5, 0.01, 50.0, "drive", "Torque at the spindle per motor current"),
    Unknown("current_offset", "N*m", 0.0, 0.01, -1.0, 1.0, "offset", "Torque that the motor's current reads too high"),
    Unknown("drive_friction", "N*m", 0.02, 0.02, 0.0, 1.0, "friction", "Friction of motor and gearbox in mid-travel"),
    Unknown("drive_friction_slope", "N*m/rad", 0.0, 0.03, -1.0, 1.0, "friction", "Its growth along the travel"),
    Unknown("load_friction", "1", 0.1, 0.15, 0.0, 0.9, "friction", "Share of motor torque lost in the gearbox"),
    Unknown("viscous", "N*m*s/rad", 0.0, 0.01, 0.0, 0.5, "friction", "Viscous friction of motor and gearbox"),
    Unknown("drive_play", "rad", 0.05, 0.1, 0.001, 1.0, "drive", "Motion by which the gearbox counts as slipping"),
    Unknown("ripple_sine", "N*m", 0.0, 0.005, -0.1, 0.1, "drive", "Torque ripple of the motor, by the sine"),
    Unknown("ripple_cosine", "N*m", 0.0, 0.005, -0.1, 0.1, "drive", "Torque ripple of the motor, by the cosine"),
    Unknown("heat_loss", "1/A^2", 0.0, 0.5, 0.0, 10.0, "drive", "Share of the torque constant lost to heat"),
)
RECALIBRATED: Final = ("offset", "friction", "pretension")
"""Groups that a short recording of a new tool determines; the others are carried over."""
BETWEEN_TOOLS: Final = 0.3
"""Standard deviation of friction and pretension between tools of a kind, of that of the one that is known."""
_LEAST_SPREAD = 0.1
"""The same of a value near zero, of the spread between tools of all kinds."""


def recalibrated(one: Unknown, known: float) -> Unknown:
    """Return a parameter with its prior over tools like one that is known."""
    if one.lower < 0:  # of no scale of its own
        return one._replace(start=known)
    spread = min(one.spread, max(BETWEEN_TOOLS * abs(known), _LEAST_SPREAD * one.spread))
    return one._replace(start=known, spread=spread)


def unknowns(signal: Signal, *, wrist: bool) -> tuple[Unknown, ...]:
    """Return the parameters of an estimate from a signal, with those of a wrist if several pitches are known."""
    return (*TOOL, *(WRIST if wrist else ()), *(DRIVE if signal == "current" else ()))


RIPPLE_ORDER = 169.5
"""Periods of the drive's ripple per radian of the spindle, times 2 pi: the line in the current of slow runs."""
_SAME_PITCH = math.radians(1)
WIDTH = 1.96
"""Standard deviations of half a 95 % interval."""


class Band(NamedTuple):
    """What is left of one far-end signal, by the residuals of recordings that a fit has not seen."""

    floor: float
    """Standard deviation where friction hides nothing, SI."""
    share: float
    """Of what friction may hide, as a standard deviation."""
    parameters: float
    """Of what the uncertainty of the parameters makes of it."""

    def std(self, hidden: Array, moved: Array) -> Array:
        """Return the standard deviation, (n,), by what friction hides, (n,), and parameters move, (axes, n)."""
        by_parameters = np.sum(moved**2, axis=0)
        variance = self.floor**2 + (self.share * hidden) ** 2 + self.parameters**2 * by_parameters
        return np.asarray(np.sqrt(variance), dtype=np.float64)


class Bands(NamedTuple):
    """Bands of angle and torque."""

    angle: Band
    torque: Band


class FarEndEstimate(NamedTuple):
    """Far end of a run, each (n,): angle (rad) and torque (N m) with their standard deviations and covariance."""

    time: Array
    angle: Array
    torque: Array
    angle_std: Array
    torque_std: Array
    covariance: Array
    """Of angle and torque, rad N m."""


@dataclass(frozen=True, kw_only=True)
class ForceModel:
    """Parameters of a tool with their covariance, by which its far end is estimated from a near-end signal."""

    signal: Signal
    bench: ForceBench
    values: Mapping[str, float]
    free: tuple[str, ...]
    """Parameters that were fitted; the others were carried over."""
    covariance: Array
    """Of all parameters, in the order of `values`."""
    prior_spread: Mapping[str, float]
    """Standard deviation of each fitted parameter before the recordings."""
    known: Bands
    """At the pitches that were fitted."""
    new: Bands
    """At others."""
    pitches: tuple[float, ...]
    """Of the recordings that were fitted, rad; none if they have no pitch."""
    wrist: bool
    """Whether coupling and growth with pitch are known."""
    samples: int = 0
    """Effective number of independent samples that were fitted."""

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """All parameters."""
        return unknowns(self.signal, wrist=self.wrist)

    def std(self, name: str) -> float:
        """Return the standard deviation of a parameter."""
        at = list(self.values).index(name)
        return math.sqrt(max(float(self.covariance[at, at]), 0.0))

    def undetermined(self) -> tuple[str, ...]:
        """Return the fitted parameters that the recordings determine less than the prior: three quarters are left."""
        return tuple(name for name in self.free if self.std(name) > 0.75 * self.prior_spread[name])

    def estimate(self, run: MeasuredRun) -> FarEndEstimate:
        """Return the far end at all samples of a recording, by its near end alone.

        Raises IdentificationError if a column is missing, or the current is saturated.
        """
        run = checked(run, self.signal)
        return self.estimate_series(series_of(run, self.bench))

    def estimate_series(self, series: Series) -> FarEndEstimate:
        """Return the far end of a run by the bench's signs."""
        bands = self.bands(series)
        far = predicted(self.values, series, self.signal, self.bench)
        by_angle, by_torque = self.moved(series, far)
        angle, torque = bands
        side = -self.bench.jaw * self.bench.load
        covariance = angle.share * torque.share * side * far.hidden_angle * far.hidden_torque
        return FarEndEstimate(
            series.time,
            far.angle,
            far.torque,
            angle.std(far.hidden_angle, by_angle),
            torque.std(far.hidden_torque, by_torque),
            covariance + angle.parameters * torque.parameters * np.sum(by_angle * by_torque, axis=0),
        )

    def bands(self, series: Series) -> Bands:
        """Return the bands at a run's pitch."""
        pitch = series.pitch
        if pitch is None or any(abs(pitch - one) < _SAME_PITCH for one in self.pitches):
            return self.known
        return self.new

    def moved(self, series: Series, far: FarEnd) -> tuple[Array, Array]:
        """Return by how much angle and torque move by a deviation of the parameters on each axis, (axes, n)."""
        values = np.array(list(self.values.values()))
        lower = np.array([one.lower for one in self.unknowns])
        upper = np.array([one.upper for one in self.unknowns])
        others = [
            predicted(
                dict(zip(self.values, np.clip(values + step, lower, upper).tolist(), strict=True)),
                series,
                self.signal,
                self.bench,
            )
            for step in _directions(self.covariance)
        ]
        shape = (len(others), series.time.size)
        return (
            np.reshape([other.angle - far.angle for other in others], shape),
            np.reshape([other.torque - far.torque for other in others], shape),
        )


def predicted(values: Mapping[str, float], series: Series, signal: Signal, bench: ForceBench) -> FarEnd:
    """Return the far end by the core's estimator, its angle in that of the jaw's sensor."""
    given = {name: value for name, value in values.items() if name in TRANSMISSION}
    # Against the load the tendon pulls the jaw to -jaw * load; the pitch that draws it there bends it over its pulley.
    coupling, pitch = values.get("coupling", 0.0), series.pitch or 0.0
    side = -bench.jaw * bench.load * math.copysign(1.0, coupling)
    growth = math.exp(values.get("bend_growth", 0.0) * max(0.0, side * pitch))
    for name in ("friction_exponent", "compliance", "far_compliance"):
        given[name] *= growth
    if signal == "current":
        phase = RIPPLE_ORDER * series.angle
        ripple = values["ripple_sine"] * np.sin(phase) + values["ripple_cosine"] * np.cos(phase)
        current = series.current - (values["current_offset"] + ripple) / given["torque_constant"]
        far = far_end(given, series.angle, current=current, time_step=series.step)
    else:
        far = far_end(given, series.angle, torque=series.torque, time_step=series.step)
    jaw = -bench.jaw * bench.load * far.angle + values["angle_offset"]
    return far._replace(angle=jaw + coupling * pitch)


def _directions(covariance: Array) -> list[Array]:
    """Return the standard deviations of a covariance along its principal axes, each (n,)."""
    variances, axes = np.linalg.eigh(covariance)
    return [math.sqrt(one) * axis for one, axis in zip(variances, axes.T, strict=True) if one > 1e-18]


def to_json(model: ForceModel) -> dict[str, object]:
    """Return a model as plain values."""
    return {**vars(model), "bench": model.bench._asdict(), "covariance": model.covariance.tolist()}


def from_json(found: Mapping[str, object], where: str) -> ForceModel:
    """Return the model that `to_json` wrote; raises IdentificationError if `found` is none."""
    try:
        return ForceModel(
            signal=SIGNALS[SIGNALS.index(found["signal"])],
            bench=ForceBench(**found["bench"]),  # type: ignore[arg-type]
            values=dict(found["values"]),  # type: ignore[call-overload]
            free=tuple(found["free"]),  # type: ignore[arg-type]
            covariance=np.array(found["covariance"], dtype=np.float64),
            prior_spread=dict(found["prior_spread"]),  # type: ignore[call-overload]
            known=_bands(found["known"]),
            new=_bands(found["new"]),
            pitches=tuple(found["pitches"]),  # type: ignore[arg-type]
            wrist=bool(found["wrist"]),
            samples=int(found["samples"]),  # type: ignore[call-overload]
        )
    except (KeyError, TypeError, ValueError) as problem:
        raise IdentificationError(
            f"{where} is no model of tenodesis force ({problem}); it must be a model.json that it wrote.",
            key="prior",
        ) from None


def _bands(rows: object) -> Bands:
    return Bands(*(Band(*row) for row in rows))  # type: ignore[attr-defined]
