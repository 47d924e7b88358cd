"""Rows of the core as the signals of a run."""

from collections.abc import Mapping, Sequence

import numpy as np

from tenodesis import _core
from tenodesis.run import Array, Run
from tenodesis.twin.commands import TENDONS

SIGNALS = _core.twin_signals()
CONTROL = _core.control_signals()
_CONTROLLED = tuple(dict.fromkeys(name.partition(".")[0] for name in CONTROL))
_MEASURED_AND_TRUE = tuple(dict.fromkeys(name.partition(".")[0] for name in SIGNALS if name != "sweeps"))


def as_run(
    time: Array,
    axes: tuple[str, ...],
    commanded: Mapping[str, Array],
    outs: Sequence[Array],
    controls: Sequence[Array] = (),
) -> Run:
    """Return rows of the core as signals: by step, by axis if there are two, by tendon.

    Parameters
    ----------
    time
        Of each row, s, shape (n,).
    axes
        Names of the axes.
    commanded
        Signals of the commands, shaped as in the run.
    outs, controls
        Per axis, the twin's signals and the controller's, a row each per step.
    """

    def signal(names: Sequence[str], stack: Sequence[Array], name: str) -> Array:
        if name in names:
            return _of_axes(stack, names.index(name))
        first = names.index(f"{name}.{TENDONS[0]}")
        return _of_axes(stack, slice(first, first + len(TENDONS)))

    sent = {name: signal(CONTROL, controls, name) for name in _CONTROLLED} if controls else {}
    twin = {name: signal(SIGNALS, outs, name) for name in _MEASURED_AND_TRUE}
    return Run(time, axes, **{**commanded, **sent, **twin})


def commanded(rows: Sequence[Array]) -> dict[str, Array]:
    """Return the commands of each axis, a row per step, as signals."""
    return {
        "commanded_handle_angle": _of_axes(rows, 0),
        "radial_force": _of_axes(rows, 2),
        "commanded_spool_velocity": _of_axes(rows, slice(4, 6)),
    }


def _of_axes(stack: Sequence[Array], columns: int | slice) -> Array:
    per_axis = [one[:, columns] for one in stack]
    return per_axis[0] if len(stack) == 1 else np.stack(per_axis, 1)
