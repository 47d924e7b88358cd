"""An axis of an instrument's recording, from any file format, and the checks it has to pass."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tenodesis.errors import IdentificationError
from tenodesis.identification.formats.measured import CLOCKS, MeasuredRun, Raw, spread_of
from tenodesis.instrument import InstrumentLike, ShortForm, as_short_form
from tenodesis.recording.lab_map import COLUMNS
from tenodesis.run import TENDONS, Array, Run

USED = (
    "commanded_handle_angle",
    "measured_handle_angle",
    "measured_output_angle",
    "measured_tension",
    "measured_spool_angle",
    "force",
    "radial_force",
)
"""The signals of a run that become columns."""

SECONDS = CLOCKS[:1]
"""The clock of a run and of stamps in nanoseconds, whatever their magnitude."""

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

    instrument: ShortForm | None = None
    others: tuple[str, ...] = ()
    """Axes of the recording that are left out"""


def checked(
    name: str,
    time: Array,
    columns: Mapping[str, Array],
    *,
    notes: Sequence[str] = (),
    instrument: ShortForm | None = None,
    axes: Sequence[str] = (),
    clocks: Sequence[tuple[str, float]] = CLOCKS,
) -> InstrumentRun:
    """Return a run whose columns are in SI and in order, or refuse it with the reason.

    The clock's unit is the first of `clocks` with a plausible magnitude. Raises IdentificationError if too much of the
    run is corrupt, it is too short, or the handle does not move.
    """
    raw = Raw(name, time, columns)
    for note in (*notes, *_first_alone(axes)):
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
    done = raw.done()
    return InstrumentRun(done.name, done.time, done.columns, done.notes, instrument=instrument, others=tuple(axes[1:]))


def measured(run: Run, instrument: InstrumentLike | None = None, *, name: str = "run") -> InstrumentRun:
    """Return the first axis of a run as a recording to identify from.

    Parameters
    ----------
    instrument
        Where the search starts; by default it has to be given with the problem.
    name
        The run's name in results and messages.

    Raises
    ------
    IdentificationError
        The run lacks a handle angle or the tensions, is too short, or its handle does not move.
    """
    notes: list[str] = []
    columns = columns_of(first_axis(run), name, notes)
    inst = None if instrument is None else as_short_form(instrument).planar[0]
    return checked(name, run.time, columns, notes=notes, instrument=inst, axes=run.axes, clocks=SECONDS)


def first_axis(run: Run) -> dict[str, Array]:
    """Return the signals of a run's first axis, each (n,) or per tendon (n, 2).

    Raises IdentificationError if that joint has no joint of the handle or no pair of tendons of its own.
    """
    try:
        alone = run.axis(run.axes[0])
    except KeyError:
        allowed = "a joint with a joint of the handle and a pair of tendons of its own"
        if run.axes[0].endswith("_arc1"):
            raise IdentificationError(
                f"{run.axes[0].removesuffix('_arc1')} bends in arcs, and a fit of recordings knows a backbone as one: "
                "record the instrument without arcs, or give tn.identification.fit_at_rest where its tip rests.",
                key="joint",
            ) from None
        raise IdentificationError(key="joint", value=run.axes[0], allowed=allowed) from None
    return {name: values for name, values in alone.signals().items() if name in USED}


def _first_alone(axes: Sequence[str]) -> list[str]:
    """Return a note if there are more axes than the first."""
    return (
        [f"of the axes {' and '.join(axes)} the first is taken, and the instrument found has it alone"]
        if axes[1:]
        else []
    )


def columns_of(signals: Mapping[str, Array], where: str, notes: list[str]) -> dict[str, Array]:
    """Return the columns of one axis's signals; raises IdentificationError if handle angle or tension are missing."""
    handle = next(
        (name for name in ("commanded_handle_angle", "measured_handle_angle") if _has_values(signals, name)), None
    )
    lacking = [] if _has_values(signals, "measured_tension") else ["measured_tension"]
    lacking += [] if handle else ["measured_handle_angle"]
    if handle is None or lacking:
        raise IdentificationError(
            f"{where} lacks {', '.join(lacking)}; it has {', '.join(signals) or 'no signals'}.",
            key="signals",
            value=lacking,
        )
    if handle == "measured_handle_angle":
        notes.append("the handle angle is that of its encoder, for no commanded angle was recorded")
    columns = {"handle_angle": signals[handle]}
    for name in ("measured_handle_angle", "measured_output_angle", "force", "radial_force"):
        if _has_values(signals, name):
            columns[name] = signals[name]
    for name, column in (("measured_tension", "tension"), ("measured_spool_angle", "spool")):
        if _has_values(signals, name):
            columns |= {f"{column}_{tendon}": signals[name][:, n] for n, tendon in enumerate(TENDONS)}
    return columns


def _has_values(signals: Mapping[str, Array], name: str) -> bool:
    return name in signals and bool(np.isfinite(signals[name]).any())
