"""What one sample comes to: its instruments taken through the cycle on the quasi-static twin."""

from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tenodesis import statics, twin
from tenodesis._core import Status
from tenodesis.errors import InstrumentError
from tenodesis.instrument import Instrument
from tenodesis.run import Array
from tenodesis.tolerance.cycle import Cycle
from tenodesis.tolerance.files import InstrumentName

INVALID = -1
"""Status of a sample that is no valid instrument."""

OF_SCALED_UP = ("loss_flexion", "loss_extension", "loop_width", "similarity_rms", "similarity_largest")
OF_REAL_SIZE = ("real_size_loss_flexion", "real_size_loss_extension", "real_size_loop_width")


class Task(NamedTuple):
    """All that the samples of a study have in common; it can be sent to another machine."""

    real_size: Instrument
    scaled_up: Instrument
    keys: tuple[tuple[InstrumentName, str], ...]
    """What the columns of the samples are."""
    cycle: Cycle
    """Of the real-size instrument."""
    scaled_up_cycle: Cycle
    real_size_force: float
    scaled_up_force: float
    reference: Array | None
    """Output angle of the real-size instrument over the cycle, rad; None where its samples differ."""

    @property
    def responses(self) -> tuple[str, ...]:
        """Names of the responses, by column."""
        return OF_SCALED_UP if self.reference is not None else (*OF_SCALED_UP, *OF_REAL_SIZE)


def evaluate(task: Task, rows: Array) -> Array:
    """Return responses and status of samples, without any effect of which others are worked out beside them.

    Parameters
    ----------
    task
        What the samples have in common.
    rows
        Values by sample and key, SI units, shape (n, keys).

    Returns
    -------
    numpy.ndarray
        Responses in deg, NaN where a run was lost, and in the last column the status: a number of
        :class:`tenodesis.statics.Status`, or :data:`INVALID`.
    """
    scaled_up = [_built(task, "scaled-up", row) for row in rows]
    angles, status = _angles(scaled_up, task.scaled_up_cycle, task.scaled_up_force)
    responses = [*_losses(scaled_up, task.scaled_up_cycle, angles)]
    if task.reference is not None:
        reference, of_real_size = task.reference, []
    else:
        real_size = [_built(task, "real-size", row) for row in rows]
        reference, other = _angles(real_size, task.cycle, task.real_size_force)
        status = np.where(status == Status.OK, other, status)
        of_real_size = [*_losses(real_size, task.cycle, reference)]
    error = np.concatenate(
        [(angles - reference)[:, task.cycle.extension], (angles - reference)[:, task.cycle.flexion]], axis=1
    )
    responses += [np.sqrt(np.mean(error**2, axis=1)), np.abs(error).max(axis=1), *of_real_size]
    table = np.degrees(np.column_stack(responses))
    unreachable = np.isnan(table).any(axis=1) & (status == Status.OK)
    status = np.where(unreachable, int(Status.UNREACHABLE), status)
    table[status != Status.OK] = np.nan
    return np.column_stack([table, status])


def angles_of(inst: Instrument, cycle: Cycle, force: float) -> tuple[Array, int]:
    """Return the output angle (rad) of one instrument over the cycle and the status of its run."""
    angles, status = _angles([inst], cycle, force)
    return angles[0], int(status[0])


def _built(task: Task, which: InstrumentName, row: Array) -> Instrument | None:
    inst = task.real_size if which == "real-size" else task.scaled_up
    changes = {key: float(value) for (of, key), value in zip(task.keys, row, strict=True) if of == which}
    try:
        return inst.replace(**changes) if changes else inst
    except InstrumentError:
        return None


def _angles(insts: Sequence[Instrument | None], cycle: Cycle, force: float) -> tuple[Array, NDArray[np.int64]]:
    """Return output angles by sample and step, rad, and the status of every run."""
    angles = np.full((len(insts), cycle.handle.size), np.nan)
    status = np.full(len(insts), INVALID)
    there = [n for n, inst in enumerate(insts) if inst is not None]
    try:
        _run(insts, there, cycle, force, (angles, status))
    except ValueError:
        # One that the twin refuses must not take the others with it.
        for n in there:
            with suppress(ValueError):
                _run(insts, [n], cycle, force, (angles, status))
    return angles, status


def _run(
    insts: Sequence[Instrument | None],
    there: list[int],
    cycle: Cycle,
    force: float,
    out: tuple[Array, NDArray[np.int64]],
) -> None:
    """Run those that are there and put their angles and status where they belong."""
    chosen = [inst for n in there if (inst := insts[n]) is not None]
    if not chosen:
        return
    batch = twin.run_many(
        chosen, cycle.handle, force * cycle.load, seeds=[0] * len(chosen), time_step=cycle.time_step, quasi_static=True
    )
    angles, status = out
    angles[there] = batch["output_angle"]
    status[there] = batch.status


def _losses(insts: Sequence[Instrument | None], cycle: Cycle, angles: Array) -> tuple[Array, Array, Array]:
    """Return loss at the end in flexion and in extension, and the loop's mean width, rad."""
    end = np.array([cycle.end])
    unloaded = np.array([np.nan if inst is None else statics.output_angle(inst, end)[0] for inst in insts])
    flexion, extension = angles[:, cycle.flexion], angles[:, cycle.extension][:, ::-1]
    return unloaded - flexion[:, -1], unloaded - extension[:, -1], np.mean(extension - flexion, axis=1)
