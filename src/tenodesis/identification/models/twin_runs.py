"""Recordings of an instrument as a twin takes them: commands step by step, and what was measured in those steps."""

from collections.abc import Mapping
from itertools import pairwise
from math import hypot, pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from tenodesis import _core
from tenodesis.identification.formats.instrument_run import TENDONS
from tenodesis.identification.formats.measured import Measured
from tenodesis.instrument import Instrument
from tenodesis.signals import Array

READINGS = ("measured_handle_angle", "measured_output_angle", "tension_agonist", "tension_antagonist")
"""What the core tells of a twin's sensors, in its order."""

_COMMANDS = _core.twin_commands()
_LEAD = 0.5
"""Time in which a run that does not begin at rest is led to where it begins, s."""
_STILL = 5e-3
"""Share of the handle's range and of the pretension's stretch that counts as being at rest."""
_BEGINNING = 0.05
"""Time that tells where a run begins, s."""
_TAUT = 0.2
"""Share of the pretension above which a tendon counts as taut."""
_NEAR = 0.5
"""Share of the pretension by which a tension may be off what a spool's angle makes it."""
_TURN = 0.1
"""Share of the handle's way that counts as having turned."""
_RESTING = 0.3
"""Time that a spool has to rest to have its own error of place, s."""
_MOST_RESTS = 3
_LONG = 4
"""How many times longer than next to it a converter's step lasts where a signal rests."""
_TURNING = 0.05
"""Time that a spool takes at most to come to rest, s."""
_LONGEST_BLUR = 0.2
"""Longest time that a sensor is smoothed over, s."""


class Prepared(NamedTuple):
    """One run in steps of equal length."""

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
    deviation: Mapping[str, float]
    """Standard deviation of a single reading, by name."""
    misplaced: tuple[Array, ...]
    """Errors that the spools' encoders leave in the commands, one standard deviation each."""
    as_read: bool
    """Whether the handle is where its encoder says less its offset, and not where it was commanded to be."""


