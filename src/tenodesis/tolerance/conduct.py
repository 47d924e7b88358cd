"""A tolerance study: sample the parameters, run the twin, and evaluate the responses."""

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from typing import Any, Literal

import numpy as np

from tenodesis import similarity
from tenodesis._core import Status
from tenodesis.cluster import Cluster
from tenodesis.errors import StudyError
from tenodesis.instrument import InstrumentLike, ShortForm
from tenodesis.instrument.reading import as_instrument
from tenodesis.run import Array
from tenodesis.simulate import campaign
from tenodesis.tolerance import sampling
from tenodesis.tolerance.defaults import default
from tenodesis.tolerance.evaluation import Evaluation, angles_of, cycles, evaluate
from tenodesis.tolerance.files import Tolerances
from tenodesis.tolerance.joints import JointEvaluation, joint_evaluation
from tenodesis.tolerance.parameters import UncertainParameter, resolve
from tenodesis.tolerance.results import Study, base_rows, respond

ENGINES = ("threads", "ray")
SAMPLES, JOINT_SAMPLES = 4096, 128
"""Default number of base samples, of one plane and of several joints."""
LEAST_SAMPLES, MOST_SAMPLES = 8, 1 << 17
CHUNK = 256
"""Samples per chunk: much longer to evaluate than to send, much shorter than a second."""
TORNADO = (0.05, 0.95)
"""Quantiles between which the tornado chart varies each parameter."""


