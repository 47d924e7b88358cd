"""The result of a fit, also in a form for JSON files; how well the model explains its runs, and the caveats."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from tenodesis import notebook
from tenodesis.errors import IdentificationError
from tenodesis.extras import require
from tenodesis.identification.identifiability import Identifiability
from tenodesis.identification.problem import Parameter, Problem, SensorError, Trace
from tenodesis.identification.search import LEAST_PER_PARAMETER, MOST_STEPS, SearchEnd
from tenodesis.identification.uncertainty import LossName, Uncertainty, Whiteness
from tenodesis.instrument import Instrument
from tenodesis.json_values import json_values
from tenodesis.magnitude import rms
from tenodesis.report.page import about
from tenodesis.run import Array

if TYPE_CHECKING:
    import pandas as pd

LIBRARIES = ("scipy",)
"""Packages whose versions a result names in addition to NumPy's."""
RESULTS_SCHEMA = 1
"""Version of the layout of result.json."""

_AS_THEY_ARE = ("samples", "loss", "starts", "same_optimum", "seed", "bootstrap", "evaluations", "jacobians", "seconds")

_DRAWN = ("measured", "model")
_MOST_NAMED = 6
"""Parameters and errors that a short description names."""
Interval: TypeAlias = tuple[float, float]


@dataclass(frozen=True)
class RunErrors:
    """Measured minus model over a run, by name with the unit last."""

    name: str
    split: str
    """train or test."""
    samples: dict[str, int]
    rmse: dict[str, float]
    mean: dict[str, float]
    largest: dict[str, float]
    sensors: dict[str, SensorError] = field(default_factory=dict)
    """Of a run that was fitted: constant errors of sensors that the fit has found, by name."""


