"""Inputs reconstructed from quantised sensors: the path that an encoder saw, and the errors that this leaves in it."""

from math import pi, sqrt
from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh, solveh_banded
from scipy.ndimage import uniform_filter1d

from tenodesis.identification.quantisation import QuantisedSensor
from tenodesis.identification.twin_model import tuning
from tenodesis.run import Array


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
        kinked = _with_kinks(values, penalised, blur, deviation)
        new_smooth, new_blur, new_risk = _least_risk(values, kinked, sample_time, deviation)
        if new_risk >= risk:
            break
        penalised, smooth, blur, risk = kinked, new_smooth, new_blur, new_risk
    if not blur:
        return ReconstructedPath(values)
    errors, mixing = _smoothing_errors(penalised, blur, deviation)
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
    resting[1:-1] |= middles[:-2] == middles[2:]
    stopping = np.minimum(np.minimum(neighbour, lengths) / 2, tuning.STOPPING_TIME / sample_time)
    at = np.concatenate([edges[1:-1], (edges[:-1] + stopping)[resting], (edges[1:] - stopping)[resting]])
    there = np.concatenate([(middles[1:] + middles[:-1]) / 2, middles[resting], middles[resting]])
    order = np.argsort(at, kind="stable")
    path = np.asarray(np.interp(np.arange(values.size), at[order], there[order]))
    errors = _errors_of_rests(edges, stopping, resting, resolution) + _errors_of_speed(
        edges, lengths, resting, resolution
    )
    return ReconstructedPath(path, tuple(errors), np.eye(len(errors)))


def _least_risk(values: Array, penalised: Array, sample_time: float, deviation: float) -> tuple[Array, float, float]:
    """Return the smooth path of least expected error, its blur in samples, 0 where none is better, and that error."""
    best, chosen, least = values, 0.0, 2 * deviation**2 * values.size
    kinks = np.count_nonzero(penalised == 0)
    longest = max(tuning.BLUR_SHORTEST, tuning.BLUR_LONGEST / sample_time)
    for blur in np.geomspace(tuning.BLUR_SHORTEST, longest, tuning.BLURS).tolist():
        weight = _weight(blur)
        smooth = _solved(weight * penalised, values)
        # the smoother's trace, for a long signal
        freedom = values.size * weight**-0.25 / (2 * sqrt(2)) + kinks
        risk = float(np.sum((values - smooth) ** 2)) + 2 * deviation**2 * min(freedom, values.size)
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


def _errors_of_speed(edges: Array, lengths: Array, resting: Array, resolution: float) -> list[PathError]:
    """Return by how much a signal whose speed changes bends away from the straight lines between its steps."""
    errors = []
    for step in np.flatnonzero(np.logical_not(resting)).tolist():
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
