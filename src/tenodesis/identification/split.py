"""One recording as two runs: one part of it is fitted, and the other held out.

The model runs through what comes before a part, because friction remembers it, by the proximal signals alone: no error
is taken there.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tenodesis.errors import IdentificationError
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.identification.problem import (
    Parameter,
    Problem,
    Trace,
    WithAdvice,
    WithChannels,
    WithDerivatives,
    WithGroups,
    WithInstrument,
    WithSystematicErrors,
    WithTraces,
)
from tenodesis.instrument import Instrument
from tenodesis.run import Array

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

    Parameters
    ----------
    recordings
        To be split.
    tests
        Recordings that are held out entirely.
    share
        Of each recording's duration, where it is split.
    fitted
        Which part is: until the split, of which alone the model is then built, or from it on.
    build
        Returns the model of recordings to fit and to hold out.

    Raises
    ------
    IdentificationError
        The share leaves too little on either side, or the model cannot be built.
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
        train, test = [_ended(one, cut) for one, cut in zip(early, cuts, strict=True)], late
        windows = dict(enumerate(behind, start=len(train)))
    else:
        train, test = late, early
        windows = dict(enumerate([*behind, *before]))
    problem = build(train, [*test, *tests])
    return (
        _WindowedTwin
        if isinstance(problem, WithDerivatives) and isinstance(problem, WithSystematicErrors)
        else Windowed
    )(problem, windows)


class Windowed:
    """A problem with some runs of which only a window counts.

    Parameters
    ----------
    problem
        The problem.
    windows
        By index of the run.
    """

    def __init__(self, problem: Problem, windows: Mapping[int, Window]) -> None:
        self._problem, self._windows = problem, windows

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The unknowns."""
        return self._problem.parameters

    @property
    def runs(self) -> tuple[str, ...]:
        """Names of the runs."""
        return self._problem.runs

    @property
    def groups(self) -> dict[str, tuple[str, ...]]:
        """Names of parameters by group."""
        return self._problem.groups if isinstance(self._problem, WithGroups) else {}

    def residuals(self, values: Array, run: int) -> Array:
        """Return measured minus model within the window, (n,), in units of the sensor's standard deviation."""
        return self._counted(self._problem.residuals(values, run), run)

    def jacobian(self, values: Array, run: int) -> Array | None:
        """Return the exact derivatives of the residuals, (n, parameters), or None to have them differenced."""
        jacobian = self._problem.jacobian(values, run)
        return None if jacobian is None else self._counted(jacobian, run)

    def errors(self, values: Array, run: int) -> dict[str, Array]:
        """Return measured minus model within the window by name, each with its unit last."""
        errors = self._problem.errors(values, run)
        if run not in self._windows:
            return errors
        traces = self._problem.traces(values, run) if isinstance(self._problem, WithTraces) else {}
        return {
            key: error[
                self._inside(traces[key].time if key in traces else self._times(error.size, run), self._windows[run])
            ]
            for key, error in errors.items()
        }

    def traces(self, values: Array, run: int) -> dict[str, Trace]:
        """Return measured and modelled signals within the window by name with the unit last."""
        traces = self._problem.traces(values, run) if isinstance(self._problem, WithTraces) else {}
        if run not in self._windows:
            return traces
        inside = {key: self._inside(one.time, self._windows[run]) for key, one in traces.items()}
        return {
            key: Trace(one.time[inside[key]], one.measured[inside[key]], one.model[inside[key]])
            for key, one in traces.items()
        }

    def sample_time(self, run: int) -> float:
        """Return the time between samples, s."""
        return self._problem.sample_time(run)

    def channels(self, run: int) -> int:
        """Return how many sensors the residuals of a run hold."""
        return self._problem.channels(run) if isinstance(self._problem, WithChannels) else 1

    def advice(self, names: Sequence[str]) -> str | None:
        """Return which recording would make these parameters identifiable, if one is known."""
        return self._problem.advice(names) if isinstance(self._problem, WithAdvice) else None

    def instrument(self, values: Array) -> Instrument | None:
        """Return the instrument with these values in place, or None where there is none to change."""
        return self._problem.instrument(values) if isinstance(self._problem, WithInstrument) else None

    def _counted(self, rows: Array, run: int) -> Array:
        if run not in self._windows:
            return rows
        count = self.channels(run)
        inside = self._inside(self._times(rows.shape[0] // count, run), self._windows[run])
        return rows[np.tile(inside, count)]

    def _times(self, count: int, run: int) -> Array:
        """Return when samples that end with the recording were taken, s."""
        return np.asarray(self._windows[run].last - self.sample_time(run) * np.arange(count)[::-1])

    @staticmethod
    def _inside(time: Array, window: Window) -> NDArray[np.bool_]:
        return np.asarray((time >= window.begin) & (time < window.end))


class _WindowedTwin(Windowed):
    """The same of a problem with derivatives by some parameters alone, and with systematic errors."""

    def derivatives(self, values: Array, run: int, which: Sequence[int]) -> Array:
        """Return the columns of the Jacobian for some parameters, by index, (n, columns)."""
        assert isinstance(self._problem, WithDerivatives)
        return self._counted(self._problem.derivatives(values, run, which), run)

    def systematic_errors(self, values: Array, run: int) -> Array:
        """Return the effects of systematic errors on the residuals, one standard deviation each, (n, errors)."""
        assert isinstance(self._problem, WithSystematicErrors)
        return self._counted(self._problem.systematic_errors(values, run), run)


def _ended(one: MeasuredRun, cut: float) -> MeasuredRun:
    """Return a recording up to a time."""
    kept = one.time < cut
    return replace(one, time=one.time[kept], columns={key: values[kept] for key, values in one.columns.items()})