@dataclass(frozen=True)
class Fit:
    """The result of a fit."""

    parameters: tuple[Parameter, ...]
    free: tuple[str, ...]
    values: dict[str, float]
    """Of all parameters, SI; those that were not fitted are at their start."""
    std: dict[str, float]
    """Of the fitted parameters, corrected for correlated residuals; infinite where nothing depends on them."""
    std_white: dict[str, float]
    """As if residuals were independent."""
    interval_95: dict[str, Interval]
    bootstrap_interval_95: dict[str, Interval] | None
    correlation: Array
    """Of the fitted parameters, in the order of `free`."""
    cost: float
    """Half the sum of the squared residuals (linear loss), in variances of the sensors."""
    aic: float
    bic: float
    """With as many samples as there are, and the noise of the residuals, as if they were independent."""
    files: tuple[RunErrors, ...]
    train_rmse: dict[str, float]
    test_rmse: dict[str, float]
    identifiability: Identifiability
    whiteness: tuple[Whiteness, ...]
    starts: int
    same_optimum: int
    """How many starts reached an optimum no worse than the best but for chance."""
    costs: tuple[float, ...]
    """Final cost of every start; infinite where the model has no solution."""
    loss: LossName
    seed: int
    bootstrap: int
    """Replicates of the bootstrap; zero where there was none."""
    samples: int
    evaluations: int
    """How often residuals of all training runs were computed, differences included."""
    jacobians: int
    """How often the model's own derivatives were."""
    warnings: tuple[str, ...]
    seconds: float
    traces: Mapping[str, Trace] = field(default_factory=dict, repr=False)
    """Of a fit of arrays: measured and modelled signals by name with the unit last."""
    instrument: Instrument | None = None
    """Of a fit of arrays: the instrument with the values in place."""

    def __repr__(self) -> str:
        fitted = ", ".join(f"{name} {self.values[name]:.4g} ± {self.std[name]:.2g}" for name in self.free[:_MOST_NAMED])
        more = f" and {len(self.free) - _MOST_NAMED} more" if len(self.free) > _MOST_NAMED else ""
        return f"<Fit of {fitted}{more}; {self._errors}>"

    def _repr_html_(self) -> str:
        """Return a table for notebooks: every parameter with its interval, and whether it is identifiable."""
        rows = [self._row(one) for one in self.parameters]
        headings = ("parameter", "value", "95 % interval", "unit", "identifiable", "meaning")
        return notebook.table(f"Fit of {len(self.free)} parameters; {self._errors}", headings, rows)

    @property
    def _errors(self) -> str:
        sets = (("training", self.train_rmse), ("test", self.test_rmse))
        found = [
            f"{name} {key.rpartition('_')[0].replace('_', ' ')} {value:.3g} {key.rpartition('_')[2]}"
            for name, rmse in sets
            for key, value in rmse.items()
        ]
        return f"RMSE: {', '.join(found[:_MOST_NAMED])}"

    def _row(self, one: Parameter) -> tuple[str, ...]:
        interval = self.interval_95.get(one.name)
        bounds = "held" if interval is None else f"{interval[0]:.4g} to {interval[1]:.4g}"
        known = self.identifiability.identifiable.get(one.name)
        return (
            one.name,
            f"{self.values[one.name]:.5g}",
            bounds,
            one.unit,
            "" if known is None else ("yes" if known else "no"),
            one.meaning,
        )

    def to_pandas(self) -> "pd.DataFrame":
        """Return a DataFrame of the fitted parameters: value, standard deviation, interval, unit, identifiable.

        Raises
        ------
        MissingExtraError
            pandas is not installed.
        """
        rows = {
            one.name: {
                "value": self.values[one.name],
                "std": self.std[one.name],
                "low_95": self.interval_95[one.name][0],
                "high_95": self.interval_95[one.name][1],
                "unit": one.unit,
                "identifiable": self.identifiability.identifiable[one.name],
            }
            for one in self.parameters
            if one.name in self.free
        }
        table: pd.DataFrame = require("pandas", "tables").DataFrame.from_dict(rows, orient="index")
        return table

    def curves(self) -> "pd.DataFrame":
        """Return a DataFrame of measured and modelled signals over time, s, of a fit of arrays.

        Raises
        ------
        MissingExtraError
            pandas is not installed.
        """
        pandas = require("pandas", "tables")
        time: Array | list[float] = next(iter(self.traces.values())).time if self.traces else []
        columns = {f"{key}.{name}": getattr(one, name) for key, one in self.traces.items() for name in _DRAWN}
        table: pd.DataFrame = pandas.DataFrame(columns, index=pandas.Index(time, name="time [s]"))
        return table

    @property
    def vector(self) -> Array:
        """The values in the order of the parameters."""
        return np.array(list(self.values.values()))


def by_unit(rmse: Mapping[str, float]) -> dict[str, float]:
    """Return the first value of each unit, named by its unit: rmse_deg for output_angle_deg, rmse_N for tension_N."""
    found: dict[str, float] = {}
    for key, value in rmse.items():
        found.setdefault(key.rpartition("_")[2], value)
    return found


def distinct(names: Sequence[str]) -> list[str]:
    """Return names with a number behind those that were there before."""
    seen: dict[str, int] = {}
    out = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        out.append(name if seen[name] == 1 else f"{name} ({seen[name]})")
    return out


