"""Many twins with their commands: what is stepped together."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tenodesis import _core, plant
from tenodesis.errors import ArgumentError
from tenodesis.instrument import Instrument, ShortForm
from tenodesis.run import Array
from tenodesis.statics.query import common_shape
from tenodesis.twin.axes_core import AxesCore
from tenodesis.twin.chain_core import ChainCore
from tenodesis.twin.commands import as_columns, check_finite, check_no_wrench, check_spool_tension
from tenodesis.twin.contact import Contact, Contacts, by_axis, rows_of
from tenodesis.twin.core import Surroundings, TwinCore
from tenodesis.twin.rows import check_handle_range, check_rig, check_seed

_BY_TENDON = ("spool_velocity", "spool_tension")
"""Arguments whose last axis is that of the tendons."""
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
    own = _seeds(seeds, len(insts))
    # Loads of one instrument are many runs, of which each needs a core of its own, and no more.
    distinct = {id(inst): inst for inst in insts}
    made = {key: ChainCore(one.expanded, steps.time_step, 0, steps.quasi_static) for key, one in distinct.items()}
    cores = [made[id(inst)] for inst in insts]
    first = cores[0]
    if any(core.names[:3] != first.names[:3] for core in made.values()):
        raise ArgumentError("the runs differ in joints or tendons; all must have the same.", key="inst")
    tissue = by_axis(contact, first.names.joints)
    for one in tissue:
        if one is not None:
            one.check_outside(0.0)
    rows = _rows(cores if per_run else cores[:1], arrays, tissue)
    given = np.flatnonzero(rows.any(axis=(0, 1))).tolist() or [0]
    twins = [core.of_seed(seed) for core, seed in zip(cores, own, strict=True)]
    return Many(first, twins, insts, np.ascontiguousarray(rows[:, :, given]), given)


def axes(
    insts: list[ShortForm],
    arguments: Mapping[str, ArrayLike],
    contact: Contacts | None,
    seeds: ArrayLike | None,
    steps: Steps,
) -> Many:
    """Return the twins of planar instruments of one axis, with their commands."""
    check_no_wrench(arguments["wrench"], insts[0])
    tissue = _tissue(contact)
    arrays = {name: np.asarray(value, float) for name, value in arguments.items() if name != "wrench"}
    shape = _shape(len(insts), arrays)
    runs = len(insts) if len(insts) > 1 else max(shape[0], len(tissue))
    insts = insts * runs if len(insts) == 1 else insts
    for name, count in (("commands are", shape[0]), ("contact is", len(tissue))):
        if count not in (1, runs):
            problem = f"{name} for {count} runs, instruments for {runs}; it must be the same."
            raise ArgumentError(problem, key=name.split()[0], value=count, allowed=f"of {runs} runs")
    prescribed = [one for one in insts if not one.dynamics.hand_stiffness]
    if prescribed:
        narrowest = min(prescribed, key=lambda one: one.handle_range)
        for row in np.atleast_2d(arrays["handle_angle"]):
            check_handle_range(narrowest, row)
    check_spool_tension(np.atleast_1d(arrays["spool_tension"]), insts[0].expanded)
    if arrays["weight"].any():
        for one in insts:
            check_rig(one)
    own = _seeds(seeds, runs)
    first = AxesCore(insts[0], steps.time_step, own[0], steps.quasi_static)
    specs: dict[int, _core.TwinSpec] = {}
    for one in insts:
        if id(one) not in specs:
            plant.steps_per_sample(one, steps.time_step, steps.quasi_static)
            specs[id(one)] = plant.spec(one, steps.time_step, steps.quasi_static)
    twins = [_core.axes_twin([specs[id(one)]], [seed]) for one, seed in zip(insts, own, strict=True)]
    # Of what is zero throughout, only the handle angle has a column.
    blocks = [
        (name, array if array.ndim and name in _BY_TENDON else array[..., np.newaxis])
        for name, array in arrays.items()
        if name == "handle_angle" or array.any()
    ]
    if tissue.any():
        blocks.append(("contact", tissue[:, np.newaxis]))
        shape = (max(len(tissue), shape[0]), shape[1])
    columns = [first.columns[name] for name, _ in blocks]
    rows = np.concatenate(
        [
            np.broadcast_to(block, (*shape, column.stop - column.start))
            for (_, block), column in zip(blocks, columns, strict=True)
        ],
        axis=-1,
    )
    given = [place for column in columns for place in range(column.start, column.stop)]
    return Many(first, twins, insts, rows, given)


def _seeds(seeds: ArrayLike | None, runs: int) -> list[int]:
    """Return the seed of each run; raises ArgumentError if there are more or fewer."""
    given = list(range(runs)) if seeds is None else np.asarray(seeds).tolist()
    if not isinstance(given, list) or len(given) != runs:
        problem = f"seeds has shape {np.shape(given)}; it must be ({runs},)."
        raise ArgumentError(problem, key="seeds", value=np.shape(given), allowed=f"({runs},)")
    for seed in given:
        check_seed(seed)
    return [int(seed) for seed in given]


def _rows(cores: Sequence[ChainCore], arrays: Mapping[str, Array], tissue: Sequence[Any]) -> Array:
    """Return the commands of all runs, (runs, n, columns): at once where each has its own, and twins take the same."""
    first, runs = cores[0], len(cores)
    shapes = {array.shape[:2] for array in arrays.values() if array.ndim}
    if runs > 1 and (len(shapes) > 1 or any(core.widths != first.widths for core in cores)):
        of_each = [{n: one[[r]] if one.ndim == _PER_RUN else one for n, one in arrays.items()} for r in range(runs)]
        return np.concatenate([_rows([core], given, tissue) for core, given in zip(cores, of_each, strict=True)])
    given = {
        n: one.reshape(math.prod(one.shape[:2]), one.shape[2]) if one.ndim == _PER_RUN else one
        for n, one in arrays.items()
    }
    unset: dict[str, Any] = dict.fromkeys(first.widths, 0.0)
    commands = as_columns(unset | given, first.widths, first.inst)
    of_runs = {name: np.split(array, runs) for name, array in commands.items()}
    for run, core in enumerate(cores):
        core.check({name: parts[run] for name, parts in of_runs.items()})
    check_spool_tension(commands["spool_tension"], first.inst)
    found = first.rows(commands, Surroundings(tissue, None, "tip"))
    return found.reshape(runs, -1, found.shape[1])


def _shape(runs: int, arrays: Mapping[str, Array]) -> tuple[int, int]:
    """Return the runs that commands are for, 1 if all share them, and their steps."""
    by_step = {name: array.shape[:-1] if name in _BY_TENDON else array.shape for name, array in arrays.items()}
    shape = common_shape(by_step)
    shape = (1,) * (2 - len(shape)) + shape
    if len(shape) != 2 or (shape[0] not in (1, runs) and runs != 1):
        problem = f"commands have shape {shape}; it must be (n,) or ({runs}, n)."
        raise ArgumentError(problem, key="handle_angle", value=shape)
    for name, array in arrays.items():
        check_finite(name, array)
    return shape[0], shape[1]


def _tissue(contact: Contacts | None) -> Array:
    """Return the commands' columns for tissue, of all runs or of each, shape (1 or runs, 3)."""
    given = (contact,) if contact is None or isinstance(contact, Contact) else tuple(contact)
    for one in given:
        if one is not None:
            one.check_outside(0.0)
    return np.concatenate([rows_of(one, ("run",)) for one in given]) if given else np.empty((0, 3))
