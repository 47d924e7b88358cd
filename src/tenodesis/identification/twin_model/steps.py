"""Recordings of an instrument in the steps of a twin: commands and measurements of each step."""

from collections.abc import Mapping
from math import pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from tenodesis import _core
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.identification.quantisation import QuantisedSensor, encoder, load_cell
from tenodesis.identification.twin_model import tuning
from tenodesis.identification.twin_model.inputs import PathError, ReconstructedPath, smoothed, unrounded
from tenodesis.instrument import ShortForm
from tenodesis.run import TENDONS, Array
from tenodesis.twin.rows import columns_by_name

READINGS = ("measured_handle_angle", "measured_output_angle", "tension_agonist", "tension_antagonist")
"""The twin's sensor readings, in the core's order."""

_COMMANDS = columns_by_name(_core.axis_commands())
_HANDLE = _COMMANDS["handle_angle"].start
_LET_OUT = range(_COMMANDS["let_out"].start, _COMMANDS["let_out"].stop)


class InputError(NamedTuple):
    """An error of a command, of one standard deviation."""

    column: int
    """Of the core's commands."""
    first: int
    """Step at which it begins."""
    shape: Array
    """(m,), from there on."""


class SteppedRun(NamedTuple):
    """A run in steps of equal length."""

    name: str
    time_step: float
    stride: int
    """Samples per step."""
    commands: Array
    """The core's commands by step."""
    lead: int
    """How many of them lead to where the run begins."""
    kept: NDArray[np.intp]
    """Steps with readings."""
    time: Array
    """Middle of each of these, s."""
    measured: Mapping[str, Array]
    """Mean reading in each of these, by name."""
    sensors: Mapping[str, QuantisedSensor]
    """Sensors of the readings, by name."""
    input_errors: tuple[InputError, ...]
    """Errors that encoders leave in the commands."""
    mixing: Array
    """Independent combinations of these, one standard deviation each, (errors, combinations)."""
    handle_as_read: bool
    """Whether the handle angle is that of its encoder less its offset, rather than the commanded angle."""

    @property
    def deviation(self) -> dict[str, float]:
        """Standard deviation of a single reading, by name."""
        return {name: sensor.deviation for name, sensor in self.sensors.items()}


def in_steps(run: MeasuredRun, inst: ShortForm, stride: int) -> SteppedRun:
    """Return a run, in columns of InstrumentRun, averaged over steps of `stride` samples.

    The instrument gives the sensors and the nominal pretension.
    """
    columns = dict(run.columns)
    # a compliant hand is not where it was commanded to be
    if inst.dynamics.hand_stiffness and "measured_handle_angle" in columns:
        columns["handle_angle"] = columns["measured_handle_angle"]
    as_read = "measured_handle_angle" not in columns or np.array_equal(
        columns["measured_handle_angle"], columns["handle_angle"]
    )
    grid = _Grid(run, stride)
    inputs = _inputs(run, columns, inst, as_read=as_read)
    commands = np.zeros((grid.count, max(columns.stop for columns in _COMMANDS.values())))
    for name in ("force", "radial_force"):
        if name in columns:
            commands[:, _COMMANDS[name].start] = grid.interpolated(columns[name])
    for column, scale, path in inputs:
        commands[:, column] = scale * grid.interpolated(path.values)

    readings = [name for name in READINGS if name in columns and not (as_read and name == READINGS[0])]
    fresh = _fresh(columns, readings)
    averaged = {name: grid.means(columns[name], fresh) for name in readings}
    filled = averaged[readings[0]][1]
    lead = _leading(commands[0], grid.step, inst)
    begin = _turned_twice(commands[:, _HANDLE]) if len(lead) else 0
    begin = max(begin, _slack(np.stack([averaged[f"tension_{tendon}"][0] for tendon in TENDONS]), filled, inst))
    known = filled >= begin
    return SteppedRun(
        name=run.name,
        time_step=grid.step,
        stride=stride,
        commands=np.concatenate([lead, commands]),
        lead=len(lead),
        kept=filled[known] + len(lead),
        time=run.time[0] + (filled[known] + 0.5 - 0.5 / stride) * grid.step,
        measured={name: values[known] for name, (values, _) in averaged.items()},
        sensors={name: load_cell(inst) if name.startswith("tension") else encoder(inst) for name in readings},
        input_errors=tuple(
            grid.error(error, column, scale, len(lead)) for column, scale, path in inputs for error in path.errors
        ),
        mixing=block_diag(*(path.mixing for _, _, path in inputs)),
        handle_as_read=as_read,
    )


