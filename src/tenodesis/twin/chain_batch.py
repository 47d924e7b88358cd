"""Many twins with their commands: what is stepped together, and that of chains."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tenodesis import _core
from tenodesis.errors import ArgumentError
from tenodesis.instrument import FullForm, Instrument
from tenodesis.run import Array
from tenodesis.twin.chain_core import ChainCore
from tenodesis.twin.commands import as_columns
from tenodesis.twin.contact import Contacts, by_axis
from tenodesis.twin.core import Constant, TwinCore
from tenodesis.twin.rows import check_seed

_PER_RUN = 3
"""Dimensions of an argument that has an axis of runs."""


class Steps(NamedTuple):
    """The steps of twins."""

    time_step: float
    quasi_static: bool


class Many(NamedTuple):
    """Twins that are stepped together, and their commands."""

    first: TwinCore
    """Of the first; what its columns are holds for all."""
    twins: list[_core.Twin]
    insts: Sequence[Instrument]
    rows: Array
    """Commands by run, or common ones, step and column."""
    given: list[int]
    """Columns that the commands have."""


def chains(
    insts: list[Instrument],
    arguments: Mapping[str, ArrayLike],
    contact: Contacts | None,
    seeds: ArrayLike | None,
    steps: Steps,
) -> Many:
    """Return the twins of instruments that list joints and tendons, with their commands.

    An argument has shape (n, columns) for all runs, or (runs, n, columns).
    """
    arrays = {name: np.asarray(value, float) for name, value in arguments.items()}
    per_run = {name: len(array) for name, array in arrays.items() if array.ndim == _PER_RUN}
    if len(insts) == 1:
        insts = insts * max([1, *per_run.values()])
    for name, count in per_run.items():
        if count != len(insts):
            problem = f"{name} is for {count} runs, instruments for {len(insts)}; it must be the same."
            raise ArgumentError(problem, key=name, value=count, allowed=str(len(insts)))
    forms: list[FullForm] = [inst.expanded for inst in insts]
    twins = [
        ChainCore(form, steps.time_step, seed, steps.quasi_static)
        for form, seed in zip(forms, seeds_of(seeds, len(insts)), strict=True)
    ]
    first = twins[0]
    if any(twin.names != first.names for twin in twins):
        raise ArgumentError("the runs differ in joints or tendons; all must have the same.", key="inst")
    tissue = by_axis(contact, first.names.joints)
    for one in tissue:
        if one is not None:
            one.check_outside(0.0)
    rows = np.array([_rows(twins[r], insts[r], arrays, tissue, r) for r in range(len(twins) if per_run else 1)])
    given = np.flatnonzero(rows.any(axis=(0, 1))).tolist() or [0]
    return Many(first, [twin.core for twin in twins], insts, np.ascontiguousarray(rows[:, :, given]), given)


def seeds_of(seeds: ArrayLike | None, runs: int) -> list[int]:
    """Return the seed of each run; raises ArgumentError if there are more or fewer."""
    given = list(range(runs)) if seeds is None else np.asarray(seeds).tolist()
    if not isinstance(given, list) or len(given) != runs:
        problem = f"seeds has shape {np.shape(given)}; it must be ({runs},)."
        raise ArgumentError(problem, key="seeds", value=np.shape(given), allowed=f"({runs},)")
    for seed in given:
        check_seed(seed)
    return [int(seed) for seed in given]


def _rows(twin: ChainCore, inst: Instrument, arrays: Mapping[str, Array], tissue: Sequence[Any], run: int) -> Array:
    given = {name: array[run] if array.ndim == _PER_RUN else array for name, array in arrays.items()}
    commands = as_columns(dict.fromkeys(twin.widths, 0.0) | given, twin.widths, inst)
    twin.check(commands)
    return twin.rows(commands, Constant(tissue, None, "tip"))
