"""The responses of a sample: its instruments on the quasi-static twin, in a cycle under constant load.

The handle flexes, goes a little beyond the working range, comes back, and flexes again.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from tenodesis import statics, twin
from tenodesis._core import Status
from tenodesis.errors import InstrumentError
from tenodesis.instrument import Instrument, ShortForm
from tenodesis.magnitude import rms
from tenodesis.run import Array
from tenodesis.similarity import Comparison
from tenodesis.tolerance.files import InstrumentName
from tenodesis.tolerance.results import DESCRIPTIONS

AnyInstrument = TypeVar("AnyInstrument", bound=Instrument)

INVALID = -1
"""Status of a sample that is not a valid instrument."""

OF_SCALED_UP = ("loss_flexion", "loss_extension", "loop_width", "similarity_rms", "similarity_largest")
OF_REAL_SIZE = ("real_size_loss_flexion", "real_size_loss_extension", "real_size_loop_width")

STEPS = 24
"""Steps from straight to the end of the working range."""
BEYOND = 6
"""Steps beyond the end, so that every contact slides before the end is approached in extension."""
LOADING = 8
SPEED = float(np.radians(10))
"""Speed of the handle, rad/s; it affects viscous friction only."""


class Cycle(NamedTuple):
    """Handle angle (rad) and share of the load by step, shape (n,), and the steps at which responses are read."""

    handle: Array
    load: Array
    end: float
    """Handle angle at the end of the working range, rad."""
    time_step: float

    @property
    def extension(self) -> slice:
        """Steps from the end back to straight."""
        first = LOADING + BEYOND + STEPS + BEYOND - 1
        return slice(first, first + STEPS + 1)

    @property
    def flexion(self) -> slice:
        """Steps from straight to the end, the second time."""
        last = len(self.handle)
        return slice(last - STEPS - 1, last)


def cycles(comparison: Comparison) -> tuple[Cycle, Cycle]:
    """Return the cycles of the real-size and the scaled-up instrument, at corresponding handle angles.

    They go to the end of the real-size working range, or less far where a handle does not reach a quarter beyond it.
    """
    real_size = comparison.real_size
    end = min(statics.reach(real_size), comparison.common_range(real_size.handle_range) / (1 + BEYOND / STEPS))
    top = STEPS + BEYOND
    nodes = np.concatenate(
        [np.zeros(LOADING), np.arange(1, top + 1), np.arange(top - 1, -1, -1), np.arange(1, STEPS + 1)]
    )
    load = np.ones(nodes.size)
    load[:LOADING] = np.arange(1, LOADING + 1) / LOADING
    handle = nodes * (end / STEPS)
    mapped = np.asarray(comparison.scaled_up_handle_angle(handle))
    other = float(comparison.scaled_up_handle_angle(end))
    return Cycle(handle, load, end, end / STEPS / SPEED), Cycle(mapped, load, other, end / STEPS / SPEED)


class Evaluation(NamedTuple):
    """The data common to all samples of a study; it can be sent to another machine."""

    real_size: ShortForm
    scaled_up: ShortForm
    keys: tuple[tuple[InstrumentName, str], ...]
    """Instrument and key of each column of the samples."""
    cycle: Cycle
    """Cycle of the real-size instrument."""
    scaled_up_cycle: Cycle
    real_size_force: float
    scaled_up_force: float
    reference: Array | None
    """Output angle of the real-size instrument over the cycle, rad; None where its samples differ."""

    @property
    def responses(self) -> tuple[str, ...]:
        """Names of the responses, by column."""
        return OF_SCALED_UP if self.reference is not None else (*OF_SCALED_UP, *OF_REAL_SIZE)

    @property
    def end(self) -> float:
        """Handle angle at which the losses are read, rad."""
        return self.cycle.end

    @property
    def described(self) -> list[tuple[str, str]]:
        """Description and unit of the responses."""
        return [(DESCRIPTIONS[key], "deg") for key in self.responses]

    def table(self, rows: Array) -> Array:
        """Return responses and status of samples, as :func:`evaluate`."""
        return evaluate(self, rows)


def evaluate(task: Evaluation, rows: Array) -> Array:
    """Return responses (deg, NaN where a run was lost) and, as the last column, the status of samples.

    The rows are samples in SI units, shape (n, keys). The status is a number of :class:`tenodesis.statics.Status`, or
    :data:`INVALID`. A sample's result does not depend on the others.
    """
    scaled_up = [_built(task, "scaled-up", row) for row in rows]
    angles, status = angles_of_many(scaled_up, task.scaled_up_cycle, task.scaled_up_force)
    responses = [*_losses(scaled_up, task.scaled_up_cycle, angles)]
    if task.reference is not None:
        reference, of_real_size = task.reference, []
    else:
        real_size = [_built(task, "real-size", row) for row in rows]
        reference, other = angles_of_many(real_size, task.cycle, task.real_size_force)
        status = np.where(status == Status.OK, other, status)
        of_real_size = [*_losses(real_size, task.cycle, reference)]
    error = np.concatenate(
        [(angles - reference)[:, task.cycle.extension], (angles - reference)[:, task.cycle.flexion]], axis=1
    )
    responses += [rms(error, axis=1), np.abs(error).max(axis=1), *of_real_size]
    table = np.degrees(np.column_stack(responses))
    unreachable = np.isnan(table).any(axis=1) & (status == Status.OK)
    status = np.where(unreachable, int(Status.UNREACHABLE), status)
    table[status != Status.OK] = np.nan
    return np.column_stack([table, status])


def angles_of(inst: ShortForm, cycle: Cycle, force: float) -> tuple[Array, int]:
    """Return the output angle (rad) of an instrument over the cycle and the status of its run."""
    angles, status = angles_of_many([inst], cycle, force)
    return angles[0], int(status[0])


def _built(task: Evaluation, which: InstrumentName, row: Array) -> ShortForm | None:
    inst = task.real_size if which == "real-size" else task.scaled_up
    return replaced(inst, {key: float(value) for (of, key), value in zip(task.keys, row, strict=True) if of == which})


def replaced(inst: AnyInstrument, values: Mapping[str, float]) -> AnyInstrument | None:
    """Return an instrument with other values, by key; None where they make none."""
    try:
        return inst.replace(**values) if values else inst
    except InstrumentError:
        return None


def angles_of_many(
    insts: Sequence[ShortForm | None], cycle: Cycle, force: float | Array
) -> tuple[Array, NDArray[np.int64]]:
    """Return output angles by sample and step, rad, and the status of every run; the force is for all, or of each."""
    angles = np.full((len(insts), cycle.handle.size), np.nan)
    status = np.full(len(insts), INVALID)
    valid = [n for n, inst in enumerate(insts) if inst is not None]
    try:
        _run(insts, valid, cycle, force, (angles, status))
    except ValueError:
        # The twin refuses one of them; the others must still run.
        for n in valid:
            with suppress(ValueError):
                _run(insts, [n], cycle, force, (angles, status))
    return angles, status


def _run(
    insts: Sequence[ShortForm | None],
    valid: list[int],
    cycle: Cycle,
    force: float | Array,
    out: tuple[Array, NDArray[np.int64]],
) -> None:
    """Run the valid instruments and write their angles and status into `out`."""
    chosen = [inst for n in valid if (inst := insts[n]) is not None]
    if not chosen:
        return
    load = np.multiply.outer(force if np.ndim(force) == 0 else np.asarray(force)[valid], cycle.load)
    batch = twin.run_many(
        chosen, cycle.handle, load, seeds=[0] * len(chosen), time_step=cycle.time_step, quasi_static=True
    )
    angles, status = out
    angles[valid] = batch["output_angle"]
    status[valid] = batch.status


def _losses(insts: Sequence[ShortForm | None], cycle: Cycle, angles: Array) -> tuple[Array, Array, Array]:
    """Return the loss at the end in flexion and in extension, and the mean width of the loop, rad."""
    end = np.array([cycle.end])
    unloaded = np.array([np.nan if inst is None else statics.output_angle(inst, end)[0] for inst in insts])
    flexion, extension = angles[:, cycle.flexion], angles[:, cycle.extension][:, ::-1]
    return unloaded - flexion[:, -1], unloaded - extension[:, -1], np.mean(extension - flexion, axis=1)
