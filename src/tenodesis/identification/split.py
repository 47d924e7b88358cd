"""Parts of a recording: the stretch that says the most, and a part that is fitted beside one that is held out.

The model runs through what comes before a part, because friction remembers it, by the proximal signals alone: no error
is taken there.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import inf
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tenodesis import plant
from tenodesis.errors import ArgumentError, IdentificationError
from tenodesis.identification.formats.instrument_run import InstrumentRun
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.identification.problem import Problem, Trace
from tenodesis.identification.routing import RoutingRun
from tenodesis.identification.twin_model import tuning
from tenodesis.identification.twin_model.problem import TwinProblem, instrument_of
from tenodesis.instrument import ShortForm
from tenodesis.run import Array

LONGEST = 30.0
"""Duration of a recording that is fitted as it is, and of the stretch of a longer one, s."""
LEAST_LENGTH = 1.0
"""Shortest stretch, s."""
_MOST_STRETCHES = 40
"""Stretches of a recording that are judged; of one of more than ten minutes they lie further apart."""
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

    Stretches overlap by half, or lie evenly apart where that would be more than 40. Each is judged by the determinant
    of the information at the instrument's values; one that begins amid a motion, so that its friction is unknown, is
    not taken.

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
    if last - first <= longest:
        return run
    if isinstance(run, RoutingRun):
        note = f"of {last - first:.4g} s the first {longest:.4g} s are fitted, from where the spools are known"
        return replace(_between(run, first, first + longest), notes=(*run.notes, note))
    if not isinstance(run, InstrumentRun):
        return run
    inst = instrument_of([run], instrument).planar[0]
    apart = max(longest / 2, (last - longest - first) / (_MOST_STRETCHES - 1))
    begins = [*np.arange(first, last - longest - apart / 2, apart).tolist(), last - longest]
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
    try:
        problem = TwinProblem([part.rows(slice(None, None, every))], law, inst)
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
    # the last digit of a clock must not decide about a sample
    slack = 1e-3 * run.sample_time
    return run.rows((run.time >= begin - slack) & (run.time <= end + slack))


FittedPart: TypeAlias = Literal["until", "from"]

LEAST_SHARE = 0.05
"""Of the duration that either part has to have."""


class Window(NamedTuple):
    """Where errors of a run are taken, s."""

    begin: float
    end: float
    last: float
    """Time of the run's last sample."""


def split(
    recordings: Sequence[MeasuredRun],
    tests: Sequence[MeasuredRun],
    share: float,
    fitted: FittedPart,
    build: Callable[[Sequence[MeasuredRun], Sequence[MeasuredRun]], Problem],
) -> Problem:
    """Return a model whose first runs are the fitted part of each recording, then come the other parts, then the tests.

    Recordings are split at a share of their duration; tests are held out entirely. `fitted` says which part is: until
    the split, of which alone the model is then built, or from it on. `build` returns the model of recordings to fit and
    to hold out.

    Raises IdentificationError if the share leaves too little on either side, or the model cannot be built.
    """
    if not LEAST_SHARE <= share <= 1 - LEAST_SHARE:
        raise IdentificationError(key="share", value=share, allowed=f"{LEAST_SHARE:g} to {1 - LEAST_SHARE:g}")
    cuts = [float(one.time[0] + share * (one.time[-1] - one.time[0])) for one in recordings]
    early = [replace(one, name=f"{one.name} (until {cut:.4g} s)") for one, cut in zip(recordings, cuts, strict=True)]
    late = [replace(one, name=f"{one.name} (from {cut:.4g} s)") for one, cut in zip(recordings, cuts, strict=True)]
    ends = [float(one.time[-1]) for one in recordings]
    before = [Window(-np.inf, cut, end) for cut, end in zip(cuts, ends, strict=True)]
    behind = [Window(cut, np.inf, end) for cut, end in zip(cuts, ends, strict=True)]
    if fitted == "until":
        train, test = [one.rows(one.time < cut) for one, cut in zip(early, cuts, strict=True)], late
        windows = dict(enumerate(behind, start=len(train)))
    else:
        train, test = late, early
        windows = dict(enumerate([*behind, *before]))
    return Windowed(build(train, [*test, *tests]), windows)


def _within(name: str) -> Any:
    """Return the method of a problem by its name, of whose rows it takes those within the window."""

    def method(self: "Windowed", values: Array, run: int, *more: Any) -> Any:
        return self.counted(getattr(self.problem, name)(values, run, *more), run)

    method.__doc__ = f"{getattr(Problem, name).__doc__} Within the window."
    return method


def _same(name: str) -> Any:
    """Return the method of a problem by its name, as it is."""

    def method(self: "Windowed", *given: Any) -> Any:
        return getattr(self.problem, name)(*given)

    method.__doc__ = getattr(Problem, name).__doc__
    return method


class Windowed(Problem):
    """A problem with some runs of which only a window counts, by index of the run."""

    residuals, jacobian, derivatives, systematic_errors, plain_residuals = map(
        _within, ("residuals", "jacobian", "derivatives", "systematic_errors", "plain_residuals")
    )
    sample_time, channels, sensors, refine, weigh_sensors, sensor_noise, advice, instrument = map(
        _same,
        ("sample_time", "channels", "sensors", "refine", "weigh_sensors", "sensor_noise", "advice", "instrument"),
    )

    def __init__(self, problem: Problem, windows: Mapping[int, Window]) -> None:
        self.problem, self._windows = problem, windows
        self.parameters, self.runs, self.groups = problem.parameters, problem.runs, problem.groups
        self.searches_near = problem.searches_near

    def errors(self, values: Array, run: int) -> dict[str, Array]:
        """Return measured minus model within the window by name, each with its unit last."""
        errors = self.problem.errors(values, run)
        if run not in self._windows:
            return errors
        traces = self.problem.traces(values, run)
        times = {key: traces[key].time if key in traces else self._times(one.size, run) for key, one in errors.items()}
        return {key: one[self._inside(times[key], run)] for key, one in errors.items()}

    def traces(self, values: Array, run: int) -> dict[str, Trace]:
        """Return measured and modelled signals within the window by name with the unit last."""
        traces = self.problem.traces(values, run)
        if run not in self._windows:
            return traces
        return {key: Trace(*(signal[self._inside(one.time, run)] for signal in one)) for key, one in traces.items()}

    def residuals_near(self, values: Array, run: int, other: Problem, there: Array) -> Array:
        """Return the residuals within the window, (n,), whitened as those of another model near its values."""
        like = other.problem if isinstance(other, Windowed) else other
        return np.asarray(self.counted(self.problem.residuals_near(values, run, like, there), run))

    def counted(self, rows: Any, run: int) -> Any:
        """Return the rows of samples within the window; None if there are none."""
        if rows is None or run not in self._windows:
            return rows
        count = self.channels(run)
        return rows[np.tile(self._inside(self._times(rows.shape[0] // count, run), run), count)]

    def _times(self, count: int, run: int) -> Array:
        """Return when samples that end with the recording were taken, s."""
        return np.asarray(self._windows[run].last - self.sample_time(run) * np.arange(count)[::-1])

    def _inside(self, time: Array, run: int) -> NDArray[np.bool_]:
        window = self._windows[run]
        return np.asarray((time >= window.begin) & (time < window.end))
