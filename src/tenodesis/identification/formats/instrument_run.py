"""An axis of an instrument's recording, from any file format, and the checks it has to pass."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.identification.formats.raw import CLOCKS, Raw, spread_of
from tenodesis.instrument import Instrument
from tenodesis.run import TENDONS, Array

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

LEAST_EXCITATION = float(np.radians(2))
"""Spread of the handle's angle below which nothing can be identified, rad."""

_JUMP = 0.5
"""Largest plausible jump of a sensor in one sample, as a share of its spread."""
_LEAST_JUMP = {"rad": float(np.radians(10)), "N": 1.0}
"""What it can leave them by however small its spread is."""
_STEADY = ("handle_angle", "measured_handle_angle", "measured_output_angle", *(f"tension_{one}" for one in TENDONS))
_ANGLES = ("measured_handle_angle", "measured_output_angle")


@dataclass(frozen=True)
class InstrumentRun(MeasuredRun):
    """An axis of a recording, with its instrument if the recording contains it.

    Columns are of :data:`COLUMNS`: the handle's commanded angle, or else that of its encoder, both tensions, and
    whatever else was recorded.
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
    clocks: Sequence[tuple[str, float]] = CLOCKS,
) -> InstrumentRun:
    """Return a run whose columns are in SI and in order, or refuse it with the reason.

    The clock's unit is the first of `clocks` with a plausible magnitude. Raises IdentificationError if too much of the
    run is corrupt, it is too short, or the handle does not move.
    """
    raw = Raw(name, time, columns)
    for note in notes:
        raw.note(note)
    if "force" not in columns:
        raw.note("no force was recorded: the tip is taken to be free")
    raw.finite()
    raw.clock(clocks)
    for column in _STEADY:
        if column in raw.columns:
            spread = spread_of(raw.columns[column])
            raw.outliers(column, max(_JUMP * spread, _LEAST_JUMP[COLUMNS[column]]))
    for tendon in TENDONS:
        raw.saturated(f"tension_{tendon}", may_rest_at_zero=True)
    tensions = [f"tension_{tendon}" for tendon in TENDONS]
    raw.tension(*tensions)
    raw.enough()
    raw.gaps()
    raw.excited("handle_angle", LEAST_EXCITATION, "rad")
    raw.frozen([one for one in _ANGLES if one in raw.columns], "handle_angle")
    raw.frozen(tensions, "handle_angle", may_rest_at_zero=True)
    done = raw.done(checksum=checksum)
    return InstrumentRun(done.name, done.time, done.columns, done.notes, None, done.checksum, instrument)
