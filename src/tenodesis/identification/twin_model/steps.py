"""Recordings of an instrument in the steps of a twin, with inputs reconstructed from quantised sensors."""

import math
from collections.abc import Iterator, Mapping
from math import pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, eigh, solveh_banded
from scipy.ndimage import minimum_filter1d, uniform_filter1d

from tenodesis import _core
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.identification.twin_model import tuning
from tenodesis.instrument import Instrument, ShortForm
from tenodesis.run import TENDONS, Array
from tenodesis.twin.rows import columns_by_name

_HARMONICS = 49
_WITHIN = np.array([0.25, 0.5, 0.75])
"""Of a step in which a signal turns, where its parabola is drawn through."""
_NEGLIGIBLE = 1e-4
"""Variance of a rounding error, over that of a reading, below which it is left out."""


class QuantisedSensor(NamedTuple):
    """A sensor with its converter, in the unit of its readings."""

    noise: float
    """Standard deviation."""
    resolution: float
    """Step of the converter."""

    @property
    def rounding_variances(self) -> tuple[float, ...]:
        """Variance, by harmonic, of the rounding error that persists while a signal rests, as far as noise leaves it.

        Rounding comes at a random place of the converter's step (Widrow and Kollár 2008, ch. 5).
        """
        turns = [2 * math.pi * harmonic for harmonic in range(1, _HARMONICS + 1)]
        return tuple(
            2 * (self.resolution / turn) ** 2 * math.exp(-((turn * self.noise / self.resolution) ** 2))
            for turn in turns
        )

    @property
    def independent_variance(self) -> float:
        """Variance of the error that is independent from sample to sample."""
        return self.noise**2 + self.resolution**2 / 12 - sum(self.rounding_variances)

    @property
    def deviation(self) -> float:
        """Standard deviation of a reading."""
        return math.hypot(self.noise, self.resolution / math.sqrt(12))

    def deviation_of_mean(self, samples: int) -> float:
        """Return the standard deviation of a mean of some samples of a signal at rest."""
        return math.sqrt(sum(self.rounding_variances) + self.independent_variance / samples)

    def harmonics(self, variance: float) -> Iterator[tuple[float, float]]:
        """Yield wave number and variance of the rounding errors that are significant beside a given variance."""
        for harmonic, size in enumerate(self.rounding_variances, 1):
            if size > _NEGLIGIBLE * variance:
                yield 2 * math.pi * harmonic / self.resolution, size


def encoder(inst: Instrument) -> QuantisedSensor:
    """Return the encoder of an instrument's joints, rad."""
    sensors = inst.sensors
    return QuantisedSensor(sensors.encoder_noise, sensors.encoder_range / 2**sensors.encoder_bits)


def load_cell(inst: ShortForm) -> QuantisedSensor:
    """Return an instrument's load cell, or its motor's current as tension, N."""
    return QuantisedSensor(inst.tension_sensor.noise, inst.tension_sensor.resolution)


class PathError(NamedTuple):
    """A possible error of a reconstructed path, of one standard deviation."""

    first: int
    """Sample at which it begins."""
    shape: Array
    """(m,), from there on."""


class ReconstructedPath(NamedTuple):
    """An input as reconstructed from its sensor."""

    values: Array
    """(n,)."""
    errors: tuple[PathError, ...] = ()
    mixing: Array = np.zeros((0, 0))
    """Independent combinations of these errors, one standard deviation each, (errors, combinations)."""


