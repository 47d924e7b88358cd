"""Fisher information of runs before anything is measured: exact derivatives, and the noise of the sensors."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from tenodesis.identification.problem import Trace
from tenodesis.identification.quantisation import QuantisedSensor, encoder, load_cell
from tenodesis.identification.twin_model.problem import TwinProblem
from tenodesis.identification.uncertainty import Uncertainty
from tenodesis.instrument import ShortForm
from tenodesis.run import Array

_UNSEEN = 1e-13
"""Information in a direction, as a share of the largest, below which it is unseen."""


@dataclass(frozen=True)
class Information:
    """Information on the parameters, in units of their scales; that of several runs is the sum."""

    curvature: Array
    """Of half the sum of squared residuals, shape (parameters, parameters)."""
    scores: Array
    """Covariance of its gradient under the sensors' errors: equal to the curvature if these are independent."""

    def __add__(self, other: "Information") -> "Information":
        """Return the information of both."""
        return Information(self.curvature + other.curvature, self.scores + other.scores)

    def of(self, free: Sequence[int]) -> "Information":
        """Return the information on some parameters where the others are known."""
        both = np.ix_(list(free), list(free))
        return Information(self.curvature[both], self.scores[both])

    def uncertainty(self) -> Uncertainty:
        """Return the covariance that estimates will have."""
        sizes, directions = linalg.eigh(self.curvature)
        seen = sizes > _UNSEEN * max(float(sizes[-1]), 1.0)
        inverse = directions[:, seen] / sizes[seen] @ directions[:, seen].T
        return Uncertainty(inverse @ self.scores @ inverse.T, inverse, directions[:, ~seen])


def converters(inst: ShortForm) -> dict[str, QuantisedSensor]:
    """Return the sensors of an instrument by the unit in which traces have their readings."""
    return {"deg": QuantisedSensor(*(math.degrees(one) for one in encoder(inst))), "N": load_cell(inst)}


def information(
    problem: TwinProblem,
    values: Array,
    scale: Array,
    sensors: dict[str, QuantisedSensor],
    *,
    averaged: int,
    until: Sequence[float],
) -> list[Information]:
    """Return the information in the first run of a problem up to some times, s.

    The noise is independent from sample to sample; rounding errors persist while a signal rests (`QuantisedSensor`). It
    is taken at `values` in units of `scale`, both of shape (parameters,). Sensors are by the unit of the problem's
    traces; `averaged` samples make one of the problem's.
    """
    traces = problem.traces(values, 0)
    kinds = [sensors[name.rpartition("_")[2]] for name in traces]
    deviations = [kind.deviation_of_mean(averaged) for kind in kinds]
    weights = _unit(problem, values, list(traces.values())) / deviations
    jacobian = (problem.jacobian(values, 0) * scale).reshape(len(kinds), -1, scale.size) * weights[:, None, None]
    time = next(iter(traces.values())).time
    found = []
    for end in np.searchsorted(time, until, side="right").tolist():
        part = jacobian[:, :end]
        curvature = np.einsum("cti,ctj->ij", part, part, optimize=True)
        scores = np.zeros_like(curvature)
        for kind, trace, one in zip(kinds, traces.values(), part, strict=True):
            scores += _scores(kind, one, trace.model[:end], averaged)
        found.append(Information(curvature, scores))
    return found


def _unit(problem: TwinProblem, values: Array, traces: Sequence[Trace]) -> Array:
    """Return the standard deviation by which the problem divides each sensor's residuals, in the unit of its traces.

    The median is robust to samples without error and to those corrected for errors of the spools.
    """
    residuals = problem.residuals(values, 0).reshape(len(traces), -1)
    off = np.array([trace.measured - trace.model for trace in traces])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.nanmedian(np.abs(off / residuals), axis=1), dtype=np.float64)


def _scores(sensor: QuantisedSensor, jacobian: Array, reading: Array, samples: int) -> Array:
    """Return the covariance of a sensor's scores."""
    variance = sensor.deviation_of_mean(samples) ** 2
    scores = sensor.independent_variance / samples / variance * jacobian.T @ jacobian
    for number, size in sensor.harmonics(variance):
        waves = jacobian.T @ np.exp(1j * number * reading)
        scores += size / variance * np.real(np.outer(waves, waves.conj()))
    return np.asarray(scores, dtype=np.float64)
