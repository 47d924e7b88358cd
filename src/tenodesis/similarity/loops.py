"""The similarity error with friction: the handle goes through its working range and back, at rest or in time."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tenodesis import plant, twin
from tenodesis.errors import ArgumentError
from tenodesis.instrument import ShortForm
from tenodesis.run import Array
from tenodesis.similarity.frictionless import ErrorStatistics
from tenodesis.similarity.pair import SimilarPair

SPEED = float(np.radians(10))
"""Speed of the real-size handle, rad/s."""

FORCES = 5
"""Number of default forces, from zero to the largest that both can hold."""

STROKE_STEPS = 180
"""Quasi-static steps from one end of the working range to the other."""

_TRIED = 33
_LOADING = 1.0  # s of real-size time, handle straight
_PHASE = 0.4  # rad of the tip's oscillation per step, where that is finer than the twin's own step


class LoopPoint(NamedTuple):
    """A point of a loop: real-size handle angle (rad) and force (N), and whether the handle flexes or extends."""

    handle_angle: float
    force: float
    flexing: bool


class HandleMotion(NamedTuple):
    """Commands to the real-size instrument: steps of `time_step` (s), the first `loading` of them at a straight handle.

    Then the handle flexes to the end of the working range, extends to the other end and flexes again.
    """

    time_step: float
    loading: int
    handle_angle: Array
    share: Array
    """Share of the constant force, by step."""

    @property
    def flexing(self) -> NDArray[np.bool_]:
        """Whether the handle flexes, step by step after loading."""
        return np.diff(self.handle_angle)[self.loading - 1 :] > 0


@dataclass(frozen=True)
class LoopError(ErrorStatistics):
    """Difference between the loops of the scaled-up and of the real-size instrument under constant forces.

    For m forces and n rows: real-size `time` (s) and `handle_angle` (rad), shape (n,); `force` (N on the real-size
    instrument), shape (m,); `real_size_angle`, `scaled_up_angle` (rad) and `error` (deg), shape (m, n), NaN after a tip
    was lost.
    """

    real_size_pretension: float
    scaled_up_pretension: float
    force_factor: float
    time_factor: float
    time: Array
    handle_angle: Array
    flexing: NDArray[np.bool_]
    force: Array
    real_size_angle: Array
    scaled_up_angle: Array
    error: Array

    def __repr__(self) -> str:
        shape = f"{self.force.size} forces, {self.time.size} rows"
        return f"<LoopError: largest {self.largest:.4g} deg, rms {self.rms:.4g} deg, {shape}>"

    @property
    def worst(self) -> LoopPoint:
        """Point of the largest error."""
        return self.point(*np.unravel_index(np.nanargmax(np.abs(self.error)), self.error.shape))

    def point(self, force: np.intp, row: np.intp) -> LoopPoint:
        """Return the point of a force and a row, by their numbers."""
        return LoopPoint(float(self.handle_angle[row]), float(self.force[force]), bool(self.flexing[row]))

    @property
    def largest_force(self) -> float:
        """Largest force, N on the real-size instrument, that both can hold to the end; NaN if there is none."""
        held = ~np.isnan(self.error).any(axis=1)
        return float(self.force[held].max()) if held.any() else float("nan")


def motion_in_time(pair: SimilarPair, speed: float) -> HandleMotion:
    """Return the motion of loops in time, with a handle at a speed (rad/s)."""
    step = min(twin.TIME_STEP, _PHASE / plant.natural_frequency(pair.real_size))
    stroke = max(2, 2 * round(pair.reach / speed / step))
    return _motion(pair.reach, step, stroke, max(1, round(_LOADING / step)))


def motion_at_rest(reach: float) -> HandleMotion:
    """Return the motion of quasi-static loops to a handle angle (rad) either side."""
    return _motion(reach, 2 * reach / SPEED / STROKE_STEPS, STROKE_STEPS, STROKE_STEPS // 10)


def nominal(inst: ShortForm, time_step: float) -> ShortForm:
    """Return the first axis without mismatch, sampled at every step, with a handle that follows its command exactly."""
    return inst.planar[0].replace(
        mismatch=None, **{"dynamics.hand_stiffness": None, "sensors.sampling_rate": 1 / time_step}
    )


def loops(inst: ShortForm, motion: HandleMotion, handle_angle: Array, forces: Array, *, quasi_static: bool) -> Array:
    """Return the output angles of a one-axis instrument after loading, rad, shape (forces, steps); NaN once lost.

    The handle angles (rad, by step) replace those of the motion; the forces (N) are constant, one per run.
    """
    batch = twin.run_many(
        [inst] * forces.size,
        np.broadcast_to(handle_angle, (forces.size, handle_angle.size)),
        forces[:, None] * motion.share,
        time_step=motion.time_step,
        quasi_static=quasi_static,
    )
    return batch["output_angle"][:, motion.loading :]


def _motion(reach: float, time_step: float, stroke: int, loading: int) -> HandleMotion:
    half = stroke // 2
    flexed = reach * np.arange(1, half + 1) / half
    extended = reach * (1 - 2 * np.arange(1, stroke + 1) / stroke)
    handle = np.concatenate([np.zeros(loading), flexed, extended, -extended])
    share = np.minimum(np.arange(1, handle.size + 1) / loading, 1.0)
    return HandleMotion(time_step, loading, handle, share)


def loop_error(
    pair: SimilarPair,
    motion: HandleMotion,
    *,
    pretension: float | None,
    force_factor: float | None,
    forces: Sequence[float] | None,
    quasi_static: bool,
) -> LoopError:
    """Return the error of loops; :meth:`tenodesis.similarity.Comparison.error_at_rest` describes the arguments."""
    tension = pair.scaled_pretension if pretension is None else pretension
    factor = float(pair.force_factor()) if force_factor is None else force_factor

    def both(motion: HandleMotion, force: Array, *, quasi_static: bool) -> tuple[Array, Array]:
        """Return the output angles of the real-size and the scaled-up instrument, rad."""
        theirs = motion._replace(time_step=motion.time_step * pair.time_factor)
        scaled_up = nominal(pair.scaled_up, theirs.time_step).replace(pretension=tension)
        mapped, own = np.asarray(pair.scaled_up_handle_angle(motion.handle_angle)), motion.handle_angle
        real_size = nominal(pair.real_size, motion.time_step)
        return (
            loops(real_size, motion, own, force, quasi_static=quasi_static),
            loops(scaled_up, theirs, mapped, force * factor, quasi_static=quasi_static),
        )

    if forces is None:
        tried = np.linspace(0.0, pair.largest_force, _TRIED)
        lost = np.isnan(sum(both(motion_at_rest(pair.reach), tried, quasi_static=True))).any(axis=1)
        held = tried[: np.argmax(lost)] if lost.any() else tried
        force = np.linspace(0.0, held[-1] if held.size else 0.0, FORCES)
    else:
        force = np.array(forces, float)
    if force.ndim != 1 or not force.size or not np.isfinite(force).all():
        raise ArgumentError(key="forces", value=forces, allowed="a list of finite numbers")
    expected, found = both(motion, force, quasi_static=quasi_static)
    rows = slice(motion.loading, None)
    time: Array = motion.time_step * np.arange(1.0, motion.handle_angle.size + 1)
    return LoopError(
        pair.real_size.pretension,
        tension,
        factor,
        pair.time_factor,
        time[rows],
        motion.handle_angle[rows],
        motion.flexing,
        force,
        expected,
        found,
        np.degrees(found - expected),
    )
