"""What a model must provide so that it can be fitted to recordings, and derivatives of those without their own."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence, Set
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tenodesis.instrument import Instrument
from tenodesis.run import Array


class Parameter(NamedTuple):
    """An unknown of a model, in SI units, with its physical bounds."""

    name: str
    unit: str
    start: float
    lower: float
    upper: float
    meaning: str
    group: str = ""
    """Name that it goes by together with others: friction, stiffness."""


class Trace(NamedTuple):
    """A measured signal of a run and the model's, each (n,), time in s."""

    time: Array
    measured: Array
    model: Array


class SensorError(NamedTuple):
    """A constant error of a sensor, as likely as a recording makes it."""

    value: float
    std: float
    unit: str


class Problem(ABC):
    """A model with the recordings it is fitted to, by the index of the run.

    `values` is (number of parameters,) in their order throughout. A model need not provide what has a default here.
    """

    parameters: tuple[Parameter, ...]
    """The unknowns."""
    runs: tuple[str, ...]
    """Names of the recordings."""
    searches_near: int = 0
    """Searches near an optimum at most, for which `refine` and `weigh_sensors` prepare."""
    advised: ClassVar[Sequence[tuple[Set[str], str]]] = ()
    """What would make one of some parameters identifiable, the first that applies."""

    @cached_property
    def groups(self) -> Mapping[str, tuple[str, ...]]:
        """Names of parameters by the name of their group."""
        named = dict.fromkeys(one.group for one in self.parameters if one.group)
        return {group: tuple(one.name for one in self.parameters if one.group == group) for group in named}

    @cached_property
    def linear(self) -> NDArray[np.bool_]:
        """Which parameters residuals are known to be linear in, (parameters,): differences by them are exact."""
        return np.zeros(len(self.parameters), dtype=np.bool_)

    @abstractmethod
    def residuals(self, values: Array, run: int) -> Array:
        """Return measured minus model, (n,), in units of the sensor's standard deviation.

        Those of several sensors follow one another: all of the first, then all of the second (`channels`).
        """

    @abstractmethod
    def errors(self, values: Array, run: int) -> dict[str, Array]:
        """Return measured minus model by name, each with its unit last: output_angle_deg, tension_N."""

    @abstractmethod
    def sample_time(self, run: int) -> float:
        """Return the time between samples, s."""

    def channels(self, run: int) -> int:
        """Return how many sensors of equal length the residuals of a run hold."""
        return 1

    def sensors(self, run: int) -> tuple[str, ...]:
        """Return what these sensors are called."""
        return tuple(f"sensor {number + 1}" for number in range(self.channels(run)))

    def starting_values(self, runs: Sequence[int]) -> Array:
        """Return the values at which a search of runs begins, (parameters,): those of `start`, unless runs say more."""
        return np.array([one.start for one in self.parameters], dtype=np.float64)

    def plain_residuals(self, values: Array, run: int) -> Array:
        """Return the residuals before any whitening, (n,)."""
        return self.residuals(values, run)

    def residuals_near(self, values: Array, run: int, other: "Problem", there: Array) -> Array:
        """Return the residuals, (n,), whitened as those of another model of the same recordings are near its values."""
        return self.residuals(values, run)

    def ahead(self, points: Sequence[Array], run: int) -> None:  # noqa: B027 - not every model can
        """Prepare for the residuals at several values of the parameters, which are asked for next."""

    def refine(self, values: Array, runs: Sequence[int]) -> bool:
        """Prepare the residuals of runs for a search near some values, and return whether they differ from before."""
        return False

    def weigh_sensors(self, values: Array, runs: Sequence[int]) -> bool:
        """Take systematic sensor errors of runs near some values into the residuals' weights; return if there are any.

        Those of other runs are taken out. The least squares of the residuals are then the generalised ones of Aitken
        (1936).
        """
        return False

    def sensor_noise(self, run: int) -> tuple[float, ...]:
        """Return the standard deviation of the residuals of each sensor of a perfect model."""
        return (1.0,) * self.channels(run)

    def jacobian(self, values: Array, run: int) -> Array | None:
        """Return the exact derivatives of the residuals, (n, parameters), or None to have them differenced."""
        return None

    def derivatives(self, values: Array, run: int, which: Sequence[int]) -> Array | None:
        """Return the columns of the Jacobian for some parameters, by index, (n, columns), or None as above."""
        jacobian = self.jacobian(values, run)
        return None if jacobian is None else jacobian[:, list(which)]

    def systematic_errors(self, values: Array, run: int) -> Array | None:
        """Return effects of systematic sensor errors of one standard deviation on residuals, (n, errors)."""
        return None

    def sensor_errors(self, values: Array, run: int, slopes: Array, covariance: Array) -> dict[str, SensorError]:
        """Return errors of sensors in the weights of a run by name, those that are likeliest at an optimum.

        `slopes` of the residuals are by free parameters, (n, free), and `covariance` is theirs, (free, free), in any
        units of theirs.
        """
        return {}

    def traces(self, values: Array, run: int) -> dict[str, Trace]:
        """Return measured and modelled signals by name with the unit last, as in errors."""
        return {}

    def instrument(self, values: Array) -> Instrument | None:
        """Return the instrument with these values in place, or None if there is no instrument to change."""
        return None

    def advice(self, names: Sequence[str]) -> str | None:
        """Return a sentence on the protocol that would make these parameters identifiable, if known."""
        return next((sentence for words, sentence in self.advised if words & {*names}), None)


