"""What runs tell of parameters before anything is measured: exact derivatives, and the noise of the sensors' table."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from tenodesis.identification.models.converter import Converter, encoder, load_cell
from tenodesis.identification.models.twin import TwinProblem
from tenodesis.identification.problem import Trace
from tenodesis.identification.uncertainty import Spread
from tenodesis.instrument import Instrument
from tenodesis.run import Array

_FAINT = 1e-4
"""Variance of a harmonic, over that of independent noise, below which it is left out."""
_BLIND = 1e-13
"""Information in a direction, as a share of the largest, below which it is not seen at all."""


@dataclass(frozen=True)
class Information:
    """What runs tell, in units of the parameters' scales; that of several is the sum."""

    curvature: Array
    """Of half the sum of squared residuals, shape (parameters, parameters)."""
    scores: Array
    """Covariance of its slope by the sensors' errors: the same where these are independent, and as large as assumed."""

    def __add__(self, other: "Information") -> "Information":
        """Return what both tell."""
        return Information(self.curvature + other.curvature, self.scores + other.scores)

    def of(self, free: Sequence[int]) -> "Information":
        """Return what is told of some parameters where the others are known."""
        both = np.ix_(list(free), list(free))
        return Information(self.curvature[both], self.scores[both])

    def spread(self) -> Spread:
        """Return the covariance that estimates will have."""
        sizes, directions = linalg.eigh(self.curvature)
        seen = sizes > _BLIND * max(float(sizes[-1]), 1.0)
        inverse = directions[:, seen] / sizes[seen] @ directions[:, seen].T
        return Spread(inverse @ self.scores @ inverse.T, inverse, directions[:, ~seen])


def converters(inst: Instrument) -> dict[str, Converter]:
    """Return the sensors of an instrument by the unit in which traces have their readings."""
    return {"deg": Converter(*(math.degrees(one) for one in encoder(inst))), "N": load_cell(inst)}


def information(
    problem: TwinProblem,
    values: Array,
    scale: Array,
    sensors: dict[str, Converter],
    *,
    averaged: int,
    until: Sequence[float],
) -> list[Information]:
    """Return what the first run of a problem tells up to some times.

    The noise is independent from sample to sample; the rounding of a reading lasts while a signal rests, and comes at a
    random place of the converter's step (Widrow and Kollár 2008, ch. 5).

    Parameters
    ----------
    problem
        The model with the run.
    values
        Where, shape (parameters,).
    scale
        What changes of parameters are measured by, shape (parameters,).
    sensors
        By the unit of the problem's traces.
    averaged
        How many samples one of the problem's is to be taken for.
    until
        Times, s.
    """
    traces = problem.traces(values, 0)
    kinds = [sensors[name.rpartition("_")[2]] for name in traces]
    deviations = [kind.mean(averaged) for kind in kinds]
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
    """Return what the problem divides each sensor's residuals by, in the unit of its traces.

    The median minds neither the samples that agree, nor those from which errors of the spools were taken.
    """
    residuals = problem.residuals(values, 0).reshape(len(traces), -1)
    off = np.array([trace.measured - trace.model for trace in traces])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.nanmedian(np.abs(off / residuals), axis=1), dtype=np.float64)


def _scores(sensor: Converter, jacobian: Array, reading: Array, samples: int) -> Array:
    """Return the covariance of what a sensor's errors pull the parameters with."""
    variance = sensor.mean(samples) ** 2
    scores = sensor.fresh / samples / variance * jacobian.T @ jacobian
    for harmonic, size in enumerate(sensor.lasting, 1):
        if size > _FAINT * variance:
            waves = jacobian.T @ np.exp(2j * math.pi * harmonic / sensor.resolution * reading)
            scores += size / variance * np.real(np.outer(waves, waves.conj()))
    return np.asarray(scores, dtype=np.float64)
