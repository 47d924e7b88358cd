"""Many twins in parallel over threads."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tenodesis import _core, plant
from tenodesis.errors import ArgumentError
from tenodesis.instrument import Instrument, InstrumentLike, ShortForm, as_instrument, as_short_form
from tenodesis.run import Array, Names
from tenodesis.statics.query import common_shape
from tenodesis.threads import threads
from tenodesis.twin.chain_batch import PER_RUN, run_chains
from tenodesis.twin.closed_loop import LoopController
from tenodesis.twin.commands import check_finite, check_no_wrench
from tenodesis.twin.contact import Contact, Contacts, rows_of
from tenodesis.twin.rows import (
    ARGUMENTS,
    COMMANDS,
    CONTROL,
    SIGNALS,
    check_handle_range,
    check_rig,
    check_seed,
)


_COLUMNS = {name: np.atleast_1d(np.arange(len(COMMANDS))[columns]).tolist() for name, columns in ARGUMENTS.items()}
"""Columns of a command, by the argument that fills them."""


@dataclass(frozen=True)
class Batch:
    """The runs of :func:`run_many`: kept signals by name, with the names and shapes of a run after an axis of runs.

    A signal has shape (runs, samples), per tendon (runs, samples, 2), one of its columns (runs, samples); NaN after a
    run ended early.
    """

    time: Array
    signals: Mapping[str, Array]
    steps: NDArray[np.int64]
    """Number of steps of each run."""
    status: NDArray[np.int64]
    """Why each run ended, values of :class:`tenodesis.statics.Status`."""
    names: Names
    """What columns are named after."""

    def __getitem__(self, name: str) -> Array:
        """Return a kept signal, or a column of one: ``batch["tension"]``, ``batch["tension.agonist"]``.

        Raises KeyError if it was not kept.
        """
        signal, _, column = name.partition(".")
        if name in self.signals or not column or signal not in self.signals:
            return self.signals[name]
        number = self.names.column(signal, column)
        values = self.signals[signal]
        return values[:, :, number] if values.ndim > 2 else values

    def __repr__(self) -> str:
        early = int(np.count_nonzero(self.status))
        kept = f"{', '.join(self.signals)} at {self.time.size} times"
        return f"<Batch of {len(self.steps)} runs: {kept}{f', {early} ended early' if early else ''}>"


def run_many(
    inst: InstrumentLike | Sequence[InstrumentLike],
    handle_angle: ArrayLike,
    force: ArrayLike = 0.0,
    *,
    radial_force: ArrayLike = 0.0,
    weight: ArrayLike = 0.0,
    wrench: ArrayLike = 0.0,
    spool_velocity: ArrayLike = 0.0,
    contact: Contacts | None = None,
    controllers: Sequence[LoopController] | None = None,
    vary: Mapping[str, ArrayLike] | None = None,
    seeds: ArrayLike | None = None,
    signals: Sequence[str] = ("output_angle",),
    every: int = 1,
    time_step: float = plant.TIME_STEP,
    quasi_static: bool = False,
) -> Batch:
    """Run many twins from rest, in parallel: over threads, and in the lanes of the processor's vectors.

    Each run is the same to the last bit as that of a :class:`Twin` by itself. Twins with friction laws that depend on
    speed or tension, with two vertices a joint, more than one sheath contact or motor currents run over threads alone,
    and so do chains other than one or two axes, each with a joint of the handle, one of the tip and a pair of tendons.

    Parameters
    ----------
    inst
        The instrument, or one per run: of one axis and all of one joint type, or all with the same joints and tendons.
    handle_angle, force, radial_force, weight
        Commands as for :meth:`Twin.run`, shape (n,) for all runs or (runs, n); where joints and tendons are listed,
        with an axis of columns, (n, columns) or (runs, n, columns).
    wrench
        On an instrument that lists joints and tendons, as for :meth:`Twin.run`, or (runs, n, 6).
    spool_velocity
        Spool velocities, rad/s, shape (n, tendons) for all runs or (runs, n, tendons).
    contact
        Tissue at the tip, for all runs or one per run, None where there is none; with several joints for all runs, one
        per joint.
    controllers
        One per run, new or reset, each for an instrument of one axis: they close the loops.
    vary
        Values per run by key of the instrument, as :meth:`Instrument.replace` takes them: ``{"pretension": array}``,
        ``{"friction.vertex_coefficient": array}``.
    seeds
        Seed per run; by default 0, 1, 2, ...
    signals
        Signals to keep, by name; a tendon's is written ``tension.agonist``, that of both ``tension``. With controllers
        also theirs, such as ``estimated_output_angle`` or ``faults``.
    every
        Keep every n-th step.
    time_step, quasi_static
        As for :class:`Twin`.

    Raises
    ------
    ValueError
        Shapes do not fit, a command is not finite or beyond the handle's range, a straight tip is inside tissue, or a
        signal is unknown.
    InstrumentError
        A varied value is not allowed.
    """
    chosen = [as_instrument(one) for one in ([inst] if isinstance(inst, InstrumentLike) else inst)]
    if any(one.short_form is None for one in chosen):
        if controllers is not None:
            raise ArgumentError("controllers are given; they are for instruments of one axis.", key="controllers")
        arguments = {
            "handle_angle": handle_angle,
            "force": force,
            "radial_force": radial_force,
            "weight": weight,
            "wrench": wrench,
            "spool_velocity": spool_velocity,
        }
        return _chains(
            _varied(chosen, vary or {}),
            arguments,
            signals,
            contact=contact,
            seeds=seeds,
            every=every,
            time_step=time_step,
            quasi_static=quasi_static,
        )
    insts = _instruments(chosen, vary or {})
    check_no_wrench(wrench, insts[0])
    commands, given = _shared_commands(len(insts), handle_angle, force, radial_force, weight, spool_velocity)
    tissue = _tissue(contact)
    runs = len(insts)
    if runs == 1:
        insts = insts * max(len(commands), len(tissue))
        runs = len(insts)
    if commands.shape[0] not in (1, runs):
        raise ArgumentError(f"commands are for {commands.shape[0]} runs, instruments for {runs}; it must be the same.")
    prescribed = [one for one in insts if not one.dynamics.hand_stiffness]
    if prescribed:
        narrowest = min(prescribed, key=lambda one: one.handle_range)
        for row in commands[:, :, 0]:
            check_handle_range(narrowest, row)
    if COMMANDS.index("weight") in given:
        for one in insts:
            check_rig(one)
    if len(tissue) not in (1, runs):
        raise ArgumentError(f"contact is for {len(tissue)} runs, instruments for {runs}; it must be the same.")
    if tissue.any():
        shape = (max(len(tissue), len(commands)), commands.shape[1])
        parts = [np.broadcast_to(part, (*shape, part.shape[2])) for part in (commands, tissue[:, np.newaxis])]
        commands = np.concatenate(parts, axis=2)
        given += _COLUMNS["contact"]
    if not commands.shape[1]:
        raise ArgumentError("handle_angle is empty; it must have one step or more.", key="handle_angle")
    if not (isinstance(every, int | np.integer) and 1 <= every <= commands.shape[1]):
        allowed = f"an integer from 1 to {commands.shape[1]}, the number of steps"
        raise ArgumentError(key="every", value=every, allowed=allowed)
    known = (*SIGNALS, *(() if controllers is None else CONTROL))
    kept = {name: _columns_of(name, known, insts[0].axes[0]) for name in signals}
    # The core has the twin's signals before the controller's.
    ordered = sorted({column for columns in kept.values() for column in columns}, key=known.index)
    twins = _core.TwinBatch(
        plant.spec(insts[0], time_step, quasi_static), _rows(insts, time_step, quasi_static), _seeds(seeds, runs)
    )
    loops = _loops(controllers, insts, twins)
    if loops and set(_COLUMNS["spool_velocity"]).intersection(given):
        raise ArgumentError("spool_velocity and controllers are both given; give one of them.", key="spool_velocity")
    out = np.full((runs, len(ordered), commands.shape[1] // every), np.nan)
    ends = np.zeros((runs, 2), np.int64)
    per_tick = plant.steps_per_sample(insts[0], time_step, quasi_static)
    columns = [known.index(name) for name in ordered]
    twins.advance(commands, given, columns, every, out, ends, threads(), loops, per_tick, time_step)
    time = (1 + np.arange(out.shape[2])) * every * time_step
    found = {
        name: np.stack([out[:, ordered.index(column)] for column in columns], axis=-1)
        if len(columns) > 1
        else out[:, ordered.index(columns[0])]
        for name, columns in kept.items()
    }
    return Batch(time, found, ends[:, 0], ends[:, 1], Names.paired(insts[0].axes))


def _columns_of(name: str, known: Sequence[str], axis: str) -> list[str]:
    """Return the core's columns of a signal, or of one of its columns."""
    signal, _, column = name.partition(".")
    column = "" if column in (axis, f"handle_{axis}") else column.removeprefix(f"{axis}_")
    found = [one for one in known if one == f"{signal}.{column}" or (not column and one.partition(".")[0] == signal)]
    if not found:
        allowed = f"one of {', '.join(known)}"
        raise ArgumentError(f"signals has {name!r}; it must be {allowed}.", key="signals", value=name, allowed=allowed)
    return found


