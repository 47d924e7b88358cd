"""Mistakes that explain a recording which its model does not: signs, order, units, a wrong instrument or held value.

Where residuals are far above the sensors' noise, each mistake is undone in turn and the model searched again; the one
that leaves the least is named if it leaves a fraction of what was left.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import degrees, inf, sqrt
from typing import Any, NamedTuple, TypeAlias, TypeVar

import numpy as np

from tenodesis.errors import Error, IdentificationError
from tenodesis.identification.comparison import MOST_EXCESS, excess
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.identification.problem import Problem
from tenodesis.identification.results import Fit
from tenodesis.identification.routing import Routing
from tenodesis.identification.search import Search
from tenodesis.identification.twin_model.problem import TwinProblem
from tenodesis.instrument import ShortForm, as_short_form, load, shipped
from tenodesis.magnitude import rms
from tenodesis.run import TENDONS, Array
from tenodesis.units import STANDARD_GRAVITY

EXPLAINS = 3.0
"""How many times less a mistake has to leave, undone, to be named."""
_REFUSED = 30.0
"""What recordings that are refused as given are taken to leave."""
_STEPS = 12
"""Iterations of the search that judges a mistake."""
_MOST_SECONDS = 6.0
"""Duration of a recording that mistakes are judged by: its first."""
MOST_SEARCHED = 6
"""Mistakes, those that leave the least before a search, after which no further one is searched."""
_MOST_HELD = 2
"""Held parameters, those that leave the least by the derivatives, that are tried."""
_FINEST = 2e-5
"""Shortest plausible time between samples, s."""
_TENSIONS = tuple(f"tension_{tendon}" for tendon in TENDONS)
_HANDLE = ("handle_angle", "measured_handle_angle")
_TIP = ("measured_output_angle",)

_Answer = TypeVar("_Answer")
Build: TypeAlias = Callable[[Sequence[MeasuredRun], ShortForm | None], Problem]
"""Returns the model of recordings, with another instrument if one is given."""


class Mistake(NamedTuple):
    """A mistake in recordings, and how it is undone."""

    sentence: str
    undo: Callable[[MeasuredRun], MeasuredRun]
    columns: tuple[str, ...]
    """Columns that it is about, one of which must be there."""


@dataclass(frozen=True)
class Explanation:
    """What would explain recordings."""

    sentence: str
    left: float
    """Root mean square of the residuals then, in standard deviations of the sensors."""
    left_as_given: float
    values: Mapping[str, float]
    """Of the fitted parameters then, SI."""

    @property
    def statement(self) -> str:
        """One sentence for people."""
        named = ", ".join(f"{name} {value:.4g}" for name, value in list(self.values.items())[:6])
        instead = f" instead of {self.left_as_given:.3g}" if self.left_as_given < inf else ""
        return (
            f"Most likely {self.sentence}: corrected, residuals would be {self.left:.3g} times the sensors' noise"
            f"{instead}, with {named}."
        )


def _scaled(columns: Sequence[str], factor: float) -> Callable[[MeasuredRun], MeasuredRun]:
    def undo(run: MeasuredRun) -> MeasuredRun:
        changed = {name: factor * run.columns[name] for name in columns if name in run.columns}
        return replace(run, columns={**run.columns, **changed})

    return undo


def _swapped(run: MeasuredRun) -> MeasuredRun:
    pairs = [
        (f"{kind}_{one}", f"{kind}_{other}") for kind in ("tension", "spool") for one, other in (TENDONS, TENDONS[::-1])
    ]
    return replace(run, columns={**run.columns, **{a: run.columns[b] for a, b in pairs if b in run.columns}})


def _clock(run: MeasuredRun) -> MeasuredRun:
    if run.sample_time < 1e3 * _FINEST:
        raise IdentificationError(key="time", value=run.sample_time, allowed=f"{1e3 * _FINEST:g} s or more apart")
    return replace(run, time=1e-3 * run.time)


def _forceless(run: MeasuredRun) -> MeasuredRun:
    return replace(run, columns={name: one for name, one in run.columns.items() if name != "force"})


_FORCES = (("kgf", STANDARD_GRAVITY), ("gf", 1e-3 * STANDARD_GRAVITY), ("lbf", 4.4482216152605), ("mN", 1e-3))
"""Units of force, and their newtons."""
MISTAKES = (
    Mistake("the force has its sign reversed", _scaled(("force",), -1.0), ("force",)),
    Mistake("the columns of the two tendons are swapped", _swapped, _TENSIONS),
    Mistake("the handle angle has its sign reversed", _scaled(_HANDLE, -1.0), _HANDLE),
    Mistake("the output angle has its sign reversed", _scaled(_TIP, -1.0), _TIP),
    Mistake(
        "both angles have their sign reversed (or the tendons are swapped and the force has its sign reversed)",
        _scaled((*_HANDLE, *_TIP), -1.0),
        _TIP,
    ),
    *(
        Mistake(f"{what} {verb} in {given}, not in {stated}", _scaled(columns, factor), columns)
        for what, verb, columns in (("the tensions", "are", _TENSIONS), ("the force", "is", ("force",)))
        for unit, newtons in _FORCES
        for given, stated, factor in ((unit, "N", newtons), ("N", unit, 1 / newtons))
    ),
    *(
        Mistake(f"{what} in {unit}", _scaled(columns, factor), columns)
        for what, columns in (
            ("the handle angle is", _HANDLE),
            ("the output angle is", _TIP),
            ("both angles are", (*_HANDLE, *_TIP)),
        )
        for unit, factor in (("radians, read as degrees", degrees(1)), ("degrees, read as radians", 1 / degrees(1)))
    ),
    Mistake("the time is in ms, not in s", _clock, ("handle_angle",)),
    Mistake("the force that was recorded did not act at the tip", _forceless, ("force",)),
)


def shipped_planar() -> dict[str, ShortForm]:
    """Return the shipped instruments that recordings of one axis may be of, by name."""
    found = {}
    for name in shipped():
        try:
            found[name] = as_short_form(load(name)).planar[0].replace(mismatch=None)
        except (Error, np.linalg.LinAlgError):
            continue  # no planar file
    return found


def is_twin(problem: Problem) -> bool:
    """Return whether a model is an instrument's twin, whose residuals are in the noise of its sensors."""
    return isinstance(getattr(problem, "problem", problem), TwinProblem | Routing)


