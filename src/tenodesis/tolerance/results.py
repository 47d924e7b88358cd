"""Results of a study: distributions of the responses, and the parameters that cause them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tenodesis.instrument import Instrument
from tenodesis.run import Array
from tenodesis.tolerance.files import Tolerances
from tenodesis.tolerance.parameters import UncertainParameter
from tenodesis.tolerance.sampling import CLOSE, Indices, estimate

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
LEAST_COMPLETE = 0.95
"""Share of base samples that must have all their runs for Sobol indices to be valid."""
LEAST_RANGE = 1e-6
"""Range of a response, deg, up to which it counts as rounding of the equilibrium."""
TOO_FEW = 0.5
"""Half width above which there are too few samples to rank parameters."""

DESCRIPTIONS: Mapping[str, str] = {
    "loss_flexion": "loss in flexion",
    "loss_extension": "loss in extension",
    "loop_width": "loop width",
    "similarity_rms": "similarity, rms",
    "similarity_largest": "similarity, largest",
    "real_size_loss_flexion": "real-size: loss in flexion",
    "real_size_loss_extension": "real-size: loss in extension",
    "real_size_loop_width": "real-size: loop width",
}
"""Responses by name: output loss by the direction of approach, mean width of the loop, similarity error."""


@dataclass(frozen=True)
class Response:
    """A response of a study, in its unit: over all rows of the scheme, at the nominal values, and by tornado."""

    key: str
    scheme: Array
    """Value by row of Saltelli's scheme; NaN where a run was lost."""
    nominal: float
    at_quantiles: Array
    """Value with one parameter at its 5 % and 95 % quantile and the others at the median, shape (parameters, 2)."""
    samples: Array
    """Values of the independent samples, the scheme's A and B, without lost samples."""
    indices: Indices | None
    """Sobol indices; None where they are not valid or the response does not vary."""
    description: str
    """Name in reports."""
    unit: str = "deg"

    def __repr__(self) -> str:
        return (
            f"<Response {self.key}: mean {self.mean:.4g} {self.unit}, std {self.std:.3g} {self.unit}, "
            f"nominal {self.nominal:.4g} {self.unit}>"
        )

    @property
    def varies(self) -> bool:
        """Whether its samples differ by more than rounding."""
        return bool(np.ptp(self.scheme[~np.isnan(self.scheme)]) > LEAST_RANGE)

    @property
    def mean(self) -> float:
        """Mean."""
        return float(self.samples.mean())

    @property
    def std(self) -> float:
        """Standard deviation."""
        return float(self.samples.std(ddof=1))

    def quantile(self, share: float) -> float:
        """Return a quantile."""
        return float(np.quantile(self.samples, share))

    @cached_property
    def order(self) -> tuple[int, ...]:
        """Parameters by falling influence: by total index, or by the tornado's range where there is none.

        Empty for a response that does not vary.
        """
        if not self.varies:
            return ()
        width = np.nan_to_num(np.abs(self.at_quantiles[:, 1] - self.at_quantiles[:, 0]))
        weight = width if self.indices is None else self.indices.total
        return tuple(int(n) for n in np.argsort(-weight, kind="stable"))


