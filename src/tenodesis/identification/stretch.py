"""The stretch of a long recording that says the most about an instrument's parameters."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import inf

import numpy as np

from tenodesis import plant
from tenodesis.errors import ArgumentError, IdentificationError
from tenodesis.identification.formats.instrument_run import InstrumentRun
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.identification.twin_model import tuning
from tenodesis.identification.twin_model.problem import TwinProblem, instrument_of
from tenodesis.instrument import ShortForm

LONGEST = 30.0
"""Duration of a recording that is fitted as it is, and of the stretch of a longer one, s."""
LEAST_LENGTH = 1.0
"""Shortest stretch, s."""
_LEAST_SAMPLES = 100
"""Of a stretch, which may hold a gap of the recording."""


def shortened(
    run: MeasuredRun,
    *,
    law: str,
    instrument: ShortForm | None,
    free: Callable[[TwinProblem], Sequence[str]] | None = None,
    longest: float = LONGEST,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> MeasuredRun:
    """Return the stretch of an instrument's recording that narrows its parameters most, or all of it if it is short.

    Stretches overlap by half. Each is judged by the determinant of the information at the instrument's values; one that
    begins amid a motion, so that its friction is unknown, is not taken.

    Parameters
    ----------
    law, instrument
        As for the problem.
    free
        Which parameters count, by the problem; by default all.
    longest
        Duration, s, at least 1 s.
    progress
        Called with how many of how many stretches are judged.

    Raises
    ------
    ValueError
        `longest` is below 1 s.
    """
    if not longest >= LEAST_LENGTH:
        raise ArgumentError(key="longest", value=longest, allowed=f"at least {LEAST_LENGTH:g} s")
    first, last = float(run.time[0]), float(run.time[-1])
    if last - first <= longest or not isinstance(run, InstrumentRun):
        return run
    inst = instrument_of([run], instrument).planar[0]
    begins = [*np.arange(first, last - longest, longest / 2).tolist(), last - longest]
    best, place = -inf, first
    for number, begin in enumerate(begins):
        progress(number, len(begins))
        information = _information(_between(run, begin, begin + longest), law, inst, free)
        if information > best:
            best, place = information, begin
    progress(len(begins), len(begins))
    if best == -inf:
        return run
    begin = place - first
    note = (
        f"of {last - first:.4g} s the {longest:.4g} s from {begin:.4g} s on are fitted, which say the most about the "
        "parameters"
    )
    name = f"{run.name} ({begin:.4g} to {begin + longest:.4g} s)"
    return replace(_between(run, place, place + longest), name=name, notes=(*run.notes, note))


def _information(
    part: MeasuredRun, law: str, inst: ShortForm, free: Callable[[TwinProblem], Sequence[str]] | None
) -> float:
    """Return the logarithm of the determinant of what a stretch says about parameters, over their ranges."""
    if len(part) < _LEAST_SAMPLES:
        return -inf
    # A rough look is enough: few samples, and no errors of the commands.
    longest = min(tuning.LONGEST_STEP, plant.longest_step(inst))
    every = max(1, int(longest / part.sample_time * (1 + 1e-6)))
    thin = replace(part, time=part.time[::every], columns={name: one[::every] for name, one in part.columns.items()})
    try:
        problem = TwinProblem([thin], law, inst)
    except IdentificationError:
        return -inf
    if not problem.begins_known(0):
        return -inf
    names = [one.name for one in problem.parameters]
    which = [names.index(name) for name in (names if free is None else free(problem))]
    values = np.array([one.start for one in problem.parameters])
    ranges = np.array([problem.parameters[n].upper - problem.parameters[n].lower for n in which])
    slopes = problem.plain_derivatives(values, 0, which) * ranges
    return float(np.linalg.slogdet(np.eye(len(which)) + slopes.T @ slopes)[1])


def _between(run: MeasuredRun, begin: float, end: float) -> MeasuredRun:
    kept = (run.time >= begin) & (run.time <= end)
    return replace(run, time=run.time[kept], columns={name: one[kept] for name, one in run.columns.items()})
