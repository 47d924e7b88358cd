"""Many twins of joints and tendons, stepped together."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tenodesis import _core
from tenodesis.errors import ArgumentError
from tenodesis.instrument import FullForm, Instrument
from tenodesis.run import Array, Names
from tenodesis.threads import threads
from tenodesis.twin.chain_core import ChainCore
from tenodesis.twin.commands import as_columns
from tenodesis.twin.contact import Contacts, by_axis
from tenodesis.twin.core import Constant

PER_RUN = 3
"""Dimensions of an argument that has an axis of runs."""


class Stepped(NamedTuple):
    """What runs of chains gave: signals by name, (runs, samples, columns), the steps and status of each."""

    signals: Mapping[str, Array]
    steps: NDArray[np.int64]
    status: NDArray[np.int64]
    names: Names


def run_chains(
    insts: Sequence[Instrument],
    arguments: Mapping[str, ArrayLike],
    *,
    contact: Contacts | None,
    seeds: Sequence[int],
    every: int,
    time_step: float,
    quasi_static: bool,
) -> Stepped:
    """Step twins over their commands, or over common ones, and keep every n-th step.

    An argument has shape (n, columns) for all runs, or (runs, n, columns).
    """
    forms: list[FullForm] = [inst.expanded for inst in insts]
    twins = [ChainCore(form, time_step, seed, quasi_static) for form, seed in zip(forms, seeds, strict=True)]
    first = twins[0]
    if any(twin.names != first.names for twin in twins):
        raise ArgumentError("the runs differ in joints or tendons; all must have the same.", key="inst")
    arrays = {name: np.asarray(value, float) for name, value in arguments.items()}
    for name, array in arrays.items():
        if array.ndim == PER_RUN and len(array) != len(twins):
            problem = f"{name} is for {len(array)} runs, instruments for {len(twins)}; it must be the same."
            raise ArgumentError(problem, key=name, value=len(array), allowed=str(len(twins)))
    tissue = by_axis(contact, first.names.joints)
    for one in tissue:
        if one is not None:
            one.check_outside(0.0)
    own = any(array.ndim == PER_RUN for array in arrays.values())
    rows = np.array([_rows(twins[r], insts[r], arrays, tissue, r) for r in range(len(twins) if own else 1)])
    if not rows.shape[1]:
        raise ArgumentError("handle_angle is empty; it must have one step or more.", key="handle_angle")
    if not (isinstance(every, int | np.integer) and 1 <= every <= rows.shape[1]):
        allowed = f"an integer from 1 to {rows.shape[1]}, the number of steps"
        raise ArgumentError(key="every", value=every, allowed=allowed)
    cores = [twin.cores[0] for twin in twins]
    width = sum(columns for _, columns in cores[0].signals)
    out = np.full((len(twins), rows.shape[1] // every, width), np.nan)
    ends = _core.run_wrist_twins(cores, rows, every, out, [], [], first.steps_per_tick, time_step, None, threads())
    signals = first.named(out)
    steps, status = (np.array(column, np.int64) for column in zip(*ends, strict=True))
    return Stepped(signals, steps, status, first.names)


def _rows(twin: ChainCore, inst: Instrument, arrays: Mapping[str, Array], tissue: Sequence[Any], run: int) -> Array:
    given = {name: array[run] if array.ndim == PER_RUN else array for name, array in arrays.items()}
    commands = as_columns(dict.fromkeys(twin.widths, 0.0) | given, twin.widths, inst)
    twin.check(commands)
    return twin.rows(commands, Constant(tissue, None, "tip"))
