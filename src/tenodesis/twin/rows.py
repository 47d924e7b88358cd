"""Rows of the core as the signals of a run."""

from collections.abc import Sequence

import numpy as np

from tenodesis import _core
from tenodesis.run import Array, Run
from tenodesis.twin.commands import TENDONS

SIGNALS = _core.twin_signals()
CONTROL = _core.control_signals()
_CONTROLLED = tuple(dict.fromkeys(name.partition(".")[0] for name in CONTROL))
_MEASURED_AND_TRUE = tuple(dict.fromkeys(name.partition(".")[0] for name in SIGNALS if name != "sweeps"))


def as_run(
    time: Array, axes: tuple[str, ...], rows: Sequence[Array], outs: Sequence[Array], controls: Sequence[Array] = ()
) -> Run:
    """Return rows of the core as signals: by step, by axis if there are two, by tendon.

    Parameters
    ----------
    time
        Of each row, s, shape (n,).
    axes
        Names of the axes.
    rows, outs, controls
        Per axis, commands, the twin's signals and the controller's, a row each per step.
    """

    def signal(names: Sequence[str], stack: Sequence[Array], name: str) -> Array:
        if name in names:
            columns: int | slice = names.index(name)
        else:
            first = names.index(f"{name}.{TENDONS[0]}")
            columns = slice(first, first + len(TENDONS))
        per_axis = [one[:, columns] for one in stack]
        return per_axis[0] if len(stack) == 1 else np.stack(per_axis, 1)

    def command(columns: int | slice) -> Array:
        per_axis = [row[:, columns] for row in rows]
        return per_axis[0] if len(rows) == 1 else np.stack(per_axis, 1)

    sent = {name: signal(CONTROL, controls, name) for name in _CONTROLLED} if controls else {}
    return Run(
        time,
        axes,
        commanded_handle_angle=command(0),
        radial_force=command(2),
        **{"commanded_spool_velocity": command(slice(4, 6)), **sent},
        **{name: signal(SIGNALS, outs, name) for name in _MEASURED_AND_TRUE},
    )