@dataclass(frozen=True)
class Study:
    """A tolerance study; :func:`tenodesis.tolerance.study` makes it."""

    real_size: Instrument
    scaled_up: Instrument
    tolerances: Tolerances
    parameters: tuple[UncertainParameter, ...]
    samples: int
    """Base samples N: the Monte-Carlo samples are 2 N, the runs N (parameters + 2) and the tornado's."""
    seed: int
    force: float
    """Force on the real-size instrument, N."""
    force_factor: float
    end: float
    """Handle angle at which the losses are read, rad; of several joints NaN."""
    matrix: Array
    """Values by row of the scheme and parameter, SI units."""
    status: NDArray[np.int64]
    """Status by row: 0 for a run to the end, otherwise why it was lost."""
    responses: Mapping[str, Response] = field(default_factory=dict)

    def __repr__(self) -> str:
        found = ", ".join(f"{key} {one.mean:.3g} ± {one.std:.2g} {one.unit}" for key, one in self.responses.items())
        lost = f", {100 * self.failed:.2g} % lost" if self.failed else ""
        pair = f"{self.real_size.name!r} and {self.scaled_up.name!r}"
        return f"<Study of {pair}: {len(self.parameters)} parameters, {self.runs} runs{lost}; {found}>"

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints at the tip that have responses of their own; none where there is one plane."""
        return tuple(key.partition(".")[2] for key in self.responses if key.startswith("similarity_largest."))

    @property
    def runs(self) -> int:
        """Number of runs, including the tornado's and the nominal run."""
        return len(self.matrix) + 2 * len(self.parameters) + 1

    @property
    def base(self) -> NDArray[np.int64]:
        """Rows of the independent samples, A and B."""
        return base_rows(self.samples, len(self.parameters))

    @property
    def failed(self) -> float:
        """Share of the independent samples whose run was lost."""
        return float(np.mean(self.status[self.base] != 0))

    @property
    def incomplete(self) -> float:
        """Share of the base samples that lack a run and are left out of the indices."""
        return 1 - float(complete_blocks(self.status, self.samples).mean())

    @property
    def indices_valid(self) -> bool:
        """Whether enough runs reached the end for Sobol indices."""
        return self.incomplete <= 1 - LEAST_COMPLETE

    @property
    def statements(self) -> tuple[str, ...]:
        """Sentences on failed runs and on convergence."""
        sentences = []
        if self.failed:
            sentences.append(
                f"{100 * self.failed:.2g} % of the samples failed (the tip was lost, or the instrument is invalid); "
                "they are left out of means and quantiles, which hold for the others."
            )
        if not self.indices_valid:
            sentences.append(
                f"{100 * self.incomplete:.2g} % of the base samples lack a run, more than the "
                f"{100 * (1 - LEAST_COMPLETE):.0f} % up to which Sobol indices are valid; there are none."
            )
        elif self.incomplete:
            sentences.append(
                f"{100 * self.incomplete:.2g} % of the base samples lack a run and are left out of the indices."
            )
        sentences += [
            f"The {one.description} does not vary: all its samples are within {LEAST_RANGE:g} {one.unit}."
            for one in self.responses.values()
            if not one.varies
        ]
        indices = [one.indices for one in self.responses.values() if one.indices is not None]
        if indices:
            widest = max(float(one.total_half_width.max()) for one in indices)
            if widest > TOO_FEW:
                sentences.append(
                    f"The {self.samples} base samples are too few for Sobol indices: some total index is known only to "
                    f"±{widest:.2g} (95 % confidence), so that the ranking is uncertain; four times the "
                    "samples halve it."
                )
            else:
                hint = "" if widest <= CLOSE else "; this is wide, four times the samples halve it"
                sentences.append(f"The total indices are known to ±{widest:.2g} or better (95 % confidence){hint}.")
        return tuple(sentences)


def base_rows(samples: int, parameters: int) -> NDArray[np.int64]:
    """Return the rows of the scheme that are independent samples, first those of A, then those of B."""
    first = np.arange(samples) * (parameters + 2)
    return np.concatenate([first, first + parameters + 1])


def complete_blocks(status: NDArray[np.int64], samples: int) -> NDArray[np.bool_]:
    """Return by base sample whether none of its runs was lost."""
    complete: NDArray[np.bool_] = (status.reshape(samples, -1) == 0).all(axis=1)
    return complete


def respond(key: str, scheme: Array, study: Study, rest: Array, described: tuple[str, str]) -> Response:
    """Return a response from its values by row of the scheme and, in `rest`, of the nominal and the tornado's rows.

    `described` are its description and unit.
    """
    samples = scheme[study.base]
    complete = complete_blocks(study.status, study.samples)
    values = scheme.reshape(study.samples, -1)[complete].ravel()
    indices = None
    if study.indices_valid and values.size and np.ptp(values) > LEAST_RANGE:
        indices = estimate(study.parameters, values, study.seed)
    at_quantiles = rest[1:].reshape(2, len(study.parameters)).T
    return Response(key, scheme, float(rest[0]), at_quantiles, samples[~np.isnan(samples)], indices, *described)
