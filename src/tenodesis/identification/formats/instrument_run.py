"""One axis of an instrument's recording, whatever file it came from, and the checks it has to pass."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tenodesis.identification.formats.measured import Measured, Raw
from tenodesis.instrument import Instrument
from tenodesis.signals import Array

TENDONS = ("agonist", "antagonist")

COLUMNS = {
    "handle_angle": "rad",
    "measured_handle_angle": "rad",
    "measured_output_angle": "rad",
    "tension_agonist": "N",
    "tension_antagonist": "N",
    "force": "N",
    "radial_force": "N",
    "spool_agonist": "rad",
    "spool_antagonist": "rad",
}
"""Every column that a run may have, with its SI unit."""

_LEAST_EXCITATION = float(np.radians(2))
_JUMP = 0.5
"""Share of the spread that a load cell cannot leave its neighbours by in one sample."""


@dataclass(frozen=True)
class InstrumentRun(Measured):
    """One axis of a recording, with the instrument that it says it was made on.

    Columns are of :data:`COLUMNS`: the handle where it was commanded to be, or else where its encoder says, both
    tensions, and whatever else was recorded.
    """

    instrument: Instrument | None = None


def checked(
    name: str,
    time: Array,
    columns: Mapping[str, Array],
    *,
    notes: Sequence[str] = (),
    checksum: str = "",
    instrument: Instrument | None = None,
) -> InstrumentRun:
    """Return a run whose columns are in SI and in order, or refuse it with the reason.

    Raises
    ------
    IdentificationError
        Too much of it is corrupt, it is too short, or the handle does not move.
    """
    raw = Raw(name, time, columns)
    for note in notes:
        raw.note(note)
    if "force" not in columns:
        raw.note("no force was recorded: the tip is taken to be free")
    raw.finite()
    raw.clock()
    for tendon in TENDONS:
        column = f"tension_{tendon}"
        if not _slack(raw.columns[column]):
            raw.saturated(column)
        raw.outliers(column, _JUMP * max(float(np.ptp(raw.columns[column])), 1.0))
    raw.enough()
    raw.gaps()
    raw.excited("handle_angle", _LEAST_EXCITATION, "rad")
    done = raw.done(checksum=checksum)
    return InstrumentRun(done.name, done.time, done.columns, done.notes, None, done.checksum, instrument)


def _slack(tension: Array) -> bool:
    """Return whether the lowest tension is none at all: a slack tendon stays there, and its load cell is well."""
    return bool(tension.size and abs(tension.min()) < 1e-3 * np.ptp(tension))