def unexplained_excess(problem: Problem, found: Fit, train: Sequence[int]) -> float:
    """Return how many times the sensors' noise an instrument's fit leaves, 0 where that is no more than noise allows.

    `train` are the indices of the fitted runs.
    """
    ratio = excess(problem, found, train) if is_twin(problem) else 0.0
    return ratio if ratio > MOST_EXCESS else 0.0


def contradicted(found: Fit, ratio: float, explained: Explanation | None) -> Fit:
    """Return a fit that its residuals contradict: nothing identifiable, intervals as wide as the model's error.

    An error of the model of the size of the residuals can shift a parameter by no more than their norm times that of
    its row in the pseudoinverse of the Jacobian (Cauchy and Schwarz): the standard deviation for white residuals times
    the square root of their number. `ratio` is that of the residuals to the sensors' noise.
    """
    intervals = {}
    for one in found.parameters:
        if one.name in found.interval_95:
            low, high = found.interval_95[one.name]
            reach = sqrt(found.samples) * found.std_white[one.name]
            intervals[one.name] = (max(one.lower, low - reach), min(one.upper, high + reach))
    said = (
        f"The model does not explain the recordings: residuals are {ratio:.3g} times the sensors' noise, where "
        f"{MOST_EXCESS:g} is the most. Nothing is identifiable from them; intervals hold what an error of the model of "
        "that size can do."
    )
    still = all(found.values[one.name] == one.start for one in found.parameters if one.name in found.free)
    why = (
        explained.statement
        if explained is not None
        else "The search did not leave its start: begin elsewhere, with more starts."
        if still
        else "No reversed sign, swapped columns, wrong unit, shipped instrument or single held parameter explains it: "
        "look for another instrument's file, a frozen sensor, or an effect that the model leaves out."
    )
    return replace(
        found,
        interval_95=intervals,
        identifiability=replace(
            found.identifiability, identifiable=dict.fromkeys(found.identifiability.identifiable, False)
        ),
        warnings=(said, why, *found.warnings),
    )


