"""Arrays fitted in one call: measured signals and an instrument in, parameters and curves out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tenodesis.errors import ArgumentError
from tenodesis.identification import mistakes
from tenodesis.identification.fit import fit as fit_problem
from tenodesis.identification.formats.instrument_run import InstrumentRun, checked
from tenodesis.identification.formats.measured import CLOCKS, MeasuredRun
from tenodesis.identification.problem import Problem
from tenodesis.identification.results import Fit
from tenodesis.identification.twin_model.problem import DEFAULT_LAW, TwinProblem
from tenodesis.instrument import InstrumentLike, ShortForm, as_instrument, as_short_form
from tenodesis.run import TENDONS, Array


def fit(
    problem: Problem | None = None,
    free: Sequence[str] | None = None,
    *,
    time: ArrayLike | None = None,
    handle_angle: ArrayLike | None = None,
    tension: ArrayLike | None = None,
    output_angle: ArrayLike | None = None,
    force: ArrayLike | None = None,
    instrument: InstrumentLike | str | None = None,
    law: str = DEFAULT_LAW,
    train: Sequence[int] = (0,),
    progress: Callable[[float, int], None] | None = None,
    **options: Any,
) -> Fit:
    """Return the parameters of a model fitted to recordings, or of an instrument fitted to arrays.

    Arrays are of NumPy, lists or pandas, all over the same time. Where residuals are far above the sensors'
    noise, the likely mistake is among the warnings, and nothing is identifiable.

    Parameters
    ----------
    problem
        The model with its recordings, in place of arrays; it goes to :func:`tenodesis.identification.fit.fit`.
    free
        Names of the parameters to fit, all by default; the others keep the instrument's values.
    time
        s, (n,), strictly increasing.
    handle_angle
        rad, (n,).
    tension
        Of agonist and antagonist at the spools, N, (n, 2).
    output_angle
        Of the tip, rad, (n,), if it was measured.
    force
        Tangential at the tip, N, (n,) or one for all; without it the tip is taken to be free.
    instrument
        Where the search starts: an instrument of one axis (of several the first), its file or its shipped name.
    law
        Friction law.
    train
        Of a problem, the runs to fit.
    progress
        Called with how many of how many searches are done.
    options
        Of a problem `test`; starts, seed, loss, derivatives, bootstrap, refine.

    Returns
    -------
    Fit
        Of arrays with `traces`, measured and modelled signals, and `instrument`, with the values in place.

    Raises
    ------
    ArgumentError
        An argument is missing, or its shape does not fit.
    IdentificationError
        The recording cannot be used, or nothing is identifiable.
    """
    given = {"time": time, "handle_angle": handle_angle, "tension": tension, "instrument": instrument}
    if problem is not None:
        named = [name for name, one in given.items() if one is not None]
        if named:
            raise ArgumentError(f"problem and {named[0]} are both given; give one of them.", key=named[0])
        return fit_problem(problem, free, train=train, progress=progress, **options)
    for name, one in given.items():
        if one is None:
            raise ArgumentError(
                key=name, value=None, allowed="given with arrays: time, handle_angle, tension, instrument"
            )
    assert instrument is not None
    inst = as_short_form(as_instrument(instrument)).planar[0].replace(mismatch=None)
    run = _recording(time, handle_angle, tension, output_angle, force)

    def build(runs: Sequence[MeasuredRun], other: ShortForm | None) -> Problem:
        return TwinProblem(runs, law, other or inst)

    def free_of(of: Problem) -> Sequence[str]:
        return [one.name for one in of.parameters] if free is None else free

    def explain() -> mistakes.Explanation | None:
        return mistakes.explain([run], build, free_of, instruments=mistakes.shipped_planar())

    model = mistakes.answered(lambda: build([run], None), explain)
    found = mistakes.answered(lambda: fit_problem(model, free, train=[0], progress=progress, **options), explain)
    if ratio := mistakes.unexplained_excess(model, found, [0]):
        found = mistakes.contradicted(found, ratio, explain())
    return replace(found, traces=model.traces(found.vector, 0), instrument=model.instrument(found.vector))


def _recording(time: Any, handle_angle: Any, tension: Any, output_angle: Any, force: Any) -> InstrumentRun:
    """Return arrays as a recording; raises ArgumentError if their shapes do not fit."""
    clock = _array("time", time, None)
    count = clock.size
    pair = _array("tension", tension, (count, len(TENDONS)))
    columns = {"handle_angle": _array("handle_angle", handle_angle, (count,))}
    columns |= {f"tension_{tendon}": pair[:, n] for n, tendon in enumerate(TENDONS)}
    if output_angle is not None:
        columns["measured_output_angle"] = _array("output_angle", output_angle, (count,))
    if force is not None:
        columns["force"] = _array("force", np.broadcast_to(force, (count,)) if np.ndim(force) == 0 else force, (count,))
    return checked("arrays", clock, columns, clocks=CLOCKS[:1])


def _array(name: str, values: Any, shape: tuple[int, ...] | None) -> Array:
    found = np.asarray(values, dtype=np.float64)
    if (found.ndim != 1) if shape is None else (found.shape != shape):
        allowed = "of shape (n,)" if shape is None else f"of shape {shape}, as long as time"
        raise ArgumentError(f"{name} has shape {found.shape}; it must be {allowed}.", key=name, value=found.shape)
    return found
