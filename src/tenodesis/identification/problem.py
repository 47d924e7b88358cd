"""What a model must provide so that it can be fitted to recordings."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol, runtime_checkable

from tenodesis.instrument import Instrument
from tenodesis.run import Array


class Parameter(NamedTuple):
    """One unknown of a model, in SI units, with its physical bounds."""

    name: str
    unit: str
    start: float
    lower: float
    upper: float
    meaning: str


class Trace(NamedTuple):
    """One measured signal of a run beside the model's, each (n,), time in s."""

    time: Array
    measured: Array
    model: Array


class Problem(Protocol):
    """A model with the recordings it is fitted to, by the index of the run.

    `values` is (number of parameters,) in their order throughout.
    """

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The unknowns."""

    @property
    def runs(self) -> tuple[str, ...]:
        """Names of the recordings."""

    def residuals(self, values: Array, run: int) -> Array:
        """Return measured minus model, (n,), in units of the sensor's standard deviation."""

    def jacobian(self, values: Array, run: int) -> Array | None:
        """Return the exact derivatives of the residuals, (n, parameters), or None to have them differenced."""

    def errors(self, values: Array, run: int) -> dict[str, Array]:
        """Return measured minus model by name, each with its unit last: output_angle_deg, tension_N."""

    def sample_time(self, run: int) -> float:
        """Return the time between samples, s."""


# Optional abilities of a problem.


@runtime_checkable
class WithInstrument(Protocol):
    """A problem whose parameters are keys of an instrument file."""

    def instrument(self, values: Array) -> Instrument | None:
        """Return the instrument with these values in place, or None where there is none to change."""


@runtime_checkable
class WithTraces(Protocol):
    """A problem that shows signal and model side by side."""

    def traces(self, values: Array, run: int) -> dict[str, Trace]:
        """Return measured and modelled signals by name with the unit last, as in errors."""


@runtime_checkable
class WithChannels(Protocol):
    """A problem with several sensors, whose residuals follow one another: all of the first, then all of the second."""

    def channels(self, run: int) -> int:
        """Return how many sensors of equal length the residuals of a run hold."""


@runtime_checkable
class WithGroups(Protocol):
    """A problem whose parameters also go by the name of a group: friction, stiffness."""

    @property
    def groups(self) -> dict[str, tuple[str, ...]]:
        """Names of parameters by group."""


@runtime_checkable
class WithDerivatives(Protocol):
    """A problem for which derivatives by some parameters cost less than by all."""

    def derivatives(self, values: Array, run: int, which: Sequence[int]) -> Array:
        """Return the columns of the Jacobian for some parameters, by index, (n, columns)."""


@runtime_checkable
class WithAdvice(Protocol):
    """A problem that knows which recording would make more parameters identifiable."""

    def advice(self, names: Sequence[str]) -> str | None:
        """Return one sentence on the protocol that would make these parameters identifiable, if one is known."""


@runtime_checkable
class WithSystematicErrors(Protocol):
    """A problem whose sensors have systematic errors, which residuals at its optimum need not show."""

    def systematic_errors(self, values: Array, run: int) -> Array:
        """Return their effects on the residuals of a run, one standard deviation each, (n, errors)."""