def _loops(
    controllers: Sequence[LoopController] | None, insts: Sequence[ShortForm], plant_: object
) -> list[_core.Controller]:
    """Return the controllers' cores, each with its request for the first tick."""
    if controllers is None:
        return []
    if len(controllers) != len(insts) or len({id(one) for one in controllers}) != len(insts):
        problem = (
            f"controllers has {len(controllers)} entries; it must have one of its own for each of {len(insts)} runs."
        )
        raise ArgumentError(problem, key="controllers", value=len(controllers), allowed="one controller per run")
    for controller, inst in zip(controllers, insts, strict=True):
        controller.check_instrument(inst)
        controller.begin(plant_, 0.0)
        controller.core.ask(int(controller.take_request()))
    return [controller.core for controller in controllers]


def _chains(
    insts: list[Instrument],
    arguments: Mapping[str, ArrayLike],
    signals: Sequence[str],
    *,
    contact: Contacts | None,
    seeds: ArrayLike | None,
    every: int,
    time_step: float,
    quasi_static: bool,
) -> Batch:
    """Return the runs of instruments that list joints and tendons."""
    if len(insts) == 1:
        insts = insts * max(
            [1, *(len(given) for given in map(np.asarray, arguments.values()) if given.ndim == PER_RUN)]
        )
    own = [int(seed) for seed in _seeds(seeds, len(insts))]
    done = run_chains(
        insts,
        arguments,
        contact=contact,
        seeds=own,
        every=every,
        time_step=time_step,
        quasi_static=quasi_static,
    )
    kept = {}
    for name in signals:
        signal, _, column = name.partition(".")
        if signal not in done.signals:
            allowed = f"one of {', '.join(done.signals)}"
            raise ArgumentError(
                f"signals has {name!r}; it must be {allowed}.", key="signals", value=name, allowed=allowed
            )
        values = done.signals[signal]
        if column:
            kept[name] = values[:, :, done.names.column(signal, column)]
        else:
            kept[name] = values.reshape(len(insts), *done.names.shape(signal, values.shape[1]))
    samples = next(iter(done.signals.values())).shape[1]
    time: Array = np.arange(1, 1 + samples, dtype=np.float64) * every * time_step
    return Batch(time, kept, done.steps, done.status, done.names)


