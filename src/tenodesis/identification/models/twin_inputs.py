"""What sensors tell of a twin's inputs: the path that an encoder saw, and the errors that this leaves in it."""

from math import pi, sqrt
from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh, solveh_banded
from scipy.ndimage import uniform_filter1d

from tenodesis.identification.models.converter import Converter
from tenodesis.run import Array

_LONGEST_BLUR = 0.2
"""Longest time that a sensor is smoothed over, s."""
_BLURS = 14
_KINK = 5.0
"""Standard errors by which a smoothed path that misses a kink is off."""
_BROADER = 2.0
"""Over the best blur, that of the path which is to miss kinks."""
_WINDOWS = (5, 11, 21, 41, 81)
"""Samples over which it may be."""
_AROUND = 5
"""Samples beside a kink that may be the kink themselves."""
_MOST_ROUNDS = 20
_APART = 0.35
"""Distance of the places at which a smoothed path has errors of their own, over the blur."""
_MOST_PLACES = 300
_REACH = 2.0
"""Times the blur beyond which a place's error has died away."""
_ONE = 1e-6
"""Share of the largest variance below which errors are one and the same."""
_FAINT = 1e-4
"""Variance of a harmonic, over that of a reading, below which it is left out."""

_LONG = 4
"""How many times longer than next to it a converter's step lasts where a signal rests."""
_TURNING = 0.05
"""Time that a spool takes at most to come to rest, s."""
_STOPPING = ((0.0, 1.0, 2.0, 0.3), (1.0, 2.0, 6.0, 0.15))
"""Begin, peak and end of errors in how a spool comes to rest, over that time, and their size in converter's steps."""
_BUMP = 1 / 8
"""Of a chord's distance from a parabola, over the square of the time."""
_SMALL = 0.02
"""Size in converter's steps below which an error of a turning spool is left out."""


class Error(NamedTuple):
    """An error that a sensor may leave in a path, one standard deviation of it."""

    first: int
    """Sample at which it begins."""
    shape: Array
    """(m,), from there on."""


class Path(NamedTuple):
    """An input as its sensor tells it."""

    values: Array
    """(n,)."""
    errors: tuple[Error, ...]
    mixing: Array
    """Combinations of these errors that are independent of one another, one standard deviation each, by column."""


def smoothed(values: Array, sample_time: float, sensor: Converter) -> Path:
    """Return a signal without as much of its noise as can be told from it, and what may be left.

    Second differences are penalised (Whittaker 1923) by the weight of least expected error (Stein 1981), up to a blur
    of a fifth of a second, but for those where the signal has a kink. The errors are those of a path whose second
    differences have the variance that this weight stands for (Wahba 1983), told at some places (Quiñonero-Candela and
    Rasmussen 2005).

    Parameters
    ----------
    values
        The signal, shape (n,), evenly sampled.
    sample_time
        Time between samples, s.
    sensor
        What it was read by, in its own unit.
    """
    deviation = sensor.deviation
    if deviation <= 0 or values.size < max(_WINDOWS) or not np.ptp(values):
        return Path(values, (), np.zeros((0, 0)))
    bending = np.ones(values.size - 2)
    smooth, blur, risk = _least_risk(values, bending, sample_time, deviation)
    for _ in range(_MOST_ROUNDS if blur else 0):
        kinked = _with_kinks(values, bending, blur, deviation)
        better, longer, less = _least_risk(values, kinked, sample_time, deviation)
        if less >= risk:
            break
        bending, smooth, blur, risk = kinked, better, longer, less
    if not blur:
        return Path(values, (), np.zeros((0, 0)))
    errors, mixing = _remaining(bending, blur, deviation)
    lasting = [
        Error(0, sqrt(size) * wave(2 * pi * harmonic / sensor.resolution * smooth))
        for harmonic, size in enumerate(sensor.lasting, 1)
        if size > _FAINT * deviation**2
        for wave in (np.cos, np.sin)
    ]
    whole = np.eye(len(errors) + len(lasting), mixing.shape[1] + len(lasting))
    whole[: len(errors), : mixing.shape[1]] = mixing
    whole[: len(errors), mixing.shape[1] :] = 0
    whole[len(errors) :, mixing.shape[1] :] = np.eye(len(lasting))
    return Path(smooth, (*errors, *lasting), whole)


def unrounded(values: Array, sample_time: float, resolution: float) -> Path:
    """Return a signal without a converter's rounding, which tells when it passes from one step to the next.

    Between such times it is drawn straight; where it rests, turns, begins or ends it is in the middle of the step. What
    it may be off by: half a step where it rests, less on the way there and where its speed changes.

    Parameters
    ----------
    values
        The signal, shape (n,), evenly sampled, rounded and without noise.
    sample_time
        Time between samples, s.
    resolution
        The converter's step.
    """
    changes = np.flatnonzero(np.diff(values))
    if not changes.size:
        return Path(values, (), np.zeros((0, 0)))
    middles = np.append(values[changes], values[-1])
    edges = np.concatenate([[-0.5], changes + 0.5, [values.size - 0.5]])
    lengths = np.diff(edges)
    near = np.minimum(np.append(np.inf, lengths[:-1]), np.append(lengths[1:], np.inf))
    resting = lengths > _LONG * near
    resting[[0, -1]] = True
    resting[1:-1] |= middles[:-2] == middles[2:]
    way = np.minimum(np.minimum(near, lengths) / 2, _TURNING / sample_time)
    at = np.concatenate([edges[1:-1], (edges[:-1] + way)[resting], (edges[1:] - way)[resting]])
    there = np.concatenate([(middles[1:] + middles[:-1]) / 2, middles[resting], middles[resting]])
    order = np.argsort(at, kind="stable")
    path = np.asarray(np.interp(np.arange(values.size), at[order], there[order]))
    errors = _of_rests(edges, way, resting, resolution) + _of_speeds(edges, lengths, resting, resolution)
    return Path(path, tuple(errors), np.eye(len(errors)))


