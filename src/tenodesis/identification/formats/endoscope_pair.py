"""Recordings of a flexible endoscopic manipulator's joint moved by an antagonistic sheathed pair of tendons.

Baek, Nho et al., ViO-Com, IEEE RA-L 2021. A text file without column names whose name is the sheath's bend in degrees.
The output angle is the reference; a model of what the proximal sensors tell may use the other columns only.
"""

import math
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tenodesis.errors import IdentificationError
from tenodesis.identification.formats.measured import Measured, Raw, Source, Unit, checksum, read_rows
from tenodesis.signals import Array

COLUMNS = 6
MOST_BEND = 1080.0
"""Highest bend that a file's name may say, deg."""

_LEAST_ANGLE = math.radians(2)
_LEAST_TENSION = 0.2
_TENSION_JUMP = 2.0
"""Off the rows around, N: the fastest release falls by less in 25 ms."""
_ANGLE_JUMP = math.radians(10)

SOURCE = Source(
    repository="nhoyh/hysteresis_compensation_ROS",
    commit="7c00843fba4d03cbe67da9244237019a9057799e",
    folder="optimization/selected",
    licence="none stated: for local verification only, not to be copied or passed on",
    citation="Baek, Nho et al., ViO-Com, IEEE RA-L 2021",
    checksums={
        "0.txt": "a84927e587796bd5a7e9e0cc3d198d253e6cd301d405cf93ee78b4019b1ad335",
        "60.txt": "603d77e47baafe9940a544b0fe9934df8b4829de1d74408aedfd741703d74657",
        "120.txt": "ac08e929f6702ea3dfa8ce050a1eed079bcb85d5810d7b1c218a17ee874d1a68",
        "180.txt": "1cf8517d9e3833dfa1d362a0dbacaa5e9fc7ef53da253c9cc430f7bc2b1d9cbc",
        "240.txt": "fe219e0106a4de75882869e6e23ceda84478fe63279de12716475d46c1f2d4a3",
    },
)


def load(path: Path) -> Measured:
    """Return one recording of the pair.

    Columns: commanded_angle, output_angle (rad), agonist_tension, antagonist_tension (N), and the bend of the file's
    name as sheath_bend (rad). Rows of the same time are what sensors said while the clock was held: their mean is
    taken.

    Raises
    ------
    IdentificationError
        The file cannot be read, its name is no bend, its units fit none that are known, or its samples cannot be used.
    """
    bend = _bend(path)
    rows = read_rows(path, COLUMNS)
    rows, notes = _held(rows)
    raw = Raw(
        path.name,
        rows[:, 0],
        {
            "commanded_angle": rows[:, 1],
            "output_angle": rows[:, 3],
            "agonist_tension": rows[:, 4],
            "antagonist_tension": rows[:, 5],
        },
    )
    raw.finite()
    raw.enough()
    raw.clock()
    for note in notes:
        raw.note(note)
    raw.excited("commanded_angle", _LEAST_ANGLE, "of the file's unit")
    unit = raw.unit("commanded_angle", _ANGLE)
    # how far the output moves is what is asked, so that its unit is the command's
    raw.columns["output_angle"] *= next(one.scale for one in _ANGLE if one.name == unit)
    raw.excited("output_angle", _LEAST_ANGLE, "rad")
    for column in ("commanded_angle", "output_angle"):
        raw.outliers(column, _ANGLE_JUMP)
    for column in ("agonist_tension", "antagonist_tension"):
        raw.excited(column, _LEAST_TENSION, "N")
        raw.unit(column, _TENSION)
        raw.outliers(column, _TENSION_JUMP)
        raw.saturated(column)
    raw.enough()
    raw.gaps()
    raw.columns["sheath_bend"] = np.full(raw.time.size, math.radians(bend))
    raw.note(f"sheath bend {bend:g} deg, from the file's name")
    return raw.done(SOURCE, checksum(path))


def _bend(path: Path) -> float:
    found = re.fullmatch(r"(\d+(?:\.\d+)?)(?:\s*deg)?", path.stem)
    bend = float(found.group(1)) if found else math.nan
    if not 0 <= bend <= MOST_BEND:
        raise IdentificationError(
            f"{path.name}: the name {path.stem!r} is no sheath bend; allowed is a number from 0 to {MOST_BEND:g}, in "
            "degrees, such as 120.txt"
        )
    return bend


def _held(rows: Array) -> tuple[Array, list[str]]:
    """Return the mean of each stretch of rows that follow one another with the same time, and what that did."""
    whole: NDArray[np.bool_] = np.asarray(np.isfinite(rows).all(axis=1))
    first = np.flatnonzero(np.concatenate([[True], np.diff(rows[:, 0]) != 0]))
    if first.size == len(rows):
        return rows, []
    count = np.add.reduceat(whole.astype(float), first)
    total = np.add.reduceat(np.where(whole[:, None], rows, 0.0), first, axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = total / count[:, None]
    mean[:, 0] = rows[first, 0]
    return mean, [f"{len(rows)} rows at {first.size} times: the mean of rows of the same time is taken"]


_ANGLE = (
    Unit("deg", math.radians(1), 5, 400, whole=None),
    Unit("rad", 1.0, _LEAST_ANGLE, 4.9, whole=False),
)
_TENSION = (
    Unit("N", 1.0, _LEAST_TENSION, 150, whole=None),
    Unit("gram-force", 9.80665e-3, 150.1, 1e5, whole=None),
)