def _varied(insts: list[Any], vary: Mapping[str, ArrayLike]) -> list[Any]:
    """Return an instrument for each run, with its values."""
    if not insts:
        raise ArgumentError("inst is empty; it must be one instrument or more.", key="inst")
    columns = {key: np.atleast_1d(np.asarray(values)) for key, values in vary.items()}
    for key, column in columns.items():
        if column.ndim != 1 or not column.size or column.dtype == object:
            problem = f"vary[{key!r}] has shape {column.shape}; it must be (runs,)."
            raise ArgumentError(problem, key="vary", value=key, allowed="one value per run")
    lengths = {column.size for column in columns.values()} | ({len(insts)} if len(insts) > 1 else set())
    if len(lengths) > 1:
        raise ArgumentError(f"vary has columns of {sorted(lengths)} runs; they must have as many.", key="vary")
    if columns:
        runs = lengths.pop()
        insts = insts * runs if len(insts) == 1 else insts
        insts = [
            one.replace(**{key: column[n].item() for key, column in columns.items()}) for n, one in enumerate(insts)
        ]
    return insts


def _instruments(chosen: Sequence[Instrument], vary: Mapping[str, ArrayLike]) -> list[ShortForm]:
    insts: list[ShortForm] = _varied([as_short_form(one) for one in chosen], vary)
    first = insts[0]
    fixed = ("law", "sheath_contacts", "vertices_per_joint", "bends")
    for one in insts:
        if len(one.axes) != 1:
            raise ArgumentError(f"{one.name} has two axes; it must have one: inst.axis(name).", key="inst")
        same = all(getattr(one.friction, key) == getattr(first.friction, key) for key in fixed)
        if one.joint_type != first.joint_type or not same or one.sensors.sampling_rate != first.sensors.sampling_rate:
            raise ArgumentError(
                "the runs differ in joint type, friction law, contacts or sampling rate; all must be the same.",
                key="inst",
            )
    return insts