def _least_risk(values: Array, bending: Array, sample_time: float, deviation: float) -> tuple[Array, float, float]:
    """Return the smooth path of least expected error, its blur in samples, 0 where none is better, and that error."""
    best, chosen, least = values, 0.0, 2 * deviation**2 * values.size
    kinks = np.count_nonzero(bending == 0)
    for blur in np.geomspace(4.0, max(4.0, _LONGEST_BLUR / sample_time), _BLURS).tolist():
        weight = (blur / (2 * pi)) ** 4
        smooth = _solved(weight * bending, values)
        # the smoother's trace, for a long signal
        freedom = values.size * weight**-0.25 / (2 * sqrt(2)) + kinks
        risk = float(np.sum((values - smooth) ** 2)) + 2 * deviation**2 * min(freedom, values.size)
        if risk < least:
            best, chosen, least = smooth, blur, risk
    return best, chosen, least


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


def _with_kinks(values: Array, bending: Array, blur: float, deviation: float) -> Array:
    """Return which second differences are penalised, less those where a path of twice the blur misses a kink."""
    off = values - _solved((_BROADER * blur / (2 * pi)) ** 4 * bending, values)
    size = np.zeros(off.size)
    for window in _WINDOWS:
        size = np.maximum(size, np.abs(uniform_filter1d(off, window)) * sqrt(window) / deviation)
    reach, found = max(1, int(_BROADER * blur)), bending.copy()
    for free in np.flatnonzero(bending == 0).tolist():
        size[max(0, free + 1 - reach // 2) : free + 2 + reach // 2] = 0
    while size.max() > _KINK:
        kink = int(size.argmax())
        found[max(0, kink - 1 - _AROUND) : kink + _AROUND] = 0
        size[max(0, kink - reach) : kink + reach + 1] = 0
    return found


def _remaining(bending: Array, blur: float, deviation: float) -> tuple[list[Error], Array]:
    """Return errors that a smooth path may have, and their independent combinations."""
    count = bending.size + 2
    apart = max(1, int(_APART * blur), count // _MOST_PLACES)
    free = np.flatnonzero(bending == 0)[:, None] + np.arange(3)
    places = np.unique(np.concatenate([np.arange(0, count, apart), [count - 1], free.ravel()]))
    reach = int(_REACH * blur) + 1
    errors, covariance = [], np.zeros((places.size, places.size))
    weights = (blur / (2 * pi)) ** 4 * bending
    for some in np.array_split(np.arange(places.size), max(1, places.size // 32)):
        right = np.zeros((count, some.size))
        right[places[some], np.arange(some.size)] = deviation**2
        columns = _solved(weights, right)
        covariance[some] = columns[places].T
        for place, column in zip(places[some].tolist(), columns.T, strict=True):
            first = max(0, place - reach)
            errors.append(Error(first, column[first : place + reach + 1] / sqrt(column[place])))
    size = np.sqrt(np.diag(covariance))
    variances, directions = eigh(covariance / np.outer(size, size))
    kept = variances > _ONE * variances[-1]
    return errors, directions[:, kept] / np.sqrt(variances[kept])


def _of_rests(edges: Array, way: Array, resting: Array, resolution: float) -> list[Error]:
    """Return what rounding hides where a signal rests: its place, and how it came there and went."""
    errors = []
    for rest in np.flatnonzero(resting).tolist():
        begin, end = float(edges[rest]), float(edges[rest + 1])
        first, last = rest == 0, rest == edges.size - 2
        place = resolution / sqrt(12)
        if first:
            # Where a spool begins is where it is counted from: all the rest is off.
            errors.append(_drawn([end - way[rest], end, edges[-1]], [0, place, place], edges))
        else:
            stop = [end, end + 1] if last else [end - way[rest], end]
            errors.append(_drawn([begin, begin + way[rest], *stop], [0, place, place, place if last else 0], edges))
        for side, skipped in ((1, first), (-1, last)):
            for left, peak, right, size in () if skipped else _STOPPING:
                at = [(begin if side > 0 else end) + side * min(one * way[rest], end - begin)
                      for one in (left, peak, right)]  # fmt: skip
                errors.append(_drawn(at[::side], [0, size * resolution, 0], edges))
    return errors


def _of_speeds(edges: Array, lengths: Array, resting: Array, resolution: float) -> list[Error]:
    """Return by how much a signal whose speed changes bends away from the straight lines between its steps."""
    errors = []
    for step in np.flatnonzero(np.logical_not(resting)).tolist():
        before, own, after = lengths[step - 1 : step + 2].tolist()
        # where the neighbour is a rest, its length says nothing of the speed
        before = own if resting[step - 1] else before
        after = own if resting[step + 1] else after
        size = _BUMP * own**2 * abs(1 / before - 1 / after) / (own + (before + after) / 2)
        if resting[step - 1] or resting[step + 1]:
            size = max(size, _BUMP / 2)
        if size > _SMALL:
            begin, end = edges[step : step + 2]
            errors.append(_drawn([begin, (begin + end) / 2, end], [0, size * resolution, 0], edges))
    return errors


def _drawn(at: list[float], heights: list[float], edges: Array) -> Error:
    """Return the error of a line through some heights, at sample numbers."""
    first = max(0, int(np.ceil(at[0])))
    last = min(int(edges[-1]), int(np.floor(at[-1])))
    return Error(first, np.interp(np.arange(first, max(first, last) + 1), at, heights))