def to_json(
    found: Fit,
    *,
    format: str,
    law: str,
    notes: Mapping[str, Sequence[str]] | None = None,
    arrangements: Sequence[Mapping[str, Any]] = (),
) -> dict[str, Any]:
    """Return a fit as plain values for JSON, SI; None for values that are not finite.

    `format` is that of the recordings, `law` the friction law; `notes` are the loader's on each recording, by its name;
    `arrangements` are those that were compared, the best first.
    """
    runs = distinct([one.name for one in found.files])
    content: dict[str, Any] = {
        "schema": RESULTS_SCHEMA,
        "about": about(*LIBRARIES),
        "format": format,
        "law": law,
        "train": [name for name, one in zip(runs, found.files, strict=True) if one.split == "train"],
        "test": [name for name, one in zip(runs, found.files, strict=True) if one.split == "test"],
        "parameters": {one.name: _parameter(found, one) for one in found.parameters},
        **{f"train_rmse_{unit}": value for unit, value in by_unit(found.train_rmse).items()},
        **{f"test_rmse_{unit}": value for unit, value in by_unit(found.test_rmse).items()},
        "train_rmse": found.train_rmse,
        "test_rmse": found.test_rmse,
        "files": {name: _file(one) for name, one in zip(runs, found.files, strict=True)},
        "correlation": {
            name: dict(zip(found.free, row, strict=True))
            for name, row in zip(found.free, found.correlation, strict=True)
        },
        "identifiability": {
            "singular_values": found.identifiability.singular_values,
            "combinations": [
                {"parameters": list(one.names), "known": one.known} for one in found.identifiability.combinations
            ],
            "at_bound": found.identifiability.at_bound,
            "statements": list(found.identifiability.statements),
        },
        "whiteness": [_whiteness(one) for one in found.whiteness],
        "cost": found.cost,
        "aic": found.aic,
        "bic": found.bic,
        "costs": found.costs,
        **{name: getattr(found, name) for name in _AS_THEY_ARE},
        "arrangements": list(arrangements),
        "warnings": list(found.warnings),
        "notes": {name: list(sentences) for name, sentences in (notes or {}).items()},
    }
    return dict(json_values(content))


def _parameter(found: Fit, one: Parameter) -> dict[str, Any]:
    name, fitted = one.name, one.name in found.free
    interval = found.interval_95.get(name)
    drawn = (found.bootstrap_interval_95 or {}).get(name)
    return {
        "value": found.values[name],
        "unit": one.unit,
        "meaning": one.meaning,
        "fitted": fitted,
        "std": found.std[name] if fitted else None,
        "std_white": found.std_white[name] if fitted else None,
        "interval_95": None if interval is None else list(interval),
        "bootstrap_interval_95": None if drawn is None else list(drawn),
        "identifiable": found.identifiability.identifiable[name] if fitted else None,
        "at_bound": found.identifiability.at_bound.get(name),
        "start": one.start,
        "lower": one.lower,
        "upper": one.upper,
    }


def _file(one: RunErrors) -> dict[str, Any]:
    return {
        "split": one.split,
        "samples": max(one.samples.values(), default=0),
        **{f"rmse_{unit}": value for unit, value in by_unit(one.rmse).items()},
        "rmse": one.rmse,
        "mean": one.mean,
        "largest": one.largest,
        "sensors": {name: error._asdict() for name, error in one.sensors.items()},
    }


def _whiteness(one: Whiteness) -> dict[str, Any]:
    return {
        "run": one.run,
        "channel": one.channel,
        "sensor": one.sensor,
        "white": one.white,
        "p_value": one.p_value,
        "ljung_box": one.statistic,
        "lags": one.lags,
        "correlation_time": one.correlation_time,
        "samples": one.samples,
        "effective_samples": one.effective_samples,
    }


_MOST_UNEXPLAINED = 0.5
"""Share of a measured signal's spread that a model may leave of it."""
_LEAST_MOVED = 0.1
"""Share of the widest spread of all runs below which a signal was held, and there is nothing to explain."""
_MOST_WORSE = 4.0
"""Largest ratio of the error of held-out runs to that of fitted runs."""


def run_errors(
    problem: Problem, values: Array, run: int, split: str, sensors: dict[str, SensorError] | None = None
) -> RunErrors:
    """Return the errors of a run, which is of the split train or test."""
    errors = problem.errors(values, run)
    for key, one in errors.items():
        if one.size == 0:
            raise IdentificationError(f"{problem.runs[run]} has no sample of {key}.", key="test", value=key)
    return RunErrors(
        name=problem.runs[run],
        split=split,
        samples={key: one.size for key, one in errors.items()},
        rmse={key: rms(one) for key, one in errors.items()},
        mean={key: float(np.mean(one)) for key, one in errors.items()},
        largest={key: float(np.max(np.abs(one))) for key, one in errors.items()},
        sensors=sensors or {},
    )


