"""What the models of the data sets share: one reference sensor, of which a model gives the readings."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Generic, TypeVar

import numpy as np

from tenodesis.errors import IdentificationError
from tenodesis.identification.datasets.friction_laws import Values
from tenodesis.identification.differences import complex_step
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.identification.problem import Problem, Trace
from tenodesis.instrument import ShortForm
from tenodesis.run import Array


@dataclass(frozen=True, kw_only=True)
class ReferenceSeries:
    """What a model reads of a run, and the reference that it is compared with, each (n,)."""

    time: Array
    """s."""
    reference: Array
    first: int = 0
    """Sample from which on errors count."""


_Series = TypeVar("_Series", bound=ReferenceSeries)


class ReferenceProblem(Problem, Generic[_Series]):
    """A model of one reference sensor, with its recordings as they are fitted and in full."""

    key: ClassVar[str]
    """Name of the errors, their unit last."""
    scale: ClassVar[float] = 1.0
    """Of that unit, per SI unit."""
    noise: ClassVar[float]
    """Standard deviation of the reference sensor, SI."""
    fitted: Sequence[_Series]
    full: Sequence[_Series]

    @abstractmethod
    def modelled(self, values: Values, series: _Series) -> Values:
        """Return the reference by the model, (n,); it is complex where values are, for exact derivatives."""

    def predict(self, values: Array, run: int) -> Array:
        """Return the modelled reference at all samples, (n,), by nothing but the run's proximal signals."""
        return self.modelled(values, self.full[run])

    def residuals(self, values: Array, run: int) -> Array:
        """Return measured minus modelled reference, (n,), in standard deviations of its sensor."""
        return self._errors(values, self.fitted[run]) / self.noise

    def jacobian(self, values: Array, run: int) -> Array:
        """Return the derivatives of the residuals, (n, parameters)."""
        series = self.fitted[run]
        return -complex_step(lambda at: self.modelled(at, series)[series.first :], values) / self.noise

    def errors(self, values: Array, run: int) -> dict[str, Array]:
        """Return measured minus modelled reference at all samples that count."""
        return {self.key: self.scale * self._errors(values, self.full[run])}

    def traces(self, values: Array, run: int) -> dict[str, Trace]:
        """Return measured and modelled reference at all samples that count."""
        series = self.full[run]
        measured = series.reference[series.first :]
        model = measured - self._errors(values, series)
        return {self.key: Trace(series.time[series.first :], self.scale * measured, self.scale * model)}

    def sample_time(self, run: int) -> float:
        """Return the time between the samples that are fitted, s."""
        series = self.fitted[run]
        return float(np.median(np.diff(series.time[series.first :])))

    def _errors(self, values: Array, series: _Series) -> Array:
        return (series.reference - self.modelled(values, series))[series.first :]


def check_recordings(recordings: Sequence[MeasuredRun]) -> None:
    """Raise IdentificationError if there is nothing to train on."""
    if not recordings:
        raise IdentificationError("train is empty; it must hold at least one recording.", key="train")


def refuse_instrument(instrument: ShortForm | None, recorded: str) -> None:
    """Raise IdentificationError for an instrument, which the model of a data set has none of."""
    if instrument is not None:
        raise IdentificationError(f"instrument is given; it must be left out: {recorded}.", key="instrument")
