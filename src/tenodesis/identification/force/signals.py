"""Signals of a bench that an estimator of the far end reads and is compared with, by common signs."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tenodesis.errors import IdentificationError
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.identification.formats.raw import Raw
from tenodesis.run import Array

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


class Bench(NamedTuple):
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


def bench_of(runs: Sequence[MeasuredRun]) -> Bench:
    """Return how the sensors of recordings go together; raises IdentificationError if there are none."""
    if not runs:
        raise IdentificationError("train is empty; it must hold at least one recording.", key="train")

    def joint(one: str, other: str) -> float:
        return sum(float(np.mean((run[one] - run[one].mean()) * run[other])) for run in runs)

    load = math.copysign(1.0, sum(float(run["spindle_torque"].mean()) for run in runs))
    low, high = np.quantile(np.concatenate([run["spindle_angle"] for run in runs]), (0.01, 0.99))
    has_current = all("motor_current" in run.columns for run in runs)
    return Bench(
        load,
        math.copysign(1.0, joint("spindle_angle", "jaw_angle")),
        load * math.copysign(1.0, joint("motor_current", "spindle_torque")) if has_current else load,
        math.copysign(1.0, sum(float(run["jaw_torque"].mean()) for run in runs)),
        float(low + high) / 2,
    )


def series_of(run: MeasuredRun, bench: Bench, *, interval: float | None = None) -> Series:
    """Return a run by a bench's signs, signals as causal means, at all samples or at an interval (s).

    Raises IdentificationError if it is too short.
    """
    step = run.sample_time
    short = max(1, round(INTERVAL / step))
    every = 1 if interval is None else max(1, round(interval / step))
    angle = -bench.load * (run["spindle_angle"] - bench.middle)
    counted = run.time >= run.time[0] + SETTLING
    if counted.sum() < _LEAST:
        raise IdentificationError(
            f"{run.name} has {int(counted.sum())} samples after the first {SETTLING:g} s, in which the bench settles; "
            f"at least {_LEAST} are needed."
        )
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