def _shared_commands(runs: int, *arguments: ArrayLike) -> tuple[Array, list[int]]:
    """Return commands of shape (runs, n, columns), or (1, n, columns) if all runs share them, and their columns.

    Of those that are zero throughout, only the handle angle has one.
    """
    arrays = [np.asarray(argument, float) for argument in arguments]
    named = dict(zip(ARGUMENTS, arrays, strict=False))
    by_step = {name: array.shape[:-1] if name == "spool_velocity" else array.shape for name, array in named.items()}
    shape = common_shape(by_step)
    shape = (1,) * (2 - len(shape)) + shape
    if len(shape) != 2 or (shape[0] not in (1, runs) and runs != 1):
        problem = f"commands have shape {shape}; it must be (n,) or ({runs}, n)."
        raise ArgumentError(problem, key="handle_angle", value=shape)
    for name, array in named.items():
        check_finite(name, array)
    there = {name: array for name, array in named.items() if name == "handle_angle" or array.any()}
    given = [column for name in there for column in _COLUMNS[name]]
    rows = np.empty((*shape, len(given)))
    for name, array in there.items():
        rows[..., [given.index(column) for column in _COLUMNS[name]]] = (
            array if array.ndim and name == "spool_velocity" else array[..., np.newaxis]
        )
    return rows, given


def _tissue(contact: Contacts | None) -> Array:
    """Return the commands' columns for tissue, of all runs or of each, shape (1 or runs, 3)."""
    given = (contact,) if contact is None or isinstance(contact, Contact) else tuple(contact)
    for one in given:
        if one is not None:
            one.check_outside(0.0)
    return np.concatenate([rows_of(one, ("run",)) for one in given]) if given else np.empty((0, 3))


def _seeds(seeds: ArrayLike | None, runs: int) -> NDArray[np.uint64]:
    given = list(range(runs)) if seeds is None else np.asarray(seeds).tolist()
    if not isinstance(given, list) or len(given) != runs:
        problem = f"seeds has shape {np.shape(given)}; it must be ({runs},)."
        raise ArgumentError(problem, key="seeds", value=np.shape(given), allowed=f"({runs},)")
    for seed in given:
        check_seed(seed)
    return np.array(given, np.uint64)


def _rows(insts: Sequence[ShortForm], time_step: float, quasi_static: bool) -> Array:
    """Return the parameters of every run, each instrument checked and converted once."""
    rows: dict[int, list[float]] = {}
    for one in insts:
        if id(one) not in rows:
            plant.steps_per_sample(one, time_step, quasi_static)
            rows[id(one)] = plant.parameter_row(one, time_step)
    return np.array([rows[id(one)] for one in insts])
