"""What models of recordings by a twin have in common: its readings in steps against those that were measured."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from tenodesis.identification.problem import Problem, Trace
from tenodesis.identification.twin_model import tuning
from tenodesis.identification.twin_model.steps import SteppedRun
from tenodesis.run import Array


class ChannelLabel(NamedTuple):
    """How a channel is shown: name of its trace, and of the errors that it counts among, if any; both end in a unit."""

    trace: str
    errors: str
    scale: float = 1.0
    """Of that unit, per SI unit."""


class SteppedProblem(Problem):
    """Recordings in the steps of a twin, whose readings are their model."""

    _runs: Sequence[SteppedRun]

    @abstractmethod
    def _readings(self, values: Array, run: int) -> Mapping[str, Array]:
        """Return the model's readings by channel in the steps with readings, NaN where its tip is lost."""

    @abstractmethod
    def _shown(self, channel: str) -> ChannelLabel:
        """Return how a channel is shown."""

    def _likeliest(self, values: Array, run: int) -> Mapping[str, Array]:
        """Return the model's readings with what sensors most likely read off."""
        return self._readings(values, run)

    def channels(self, run: int) -> int:
        """Return how many sensors the residuals of a run hold."""
        return len(self._runs[run].measured)

    def sensors(self, run: int) -> tuple[str, ...]:
        """Return what these sensors are called."""
        return tuple(self._runs[run].measured)

    def sample_time(self, run: int) -> float:
        """Return the time between residuals of a sensor, s."""
        return float(np.median(np.diff(self._runs[run].time)))

    def plain_residuals(self, values: Array, run: int) -> Array:
        """Return measured minus model in standard deviations, (n,), errors of commands included."""
        return self._plain(self._readings(values, run), run)

    def errors(self, values: Array, run: int) -> dict[str, Array]:
        """Return measured minus model by kind, of each all its channels one after another."""
        model, found = self._likeliest(values, run), dict[str, list[Array]]()
        for channel, measured in self._runs[run].measured.items():
            shown = self._shown(channel)
            if shown.errors:
                found.setdefault(shown.errors, []).append(shown.scale * (measured - model[channel]))
        return {kind: np.concatenate(parts) for kind, parts in found.items()}

    def traces(self, values: Array, run: int) -> dict[str, Trace]:
        """Return every channel's signal with the model's."""
        model, one = self._likeliest(values, run), self._runs[run]
        found = {}
        for channel, measured in one.measured.items():
            shown = self._shown(channel)
            found[shown.trace] = Trace(one.time, shown.scale * measured, shown.scale * model[channel])
        return found

    def _plain(self, readings: Mapping[str, Array], run: int) -> Array:
        """Return measured minus readings in standard deviations, one channel after another."""
        off = self._scaled(self._runs[run].measured, run) - self._scaled(readings, run)
        return np.asarray(np.nan_to_num(off, nan=tuning.LOST_RESIDUAL), dtype=np.float64)

    def _scaled(self, readings: Mapping[str, Array], run: int) -> Array:
        """Return readings of what was measured, (n,) each, in standard deviations, one channel after another."""
        deviation = self._runs[run].deviation
        return np.concatenate([readings[channel] / deviation[channel] for channel in self._runs[run].measured])