class _Grid:
    """The steps of a run, and which samples fall into each."""

    def __init__(self, run: MeasuredRun, stride: int) -> None:
        self.step = stride * run.sample_time
        self._place = np.floor((run.time - run.time[0]) / self.step + 0.5 / stride).astype(np.intp)
        # samples left over at the end would make a shorter step
        self.count = max(1, int((run.time[-1] - run.time[0]) / run.sample_time + 1.5) // stride)
        self._inside = self._place < self.count

    def means(self, values: Array, chosen: NDArray[np.bool_] | None = None) -> tuple[Array, NDArray[np.intp]]:
        """Return the mean of (chosen) samples in each step that has any, and which steps these are."""
        inside = self._inside if chosen is None else self._inside & chosen
        weights = np.bincount(self._place[inside], minlength=self.count)
        filled = np.flatnonzero(weights)
        return np.bincount(self._place[inside], values[inside], minlength=self.count)[filled] / weights[filled], filled

    def interpolated(self, values: Array) -> Array:
        """Return the mean of samples in each step, interpolated in steps without samples."""
        means, filled = self.means(values)
        return np.asarray(np.interp(np.arange(self.count), filled, means), dtype=np.float64)

    def error(self, error: PathError, column: int, scale: float, lead: int) -> InputError:
        """Return an error of a path, averaged over the samples of each step as its command is."""
        steps = np.minimum(self._place, self.count - 1)[error.first : error.first + error.shape.size]
        first, steps = int(steps[0]), steps - steps[0]
        means = np.bincount(steps, scale * error.shape) / np.maximum(np.bincount(steps), 1)
        return InputError(column, first + lead, means)


def _inputs(
    run: MeasuredRun, columns: Mapping[str, Array], inst: ShortForm, *, as_read: bool
) -> list[tuple[int, float, ReconstructedPath]]:
    """Return the reconstructed motion of handle and spools: the command's column, and its factor from the path."""
    handle = ReconstructedPath(columns["handle_angle"])
    if as_read:
        handle = smoothed(handle.values, run.sample_time, encoder(inst))
    inputs, drives = [(_HANDLE, 1.0, handle)], inst.drives
    for let_out, tendon in zip(_LET_OUT, TENDONS, strict=True):
        if f"spool_{tendon}" in columns:
            spool = columns[f"spool_{tendon}"]
            reference = _reference(run.time, spool, columns[f"tension_{tendon}"], inst)
            path = unrounded(spool, run.sample_time, 2 * pi / drives.encoder_counts / drives.gear_ratio)
            path = path._replace(values=path.values - reference)
            inputs.append((let_out, -drives.spool_radius, path))
    return inputs


def _fresh(columns: Mapping[str, Array], readings: list[str]) -> NDArray[np.bool_]:
    """Return which rows hold a new reading, where sensors are held over several rows."""
    changed = np.zeros(columns[readings[0]].size, dtype=np.bool_)
    changed[0] = True
    for name in readings:
        changed[1:] |= np.diff(columns[name]) != 0
    return changed if changed.mean() < tuning.HELD_SHARE else np.ones_like(changed)


def _slack(tensions: Array, filled: NDArray[np.intp], inst: ShortForm) -> int:
    """Return the step at which both tendons, (2, n), are first slack, so that earlier motion has no effect.

    That is the beginning where none is slack in the first third of the run.
    """
    loose = np.flatnonzero((np.abs(tensions) < tuning.REST_SHARE * inst.pretension).all(axis=0))
    return int(filled[loose[0]]) if loose.size and loose[0] < filled.size // 3 else 0


def _reference(time: Array, spool: Array, tension: Array, inst: ShortForm) -> float:
    """Return the spool's angle at which its tendon has the pretension.

    That is its angle where a taut run begins, or where a slack tendon has first grown as tight as the instrument's
    pretension; but zero if the tension there is about the one of a spool that counts from the pretension, as in
    recordings of this package.
    """
    beginning = time <= time[0] + tuning.BEGINNING
    angle, pulled = float(np.median(spool[beginning])), float(np.median(tension[beginning]))
    if pulled < tuning.TAUT_SHARE * inst.pretension:
        reached = np.flatnonzero(tension >= inst.pretension)
        tight = int(reached[0]) if reached.size else int(np.argmax(tension))
        angle, pulled = float(spool[tight]), float(tension[tight])
    expected = inst.pretension + inst.tendon_stiffness * inst.drives.spool_radius * angle
    return 0.0 if abs(pulled - expected) < tuning.REFERENCE_SHARE * inst.pretension else angle


def _leading(first: Array, step: float, inst: ShortForm) -> Array:
    """Return commands that lead from rest to the first command; none if that is rest."""
    scale = np.full(first.size, tuning.REST_SHARE * inst.pretension)
    scale[_HANDLE] = tuning.REST_SHARE * inst.handle_range
    for let_out in _LET_OUT:
        scale[let_out] = tuning.REST_SHARE * inst.pretension / inst.tendon_stiffness
    if (np.abs(first) <= scale).all():
        return np.zeros((0, first.size))
    share = np.linspace(0, 1, max(2, round(tuning.LEAD_TIME / step)))[:, None]
    return np.asarray(share**2 * (3 - 2 * share) * first)


def _turned_twice(handle: Array) -> int:
    """Return the step from which the handle has reversed twice, so that earlier friction states have no effect.

    That is the beginning where it takes more than a third of the run.
    """
    least, turns, way, farthest = tuning.TURN_SHARE * float(np.ptp(handle)), 0, 0.0, 0
    for at, angle in enumerate(handle[: len(handle) // 3].tolist()):
        gone = angle - handle[farthest]
        if way == 0 and abs(gone) >= least:
            way, farthest = np.sign(gone), at
        elif way * gone > 0:
            farthest = at
        elif way * gone <= -least and way:
            way, farthest, turns = -way, at, turns + 1
        if turns == 2:
            return at
    return 0
