"""A tool read from its near end: what it predicts of its far end, and how far that can be relied on."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tenodesis.errors import IdentificationError
from tenodesis.identification.force.parameters import Unknown, unknowns
from tenodesis.identification.force.signals import SIGNALS, Bench, Series, Signal, checked, series_of
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.run import Array
from tenodesis.tendon import TRANSMISSION, FarEnd, far_end

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


class Estimate(NamedTuple):
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
    bench: Bench
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

    def estimate(self, run: MeasuredRun) -> Estimate:
        """Return the far end at all samples of a recording, by its near end alone.

        Raises IdentificationError if a column is missing, or the current is saturated.
        """
        run = checked(run, self.signal)
        return self.estimate_series(series_of(run, self.bench))

    def estimate_series(self, series: Series) -> Estimate:
        """Return the far end of a run by the bench's signs."""
        bands = self.bands(series)
        far = predicted(self.values, series, self.signal, self.bench)
        by_angle, by_torque = self.moved(series, far)
        angle, torque = bands
        side = -self.bench.jaw * self.bench.load
        covariance = angle.share * torque.share * side * far.hidden_angle * far.hidden_torque
        return Estimate(
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


def predicted(values: Mapping[str, float], series: Series, signal: Signal, bench: Bench) -> FarEnd:
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
    return {
        "signal": model.signal,
        "bench": model.bench._asdict(),
        "values": dict(model.values),
        "free": list(model.free),
        "covariance": model.covariance.tolist(),
        "prior_spread": dict(model.prior_spread),
        "known": [*model.known],
        "new": [*model.new],
        "pitches": list(model.pitches),
        "wrist": model.wrist,
        "samples": model.samples,
    }


def from_json(found: Mapping[str, object], where: str) -> ForceModel:
    """Return the model that `to_json` wrote; raises IdentificationError if `found` is none."""
    try:
        return ForceModel(
            signal=SIGNALS[SIGNALS.index(found["signal"])],
            bench=Bench(**found["bench"]),  # type: ignore[arg-type]
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
