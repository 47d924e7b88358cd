"""A recording made by others, in SI units, and the checks that every format shares on the way to it.

A loader reads a file into `Raw`, says what each column is and which units it may be in, and lets the checks drop rows.
Whatever is dropped, converted or doubtful leaves a note; what cannot be used is refused with the reason.
"""

import bisect
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tenodesis.errors import IdentificationError
from tenodesis.signals import Array

LEAST_SAMPLES = 200
MOST_CORRUPT = 0.02
"""Share of the rows that may be corrupt before the file is refused."""
MOST_BACKWARDS = 0.01
MOST_SATURATED = 0.05
MOST_MISSING = 0.2
"""Share of the duration that gaps may take."""


@dataclass(frozen=True)
class Source:
    """Where published data come from: facts only, the data stay outside the repository."""

    repository: str
    commit: str
    folder: str
    licence: str
    citation: str
    checksums: Mapping[str, str] = field(default_factory=dict)
    """SHA-256 of each published file by its name."""

    def note(self, name: str, checksum: str) -> str:
        """Return whether a file of this checksum is one of the published ones."""
        published = next((file for file, known in self.checksums.items() if known == checksum), None)
        if published is not None:
            return f"{name} is the published {published} ({self.repository} at {self.commit[:10]}), unmodified"
        return f"{name} is not one of the files published in {self.repository} at {self.commit[:10]}"


@dataclass(frozen=True)
class Measured:
    """One recording: columns in SI units by name over one strictly increasing clock."""

    name: str
    time: Array
    """s, shape (n,), strictly increasing."""
    columns: Mapping[str, Array]
    """Each of shape (n,), SI units."""
    notes: tuple[str, ...] = ()
    """What was dropped, converted or is doubtful."""
    source: Source | None = None
    checksum: str = ""
    """SHA-256 of the file."""

    def __getitem__(self, column: str) -> Array:
        try:
            return self.columns[column]
        except KeyError:
            raise IdentificationError(
                f"{self.name} has no column {column!r}; it has {', '.join(self.columns)}"
            ) from None

    def __len__(self) -> int:
        return self.time.size

    @property
    def sample_time(self) -> float:
        """Median time between samples, s."""
        return float(np.median(np.diff(self.time)))


class Unit(NamedTuple):
    """One unit that a column may be in."""

    name: str
    scale: float
    """SI per unit."""
    least: float
    most: float
    """Plausible spread (highest less lowest) of the column in this unit."""
    whole: bool | None = None
    """Whether values are whole numbers (True: counts), never all whole (False: physical), or either (None)."""


