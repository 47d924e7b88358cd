"""Many twins in parallel over threads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tenodesis import _core, plant
from tenodesis.control.pairs import compensated
from tenodesis.errors import ArgumentError
from tenodesis.instrument import InstrumentLike, ShortForm, as_instrument, as_short_form
from tenodesis.run import SIGNALS, Array, Names
from tenodesis.threads import threads
from tenodesis.twin.closed_loop import LoopController
from tenodesis.twin.contact import Contacts
from tenodesis.twin.core import TwinCore
from tenodesis.twin.many import Many, Steps, axes, chains
from tenodesis.twin.rows import CONTROL, columns_by_name


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
        values, of = self.signals[signal], self.names.arcs(signal, column)
        return values[:, :, of].sum(axis=-1) if values.ndim > 2 else values

    def __getattr__(self, name: str) -> Array:
        """Return a kept signal by the name that it has in a run: ``batch.output_angle``."""
        if name in SIGNALS and name in self.signals:
            return self.signals[name]
        kept = f"; kept are {', '.join(self.signals)}" if name in SIGNALS else ""
        raise AttributeError(f"a Batch has no {name}{kept}", name=name, obj=self)

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
    grip_force: ArrayLike = 0.0,
    spool_velocity: ArrayLike = 0.0,
    spool_tension: ArrayLike = 0.0,
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
    grip_force
        On one with jaws, likewise, (n, 1) or (runs, n, 1).
    spool_velocity
        Spool velocities, rad/s, shape (n, tendons) for all runs or (runs, n, tendons).
    spool_tension
        Tensions that drives hold instead, N, likewise; 0 for a drive that follows its velocity.
    contact
        Tissue at the tip, for all runs or one per run, None where there is none; with several joints for all runs, one
        per joint.
    controllers
        One per run, new or reset, each for its run's instrument: they close the loops.
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
    arguments: dict[str, ArrayLike] = {
        "handle_angle": handle_angle,
        "force": force,
        "radial_force": radial_force,
        "weight": weight,
        "wrench": wrench,
        "spool_velocity": spool_velocity,
        "spool_tension": spool_tension,
    }
    if np.any(grip_force):
        arguments["grip_force"] = grip_force
    steps = Steps(time_step, quasi_static)
    if any(one.short_form is None for one in chosen):
        many = chains(_varied(chosen, vary or {}), arguments, contact, seeds, steps)
    else:
        many = axes(_instruments(chosen, vary or {}), arguments, contact, seeds, steps)
    count = many.rows.shape[1]
    if not count:
        raise ArgumentError(key="handle_angle", value=[], allowed="of one step or more")
    if not (isinstance(every, int | np.integer) and 1 <= every <= count):
        allowed = f"an integer from 1 to {count}, the number of steps"
        raise ArgumentError(key="every", value=every, allowed=allowed)
    first, runs = many.first, len(many.twins)
    twins = _core.TwinBatch(many.twins)
    loops = _loops(controllers, many, twins)
    kept = _kept(signals, first, controlled=bool(loops))
    # The core has the twin's signals before the controller's.
    ordered = sorted({column for columns in kept.values() for column in columns})
    try:
        out = np.full((runs, len(ordered), count // every), np.nan)
    except MemoryError:
        size = 8e-9 * runs * len(ordered) * (count // every)
        raise MemoryError(
            f"{runs} runs x {len(ordered)} columns x {count // every} samples need {size:.3g} GB; keep fewer signals, "
            "a larger every, or run fewer at a time."
        ) from None
    ends = np.zeros((runs, 2), np.int64)
    twins.advance(
        many.rows, many.given, ordered, every, out, ends, threads(), loops, first.pairs, first.steps_per_tick, time_step
    )
    time = (1 + np.arange(out.shape[2])) * every * time_step
    found = {}
    for name, columns in kept.items():
        values = np.stack([out[:, ordered.index(column)] for column in columns], axis=-1)
        single = len(columns) == 1 and not (name in SIGNALS and SIGNALS[name].per_tendon)
        found[name] = values[:, :, 0] if single else values
    return Batch(time, found, ends[:, 0], ends[:, 1], first.names)


def _kept(signals: Sequence[str], core: TwinCore, *, controlled: bool) -> dict[str, list[int]]:
    """Return the core's columns of signals, or of one of their columns, by name."""
    known = {
        name: list(range(columns.start, columns.stop)) for name, columns in columns_by_name(core.core.signals).items()
    }
    width = sum(len(columns) for columns in known.values())
    for place, column in enumerate(CONTROL * len(core.pairs) if controlled else ()):
        known.setdefault(column.partition(".")[0], []).append(width + place)
    kept = {}
    for name in signals:
        signal, _, column = name.partition(".")
        try:
            kept[name] = [known[signal][core.names.column(signal, column)]] if column else known[signal]
        except KeyError:
            allowed = f"one of {', '.join(known)}, or a column of one"
            raise ArgumentError(key="signals", value=name, allowed=allowed) from None
    return kept


def _loops(controllers: Sequence[LoopController] | None, many: Many, plant_: object) -> list[_core.Controller]:
    """Return the controllers' cores, each with its request for the first tick."""
    if controllers is None:
        return []
    runs = len(many.twins)
    if len(controllers) != runs or len({id(one) for one in controllers}) != runs:
        problem = f"controllers has {len(controllers)} entries; it must have one of its own for each of {runs} runs."
        raise ArgumentError(problem, key="controllers", value=len(controllers), allowed="one controller per run")
    for name in ("spool_velocity", "spool_tension"):
        spools = many.first.columns[name].start
        if {spools + tendon for tendon in many.first.own_tendons}.intersection(many.given):
            raise ArgumentError(f"{name} and controllers are both given; give one of them.", key=name)
    for controller, inst in zip(controllers, many.insts, strict=True):
        controller.check_instrument(compensated(inst))
        controller.begin(plant_, 0.0)
        controller.core.ask(int(controller.take_request()))
    return [controller.core for controller in controllers]


def _varied(insts: list[Any], vary: Mapping[str, ArrayLike]) -> list[Any]:
    """Return an instrument for each run, with its values."""
    if not insts:
        raise ArgumentError(key="inst", value=[], allowed="one instrument or more")
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


def _instruments(chosen: Sequence[InstrumentLike], vary: Mapping[str, ArrayLike]) -> list[ShortForm]:
    insts: list[ShortForm] = _varied([as_short_form(one) for one in chosen], vary)
    first = insts[0]
    fixed = ("law", "sheath_contacts", "vertices_per_joint", "bends")
    for one in insts:
        if len(one.axes) != 1:
            names = " or ".join(f"inst.axis({axis!r})" for axis in one.axes)
            raise ArgumentError(
                f"{one.name} has two axes; it must have one: {names}, with handle angles (time steps,) or (runs, time "
                "steps). Two axes run one by one: Twin(inst).run(...), with handle angles (time steps, 2).",
                key="inst",
            )
        same = all(getattr(one.friction, key) == getattr(first.friction, key) for key in fixed)
        if one.joint_type != first.joint_type or not same or one.sensors.sampling_rate != first.sensors.sampling_rate:
            raise ArgumentError(
                "the runs differ in joint type, friction law, contacts or sampling rate; all must be the same.",
                key="inst",
            )
    return insts
