"""Recordings of a flexible endoscopic manipulator's joint moved by an antagonistic sheathed pair of tendons.

Baek, Nho et al., ViO-Com, IEEE RA-L 2021. A text file without column names whose name has the sheath's bend in degrees.
The output angle is the reference; a model of what the proximal sensors tell may use the other columns only.
"""

import math
import re
from pathlib import Path

import numpy as np

from tenodesis.errors import IdentificationError
from tenodesis.identification.formats.measured import Measured, Source, checksum
from tenodesis.identification.formats.raw import GRAM_FORCE, Raw, Unit, spread_of
from tenodesis.identification.formats.table import read_rows

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
    _to_si(raw)
    _without_outliers(raw)
    raw.averaged()
    raw.clock()
    # a value that the sensor held for all rows of one time is an outlier among the means only
    _without_outliers(raw)
    for column in _TENSIONS:
        raw.saturated(column, may_rest_at_zero=True)
    raw.tension(*_TENSIONS)
    raw.frozen(("output_angle",), "commanded_angle")
    raw.frozen(_TENSIONS, "commanded_angle", may_rest_at_zero=True)
    raw.enough()
    raw.gaps()
    raw.columns["sheath_bend"] = np.full(raw.time.size, math.radians(bend))
    raw.note(f"sheath bend {bend:g} deg, from the file's name")
    sha = checksum(path)
    published = SOURCE.published(sha)
    if published is not None and _bend(Path(published)) != bend:
        raw.note(
            f"the file's name says a sheath bend of {bend:g} deg, but its bytes are those published as {published}, "
            f"of {_bend(Path(published)):g} deg"
        )
    return raw.done(SOURCE, sha)


def _to_si(raw: Raw) -> None:
    own = raw.unit(_ANGLE, "commanded_angle", advice="write it in deg")
    raw.excited("commanded_angle", _LEAST_ANGLE, "rad")
    # the output is most likely in the command's unit, and in another only where it then moves little more than that
    commanded = spread_of(raw.columns["commanded_angle"])
    units = [
        one._replace(least=_LEAST_ANGLE / one.scale)
        if one.name == own
        else one._replace(most=_MOST_RATIO * commanded / one.scale)
        for one in sorted(_ANGLE, key=lambda one: one.name != own)
    ]
    raw.unit(units, "output_angle", advice="write it in deg")
    raw.excited("output_angle", _LEAST_ANGLE, "rad")
    raw.unit(_TENSION, *_TENSIONS, advice="write both in N")
    for column in _TENSIONS:
        raw.excited(column, _LEAST_TENSION, "N")


def _without_outliers(raw: Raw) -> None:
    for column in raw.columns:
        raw.outliers(column, _TENSION_JUMP if column in _TENSIONS else _ANGLE_JUMP)


def _bend(path: Path) -> float:
    """Return the one number in a file's name that can be the bend: marked as such, or else standing by itself."""
    # what follows a dot is an extension unless it is the rest of a number
    stem = path.name if re.match(r"\.\d", path.suffix) else path.stem
    name = _COPY.sub("", stem)
    marked = [before or behind for before, behind in _MARKED.findall(name)]
    alone = [part for part in _BETWEEN.split(name) if _NUMBER.fullmatch(part)]
    found = marked or alone
    advice = f"allowed is a number from 0 to {MOST_BEND:g}, in degrees, such as 120.txt or bend120_day2.txt"
    if len(set(map(float, found))) > 1:
        raise IdentificationError(
            f"{path.name}: which number of the name {stem!r} is the sheath's bend cannot be told; {advice}"
        )
    if not found or not 0 <= float(found[0]) <= MOST_BEND:
        raise IdentificationError(f"{path.name}: the name {stem!r} is no sheath bend; {advice}")
    return float(found[0])


_TENSIONS = ("agonist_tension", "antagonist_tension")
_MOST_RATIO = 1.2
"""How many times the command's way the output may move to be taken in another unit than the command."""
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
_MARKED = re.compile(
    r"(?:bend(?:ing)?|sheath)[\s_=-]*(\d+(?:\.\d+)?)|(\d+(?:\.\d+)?)(?:bend|[\s_-]*(?:deg|°))", re.IGNORECASE
)
_COPY = re.compile(r"\s*\(\d+\)$")
_BETWEEN = re.compile(r"[\s_,;]+|(?<=[^\s_,;])-")

_ANGLE = (
    Unit("deg", math.radians(1), 5, 400),
    Unit("rad", 1.0, _LEAST_ANGLE, 4.9, whole=False),
)
_TENSION = (
    Unit("N", 1.0, _LEAST_TENSION, 100),
    # no range in which these two could be taken for N; where they could be for one another neither is
    Unit("gram-force", GRAM_FORCE, 1.5 / GRAM_FORCE, 60 / GRAM_FORCE),
    Unit("mN", 1e-3, 1500, 60e3),
)