def prepared(run: Measured, inst: Instrument, stride: int) -> Prepared:
    """Return a run averaged over so many samples a step.

    Parameters
    ----------
    run
        The recording, in columns of InstrumentRun.
    inst
        The instrument, for what its sensors are and what pretension it should have.
    stride
        Samples per step.
    """
    columns = dict(run.columns)
    # A hand that gives way is not where it was told to be.
    if inst.dynamics.hand_stiffness and "measured_handle_angle" in columns:
        columns["handle_angle"] = columns["measured_handle_angle"]
    as_read = "measured_handle_angle" not in columns or np.array_equal(
        columns["measured_handle_angle"], columns["handle_angle"]
    )
    readings = [name for name in READINGS if name in columns and not (as_read and name == READINGS[0])]
    fresh = _fresh(columns, readings)
    step = stride * run.sample_time
    place = np.floor((run.time - run.time[0]) / step + 0.5 / stride).astype(np.intp)
    # samples left over at the end would make a step that is not whole
    count = max(1, int((run.time[-1] - run.time[0]) / run.sample_time + 1.5) // stride)
    inside = place < count

    def mean(values: Array, chosen: NDArray[np.bool_] = inside) -> tuple[Array, NDArray[np.intp]]:
        weights = np.bincount(place[chosen], minlength=count)
        filled = np.flatnonzero(weights)
        return np.bincount(place[chosen], values[chosen], minlength=count)[filled] / weights[filled], filled

    def bridged(values: Array) -> Array:
        means, filled = mean(values)
        full: Array = np.interp(np.arange(count), filled, means)
        return full

    commands = np.zeros((count, len(_COMMANDS)))
    handle = columns["handle_angle"]
    if as_read:
        handle = smoothed(handle, run.sample_time, _deviation(READINGS[0], inst))
    commands[:, _COMMANDS.index("handle_angle")] = bridged(handle)
    for name in ("force", "radial_force"):
        if name in columns:
            commands[:, _COMMANDS.index(name)] = bridged(columns[name])
    drives = inst.drives
    counts = 2 * pi / drives.encoder_counts / drives.gear_ratio
    errors = []
    for tendon in TENDONS:
        if f"spool_{tendon}" in columns:
            spool = columns[f"spool_{tendon}"]
            reference = _reference(run.time, spool, columns[f"tension_{tendon}"], inst)
            let_out = _COMMANDS.index(f"{tendon}_let_out")
            read = bridged(spool)
            commands[:, let_out] = -drives.spool_radius * bridged(unrounded(spool, run.sample_time) - reference)
            for rest in _rests(read, step):
                # A spool that stops elsewhere stops earlier or later: friction is as the way there leaves it.
                way = np.sign(read[rest.start] - read[max(0, rest.start - 1)]) or 1.0
                errors.append((let_out, rest, -way * drives.spool_radius * counts / sqrt(12)))
    averaged = {name: mean(columns[name], inside & fresh) for name in readings}
    kept = averaged[readings[0]][1]
    lead = _leading(commands[0], step, inst)
    known = kept >= (_turned(commands[:, _COMMANDS.index("handle_angle")]) if len(lead) else 0)
    misplaced = []
    for column, rest, error in errors:
        moved = np.zeros((len(lead) + count, len(_COMMANDS)))
        moved[len(lead) + rest.start : len(lead) + rest.stop, column] = error
        misplaced.append(moved)
    return Prepared(
        name=run.name,
        time_step=step,
        stride=stride,
        commands=np.concatenate([lead, commands]),
        lead=len(lead),
        kept=kept[known] + len(lead),
        time=run.time[0] + (kept[known] + 0.5 - 0.5 / stride) * step,
        measured={name: values[known] for name, (values, _) in averaged.items()},
        deviation={name: _deviation(name, inst) for name in readings},
        misplaced=tuple(misplaced),
        as_read=as_read,
    )


def smoothed(values: Array, sample_time: float, deviation: float) -> Array:
    """Return a signal without as much of its noise as can be told from it.

    Second differences are penalised (Whittaker 1923) by the weight of least expected error (Stein 1981), up to a blur
    of a fifth of a second.

    Parameters
    ----------
    values
        The signal, shape (n,), evenly sampled.
    sample_time
        Time between samples, s.
    deviation
        Standard deviation of its noise, in its own unit.
    """
    if deviation <= 0 or values.size < 8 or not np.ptp(values):
        return values
    squares = np.array([[1.0, -4.0, 6.0]]).T * np.ones(values.size)
    squares[2, [0, -1]], squares[2, [1, -2]] = 1, 5
    squares[1, [1, -1]] = -2
    best, least = values, 2 * deviation**2 * values.size
    longest = max(4.0, _LONGEST_BLUR / sample_time)
    for blur in np.geomspace(4.0, longest, 12):
        weight = (blur / (2 * pi)) ** 4
        banded = weight * squares
        banded[2] += 1
        smooth = solveh_banded(banded, values, overwrite_ab=True, check_finite=False)
        # the smoother's trace, for a long signal
        freedom = values.size * weight**-0.25 / (2 * sqrt(2))
        risk = float(np.sum((values - smooth) ** 2)) + 2 * deviation**2 * min(freedom, values.size)
        if risk >= least:
            break
        best, least = smooth, risk
    return best


def unrounded(values: Array, sample_time: float) -> Array:
    """Return a signal without a converter's rounding, which tells when it passes from one step to the next.

    Between such times it is drawn straight; where it rests, turns, begins or ends it is in the middle of the step.

    Parameters
    ----------
    values
        The signal, shape (n,), evenly sampled, rounded and without noise.
    sample_time
        Time between samples, s.
    """
    changes = np.flatnonzero(np.diff(values))
    if not changes.size:
        return values
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
    return np.asarray(np.interp(np.arange(values.size), at[order], there[order]))


def _fresh(columns: Mapping[str, Array], readings: list[str]) -> NDArray[np.bool_]:
    """Return which rows hold a reading of their own, where sensors are held over several rows."""
    changed = np.zeros(columns[readings[0]].size, dtype=np.bool_)
    changed[0] = True
    for name in readings:
        changed[1:] |= np.diff(columns[name]) != 0
    held = changed.mean() < 0.7
    return changed if held else np.ones_like(changed)


def _reference(time: Array, spool: Array, tension: Array, inst: Instrument) -> float:
    """Return the spool's angle at which its tendon has the pretension.

    It is looked at where a taut run begins, or where a slack tendon has first grown as tight as the instrument's
    pretension. If a spool that counts from the pretension would be about there, as in recordings of this package, the
    angle is zero; otherwise it is the one looked at.
    """
    beginning = time <= time[0] + _BEGINNING
    at, pulled = float(np.median(spool[beginning])), float(np.median(tension[beginning]))
    if pulled < _TAUT * inst.pretension:
        reached = np.flatnonzero(tension >= inst.pretension)
        tight = int(reached[0]) if reached.size else int(np.argmax(tension))
        at, pulled = float(spool[tight]), float(tension[tight])
    expected = inst.pretension + inst.tendon_stiffness * inst.drives.spool_radius * at
    return 0.0 if abs(pulled - expected) < _NEAR * inst.pretension else at


def _rests(spool: Array, step: float) -> list[slice]:
    """Return the longest stretches of time in which a spool that moves otherwise rests.

    Rounding of its angle lasts as long, and no sample of it tells that.
    """
    edges = np.concatenate([[0], np.flatnonzero(np.diff(spool)) + 1, [spool.size]])
    if edges.size == 2:
        return []
    stretches = [slice(int(start), int(end)) for start, end in pairwise(edges) if (end - start) * step >= _RESTING]
    return sorted(stretches, key=lambda one: one.start - one.stop)[:_MOST_RESTS]


def _leading(first: Array, step: float, inst: Instrument) -> Array:
    """Return commands that lead from rest to the first one; none where that is rest."""
    scale = np.full(first.size, _STILL * inst.pretension)
    scale[_COMMANDS.index("handle_angle")] = _STILL * inst.handle_range
    for tendon in TENDONS:
        scale[_COMMANDS.index(f"{tendon}_let_out")] = _STILL * inst.pretension / inst.tendon_stiffness
    if (np.abs(first) <= scale).all():
        return np.zeros((0, first.size))
    share = np.linspace(0, 1, max(2, round(_LEAD / step)))[:, None]
    return np.asarray(share**2 * (3 - 2 * share) * first)


def _turned(handle: Array) -> int:
    """Return from where on a handle has turned twice, so that friction depends no more on what was before.

    That is the beginning where it takes more than a third of the run.
    """
    least, turns, way, far = _TURN * float(np.ptp(handle)), 0, 0.0, 0
    for at, angle in enumerate(handle[: len(handle) // 3].tolist()):
        gone = angle - handle[far]
        if way == 0 and abs(gone) >= least:
            way, far = np.sign(gone), at
        elif way * gone > 0:
            far = at
        elif way * gone <= -least and way:
            way, far, turns = -way, at, turns + 1
        if turns == 2:
            return at
    return 0


def _deviation(name: str, inst: Instrument) -> float:
    """Return the standard deviation of a reading of a sensor, with its converter's steps."""
    sensors = inst.sensors
    if name.startswith("tension"):
        return hypot(sensors.load_cell_noise, 2 * sensors.load_cell_range / 2**sensors.load_cell_bits / sqrt(12))
    return hypot(sensors.encoder_noise, sensors.encoder_range / 2**sensors.encoder_bits / sqrt(12))