def smoothed(values: Array, sample_time: float, sensor: QuantisedSensor) -> ReconstructedPath:
    """Return a noisy signal smoothed for the least expected error, with the errors that may remain.

    Second differences are penalised (Whittaker 1923) by the weight of least expected error (Stein 1981), up to a blur
    of a fifth of a second, except where the signal has a kink. The errors are those of a path whose second differences
    have the variance that this weight stands for (Wahba 1983), described at some places (Quiñonero-Candela and
    Rasmussen 2005). The signal, shape (n,), is in the sensor's unit and evenly sampled, every `sample_time` s.
    """
    deviation = sensor.deviation
    if deviation <= 0 or values.size < max(tuning.KINK_WINDOWS) or not np.ptp(values):
        return ReconstructedPath(values)
    penalised = np.ones(values.size - 2)
    smooth, blur, risk = _least_risk(values, penalised, sample_time, deviation)
    for _ in range(tuning.KINK_ROUNDS if blur else 0):
        kinked = _narrowed(values, penalised, _with_kinks(values, penalised, blur, deviation), blur, deviation)
        new_smooth, new_blur, new_risk = _least_risk(values, kinked, sample_time, deviation)
        if new_risk >= risk:
            break
        penalised, smooth, blur, risk = kinked, new_smooth, new_blur, new_risk
    if not blur:
        return ReconstructedPath(values)
    # a kink may lie a sample beside where it was put
    errors, mixing = _smoothing_errors(minimum_filter1d(penalised, 3), blur, deviation)
    rounding = [
        PathError(0, sqrt(size) * wave(number * smooth))
        for number, size in sensor.harmonics(deviation**2)
        for wave in (np.cos, np.sin)
    ]
    both = np.zeros((len(errors) + len(rounding), mixing.shape[1] + len(rounding)))
    both[: len(errors), : mixing.shape[1]] = mixing
    both[len(errors) :, mixing.shape[1] :] = np.eye(len(rounding))
    return ReconstructedPath(smooth, (*errors, *rounding), both)


def unrounded(values: Array, sample_time: float, resolution: float) -> ReconstructedPath:
    """Return a signal without a converter's rounding, reconstructed from when it passes from one step to the next.

    Between such times it is drawn straight; where it rests, turns, begins or ends it is in the middle of the step. Its
    errors: half a step where it rests, less on the way there and where its speed changes. The signal, shape (n,), is
    evenly sampled, every `sample_time` s, without noise and rounded to the converter's steps, `resolution`.
    """
    changes = np.flatnonzero(np.diff(values))
    if not changes.size:
        return ReconstructedPath(values)
    middles = np.append(values[changes], values[-1])
    edges = np.concatenate([[-0.5], changes + 0.5, [values.size - 0.5]])
    lengths = np.diff(edges)
    neighbour = np.minimum(np.append(np.inf, lengths[:-1]), np.append(lengths[1:], np.inf))
    resting = lengths > tuning.REST_LENGTH * neighbour
    resting[[0, -1]] = True
    back = np.flatnonzero(middles[:-2] == middles[2:]) + 1
    turns = _turns(lengths, back, resting)
    resting[back] = True
    resting[[*turns]] = False
    stopping = np.minimum(np.minimum(neighbour, lengths) / 2, tuning.STOPPING_TIME / sample_time)
    at = np.concatenate([edges[1:-1], (edges[:-1] + stopping)[resting], (edges[1:] - stopping)[resting]])
    there = np.concatenate([(middles[1:] + middles[:-1]) / 2, middles[resting], middles[resting]])
    for step, (depth, _) in turns.items():
        beyond = middles[step] - middles[step - 1]
        at = np.append(at, edges[step] + lengths[step] * _WITHIN)
        there = np.append(there, middles[step] - beyond / 2 + beyond * depth * 4 * _WITHIN * (1 - _WITHIN))
    order = np.argsort(at, kind="stable")
    path = np.asarray(np.interp(np.arange(values.size), at[order], there[order]))
    errors = _errors_of_rests(edges, stopping, resting, resolution) + _errors_of_speed(
        edges, lengths, resting, turns, resolution
    )
    return ReconstructedPath(path, tuple(errors), np.eye(len(errors)))


def _least_risk(values: Array, penalised: Array, sample_time: float, deviation: float) -> tuple[Array, float, float]:
    """Return the smooth path of least expected error, its blur in samples, 0 where none is better, and that error."""
    best, chosen, least = values, 0.0, 2 * deviation**2 * values.size
    kinks = np.count_nonzero(penalised == 0)
    # rounded, for counts of samples by the blur must not hang on a clock's last digit
    longest = max(tuning.BLUR_SHORTEST, round(tuning.BLUR_LONGEST / sample_time, 6))
    for blur in np.geomspace(tuning.BLUR_SHORTEST, longest, tuning.BLURS).tolist():
        weight = _weight(blur)
        smooth = _solved(weight * penalised, values)
        # the smoother's trace, for a long signal
        dof = values.size * weight**-0.25 / (2 * sqrt(2)) + kinks
        risk = float(np.sum((values - smooth) ** 2)) + 2 * deviation**2 * min(dof, values.size)
        if risk < least:
            best, chosen, least = smooth, blur, risk
    return best, chosen, least