def study(
    real_size: InstrumentLike,
    scaled_up: InstrumentLike,
    tolerances: Tolerances | None = None,
    *,
    samples: int | None = None,
    seed: int = 0,
    force: float | None = None,
    engine: Literal["threads", "ray"] | campaign.SharedOut = "threads",
    address: str | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Study:
    """Return the effect of tolerances on a scaled-up instrument's output loss and similarity, with friction.

    The force on the scaled-up instrument is that on the real-size one times the force factor of the nominal pair,
    since the laboratory uses nominal weights. Instruments of several joints are run through the loops of
    :class:`tenodesis.similarity.JointComparison`, those of one plane through a cycle of the handle, and of the same
    joint type compared at equal handle angles, others at handle angles of equal unloaded output of the nominal pair.
    Results do not depend on engine, threads or chunks.

    Parameters
    ----------
    real_size
        The real-size instrument; where both have the short form, its first axis. Expanded, all its joints.
    scaled_up
        The scaled-up one as in its file, including mismatch.
    tolerances
        The tolerances; by default :func:`tenodesis.tolerance.default` of the scaled-up instrument.
    samples
        Base samples N, rounded up to a power of two for Sobol' sequences; N (parameters + 2) runs. By default 4096,
        of several joints 128.
    seed
        Seed of the samples and of the confidence intervals.
    force
        Force on the real-size instrument, N; by default the largest test force of the scaled-up one, scaled to real
        size, or else the largest test force of the real-size one, or 1 N. Of several joints, the size of the forces
        of :func:`tenodesis.statics.usual_loads`.
    engine
        threads for this machine, ray for a Ray cluster, or what else a campaign can be run on.
    address
        Of the cluster, as :class:`tenodesis.cluster.Cluster` takes it.
    progress
        Called with the number of samples done and their total.

    Raises
    ------
    StudyError
        A tolerance or an argument is not valid, the scaled-up instrument does not reach half of the real-size working
        range, or the nominal instruments do not hold the force.
    """
    real_size, scaled_up = as_instrument(real_size, "real_size"), as_instrument(scaled_up, "scaled_up")
    planar = [one.planar[0] for one in (real_size, scaled_up) if isinstance(one, ShortForm)]
    samples = (SAMPLES if planar[1:] else JOINT_SAMPLES) if samples is None else samples
    if not isinstance(samples, int | np.integer) or not LEAST_SAMPLES <= samples <= MOST_SAMPLES:
        raise StudyError(key="samples", value=samples, allowed=f"an integer from {LEAST_SAMPLES} to {MOST_SAMPLES}")
    if not isinstance(seed, int | np.integer) or isinstance(seed, bool) or not 0 <= seed < 2**32:
        raise StudyError(key="seed", value=seed, allowed="an integer from 0 to 2**32 - 1")
    _refuse_engine(engine, address)
    given = default(scaled_up) if tolerances is None else tolerances
    comparison = None
    if planar[1:]:
        real_size, scaled_up = planar
        comparison = _compared(*planar)
    parameters = resolve(given, real_size, scaled_up)
    count = 1 << (int(samples) - 1).bit_length()
    task: Evaluation | JointEvaluation
    if comparison is not None:
        factor = float(comparison.force_factor())
        task = _task(comparison, parameters, _force(comparison, factor, force), factor)
    else:
        task = joint_evaluation(real_size, scaled_up, parameters, None if force is None else _given(force))
        factor = task.comparison.factors["force"]
    real_force = task.real_size_force
    scheme = sampling.scheme(parameters, count, int(seed))
    samples_and_tornado = np.concatenate([scheme, _tornado(parameters)])
    with Cluster(address) if address is not None else nullcontext(engine) as on:
        table = _evaluated(on, task, samples_and_tornado, progress)

    rows = len(scheme)
    status = table[:rows, -1].astype(np.int64)
    found = Study(
        real_size, scaled_up, given, parameters, count, int(seed), real_force, factor, task.end, scheme, status
    )
    if found.failed == 1:
        raise StudyError(
            f"every sample of {scaled_up.name} lost its tip under {real_force:g} N on {real_size.name}; use a "
            "smaller force or narrower tolerances.",
            key="force",
            value=real_force,
            allowed="smaller",
        )
    responses = {
        key: respond(key, table[:rows, n], found, table[rows:, n], described)
        for n, (key, described) in enumerate(zip(task.responses, task.described, strict=True))
    }
    return replace(found, responses=responses)


def drawn(
    real_size: InstrumentLike,
    scaled_up: InstrumentLike,
    tolerances: Tolerances | None = None,
    *,
    samples: int,
    seed: int = 0,
) -> dict[str, Array]:
    """Return the responses of instruments of several joints that are drawn from tolerances, by key, (2 samples,).

    Arguments, responses and errors as of :func:`study`, without its sensitivities; rows that were lost are left out.
    """
    real_size, scaled_up = as_instrument(real_size, "real_size"), as_instrument(scaled_up, "scaled_up")
    given = default(scaled_up) if tolerances is None else tolerances
    parameters = resolve(given, real_size, scaled_up)
    task = joint_evaluation(real_size, scaled_up, parameters, None)
    rows = sampling.scheme(parameters, samples, seed)[base_rows(samples, len(parameters))]
    table = task.table(rows)
    held = table[:, -1] == Status.OK
    return dict(zip(task.responses, table[held].T, strict=False))


def _force(comparison: similarity.Comparison, factor: float, force: float | None) -> float:
    if force is None:
        tested = max(comparison.scaled_up.conditions.forces, default=0.0) / factor
        return tested or max(comparison.real_size.conditions.forces, default=1.0)
    return _given(force)


def _given(force: float) -> float:
    if isinstance(force, bool) or not isinstance(force, int | float) or not (np.isfinite(force) and force > 0):
        raise StudyError(key="force", value=force, allowed="a force above 0 N")
    return float(force)


def _compared(real_size: ShortForm, scaled_up: ShortForm) -> similarity.Comparison:
    try:
        compared = similarity.compare(real_size, scaled_up)
    except ValueError as problem:
        raise StudyError(
            f"{scaled_up.name} for {real_size.name}: {problem}", key="scaled_up", value=scaled_up.name
        ) from None
    if compared.factors["length"] < 1:
        raise StudyError(
            f"{real_size.name} is larger than {scaled_up.name}, whose joints have {compared.factors['length']:.3g} of "
            "its size; the real-size instrument comes first, the scaled-up one second.",
            key="real_size",
            value=real_size.name,
        )
    return compared


def _task(
    comparison: similarity.Comparison, parameters: tuple[UncertainParameter, ...], force: float, factor: float
) -> Evaluation:
    """Return the data common to all samples, once the nominal instruments have held the force."""
    real_size, scaled_up = comparison.real_size, comparison.scaled_up
    cycle, scaled_up_cycle = cycles(comparison)
    keys = tuple((one.instrument, one.key) for one in parameters)
    reference, lost = angles_of(real_size, cycle, force)
    both = any(one.instrument == "real-size" for one in parameters)
    task = Evaluation(
        real_size, scaled_up, keys, cycle, scaled_up_cycle, force, force * factor, None if both else reference
    )
    nominal = evaluate(task, np.array([[one.nominal for one in parameters]]))[0, -1]
    for inst, status, own in ((real_size, lost, force), (scaled_up, nominal, force * factor)):
        if status != Status.OK:
            raise StudyError(
                f"{inst.name} as in its file does not hold {own:.4g} N through its working range "
                f"({force:.4g} N on {real_size.name}); use a smaller force or more pretension.",
                key="force",
                value=force,
            )
    return task


def _tornado(parameters: tuple[UncertainParameter, ...]) -> Array:
    """Return the nominal row, then each parameter at its lower quantile, then each at its upper."""
    nominal = np.array([one.nominal for one in parameters])
    low, high = sampling.levels(parameters, TORNADO)
    rows = [nominal]
    for level in (low, high):
        rows += [np.where(np.arange(len(parameters)) == n, level, nominal) for n in range(len(parameters))]
    return np.array(rows)


def _refuse_engine(engine: object, address: str | None) -> None:
    """Refuse an engine that there is not, and an address that does not go with it."""
    if isinstance(engine, str) and engine not in ENGINES:
        raise StudyError(key="engine", value=engine, allowed=" or ".join(ENGINES))
    if engine != "ray" and address is not None:
        raise StudyError(
            f"address is {address!r}, but engine is {engine}; an address goes with engine ray only.",
            key="address",
            value=address,
        )
    if engine == "ray" and address is None:
        raise StudyError("engine is ray, but there is no address; it must be host:port, auto or local.", key="address")


def _evaluated(on: Any, task: Evaluation | JointEvaluation, rows: Array, progress: Callable[[int, int], None]) -> Array:
    """Return responses and status of rows, evaluated in chunks."""
    chunks = [{"rows": rows[n : n + CHUNK]} for n in range(0, len(rows), CHUNK)]
    progress(0, len(rows))
    found = campaign.run(
        partial(_chunk, task), chunks, on=on, progress=lambda done, _: progress(min(done * CHUNK, len(rows)), len(rows))
    )
    return np.concatenate([row["table"] for row in found])


def _chunk(task: Evaluation | JointEvaluation, rows: Array) -> dict[str, Array]:
    return {"table": task.table(rows)}
