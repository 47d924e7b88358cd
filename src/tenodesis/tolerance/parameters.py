"""Parameters of a study: values of an instrument with their distributions and the bounds of its file."""

import math
import re
from typing import Annotated, Any, NamedTuple, get_args

from pydantic import TypeAdapter, ValidationError
from pydantic.fields import FieldInfo

from tenodesis.errors import StudyError
from tenodesis.instrument import Instrument
from tenodesis.instrument.numbers import values_by_key
from tenodesis.report.content import unit_text
from tenodesis.tolerance.files import DistributionName, InstrumentName, Tolerance, Tolerances
from tenodesis.toml import did_you_mean
from tenodesis.units import Quantity, annotation, in_unit, quantity_of

MOST_OUTSIDE = 1e-6
"""Largest probability of values outside the bounds of an instrument file; the distribution is truncated there."""

_FIXED = {
    "handle_range": "it bounds the cycle, which is the same for all samples",
    "output_range": "it bounds the cycle, which is the same for all samples",
    "sensors.sampling_rate": "it is the same for all runs of a batch",
}
_PERCENT = re.compile(r"\s*(?P<number>[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)\s*%\s*")
_SHOWN = {"m": "mm", "Pa": "GPa", "rad": "deg"}


class UncertainParameter(NamedTuple):
    """A value that varies, in SI units."""

    key: str
    instrument: InstrumentName
    nominal: float
    """Value of the instrument file, also the median."""
    distribution: DistributionName
    width: float
    """Half width of a uniform or triangular distribution, standard deviation of a normal distribution."""
    lower: float
    """Lower bound of an instrument file."""
    upper: float
    """Upper bound of an instrument file."""
    unit: str
    source: str

    @property
    def label(self) -> str:
        """Name in figures and tables."""
        return self.key.replace("_", " ").replace(".", " ") + " (real-size)" * (self.instrument == "real-size")

    def shown(self, value: float, digits: int = 4) -> str:
        """Return a value with its unit, in mm, GPa and degrees."""
        unit = _SHOWN.get(self.unit, self.unit)
        number = f"{value * in_unit(unit, self.unit) if unit != '1' else value:.{digits}g}"
        return f"{number} {unit_text(unit)}".removesuffix(" 1").replace(" deg", "°")


class _Number(NamedTuple):
    value: float
    quantity: Quantity | None
    lower: float
    upper: float


def resolve(tolerances: Tolerances, real_size: Instrument, scaled_up: Instrument) -> tuple[UncertainParameter, ...]:
    """Return the parameters of a study, from tolerances and the two instruments.

    Raises StudyError if a key is unknown or not a number, a width is not understood, zero or negative, or a
    distribution exceeds the bounds of an instrument file.
    """
    return tuple(
        _parameter(one, real_size if one.instrument == "real-size" else scaled_up) for one in tolerances.parameters
    )


def _parameter(tolerance: Tolerance, inst: Instrument) -> UncertainParameter:
    number = _number(tolerance.key, inst)
    width = _width(tolerance, inst, number)
    parameter = UncertainParameter(
        tolerance.key,
        tolerance.instrument,
        number.value,
        tolerance.distribution,
        width,
        number.lower,
        number.upper,
        number.quantity.unit if number.quantity else "1",
        tolerance.source,
    )
    _refuse_outside(parameter, inst, tolerance.width_key)
    return parameter


def _number(key: str, inst: Instrument) -> _Number:
    if key in _FIXED:
        raise StudyError(f"{key} of {inst.name} cannot vary: {_FIXED[key]}.", key=key)
    known = values_by_key(inst)
    if key not in known:
        keys = ", ".join(name for name, (value, _) in known.items() if name not in _FIXED and isinstance(value, float))
        hint = did_you_mean(key, (), known)
        raise StudyError(
            f"{key} is not a known key of {inst.name}{hint}; keys that can vary are {keys}.", key=key, allowed=keys
        )
    value, field = known[key]
    if value is None:
        raise StudyError(f"{key} of {inst.name} is not given, so it cannot vary; use a key that its file has.", key=key)
    if not isinstance(value, float):
        raise StudyError(f"{key} of {inst.name} is {_kind(value)}; only a number can vary.", key=key, value=value)
    return _Number(value, quantity_of(field), *_bounds(field))