def explain(
    runs: Sequence[MeasuredRun],
    build: Build,
    free: Callable[[Problem], Sequence[str]],
    *,
    instruments: Mapping[str, ShortForm] | None = None,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> Explanation | None:
    """Return the mistake that explains recordings, None if none does.

    Parameters
    ----------
    runs
        Those that were fitted.
    build
        Returns the model of recordings.
    free
        Returns the names of a model's parameters that are fitted.
    instruments
        Those to be tried in place of the given one, by name.
    progress
        Called with how many of how many mistakes are tried.
    """
    short = [_shortened(one) for one in runs]
    own = inf
    tries: list[_Try] = []
    try:
        problem = build(short, None)
        names = free(problem)
        own, at = _searched(problem, names)
        tries = [
            _Try(left, f"{name} is held at a wrong value", problem, (*names, name))
            for name, left in _predicted(problem, names, at)
        ]
    except (Error, np.linalg.LinAlgError):
        pass  # as they were given, recordings may be out of every range
    options: list[tuple[str, Callable[[], Problem]]] = [
        (one.sentence, lambda one=one: build([_shortened(one.undo(run)) for run in runs], None))  # type: ignore[misc]
        for one in MISTAKES
        if any(name in run.columns for run in runs for name in one.columns)
    ]
    options += [
        (f"the recording is of another instrument: {name}", partial(build, short, inst))
        for name, inst in (instruments or {}).items()
    ]
    for number, (sentence, built) in enumerate(options):
        progress(number, len(options) + MOST_SEARCHED)
        try:
            other = built()
            tries.append(_Try(_rms(other, _start(other)), sentence, other, tuple(free(other))))
        except (Error, np.linalg.LinAlgError):
            continue
    best: Explanation | None = None
    for number, one in enumerate(sorted(tries, key=lambda one: one.left)[:MOST_SEARCHED]):
        progress(len(options) + number, len(options) + MOST_SEARCHED)
        try:
            left, at = _searched(one.problem, one.free)
        except (Error, np.linalg.LinAlgError):
            continue
        if left * EXPLAINS < min(own, _REFUSED) and left < (best.left if best else inf):
            values = dict(zip((parameter.name for parameter in one.problem.parameters), at.tolist(), strict=True))
            best = Explanation(one.sentence, left, own, {name: values[name] for name in one.free if name in values})
        if best and best.left <= MOST_EXCESS:
            break
    return best


def answered(ask: Callable[[], _Answer], explain: Callable[[], Explanation | None]) -> _Answer:
    """Return a model of recordings, or its fit; where they are refused, the error names the likely mistake.

    Raises IdentificationError as `ask` does.
    """
    try:
        return ask()
    except IdentificationError as refusal:
        explained = explain()
        if explained is None:
            raise
        about: dict[str, Any] = {"key": refusal.key, "value": refusal.value, "allowed": refusal.allowed}
        raise IdentificationError(f"{refusal} {explained.statement}", **about) from None


class _Try(NamedTuple):
    """A mistake that is tried: how much it would leave before a search, and the model without it."""

    left: float
    sentence: str
    problem: Problem
    free: tuple[str, ...]


def _start(problem: Problem) -> Array:
    return np.array([one.start for one in problem.parameters])


def _rms(problem: Problem, values: Array) -> float:
    plain = np.concatenate([problem.plain_residuals(values, run) for run in range(len(problem.runs))])
    return rms(plain)


def _indices(problem: Problem, free: Sequence[str]) -> list[int]:
    return [n for n, one in enumerate(problem.parameters) if one.name in free]


def _searched(problem: Problem, free: Sequence[str]) -> tuple[float, Array]:
    """Return the root mean square of the residuals after a short search, and the values of all parameters there."""
    indices = _indices(problem, free)
    search = Search(problem, indices, range(len(problem.runs)), "linear", "exact")
    end = search.solve(search.begin, steps=_STEPS)
    if end is None:
        return inf, search.start
    values = search.full(end.at)
    residuals = np.concatenate([problem.residuals(values, run) for run in search.train])
    return rms(residuals), values


def _predicted(problem: Problem, free: Sequence[str], at: Array) -> list[tuple[str, float]]:
    """Return the names of held parameters, and what each would leave by the derivatives if it were fitted too."""
    runs = range(len(problem.runs))
    slopes = [problem.jacobian(at, run) for run in runs]
    residuals = np.concatenate([problem.residuals(at, run) for run in runs])
    known = [one for one in slopes if one is not None]
    if len(known) < len(slopes):
        return []
    jacobian, indices = np.concatenate(known), _indices(problem, free)
    found = []
    for n, one in enumerate(problem.parameters):
        if n not in indices:
            rows = jacobian[:, [*indices, n]]
            rest = residuals - rows @ np.linalg.lstsq(rows, residuals)[0]
            found.append((one.name, rms(rest)))
    return sorted(found, key=lambda one: one[1])[:_MOST_HELD]


def _shortened(run: MeasuredRun) -> MeasuredRun:
    kept = run.time <= run.time[0] + _MOST_SECONDS
    return run if kept.all() else run.rows(kept)
