"""Fisher information of runs before anything is measured, and the choice of candidates that have the most of it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from tenodesis.identification.problem import Trace
from tenodesis.identification.twin_model.problem import TwinProblem
from tenodesis.identification.twin_model.steps import QuantisedSensor, encoder, load_cell
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


CriterionName: TypeAlias = Literal["D", "A"]

_PASSES = 8
_FITS = 1e-9


class Criterion:
    """How well parameters are known, in natural logarithms of a standard deviation: less is better.

    D is the volume of the wanted parameters' confidence region, A the sum of their variances over their scales; both of
    the marginal covariance, whose inverse is the Schur complement of the others in the information (Atkinson, Donev and
    Tobias 2007, ch. 10). What nothing identifies counts as known to its scale.

    `free` are the indices of the parameters that are open, `wanted` those among them that count.
    """

    def __init__(self, name: CriterionName, free: Sequence[int], wanted: Sequence[int]) -> None:
        self.name = name
        self._free = list(free)
        self._wanted = [self._free.index(one) for one in wanted]

    def one(self, found: Information) -> float:
        """Return the criterion of some information."""
        return float(self.many(found.curvature[None], found.scores[None])[0])

    def many(self, curvature: Array, scores: Array) -> Array:
        """Return the criterion of several, each (n, parameters, parameters); shape (n,)."""
        both = np.ix_(range(len(curvature)), self._free, self._free)
        known = np.eye(len(self._free))
        inverse = np.linalg.inv(curvature[both] + known)
        covariance = (inverse @ (scores[both] + known) @ inverse)[:, self._wanted][:, :, self._wanted]
        count = len(self._wanted)
        if self.name == "A":
            return np.asarray(np.log(np.trace(covariance, axis1=1, axis2=2) / count) / 2, dtype=np.float64)
        return np.asarray(np.linalg.slogdet(covariance)[1] / (2 * count), dtype=np.float64)


def choose(
    offered: Sequence[Information], seconds: Sequence[float], duration: float, criterion: Criterion, *, most: int
) -> list[int]:
    """Return the indices of candidates to take, ascending, some repeated: greedy by gain a second, then by exchange.

    The information of several candidates is taken to be the sum. Each lasts `seconds`, all together `duration` (s) at
    most, and each is taken `most` times at most. The criterion is minimised; nothing is taken where no candidate fits.
    """
    pool = _Pool(offered, np.asarray(seconds, dtype=np.float64), duration, criterion, most)
    chosen = pool.filled([])
    for _ in range(_PASSES):
        better = pool.exchanged(chosen)
        if better == chosen:
            break
        chosen = pool.filled(better)
    return sorted(chosen)


class _Pool:
    def __init__(
        self, offered: Sequence[Information], seconds: Array, duration: float, criterion: Criterion, most: int
    ) -> None:
        self._curvature = np.stack([one.curvature for one in offered])
        self._scores = np.stack([one.scores for one in offered])
        self._seconds, self._duration, self._criterion, self._most = seconds, duration, criterion, most

    def filled(self, chosen: list[int]) -> list[int]:
        """Return the choice with candidates added until none fits, each time that with the largest gain per second."""
        chosen = list(chosen)
        while True:
            fitting = self._fitting(chosen)
            if not fitting.size:
                return chosen
            gains = self._of(chosen) - self._with(chosen, fitting)
            best = int(np.argmax(gains / self._seconds[fitting]))
            if gains[best] <= 0:
                return chosen
            chosen.append(int(fitting[best]))

    def exchanged(self, chosen: list[int]) -> list[int]:
        """Return the choice with each candidate in turn exchanged for the best in its place."""
        chosen = list(chosen)
        for place in range(len(chosen)):
            rest = chosen[:place] + chosen[place + 1 :]
            fitting = self._fitting(rest)
            best = int(fitting[np.argmin(self._with(rest, fitting))])
            chosen[place] = best
        return chosen

    def _fitting(self, chosen: Sequence[int]) -> NDArray[np.intp]:
        left = self._duration - self._seconds[list(chosen)].sum() + _FITS
        taken = np.bincount(np.array(chosen, dtype=np.intp), minlength=self._seconds.size)
        return np.flatnonzero((self._seconds <= left) & (taken < self._most))

    def _of(self, chosen: Sequence[int]) -> float:
        curvature, scores = (of[list(chosen)].sum(axis=0) for of in (self._curvature, self._scores))
        return float(self._criterion.many(curvature[None], scores[None])[0])

    def _with(self, chosen: Sequence[int], added: NDArray[np.intp]) -> Array:
        places = list(chosen)
        return self._criterion.many(
            self._curvature[places].sum(axis=0) + self._curvature[added],
            self._scores[places].sum(axis=0) + self._scores[added],
        )