def _weight(blur: float) -> float:
    """Return the weight of second differences by which waves as long as the blur (samples) are halved."""
    return (blur / (2 * pi)) ** 4


def _solved(weights: Array, right: Array) -> Array:
    """Return the solution of (1 + D' weights D) x = right, where D takes second differences."""
    banded = np.zeros((3, right.shape[0]))
    banded[0, 2:] = weights
    banded[1, 1:-1] -= 2 * weights
    banded[1, 2:] -= 2 * weights
    banded[2, :-2] += weights
    banded[2, 1:-1] += 4 * weights
    banded[2, 2:] += weights
    banded[2] += 1
    return np.asarray(solveh_banded(banded, right, overwrite_ab=True, check_finite=False))


def _with_kinks(values: Array, penalised: Array, blur: float, deviation: float) -> Array:
    """Return which second differences are penalised, without those where a path of a longer blur misses a kink."""
    missed = values - _solved(_weight(tuning.KINK_BLUR * blur) * penalised, values)
    size = np.zeros(missed.size)
    for window in tuning.KINK_WINDOWS:
        size = np.maximum(size, np.abs(uniform_filter1d(missed, window)) * sqrt(window) / deviation)
    reach, found = max(1, int(tuning.KINK_BLUR * blur)), penalised.copy()
    for free in np.flatnonzero(penalised == 0).tolist():
        size[max(0, free + 1 - reach // 2) : free + 2 + reach // 2] = 0
    while size.max() > tuning.KINK_DEVIATIONS:
        kink = int(size.argmax())
        found[max(0, kink - 1 - tuning.KINK_WIDTH) : kink + tuning.KINK_WIDTH] = 0
        size[max(0, kink - reach) : kink + reach + 1] = 0
    return found


def _narrowed(values: Array, before: Array, wide: Array, blur: float, deviation: float) -> Array:
    """Return new kinks at one sample each, where that has the least expected error.

    A path that is free over several samples takes their noise over, which may turn a handle round that stands still.
    """
    new = np.flatnonzero(before - wide)
    if not new.size:
        return wide
    kinks = np.split(new, np.flatnonzero(np.diff(new) > 1) + 1)
    reach = max(tuning.KINK_WIDTH, int(tuning.KINK_BLUR * blur) // 2)
    best, chosen = np.full(len(kinks), np.inf), list(kinks)
    for place in range(-1, max(one.size for one in kinks)):
        tried = [one if place < 0 else one[place : place + 1] for one in kinks]
        penalised = before.copy()
        penalised[np.concatenate(tried)] = 0
        missed = (values - _solved(_weight(blur) * penalised, values)) ** 2
        for n, (own, free) in enumerate(zip(kinks, tried, strict=True)):
            near = missed[max(0, own[0] + 1 - reach) : own[-1] + 2 + reach]
            risk = float(near.sum()) + 2 * deviation**2 * free.size
            if free.size and risk < best[n]:
                best[n], chosen[n] = risk, free
    found = before.copy()
    found[np.concatenate(chosen)] = 0
    return found


def _smoothing_errors(penalised: Array, blur: float, deviation: float) -> tuple[list[PathError], Array]:
    """Return errors that a smooth path may have, and their independent combinations."""
    count = penalised.size + 2
    distance = max(1, int(tuning.NODE_DISTANCE * blur), count // tuning.MOST_NODES)
    free = np.flatnonzero(penalised == 0)[:, None] + np.arange(3)
    nodes = np.unique(np.concatenate([np.arange(0, count, distance), [count - 1], free.ravel()]))
    reach = int(tuning.NODE_REACH * blur) + 1
    errors, covariance = [], np.zeros((nodes.size, nodes.size))
    weights = _weight(blur) * penalised
    for some in np.array_split(np.arange(nodes.size), max(1, nodes.size // 32)):
        right = np.zeros((count, some.size))
        right[nodes[some], np.arange(some.size)] = deviation**2
        columns = _solved(weights, right)
        covariance[some] = columns[nodes].T
        for node, column in zip(nodes[some].tolist(), columns.T, strict=True):
            first = max(0, node - reach)
            errors.append(PathError(first, column[first : node + reach + 1] / sqrt(column[node])))
    size = np.sqrt(np.diag(covariance))
    variances, directions = eigh(covariance / np.outer(size, size))
    kept = variances > tuning.SAME_ERROR * variances[-1]
    return errors, directions[:, kept] / np.sqrt(variances[kept])


def _turns(lengths: Array, back: NDArray[np.intp], resting: NDArray[np.bool_]) -> dict[int, tuple[float, float]]:
    """Return how far into a step a signal goes that turns there, and that depth's error, in steps, by step.

    At a constant acceleration a signal that took a time L for the step before and is back after T went T² / 4 L (L + T)
    of a step far; the step after says the same, and their difference what the acceleration's change makes of it. One
    that would come to the next step rests.
    """
    found = {}
    for step in back.tolist():
        beside = lengths[[step - 1, step + 1]]
        depths = lengths[step] ** 2 / (4 * beside * (beside + lengths[step]))
        if not (resting[step - 1 : step + 2].any() or depths.max() >= 1):
            depth = float(depths.mean())
            found[step] = depth, max(float(np.ptp(depths)) / 2, tuning.CHORD_ERROR * depth)
    return found


def _errors_of_rests(edges: Array, stopping: Array, resting: Array, resolution: float) -> list[PathError]:
    """Return the errors that rounding hides where a signal rests: its position, its arrival and its departure."""
    errors = []
    for rest in np.flatnonzero(resting).tolist():
        begin, end = float(edges[rest]), float(edges[rest + 1])
        first, last = rest == 0, rest == edges.size - 2
        place = resolution / sqrt(12)
        if first:
            # A spool counts from where it begins: an error there displaces all the rest.
            errors.append(_polyline([end - stopping[rest], end, edges[-1]], [0, place, place], edges))
        else:
            leaving = [end, end + 1] if last else [end - stopping[rest], end]
            heights = [0, place, place, place if last else 0]
            errors.append(_polyline([begin, begin + stopping[rest], *leaving], heights, edges))
        for sign, at_edge in ((1, first), (-1, last)):
            for left, peak, right, size in () if at_edge else tuning.STOPPING_ERRORS:
                times = [sign * min(one * stopping[rest], end - begin) for one in (left, peak, right)]
                at = [(begin if sign > 0 else end) + time for time in times]
                errors.append(_polyline(at[::sign], [0, size * resolution, 0], edges))
    return errors


def _errors_of_speed(
    edges: Array, lengths: Array, resting: Array, turns: Mapping[int, tuple[float, float]], resolution: float
) -> list[PathError]:
    """Return by how much a signal whose speed changes bends away from its path between its steps."""
    errors = []
    for step in np.flatnonzero(np.logical_not(resting)).tolist():
        if step in turns:
            begin, end = edges[step : step + 2]
            errors.append(_polyline([begin, (begin + end) / 2, end], [0, turns[step][1] * resolution, 0], edges))
            continue
        before, own, after = lengths[step - 1 : step + 2].tolist()
        # the length of a rest does not show a speed
        before = own if resting[step - 1] else before
        after = own if resting[step + 1] else after
        size = tuning.CHORD_ERROR * own**2 * abs(1 / before - 1 / after) / (own + (before + after) / 2)
        if resting[step - 1] or resting[step + 1]:
            size = max(size, tuning.CHORD_ERROR / 2)
        if size > tuning.NEGLIGIBLE_STEP:
            begin, end = edges[step : step + 2]
            errors.append(_polyline([begin, (begin + end) / 2, end], [0, size * resolution, 0], edges))
    return errors


def _polyline(at: list[float], heights: list[float], edges: Array) -> PathError:
    """Return the error that runs straight between heights at sample numbers."""
    first = max(0, int(np.ceil(at[0])))
    last = min(int(edges[-1]), int(np.floor(at[-1])))
    return PathError(first, np.interp(np.arange(first, max(first, last) + 1), at, heights))


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
    substeps: int = 1
    """Steps of the model in each of these, where samples are far apart for its tip."""

    @property
    def fine_commands(self) -> Array:
        """The core's commands by step of the model, interpolated."""
        if self.substeps == 1:
            return self.commands
        count = len(self.commands)
        at = (np.arange(1, self.substeps * count + 1) / self.substeps) - 1
        return np.stack([np.interp(at, np.arange(count), column) for column in self.commands.T], axis=1)

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
