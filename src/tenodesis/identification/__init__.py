"""Identification from recordings: parameters, with their uncertainty, and which are not identifiable."""

from tenodesis.identification.any_instrument import AtRest, Estimate, RestFit, fit_at_rest
from tenodesis.identification.arrays import fit
from tenodesis.identification.formats.instrument_run import measured
from tenodesis.identification.identifiability import Combination, Identifiability
from tenodesis.identification.kinematic import Kinematic, recorded
from tenodesis.identification.problem import Parameter, Problem, Trace, jacobian_error
from tenodesis.identification.registry import FORMATS, Format
from tenodesis.identification.results import Fit, RunErrors, to_json
from tenodesis.identification.uncertainty import Whiteness

__all__ = [
    "FORMATS",
    "AtRest",
    "Combination",
    "Estimate",
    "Fit",
    "Format",
    "Identifiability",
    "Kinematic",
    "Parameter",
    "Problem",
    "RestFit",
    "RunErrors",
    "Trace",
    "Whiteness",
    "fit",
    "fit_at_rest",
    "jacobian_error",
    "measured",
    "recorded",
    "to_json",
]


def __dir__() -> list[str]:
    return sorted(__all__)
