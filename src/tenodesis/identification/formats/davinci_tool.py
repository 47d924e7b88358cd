"""Recordings of a da Vinci tool on a bench that measures angle and torque at its spindle and at its jaw.

O'Neill, Stephens and Kowalewski, IEEE RA-L 3(4):3027-3034, 2018. A text file without column names; lines of % are a
header. The jaw's columns are the reference; a model of what the proximal sensors tell may use the spindle's only.
"""

import math
from pathlib import Path

import numpy as np

from tenodesis.identification.formats.measured import Measured, Source, checksum
from tenodesis.identification.formats.raw import Raw, Unit
from tenodesis.identification.formats.table import read_rows

COLUMNS = 10
TORQUE_PER_COUNT = 3.9811e-5
"""N*m per count of both torque sensors."""
SPINDLE_COUNTS = 8192
"""Counts of the spindle's encoder per turn."""
JAW_COUNTS = 4000
"""Counts of the jaw's encoder per turn."""
MOST_COUNTS = 1500
MOST_SPINDLE = MOST_COUNTS * 2 * math.pi / SPINDLE_COUNTS
"""How far the spindle may be off its median before a row is corrupt, rad: where its encoder is zero is the tool's."""

_TURN = 2 * math.pi
_JUMP = math.radians(5)
"""Off the rows around, rad: the bench turns by less than 2 degrees in a millisecond even when its drive runs away."""
_TORQUE_JUMP = 0.04
"""Off the rows around, N*m."""
_LEAST_ANGLE = math.radians(1)
_LEAST_TORQUE = 2e-3

SOURCE = Source(
    repository="MRDLab/mis-tool-characterization",
    commit="03658b2ccefef9adceebc38dd4a17bd6e190cd2e",
    folder="data/Tool_4_Maryland_L_4",
    licence="database ODbL 1.0, contents DbCL 1.0 (attribution, share-alike)",
    citation="O'Neill, Stephens, Kowalewski, IEEE RA-L 3(4):3027-3034, 2018",
    checksums={
        "00.TXT": "796f89cb5e4469d590ae78db7a2a504ca0673f939c0255c00b1421b70d05ce62",
        "01.TXT": "70eac4b90f92cb1005fa9507af7001edec4251c75b3a67de40e1175d168d2145",
        "02.TXT": "dc180d55e1b28d10db893d8d779a386e8447e3fc992210251de330925898b4fd",
        "03.TXT": "5da7dff6ff951697b4c587d0f9c9a853673cc7e724ed6a04a4960d5b6a9977f4",
        "04.TXT": "48cbd949a66420f20ce3f000c3be2d4cfc97c1c77535317746aa161683ee4736",
        "05.TXT": "ced7f47ff1c4d83305965af8e02a283bc9ed0f7e33a241f4fdf1ccfa346d4ecf",
        "06.TXT": "629b0c36f20f7d9db84610dff0afc1f3f294207c90cb8694742991bb94a971c3",
        "07.TXT": "c106c87ae325d0e88c247001b097f828c7cb6bb69bf3dde84affe691e2c43c0b",
        "08.TXT": "863717442bbc86bb2e5d03370c97b67f1180a0f1859f6cfb6655d710de57288b",
        "09.TXT": "741b6c4986201b6cbf8c84748288685e38b6768079bcbe72f934ba67774b472b",
        "30.TXT": "da6d50c9ce180160a646f6aa7188646c54133c7c9eecae3579e105b64a96151c",
        "34.TXT": "b60e8b792b68e27b875780edd98455c0a5db2ca12bf070d53e250c814dad26d6",
        "38.TXT": "a1a0db39064e1a3c12d3e41b122135bf42e06f290518d2225f35979a08c8c257",
    },
)


def load(path: Path) -> Measured:
    """Return one recording of a da Vinci tool.

    Columns: spindle_angle, jaw_angle (rad), spindle_torque, jaw_torque (N*m), by the signs of the file; the last is as
    it was measured, for no model takes it. The first seconds, in which the bench settles, are kept: a model with memory
    needs them.

    Raises
    ------
    IdentificationError
        The file cannot be read, its units fit none that are known, or its samples cannot be used.
    """
    rows = read_rows(path, COLUMNS)
    raw = Raw(
        path.name,
        rows[:, 0],
        {
            "spindle_angle": rows[:, 1],
            "spindle_torque": rows[:, 2],
            "jaw_angle": rows[:, 4],
            "jaw_torque": rows[:, 5],
        },
    )
    raw.finite()
    raw.enough()
    raw.clock()
    for column, counts in (("spindle_angle", SPINDLE_COUNTS), ("jaw_angle", JAW_COUNTS)):
        raw.unit(_angle(counts), column)
        raw.excited(column, _LEAST_ANGLE, "rad")
    # the jaw's torque may well be constant: it is the load
    raw.unit(_TORQUE, "spindle_torque", "jaw_torque")
    raw.excited("spindle_torque", _LEAST_TORQUE, "N*m")
    spindle = raw.columns["spindle_angle"]
    limit = f"{MOST_COUNTS} counts, {math.degrees(MOST_SPINDLE):.3g} deg"
    raw.drop(np.abs(spindle - np.median(spindle)) > MOST_SPINDLE, f"corrupt (the spindle over {limit}, off its median)")
    for column, jump in (("spindle_angle", _JUMP), ("jaw_angle", _JUMP), ("spindle_torque", _TORQUE_JUMP)):
        raw.outliers(column, jump)
    raw.saturated("spindle_torque")
    raw.enough()
    raw.gaps()
    return raw.done(SOURCE, checksum(path))


def _angle(counts: int) -> tuple[Unit, ...]:
    return (
        Unit("counts", _TURN / counts, _LEAST_ANGLE / _TURN * counts, counts / 2, whole=True),
        # neither the spindle nor the jaw turns by half a turn, so that the two cannot be taken for one another
        Unit("rad", 1.0, _LEAST_ANGLE, math.pi, whole=False),
        Unit("deg", math.radians(1), 5, 180, whole=False),
    )


_TORQUE = (
    Unit("counts", TORQUE_PER_COUNT, _LEAST_TORQUE / TORQUE_PER_COUNT, 1 / TORQUE_PER_COUNT, whole=True),
    Unit("N*m", 1.0, _LEAST_TORQUE, 1.0, whole=False),
    Unit("mN*m", 1e-3, 1e3 * _LEAST_TORQUE, 1e3, whole=False),
)