class Raw:
    """Rows of one file on their way to `Measured`: every check may drop rows and leaves a note."""

    def __init__(self, name: str, time: ArrayLike, columns: Mapping[str, ArrayLike]) -> None:
        self.name = name
        self.time: Array = np.array(time, dtype=np.float64)
        self.columns: dict[str, Array] = {key: np.array(value, dtype=np.float64) for key, value in columns.items()}
        self.notes: list[str] = []

    def note(self, text: str) -> None:
        """Add one note."""
        self.notes.append(text)

    def refuse(self, reason: str) -> IdentificationError:
        """Return the error that names this recording, to be raised."""
        return IdentificationError(f"{self.name}: {reason}")

    def drop(self, bad: NDArray[np.bool_], what: str, most: float = MOST_CORRUPT) -> None:
        """Drop rows, say how many and where the first is, and refuse the file if they exceed a share of it."""
        count = int(bad.sum())
        if not count:
            return
        at = self.time[bad][0]
        where = f", first at {at:.6g} s" if np.isfinite(at) else ""
        if count > most * bad.size:
            raise self.refuse(f"{count} of {bad.size} rows are {what}{where}; at most {100 * most:g} % may be")
        self.notes.append(f"dropped {_rows(count)}: {what}{where}")
        self._keep(~bad)

    def _keep(self, good: NDArray[np.bool_]) -> None:
        self.time = self.time[good]
        self.columns = {key: value[good] for key, value in self.columns.items()}

    def finite(self) -> None:
        """Drop rows with a value that is missing, NaN or infinite."""
        bad = ~np.isfinite(self.time)
        for values in self.columns.values():
            bad |= ~np.isfinite(values)
        self.drop(bad, "not numbers in every column")

    def clock(
        self, units: Sequence[tuple[str, float]] = (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9))
    ) -> None:
        """Bring time to seconds from 0, with repeated rows and rows whose clock ran back dropped.

        The unit is the first one that makes the median interval 20 us to 0.5 s. A row repeated with the same time is
        dropped whatever their number (held samples); of rows out of order the fewest that leave a rising clock are.
        """
        if self.time.size > 1:
            values = np.column_stack(list(self.columns.values()))
            repeated = np.zeros(self.time.size, dtype=bool)
            repeated[1:] = (np.diff(self.time) == 0) & (np.diff(values, axis=0) == 0).all(axis=1)
            self.drop(repeated, "duplicates of the row before", most=1.0)
        step = np.diff(self.time)
        if (step <= 0).any():
            self.drop(~_longest_rise(self.time), "out of order (the clock ran back or stood still)", MOST_BACKWARDS)
            step = np.diff(self.time)
        interval = float(np.median(step)) if step.size else 0.0
        for name, scale in units:
            if 2e-5 <= interval * scale <= 0.5:
                if name != units[0][0]:
                    self.note(f"time taken as {name}: its rows are {interval:g} apart")
                self.time = (self.time - self.time[0]) * scale
                return
        raise self.refuse(
            f"time rises by {interval:g} a row (median), which is no clock of 2 Hz to 50 kHz in "
            f"{', '.join(name for name, _ in units)}"
        )

    def unit(self, column: str, units: Sequence[Unit]) -> str:
        """Bring a column to SI from the unit that its magnitude shows, and return that unit's name.

        The first unit is the format's own and holds whenever it is plausible; any other is said in a note. Refused
        where no unit is plausible, several are, or the column does not move. Plausible is judged on the spread of the
        middle 90 % of the values, and on whether most are whole numbers.
        """
        values = self.columns[column]
        if not values.size:
            raise self.refuse(f"no samples of {column}")
        low, high = np.quantile(values, [0.05, 0.95])
        spread = float(high - low)
        whole = bool((values == np.round(values)).mean() > 0.5)
        kin = [u for u in units if u.whole is None or u.whole == whole]
        if not spread or (kin and all(spread < u.least for u in kin)):
            least = " or ".join(f"{u.least:g} {u.name}" for u in kin)
            raise self.refuse(f"no excitation: {column} moves by {spread:.3g}, and at least {least} is needed")
        fits = [u for u in kin if u.least <= spread <= u.most]
        if fits and fits[0] is units[0]:
            fits = fits[:1]
        if len(fits) != 1:
            kind = "whole numbers" if whole else "fractions"
            allowed = "; ".join(f"{u.least:g} to {u.most:g} in {u.name}" for u in units)
            problem = "may be " + " or ".join(u.name for u in fits) if fits else "fits no unit"
            raise self.refuse(f"{column} ({kind} with a spread of {spread:.4g}) {problem}; a spread may be {allowed}")
        if fits[0] is not units[0]:
            self.note(
                f"{column} taken as {fits[0].name}, not {units[0].name}: its values have a spread of {spread:.4g}"
            )
        self.columns[column] = values * fits[0].scale
        return fits[0].name

    def outliers(self, column: str, limit: float, window: int = 5) -> None:
        """Drop rows where a column is further than a limit (SI) from the median of the rows around it."""
        values = self.columns[column]
        if values.size < window:
            return
        padded = np.pad(values, window // 2, mode="edge")
        middle = np.median(np.lib.stride_tricks.sliding_window_view(padded, window), axis=1)
        self.drop(np.abs(values - middle) > limit, f"outliers of {column} (over {limit:.3g} off the rows around them)")

    def saturated(self, column: str, least: int = 20) -> None:
        """Drop rows where a noisy sensor stays at its highest or lowest value for at least so many rows at once."""
        values = self.columns[column]
        bad = np.zeros(values.size, dtype=bool)
        if values.size and values.max() > values.min():
            for extreme in (values.min(), values.max()):
                bad |= _runs(values == extreme, least)
        self.drop(bad, f"saturated: {column} stays at its extreme", MOST_SATURATED)

    def gaps(self, factor: float = 5.0) -> None:
        """Note intervals over so many times the median one; refuse the file if they take too much of its duration."""
        step = np.diff(self.time)
        usual = float(np.median(step))
        wide = step > factor * usual
        if not wide.any():
            return
        missing, whole = float(step[wide].sum()), float(self.time[-1] - self.time[0])
        first = float(self.time[:-1][wide][0])
        said = f"{int(wide.sum())} gaps of {missing:.3g} s together in {whole:.3g} s, first at {first:.6g} s"
        if missing > MOST_MISSING * whole:
            raise self.refuse(f"{said}; at most {100 * MOST_MISSING:g} % may be missing")
        self.note(said)

    def enough(self, least: int = LEAST_SAMPLES) -> None:
        """Refuse fewer samples than asked for."""
        if self.time.size < least:
            raise self.refuse(f"{self.time.size} samples are left, which is too few; at least {least} are needed")

    def excited(self, column: str, least: float, unit: str) -> None:
        """Refuse a column whose spread (SI) is below the least from which anything can be identified."""
        values = self.columns[column]
        spread = float(np.ptp(values)) if values.size else 0.0
        if spread < least:
            raise self.refuse(
                f"no excitation: {column} moves by {spread:.3g} {unit}, and at least {least:.3g} {unit} is needed"
            )

    def done(self, source: Source | None = None, checksum: str = "") -> Measured:
        """Return the recording."""
        notes = tuple(self.notes)
        if source is not None and checksum:
            notes = (source.note(self.name, checksum), *notes)
        return Measured(self.name, self.time, dict(self.columns), notes, source, checksum)


def read_rows(
    path: Path, width: int, *, delimiter: str | None = ",", comment: str | None = "%", skip: int = 0
) -> Array:
    """Return the numbers of a text file, shape (rows, width); a row that cannot be read is NaN.

    Parameters
    ----------
    path
        The file.
    width
        Columns of the format; further ones are not read.
    delimiter, comment
        What separates columns (None: white space) and what starts a line to leave out (None: nothing does).
    skip
        Header lines to leave out.

    Raises
    ------
    IdentificationError
        The file cannot be read, or no row has enough columns.
    """
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise IdentificationError(f"{path} cannot be read: {error.strerror}") from None
    lines = [line for line in text.splitlines()[skip:] if line.strip() and not (comment and line.startswith(comment))]
    if not lines:
        raise IdentificationError(f"{path} has no row of {width} numbers")
    try:
        rows = np.loadtxt(lines, delimiter=delimiter, comments=None, usecols=range(width), ndmin=2)
    except ValueError:
        rows = np.array([_numbers(line, width, delimiter) for line in lines]).reshape(-1, width)
    if np.isnan(rows).all(axis=1).all():
        raise IdentificationError(f"{path} has no row of {width} numbers")
    return np.asarray(rows, dtype=np.float64)


def checksum(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _numbers(line: str, width: int, delimiter: str | None) -> list[float]:
    try:
        found = [float(part) for part in line.split(delimiter)[:width]]
    except ValueError:
        found = []
    return found if len(found) == width else [np.nan] * width


def _longest_rise(values: Array) -> NDArray[np.bool_]:
    """Return which values form the longest strictly rising sequence (patience sorting)."""
    tops: list[float] = []
    places: list[int] = []
    before = np.full(values.size, -1)
    for index, value in enumerate(values.tolist()):
        pile = bisect.bisect_left(tops, value)
        before[index] = places[pile - 1] if pile else -1
        tops[pile : pile + 1] = [value]
        places[pile : pile + 1] = [index]
    kept = np.zeros(values.size, dtype=bool)
    index = places[-1] if places else -1
    while index >= 0:
        kept[index] = True
        index = int(before[index])
    return kept


def _runs(held: NDArray[np.bool_], least: int) -> NDArray[np.bool_]:
    """Return where a condition holds for at least so many rows at once."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], held, [False]]).astype(np.int8)))
    out = np.zeros(held.size, dtype=bool)
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        out[start:end] = end - start >= least
    return out


def _rows(count: int) -> str:
    return "1 row" if count == 1 else f"{count} rows"