STEP = 1e-6
"""Step as a share of a parameter's scale."""
_IMAGINARY = 1e-30
"""Imaginary step: its square vanishes beside any real part."""


def differenced(
    function: Callable[[Array], Array],
    at: Array,
    lower: Array,
    upper: Array,
    scale: Array,
    *,
    which: Sequence[int] | None = None,
    step: float = STEP,
    ahead: Callable[[list[Array]], None] = lambda _points: None,
) -> Array:
    """Return the derivatives of a vector function by central differences within bounds, shape (n, parameters).

    Those by some parameters, by index, if `which` names them; `step` is a share of each parameter's scale. To one side
    alone where the function has no value at the other. `ahead` is told at which points it will be asked.
    """
    ends = []
    for index in range(at.size) if which is None else which:
        above, below = at.copy(), at.copy()
        above[index] = min(at[index] + step * scale[index], upper[index])
        below[index] = max(at[index] - step * scale[index], lower[index])
        ends.append((index, above, below))
    ahead([point for _, *both in ends for point in both])
    columns = []
    for index, *both in ends:
        above, below = both
        upper_value, lower_value = function(above), function(below)
        if not np.isfinite(upper_value).all():
            above, upper_value = at, function(at)
        elif not np.isfinite(lower_value).all():
            below, lower_value = at, function(at)
        columns.append((upper_value - lower_value) / (above[index] - below[index]))
    return np.stack(columns, axis=1)


def complex_step(function: Callable[[NDArray[Any]], NDArray[Any]], at: Array) -> Array:
    """Return the derivatives of an analytic vector function, exact to rounding, shape (n, parameters).

    By an imaginary step (Squire and Trapp, SIAM Review 40:110-112, 1998), which leaves nothing to cancel.
    """
    steps = at + 1j * _IMAGINARY * np.eye(at.size)
    return np.stack([function(one).imag / _IMAGINARY for one in steps], axis=1)


def scales(parameters: Sequence[Parameter], values: Array) -> Array:
    """Return the scales of changes of parameters, shape (parameters,): the ranges between their bounds.

    A quantity that cannot be zero is measured by its value where that is less.
    """
    pairs = zip(parameters, values.tolist(), strict=True)
    return np.array(
        [min(one.upper - one.lower, value) if one.lower > 0 else one.upper - one.lower for one, value in pairs]
    )


def jacobian_error(problem: Problem, values: Array, run: int, *, quantile: float = 1.0) -> float:
    """Return how far a problem's own derivatives are from differences, as a share of each column's largest.

    Values have the shape (parameters,). A quantile of the deviations below 1 leaves out the few samples where a
    difference steps over stick and slip.
    """
    own = problem.jacobian(values, run)
    if own is None:
        return 0.0
    lower = np.array([one.lower for one in problem.parameters])
    upper = np.array([one.upper for one in problem.parameters])
    other = differenced(lambda at: problem.residuals(at, run), values, lower, upper, scales(problem.parameters, values))
    size = np.maximum(np.abs(other).max(axis=0), 1e-12 * np.abs(other).max() + 1e-300)
    return float(np.quantile(np.abs(own - other) / size, quantile, axis=0).max())
