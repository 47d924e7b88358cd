"""The similarity error with friction: the handle goes through its working range and back, at rest or in time."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tenodesis import plant, twin
from tenodesis.instrument import Instrument
from tenodesis.similarity.frictionless import Spread
from tenodesis.similarity.parameters import alone

if TYPE_CHECKING:
    from tenodesis.similarity.comparison import Comparison

Array = NDArray[np.float64]

SPEED = float(np.radians(10))
"""Speed of the real-size handle, rad/s."""

FORCES = 5
"""Constant forces that a default set has, from none to the largest that both hold."""

STROKE_STEPS = 180
"""Steps at rest from one end of the working range to the other."""

_TRIED = 33
_LOADING = 1.0  # s on the model, handle straight
_PHASE = 0.4  # of the tip's swing in a step, where that is finer than the twin's own


class Place(NamedTuple):
    """Where in a loop: handle angle (rad) and force (N) of the model, and whether the handle flexes or extends."""

    handle_angle: float
    force: float
    flexing: bool


class Path(NamedTuple):
    """What is done to the model over time: steps of `time_step` (s), the first `loading` of them at a straight handle.

    Then the handle flexes to the end of the working range, extends to the other and flexes again.
    """

    time_step: float
    loading: int
    handle_angle: Array
    share: Array
    """Of the constant force."""

    @property
    def flexing(self) -> NDArray[np.bool_]:
        """Whether the handle flexes, step by step after loading."""
        return np.diff(self.handle_angle)[self.loading - 1 :] > 0


@dataclass(frozen=True)
class LoopError(Spread):
    """How far the prototype's loops stray from the model's under constant forces.

    For m forces and n rows: `time` (s) and `handle_angle` (rad), both of the model, (n,); `force` (N on the model),
    (m,); `model_angle`, `prototype_angle` (rad) and `error` (deg), (m, n), NaN after a tip was lost.
    """

    model_pretension: float
    prototype_pretension: float
    force_factor: float
    time_factor: float
    time: Array
    handle_angle: Array
    flexing: NDArray[np.bool_]
    force: Array
    model_angle: Array
    prototype_angle: Array
    error: Array

    @property
    def worst(self) -> Place:
        """Where the largest error is."""
        at = np.unravel_index(np.nanargmax(np.abs(self.error)), self.error.shape)
        return Place(float(self.handle_angle[at[1]]), float(self.force[at[0]]), bool(self.flexing[at[1]]))

    @property
    def held_by_one(self) -> float:
        """Share of the rows that exactly one of the two instruments gets to."""
        return float((np.isnan(self.model_angle) != np.isnan(self.prototype_angle)).mean())

    @property
    def largest_force(self) -> float:
        """Largest force, N on the model, that both hold all the way; NaN if there is none."""
        held = ~np.isnan(self.error).any(axis=1)
        return float(self.force[held].max()) if held.any() else float("nan")


def error_at_rest(
    comparison: "Comparison", pretension: float | None, force_factor: float | None, forces: Sequence[float] | None
) -> LoopError:
    """Return the error of quasi-static loops; :meth:`Comparison.error_at_rest` says more."""
    return _error(_Pair(comparison, pretension, force_factor), path_at_rest(comparison.reach), forces, True)


def cycle_error(
    comparison: "Comparison",
    pretension: float | None,
    force_factor: float | None,
    forces: Sequence[float] | None,
    speed: float,
) -> LoopError:
    """Return the error of loops in time; :meth:`Comparison.cycle_error` says more."""
    step = min(twin.TIME_STEP, _PHASE / plant.natural_frequency(comparison.model))
    stroke = max(2, 2 * round(comparison.reach / speed / step))
    path = _path(comparison.reach, step, stroke, max(1, round(_LOADING / step)))
    return _error(_Pair(comparison, pretension, force_factor), path, forces, False)


def path_at_rest(reach: float) -> Path:
    """Return the path of quasi-static loops to a handle angle (rad) either side."""
    return _path(reach, 2 * reach / SPEED / STROKE_STEPS, STROKE_STEPS, STROKE_STEPS // 10)


def judged(inst: Instrument, time_step: float) -> Instrument:
    """Return the first axis as its file means it: without mismatch, its handle where it is told to be."""
    return alone(inst).replace(
        mismatch=None, **{"dynamics.hand_stiffness": None, "sensors.sampling_rate": 1 / time_step}
    )


def loops(
    inst: Instrument | Sequence[Instrument], path: Path, handle_angle: Array, forces: Array, *, quasi_static: bool
) -> Array:
    """Return the output angles after loading, rad, by run and step; NaN after the tip was lost.

    Parameters
    ----------
    inst
        The instrument, or one per force; of one axis.
    path
        What is done over time, at the instrument's own time step.
    handle_angle
        The instrument's handle angles in place of the path's, rad.
    forces
        Constant force per run, N.
    """
    insts = [inst] * forces.size if isinstance(inst, Instrument) else list(inst)
    batch = twin.run_many(
        insts,
        np.broadcast_to(handle_angle, (forces.size, handle_angle.size)),
        forces[:, None] * path.share,
        time_step=path.time_step,
        quasi_static=quasi_static,
    )
    return batch["output_angle"][:, path.loading :]


def _path(reach: float, time_step: float, stroke: int, loading: int) -> Path:
    half = stroke // 2
    flexed = reach * np.arange(1, half + 1) / half
    extended = reach * (1 - 2 * np.arange(1, stroke + 1) / stroke)
    handle = np.concatenate([np.zeros(loading), flexed, extended, -extended])
    share = np.minimum(np.arange(1, handle.size + 1) / loading, 1.0)
    return Path(time_step, loading, handle, share)


class _Pair:
    """Both instruments with the prototype's pretension and the factors of force and time."""

    def __init__(self, comparison: "Comparison", pretension: float | None, force_factor: float | None) -> None:
        self.comparison = comparison
        self.pretension = comparison.scaled_pretension if pretension is None else pretension
        self.force_factor = float(comparison.force_factor()) if force_factor is None else force_factor
        self.time_factor = comparison.time_factor

    def loops(self, path: Path, force: Array, quasi_static: bool) -> tuple[Array, Array]:
        """Return the output angles of model and prototype, rad."""
        theirs = path._replace(time_step=path.time_step * self.time_factor)
        model = judged(self.comparison.model, path.time_step)
        prototype = judged(self.comparison.prototype, theirs.time_step).replace(pretension=self.pretension)
        mapped = self.comparison.prototype_handle_angle(path.handle_angle)
        return (
            loops(model, path, path.handle_angle, force, quasi_static=quasi_static),
            loops(prototype, theirs, mapped, force * self.force_factor, quasi_static=quasi_static),
        )

    def default_forces(self) -> Array:
        """Return forces from none to the largest that both hold at rest through the working range, to a few percent."""
        tried = np.linspace(0.0, self.comparison.largest_force, _TRIED)
        expected, found = self.loops(path_at_rest(self.comparison.reach), tried, True)
        lost = np.isnan(expected + found).any(axis=1)
        held = tried[: np.argmax(lost)] if lost.any() else tried
        return np.linspace(0.0, held[-1] if held.size else 0.0, FORCES)


def _error(pair: _Pair, path: Path, forces: Sequence[float] | None, quasi_static: bool) -> LoopError:
    force = pair.default_forces() if forces is None else np.array(forces, float)
    if force.ndim != 1 or not force.size or not np.isfinite(force).all():
        raise ValueError(f"forces is {forces!r}; allowed is a row of finite numbers.")
    expected, found = pair.loops(path, force, quasi_static)
    rows = slice(path.loading, None)
    time: Array = path.time_step * np.arange(1.0, path.handle_angle.size + 1)
    return LoopError(
        pair.comparison.model.pretension,
        pair.pretension,
        pair.force_factor,
        pair.time_factor,
        time[rows],
        path.handle_angle[rows],
        path.flexing,
        force,
        expected,
        found,
        np.degrees(found - expected),
    )
