"""A sheathed tendon with a load cell at each end: its files and its model.

GIRAFFE, RAL 2024. A CSV file with column names; tensions in gram-force, or in the unit that both headings give, such as
``data_0 [N]``. The distal tension is the reference: a model may use it for fitting only.

The model gives the distal tension from the proximal one: distal = gain * (what the friction law passes on), the gain
being that between the two load cells. The far end is held, so that its tension stays while the sheath sticks.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import median_filter

from tenodesis.errors import IdentificationError
from tenodesis.identification.datasets.reference import (
    LAWS,
    ReferenceProblem,
    ReferenceSeries,
    Values,
    pass_on,
    without_instrument,
)
from tenodesis.identification.formats.csv import read_table, scale_of
from tenodesis.identification.formats.measured import (
    CLOCKS,
    GRAM_FORCE,
    MeasuredRun,
    Raw,
    Source,
    Unit,
    checksum,
    spread_of,
)
from tenodesis.identification.problem import Parameter
from tenodesis.identification.registry import Format
from tenodesis.identification.uncertainty import LossName
from tenodesis.recording.lab_map import heading
from tenodesis.run import Array

# The files.

NEEDED = {"Time": "time", "data_0": "proximal_tension", "data_2": "distal_tension"}
"""Columns of the file and their meanings."""
TENSIONS = ("proximal_tension", "distal_tension")
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


def load(path: Path) -> MeasuredRun:
    """Return a recording of a sheathed tendon.

    Columns: proximal_tension, distal_tension (N), each the median of three samples, so that isolated spikes go.

    Raises IdentificationError if the file cannot be read, a column is missing, its units fit none that are known, or
    its samples cannot be used.
    """
    table = read_table(path)
    headings = [heading(one) for one in table.headings]
    names = [one.name for one in headings]
    missing = [name for name in NEEDED if name not in names]
    if missing:
        raise IdentificationError(
            f"{path.name} has no column {', '.join(missing)}; it must have {', '.join(NEEDED)}",
            key="columns",
            value=missing,
            allowed=", ".join(NEEDED),
        )
    places = {ours: names.index(theirs) for theirs, ours in NEEDED.items()}
    units = {ours: headings[at].unit for ours, at in places.items()}
    raw = Raw(path.name, table.column(places["time"]), {name: table.column(places[name]) for name in TENSIONS})
    raw.finite()
    raw.enough()
    stated = units["time"]
    raw.clock(CLOCKS if stated is None else [(stated, scale_of(stated, "s", f"{path.name}: the unit of Time"))])
    _to_si(raw, [units[name] for name in TENSIONS])
    for column in TENSIONS:
        raw.excited(column, _LEAST, "N")
        raw.outliers(column, _JUMP)
    for column in TENSIONS:
        smooth = median_filter(raw.columns[column], 3, mode="nearest")
        spikes = int((np.abs(raw.columns[column] - smooth) > SPIKE).sum())
        raw.columns[column] = smooth
        raw.note(f"{column}: median of three samples, which took {spikes} spikes of over {SPIKE:g} N out")
    for column in TENSIONS:
        raw.saturated(column, may_rest_at_zero=True)
    raw.tension(*TENSIONS)
    for column, other in (TENSIONS, TENSIONS[::-1]):
        raw.frozen((column,), other, may_rest_at_zero=True)
    raw.enough()
    raw.gaps()
    return raw.done(SOURCE, checksum(path))


def _to_si(raw: Raw, stated: Sequence[str | None]) -> None:
    """Convert both tensions to N, from the unit in the headings, or else from the unit that the magnitudes show."""
    given = dict.fromkeys(one for one in stated if one is not None)
    if not given:
        taken = raw.unit(_TENSION, *TENSIONS, advice="give the unit in both headings, such as 'data_0 [N]'")
        if taken == _TENSION[0].name:
            spread = max(spread_of(raw.columns[column]) for column in TENSIONS)
            raw.note(
                f"tensions taken as {taken}, the format's unit, with a spread of {spread:.3g} N; if they are mN "
                f"({spread / GRAM_FORCE / 1e3:.3g} N) give the unit in both headings, such as 'data_0 [mN]'"
            )
        return
    if len(given) > 1 or None in stated:
        said = " and ".join("no unit" if one is None else repr(one) for one in stated)
        reason = f"the headings of data_0 and data_2 give {said}; they must give one unit for both, or none"
        raise raw.refuse(reason, "data_0", said, "one unit for both")
    (name,) = given
    scale = scale_of(name, "N", f"{raw.name}: the unit of data_0 and data_2")
    raw.unit([Unit(name, scale, _LEAST / scale, _MOST / scale)], *TENSIONS)
    raw.note(f"tensions taken as {name}, from their headings")


_LEAST, _MOST = 0.2, 100.0
"""Plausible spread of a tension, N."""
_JUMP = 3.0
"""Off the rows around, N: the fastest hand in the published file pulls by 2 N a sample."""
_TENSION = (
    Unit("gram-force", GRAM_FORCE, _LEAST / GRAM_FORCE, _MOST / GRAM_FORCE),
    Unit("N", 1.0, _LEAST, _MOST),
    # below that the format's own unit is far more likely
    Unit("mN", 1e-3, 5e3, 1e3 * _MOST),
)


# The model.

DEFAULT_LAW = "capstan-power"
DEFAULT_LOSS: LossName = "soft_l1"
"""At times the distal end is released or pulled by hand; the model does not describe the distal cell there."""
NOISE = 0.02
"""Standard deviation of the distal load cell, N."""

_GAIN = Parameter("gain", "1", 1.0, 0.3, 2.0, "Gain of the distal load cell over the proximal one", "kinematics")


@dataclass(frozen=True, kw_only=True)
class SheathSeries(ReferenceSeries):
    """A run with its distal tension, each (n,); s, N, N/s."""

    proximal: Array
    rate: Array


class Sheath(ReferenceProblem[SheathSeries]):
    """A sheathed tendon with its recordings of proximal_tension and distal_tension.

    The law is a key of `LAWS`. Raises IdentificationError if there is no such law, or no recording.
    """

    key, noise = "tension_N", NOISE

    def __init__(
        self, train: Sequence[MeasuredRun], test: Sequence[MeasuredRun] = (), *, law: str = DEFAULT_LAW
    ) -> None:
        super().__init__(train, test, law=law)
        found = LAWS[law]
        self.full = self.fitted = [_series(one) for one in (*train, *test)]
        friction = [*found.magnitudes, *(_in_unit(one, self.fitted[0].rate) for one in found.shapes)]
        self.parameters = (_GAIN, *friction)

    def advice(self, names: Sequence[str]) -> str | None:
        """Return which recording would make these parameters identifiable."""
        if "gain" in names:
            return "Pull and release far enough that the tendon slides both ways: the band's two edges show the gain."
        return "Record reversals at several tensions, the highest several times the lowest."

    def modelled(self, values: Values, series: SheathSeries) -> Values:
        """Return what the distal load cell would show, (n,), N."""
        given = self.given(values, series)
        start = float(series.proximal[0])
        return np.asarray(given["gain"] * pass_on(self.law, given, series.proximal, speed=series.rate, start=start))


def _in_unit(one: Parameter, rate: Array) -> Parameter:
    """Return a parameter in the sheath's unit of speed, N/s; speeds start at the usual speed of a recording."""
    if "{speed}" not in one.unit:
        return one
    usual = float(np.clip(np.median(np.abs(rate)), one.lower, one.upper))
    return one._replace(unit=one.unit.format(speed="N/s"), start=usual)


def _series(one: MeasuredRun) -> SheathSeries:
    proximal = np.maximum(one["proximal_tension"], 0.0)
    rate = np.gradient(proximal, one.time)
    return SheathSeries(time=one.time, reference=one["distal_tension"], proximal=proximal, rate=rate)


problem = without_instrument(Sheath, "a tendon-sheath recording is of a tendon without one")
FORMAT = Format(load, problem, laws=tuple(LAWS), law=DEFAULT_LAW, loss=DEFAULT_LOSS)
