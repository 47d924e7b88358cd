"""Recordings of an instrument as a twin takes them: commands step by step, and what was measured in those steps."""

from collections.abc import Mapping
from math import pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from tenodesis import _core
from tenodesis.identification.formats.instrument_run import TENDONS
from tenodesis.identification.formats.measured import Measured
from tenodesis.identification.models.converter import Converter, encoder, load_cell
from tenodesis.identification.models.twin_inputs import Error, Path, smoothed, unrounded
from tenodesis.instrument import Instrument
from tenodesis.run import Array

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


class Misplaced(NamedTuple):
    """An error of one of the commands, one standard deviation of it."""

    column: int
    """Of the core's commands."""
    first: int
    """Step at which it begins."""
    shape: Array
    """(m,), from there on."""


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
    sensors: Mapping[str, Converter]
    """What readings were taken by, by name."""
    misplaced: tuple[Misplaced, ...]
    """Errors that encoders leave in the commands."""
    mixing: Array
    """Combinations of these that are independent of one another, one standard deviation each, by column."""
    as_read: bool
    """Whether the handle is where its encoder says less its offset, and not where it was commanded to be."""

    @property
    def deviation(self) -> dict[str, float]:
        """Standard deviation of a single reading, by name."""
        return {name: sensor.deviation for name, sensor in self.sensors.items()}


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
    paths: list[tuple[int, float, Path]] = []
    handle = Path(columns["handle_angle"], (), np.zeros((0, 0)))
    if as_read:
        handle = smoothed(handle.values, run.sample_time, encoder(inst))
    paths.append((_COMMANDS.index("handle_angle"), 1.0, handle))
    for name in ("force", "radial_force"):
        if name in columns:
            commands[:, _COMMANDS.index(name)] = bridged(columns[name])
    drives = inst.drives
    for tendon in TENDONS:
        if f"spool_{tendon}" in columns:
            spool = columns[f"spool_{tendon}"]
            reference = _reference(run.time, spool, columns[f"tension_{tendon}"], inst)
            path = unrounded(spool, run.sample_time, 2 * pi / drives.encoder_counts / drives.gear_ratio)
            path = path._replace(values=path.values - reference)
            paths.append((_COMMANDS.index(f"{tendon}_let_out"), -drives.spool_radius, path))
    for column, scale, path in paths:
        commands[:, column] = scale * bridged(path.values)
    averaged = {name: mean(columns[name], inside & fresh) for name in readings}
    kept = averaged[readings[0]][1]
    lead = _leading(commands[0], step, inst)
    begun = _turned(commands[:, _COMMANDS.index("handle_angle")]) if len(lead) else 0
    begun = max(begun, _slack(np.stack([averaged[f"tension_{tendon}"][0] for tendon in TENDONS]), kept, inst))
    known = kept >= begun
    misplaced = [
        _in_steps(error, column, scale, np.minimum(place, count - 1), len(lead))
        for column, scale, path in paths
        for error in path.errors
    ]
    return Prepared(
        name=run.name,
        time_step=step,
        stride=stride,
        commands=np.concatenate([lead, commands]),
        lead=len(lead),
        kept=kept[known] + len(lead),
        time=run.time[0] + (kept[known] + 0.5 - 0.5 / stride) * step,
        measured={name: values[known] for name, (values, _) in averaged.items()},
        sensors={name: load_cell(inst) if name.startswith("tension") else encoder(inst) for name in readings},
        misplaced=tuple(misplaced),
        mixing=block_diag(*(path.mixing for _, _, path in paths)),
        as_read=as_read,
    )


def _in_steps(error: Error, column: int, scale: float, place: NDArray[np.intp], lead: int) -> Misplaced:
    """Return an error of a path, averaged over the samples of each step as its commands are."""
    steps = place[error.first : error.first + error.shape.size]
    steps = steps - steps[0]
    means = np.bincount(steps, scale * error.shape) / np.maximum(np.bincount(steps), 1)
    return Misplaced(column, int(place[error.first]) + lead, means)


def _fresh(columns: Mapping[str, Array], readings: list[str]) -> NDArray[np.bool_]:
    """Return which rows hold a reading of their own, where sensors are held over several rows."""
    changed = np.zeros(columns[readings[0]].size, dtype=np.bool_)
    changed[0] = True
    for name in readings:
        changed[1:] |= np.diff(columns[name]) != 0
    held = changed.mean() < 0.7
    return changed if held else np.ones_like(changed)


def _slack(tensions: Array, kept: NDArray[np.intp], inst: Instrument) -> int:
    """Return the step at which both tendons, (2, n), first hang slack; what comes before does not outlast that.

    That is the beginning where none is slack in the first third of the run.
    """
    loose = np.flatnonzero((np.abs(tensions) < _STILL * inst.pretension).all(axis=0))
    return int(kept[loose[0]]) if loose.size and loose[0] < kept.size // 3 else 0


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