def pooled(files: Sequence[RunErrors]) -> dict[str, float]:
    """Return the root mean square over all samples of several runs, by name."""
    keys = dict.fromkeys(key for one in files for key in one.rmse)
    out = {}
    for key in keys:
        having = [one for one in files if key in one.rmse]
        squares = sum(one.rmse[key] ** 2 * one.samples[key] for one in having)
        out[key] = math.sqrt(squares / sum(one.samples[key] for one in having))
    return out


def information_criteria(residuals: Array, parameters: int) -> tuple[float, float]:
    """Return the criteria of Akaike and of Schwarz, with the noise as an additional parameter."""
    count = residuals.size
    squares = float(residuals @ residuals)
    likelihood = count * math.log(squares / count) if squares > 0 else -math.inf
    return likelihood + 2 * (parameters + 1), likelihood + math.log(count) * (parameters + 1)


def unexplained(problem: Problem, values: Array, files: Sequence[RunErrors]) -> list[str]:
    """Return a sentence for each signal of a run of which the model explains little.

    `values` are those of all parameters, `files` the errors of the runs there.
    """
    spreads = {
        one.name: {
            key: float(np.std(trace.measured))
            for key, trace in problem.traces(values, problem.runs.index(one.name)).items()
        }
        for one in files
    }
    out = []
    for one in files:
        for key, spread in spreads[one.name].items():
            widest = max(other.get(key, 0.0) for other in spreads.values())
            rmse = one.rmse.get(key, 0.0)
            if spread > _LEAST_MOVED * widest and rmse > _MOST_UNEXPLAINED * spread:
                signal, _, unit = key.rpartition("_")
                out.append(
                    f"The model explains little of {signal.replace('_', ' ')} of {one.name} (rmse {rmse:.3g} {unit}, "
                    f"spread {spread:.3g} {unit}): look for a reversed sign, swapped columns, a frozen sensor or a "
                    "wrong unit."
                )
    return out


def worse_held_out(files: Sequence[RunErrors]) -> list[str]:
    """Return a sentence for each signal whose error is far larger where it was held out."""
    fitted, held = (pooled([one for one in files if one.split == split]) for split in ("train", "test"))
    return [
        f"The error of {key.rpartition('_')[0].replace('_', ' ')} is {rmse / fitted[key]:.3g} times as large in the "
        f"runs held out as in those fitted (rmse {rmse:.3g} and {fitted[key]:.3g} {key.rpartition('_')[2]}): the "
        "model does not extrapolate to them."
        for key, rmse in held.items()
        if rmse > _MOST_WORSE * fitted.get(key, math.inf) > 0
    ]


def warnings(
    found: Uncertainty, noises: Sequence[Whiteness], best: SearchEnd, *, same: int, starts: int, parameters: int
) -> list[str]:
    """Return the caveats of a fit, a sentence each."""
    out = []
    if not best.converged:
        out.append(f"The search stopped after {MOST_STEPS} steps without having converged.")
    if starts > 2 and same == 1:
        out.append(f"Only one of {starts} starts reached the best optimum; there may be a better one.")
    effective = sum(noise.effective_samples for noise in noises)
    if effective < LEAST_PER_PARAMETER * parameters:
        out.append(
            f"Residuals are so correlated that all samples count as {effective:.3g} independent ones, for {parameters} "
            "parameters: the intervals are rough."
        )
    coloured = [noise for noise in noises if not noise.white]
    if coloured:
        with np.errstate(invalid="ignore", divide="ignore"):
            widening = found.std / found.white_std
        factor = np.nanmax(np.where(np.isfinite(widening), widening, np.nan), initial=1.0)
        worst = max(coloured, key=lambda noise: noise.correlation_time)
        out.append(
            f"Residuals are not white in {len(coloured)} of {len(noises)} series (up to {worst.correlation_time:.3g} s "
            f"correlated, {worst.run}): the model leaves an effect out; intervals are up to {factor:.3g} times "
            "those for white noise."
        )
    return out