def _kind(value: object) -> str:
    if isinstance(value, int):
        return f"{value}, an integer"
    return f"{value!r}, not a number" if isinstance(value, str) else "not a number"


def _metadata(field: FieldInfo) -> list[Any]:
    inner = [item for option in get_args(field.annotation) for item in getattr(option, "__metadata__", ())]
    return [item for one in [*field.metadata, *inner] for item in getattr(one, "metadata", [one])]


def _bounds(field: FieldInfo) -> tuple[float, float]:
    lower, upper = [-math.inf], [math.inf]
    for item in _metadata(field):
        if isinstance(item, Quantity):
            lower += [bound for bound in (item.above, item.at_least) if bound is not None]
            upper += [bound for bound in (item.below,) if bound is not None]
        lower += [getattr(item, key) for key in ("ge", "gt") if hasattr(item, key)]
        upper += [getattr(item, key) for key in ("le", "lt") if hasattr(item, key)]
    return float(max(lower)), float(min(upper))


def _width(tolerance: Tolerance, inst: Instrument, number: _Number) -> float:
    place = f"{tolerance.key} of {inst.name}: {tolerance.width_key} = {tolerance.width!r}"
    percent = _PERCENT.fullmatch(tolerance.width) if isinstance(tolerance.width, str) else None
    if percent is not None:
        if number.value == 0:
            raise StudyError(
                f"{place}: the file's value is 0, of which there is no share; use an absolute width.",
                key=tolerance.key,
                value=0,
                allowed="an absolute width",
            )
        width = float(percent["number"]) / 100 * abs(number.value)
    elif number.quantity is None:
        try:
            width = float(tolerance.width)
        except ValueError:
            raise StudyError(
                f'{place}: it is not understood; it must be a number, or a share like "5 %".',
                key=tolerance.key,
                value=tolerance.width,
                allowed='a number, or a share like "5 %"',
            ) from None
    else:
        of = number.quantity
        written = Annotated[float, *annotation(Quantity(of.name, of.unit, of.example, above=0))]
        try:
            return float(TypeAdapter(written).validate_python(tolerance.width, context={"file": True}))
        except ValidationError as invalid:
            problem = invalid.errors(include_url=False)[0]["msg"].removeprefix("Value error, ")
            raise StudyError(
                f'{place}: {problem}, or a share like "5 %".', key=tolerance.key, value=tolerance.width
            ) from None
    if not (math.isfinite(width) and width > 0):
        raise StudyError(
            f"{place}: it must be above 0.", key=tolerance.key, value=tolerance.width, allowed="a width above 0"
        )
    return width


def _refuse_outside(parameter: UncertainParameter, inst: Instrument, width_key: str) -> None:
    outside = probability_outside(parameter)
    if outside <= MOST_OUTSIDE:
        return
    bounds = [
        f"{word} {parameter.shown(bound)}"
        for word, bound in (("from", parameter.lower), ("to", parameter.upper))
        if math.isfinite(bound)
    ]
    share = f"{100 * outside:.2g} %"
    raise StudyError(
        f"{parameter.key} of {inst.name}: a {parameter.distribution} distribution about "
        f"{parameter.shown(parameter.nominal)} with a {width_key} of {parameter.shown(parameter.width)} exceeds the "
        f"bounds of an instrument file ({' '.join(bounds)}) with a probability of {share}; use a narrower one.",
        key=parameter.key,
        value=parameter.width,
    )


def probability_outside(parameter: UncertainParameter) -> float:
    """Return the probability that a parameter's distribution exceeds the bounds of an instrument file."""
    centre, width = parameter.nominal, parameter.width
    from scipy import stats  # noqa: PLC0415 - takes half a second

    if parameter.distribution == "normal":
        distribution: Any = stats.norm(centre, width)
    else:
        distribution = stats.uniform(centre - width, 2 * width)
    if parameter.distribution == "triangular":
        distribution = stats.triang(0.5, loc=centre - width, scale=2 * width)
    return float(distribution.cdf(parameter.lower) + distribution.sf(parameter.upper))
