"""One tolerance study: sample, run, and say what varies by how much and why."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tenodesis import similarity
from tenodesis._core import Status
from tenodesis.errors import StudyError
from tenodesis.instrument import Instrument
from tenodesis.run import Array
from tenodesis.tolerance import engines, sampling
from tenodesis.tolerance.cycle import cycles
from tenodesis.tolerance.defaults import default
from tenodesis.tolerance.evaluation import Task, angles_of, evaluate
from tenodesis.tolerance.files import Tolerances
from tenodesis.tolerance.parameters import Parameter, resolve
from tenodesis.tolerance.results import Study, respond

SAMPLES = 4096
"""Default number of base samples."""
LEAST_SAMPLES, MOST_SAMPLES = 8, 1 << 17
CHUNK = 256
"""Samples per chunk: large beside what it costs to send one, small beside a second."""
TORNADO = (0.05, 0.95)
"""Quantiles between which the tornado chart moves each parameter."""


def study(
    real_size: Instrument,
    scaled_up: Instrument,
    tolerances: Tolerances | None = None,
    *,
    samples: int = SAMPLES,
    seed: int = 0,
    force: float | None = None,
    engine: str | engines.Engine = "threads",
    address: str | None = None,
    progress: Callable[[int, int], None] = lambda done, whole: None,
) -> Study:
    """Return what tolerances do to a scaled-up instrument's loss of angle and to its similarity, with friction.

    The forces on the scaled-up instrument are those on the real-size one times the force factor of the nominal pair,
    since the laboratory hangs nominal weights. Two instruments of one joint type are compared at equal handle angles,
    of two at those of equal unloaded output of the nominal pair. A study's numbers do not depend on engine, threads or
    chunks.

    Parameters
    ----------
    real_size
        The real-size instrument; of two axes, the first.
    scaled_up
        The scaled-up one, as its file has it, mismatch included.
    tolerances
        What varies; by default :func:`tenodesis.tolerance.default` of the scaled-up instrument.
    samples
        Base samples N, rounded up to a power of two as Sobol' sequences want it; N (parameters + 2) runs.
    seed
        Seed of the samples and of the confidence intervals.
    force
        Force on the real-size instrument, N; by default the largest that the scaled-up one is tested under, brought
        down to real size, or else the largest that the real-size one is tested under, or 1 N.
    engine
        threads for this machine, ray for a Ray cluster, or an engine of one's own.
    address
        Where the cluster is, host:port or auto.
    progress
        Called with the samples done and the samples in all.

    Raises
    ------
    StudyError
        A tolerance, a number or the engine is not allowed, the scaled-up instrument does not reach half of the
        real-size one's working range, or the nominal instruments do not hold the force.
    """
    if not isinstance(samples, int | np.integer) or not LEAST_SAMPLES <= samples <= MOST_SAMPLES:
        raise StudyError(f"samples is {samples!r}; allowed is a whole number from {LEAST_SAMPLES} to {MOST_SAMPLES}.")
    if not isinstance(seed, int | np.integer) or isinstance(seed, bool) or not 0 <= seed < 2**32:
        raise StudyError(f"seed is {seed!r}; allowed is a whole number from 0 to 2**32 - 1.")
    runner = engines.named(engine, address) if isinstance(engine, str) else engine
    real_size, scaled_up = (one.axis(one.axes[0]) if len(one.axes) > 1 else one for one in (real_size, scaled_up))
    given = default(scaled_up) if tolerances is None else tolerances
    parameters = resolve(given, real_size, scaled_up)
    count = 1 << (int(samples) - 1).bit_length()

    comparison = _compared(real_size, scaled_up)
    factor = float(comparison.force_factor())
    real_force = _force(real_size, scaled_up, factor, force)
    task = _task(comparison, parameters, real_force, factor)
    scheme = sampling.scheme(parameters, count, int(seed))
    whole = np.concatenate([scheme, _tornado(parameters)])
    table = _evaluated(runner, task, whole, progress)

    rows = len(scheme)
    status = table[:rows, -1].astype(np.int64)
    found = Study(
        real_size, scaled_up, given, parameters, count, int(seed), real_force, factor, task.cycle.end, scheme, status
    )
    if found.failed == 1:
        raise StudyError(
            f"every sample of {scaled_up.name} lost its tip under {real_force:g} N on {real_size.name}; allowed is a "
            "smaller force or narrower tolerances."
        )
    responses = {key: respond(key, table[:rows, n], found, table[rows:, n]) for n, key in enumerate(task.responses)}
    return replace(found, responses=responses)


def _force(real_size: Instrument, scaled_up: Instrument, factor: float, force: float | None) -> float:
    if force is None:
        tested = max(scaled_up.conditions.forces, default=0.0) / factor
        return tested or max(real_size.conditions.forces, default=1.0)
    if isinstance(force, bool) or not isinstance(force, int | float) or not (np.isfinite(force) and force > 0):
        raise StudyError(f"force is {force!r}; allowed is a force above 0 N.")
    return float(force)


def _compared(real_size: Instrument, scaled_up: Instrument) -> similarity.Comparison:
    try:
        return similarity.compare(real_size, scaled_up)
    except ValueError as problem:
        raise StudyError(f"{scaled_up.name} for {real_size.name}: {problem}") from None


def _task(comparison: similarity.Comparison, parameters: tuple[Parameter, ...], force: float, factor: float) -> Task:
    """Return what all samples have in common, once the nominal instruments have been through it."""
    real_size, scaled_up = comparison.real_size, comparison.scaled_up
    way, other = cycles(comparison)
    keys = tuple((one.instrument, one.key) for one in parameters)
    reference, lost = angles_of(real_size, way, force)
    both = any(one.instrument == "real-size" for one in parameters)
    task = Task(real_size, scaled_up, keys, way, other, force, force * factor, None if both else reference)
    nominal = evaluate(task, np.array([[one.nominal for one in parameters]]))[0, -1]
    for inst, status, own in ((real_size, lost, force), (scaled_up, nominal, force * factor)):
        if status != Status.OK:
            raise StudyError(
                f"{inst.name} as its file has it does not hold {own:.4g} N through its working range "
                f"({force:.4g} N on {real_size.name}); allowed is a smaller force, or more pretension."
            )
    return task


def _tornado(parameters: tuple[Parameter, ...]) -> Array:
    """Return the nominal row, then each parameter at its lower quantile, then each at its upper."""
    nominal = np.array([one.nominal for one in parameters])
    low, high = sampling.levels(parameters, TORNADO)
    rows = [nominal]
    for level in (low, high):
        rows += [np.where(np.arange(len(parameters)) == n, level, nominal) for n in range(len(parameters))]
    return np.array(rows)


def _evaluated(runner: engines.Engine, task: Task, rows: Array, progress: Callable[[int, int], None]) -> Array:
    chunks = [rows[n : n + CHUNK] for n in range(0, len(rows), CHUNK)]
    done = 0

    def report(count: int) -> None:
        nonlocal done
        done += count
        progress(done, len(rows))

    progress(0, len(rows))
    return np.concatenate(runner.evaluate(task, chunks, report))
