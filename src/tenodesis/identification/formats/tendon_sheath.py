"""Recordings of one sheathed tendon with a load cell at each end.

GIRAFFE, RAL 2024. A CSV file with column names; tensions in gram-force. The distal tension is the reference.
"""

from pathlib import Path

import numpy as np

from tenodesis.errors import IdentificationError
from tenodesis.identification.formats.measured import Measured, Raw, Source, Unit, checksum
from tenodesis.signals import Array

NEEDED = {"Time": "time", "data_0": "proximal_tension", "data_2": "distal_tension"}
"""Columns of the file and what they are."""
GRAM_FORCE = 9.80665e-3
"""N per gram-force."""
SPIKE = 0.05
"""How far a sample may be off the median of itself and its neighbours before it counts as a spike in the notes, N."""

SOURCE = Source(
    repository="jerluenn/RAL2024-GIRAFFE",
    commit="42f753316fa408b6d3f70a1fcfd5e95acff73015",
    folder="test_mhe",
    licence="none stated: for local verification only, not to be copied or passed on",
    citation="GIRAFFE, IEEE RA-L 2024",
    checksums={
        "loadcell_measurements.csv": "bab73a8883802a5bc9037b48af47d97308e2ef7ec131327509db10bff21a372a",
    },
)


def load(path: Path) -> Measured:
    """Return one recording of a sheathed tendon.

    Columns: proximal_tension, distal_tension (N), each the median of three samples, so that isolated spikes go.

    Raises
    ------
    IdentificationError
        The file cannot be read, a column is missing, its units fit none that are known, or its samples cannot be used.
    """
    table = _table(path)
    raw = Raw(path.name, table["time"], {name: table[name] for name in ("proximal_tension", "distal_tension")})
    raw.finite()
    raw.enough()
    raw.clock()
    for column in raw.columns:
        raw.excited(column, 0.2, "of the file's unit")
        raw.unit(column, _TENSION)
        smooth = _median_of_three(raw.columns[column])
        spikes = int((np.abs(raw.columns[column] - smooth) > SPIKE).sum())
        raw.columns[column] = smooth
        raw.note(f"{column}: median of three samples, which took {spikes} spikes of over {SPIKE:g} N out")
        raw.saturated(column)
    raw.enough()
    raw.gaps()
    return raw.done(SOURCE, checksum(path))


def halves(recording: Measured) -> tuple[Measured, Measured]:
    """Return the first and the second half of a recording, by samples."""
    middle = len(recording) // 2
    first, second = (
        Measured(
            f"{recording.name} ({name} half)",
            recording.time[part],
            {key: values[part] for key, values in recording.columns.items()},
            recording.notes,
            recording.source,
            recording.checksum,
        )
        for name, part in (("first", slice(None, middle)), ("second", slice(middle, None)))
    )
    return first, second


def _table(path: Path) -> dict[str, Array]:
    try:
        lines = [one for one in path.read_text(encoding="utf-8", errors="replace").splitlines() if one.strip()]
    except OSError as error:
        raise IdentificationError(f"{path} cannot be read: {error.strerror}") from None
    head = [one.strip() for one in lines[0].split(",")] if lines else []
    missing = [name for name in NEEDED if name not in head]
    if missing:
        raise IdentificationError(f"{path.name} has no column {', '.join(missing)}; needed are {', '.join(NEEDED)}")
    places = {ours: head.index(theirs) for theirs, ours in NEEDED.items()}
    rows = [line.split(",") for line in lines[1:]]
    return {name: np.array([_number(row, at) for row in rows]) for name, at in places.items()}


def _number(row: list[str], at: int) -> float:
    try:
        return float(row[at])
    except (IndexError, ValueError):
        return np.nan


def _median_of_three(values: Array) -> Array:
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(values, 1, mode="edge"), 3)
    return np.asarray(np.median(windows, axis=1), dtype=np.float64)


_TENSION = (
    Unit("gram-force", GRAM_FORCE, 100, 1e5, whole=None),
    Unit("N", 1.0, 0.2, 99.9, whole=None),
)
