"""Tolerance studies: the effect of manufacturing tolerances and identification errors on a scale model."""

from tenodesis.tolerance.conduct import drawn, study
from tenodesis.tolerance.defaults import default
from tenodesis.tolerance.files import Tolerance, Tolerances, json_schema, load, parse
from tenodesis.tolerance.parameters import UncertainParameter
from tenodesis.tolerance.results import Response, Study
from tenodesis.tolerance.sampling import Indices

__all__ = [
    "Indices",
    "Response",
    "Study",
    "Tolerance",
    "Tolerances",
    "UncertainParameter",
    "default",
    "drawn",
    "json_schema",
    "load",
    "parse",
    "study",
]


def __dir__() -> list[str]:
    return sorted(__all__)
