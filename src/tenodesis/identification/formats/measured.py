"""A measured run in SI units, and the checks on the way there from the rows of a file, which every format shares.

A loader reads a file into `Raw`, declares what each column is and its possible units, and applies the checks.
Whatever is dropped, converted or uncertain leaves a note; what cannot be used is refused with the reason.
"""

import bisect
import hashlib
import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import median_filter

from tenodesis.errors import IdentificationError
from tenodesis.run import Array
from tenodesis.units import STANDARD_GRAVITY


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

    def published(self, checksum: str) -> str | None:
        """Return the name under which a file of this checksum was published, None if it was not."""
        return next((file for file, known in self.checksums.items() if known == checksum), None)

    def note(self, checksum: str) -> str:
        """Return whether a file of this checksum is a published file, and if so under which licence."""
        place = f"{self.repository} at {self.commit[:10]}"
        name = self.published(checksum)
        if name is None:
            return (
                f"none of the {len(self.checksums)} files of {place} whose checksums are known here: another file of "
                "it, another recording, or a changed one"
            )
        return f"as published: {self.folder}/{name} of {place}; licence: {self.licence}"


@dataclass(frozen=True)
class MeasuredRun:
    """A recording: columns in SI units by name over a strictly increasing time."""

    name: str
    time: Array
    """s, shape (n,), strictly increasing."""
    columns: Mapping[str, Array]
    """Each of shape (n,), SI units."""
    notes: tuple[str, ...] = ()
    """What was dropped, converted or is uncertain."""
    source: Source | None = None
    """Where the file was published; None for a file that was not."""
    checksum: str = ""
    """SHA-256 of the file."""

    def __getitem__(self, column: str) -> Array:
        try:
            return self.columns[column]
        except KeyError:
            raise IdentificationError(
                f"{self.name} has no column {column!r}; it has {', '.join(self.columns)}",
                key="columns",
                value=column,
                allowed=f"among {', '.join(self.columns)}",
            ) from None

    def __len__(self) -> int:
        return self.time.size

    def rows(self, kept: slice | NDArray[np.bool_]) -> Self:
        """Return some of its samples."""
        return replace(self, time=self.time[kept], columns={name: one[kept] for name, one in self.columns.items()})

    @property
    def sample_time(self) -> float:
        """Median time between samples, s."""
        return float(np.median(np.diff(self.time)))


_MeasuredRun = TypeVar("_MeasuredRun", bound=MeasuredRun)


def checksum(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def distinct_names(paths: Sequence[Path]) -> list[str]:
    """Return the shortest end of each path that no other path has."""
    parts = [Path(os.path.abspath(path)).parts for path in paths]  # noqa: PTH100 - a link keeps the name it was given
    depths = [1] * len(parts)
    while True:
        names = ["/".join(part[-depth:]) for part, depth in zip(parts, depths, strict=True)]
        seen = Counter(names)
        longer = [
            depth + 1 if seen[name] > 1 and depth < len(part) else depth
            for name, part, depth in zip(names, parts, depths, strict=True)
        ]
        if longer == depths:
            return names
        depths = longer


def load_all(load: Callable[[Path], _MeasuredRun], paths: Sequence[Path]) -> list[_MeasuredRun]:
    """Return the recordings of several files, each under a name of its own.

    Raises IdentificationError if one of them cannot be used.
    """
    return [_named(load, path, name) for path, name in zip(paths, distinct_names(paths), strict=True)]


def _named(load: Callable[[Path], _MeasuredRun], path: Path, name: str) -> _MeasuredRun:
    try:
        return replace(load(path), name=name)
    except IdentificationError as problem:
        sentence = str(problem)
        if path.name and sentence.startswith(path.name):
            about: dict[str, Any] = {"key": problem.key, "value": problem.value, "allowed": problem.allowed}
            raise IdentificationError(name + sentence.removeprefix(path.name), **about) from None
        raise


LEAST_SAMPLES = 200
MOST_CORRUPT = 0.02
"""Share of the rows that may be corrupt before the file is refused."""
MOST_BACKWARDS = 0.01
MOST_SATURATED = 0.05
MOST_MISSING = 0.2
"""Share of the duration that gaps may take."""
LONG_FROZEN = 0.15
"""Share of the samples over which a value that stays the same is noted."""
LEAST_FROZEN = 100
"""Samples over which it is not yet."""
WIDE = 5.0
"""How many times the median interval makes a gap."""
CLOCKS = (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9))
"""Units that a clock may be in, and their seconds."""

GRAM_FORCE = 1e-3 * STANDARD_GRAVITY
"""N per gram-force."""

_OFFSET, _OFFSET_SHARE = 0.05, 0.1
"""What a load cell's offset may be below zero, N and of the spread."""
_MOVES = 0.1
"""Share of its spread by which a column moves."""
_MIDDLE = (0.05, 0.95)
"""Quantiles that a spread is between: as many corrupt values as may be dropped do not reach it."""


class Unit(NamedTuple):
    """A unit that a column may have."""

    name: str
    scale: float
    """SI per unit."""
    least: float
    most: float
    """Plausible spread of the column in this unit."""
    integer: bool | None = None
    """Whether values are integers (True: counts), never all integers (False: physical), or either (None)."""


class Raw:
    """Rows of a file that become a `MeasuredRun`: every check may drop rows and adds a note."""

    def __init__(self, name: str, time: ArrayLike, columns: Mapping[str, ArrayLike]) -> None:
        self.name = name
        self.time: Array = np.array(time, dtype=np.float64)
        self.columns: dict[str, Array] = {key: np.array(value, dtype=np.float64) for key, value in columns.items()}
        self.notes: list[str] = []
        self._seconds = False

    def note(self, text: str) -> None:
        """Add a note."""
        self.notes.append(text)

    def refuse(self, reason: str, key: str, value: object = None, allowed: str = "") -> IdentificationError:
        """Return the error that names this recording, to be raised."""
        return IdentificationError(f"{self.name}: {reason}", key=key, value=value, allowed=allowed)

    def drop(self, bad: NDArray[np.bool_], what: str, most: float = MOST_CORRUPT, column: str = "rows") -> None:
        """Drop rows, say how many and where the first is, and refuse the file if they exceed a share of it."""
        number = int(bad.sum())
        if not number:
            return
        at = self.time[bad][0]
        where = (
            "" if not np.isfinite(at) else f", first at {at:.6g} s" if self._seconds else f", first at time {at:.9g}"
        )
        if number > most * bad.size:
            allowed = f"at most {100 * most:g} %"
            raise self.refuse(
                f"{number} of {bad.size} rows are {what}{where}; {allowed} may be", column, number, allowed
            )
        self.notes.append(f"dropped {counted(number, 'row')}: {what}{where}")
        self.time = self.time[~bad]
        self.columns = {key: value[~bad] for key, value in self.columns.items()}

    def finite(self) -> None:
        """Drop rows with a value that is missing, NaN or infinite."""
        lost = {key: ~np.isfinite(values) for key, values in (("time", self.time), *self.columns.items())}
        bad = np.logical_or.reduce([*lost.values()])
        named = [key for key, there in lost.items() if there.any()]
        which = f" ({', '.join(named)})" if len(named) < len(lost) else ""
        self.drop(bad, f"not numbers in every column{which}")

    def averaged(self) -> None:
        """Replace successive rows with the same time by their mean: readings while the clock stood still."""
        first = np.flatnonzero(np.concatenate([[True], np.diff(self.time) != 0])[: self.time.size])
        if first.size == self.time.size:
            return
        self.note(f"{self.time.size} rows at {first.size} times: the mean of rows of the same time is taken")
        held = np.diff(np.append(first, self.time.size))
        self.time = self.time[first]
        self.columns = {key: np.add.reduceat(values, first) / held for key, values in self.columns.items()}

    def ordered(self) -> None:
        """Drop repeated rows and rows whose clock ran back.

        A row repeated with the same time is dropped whatever their number (held samples); of rows out of order the
        fewest that leave a rising clock are.
        """
        if self.time.size > 1:
            values = np.column_stack(list(self.columns.values()))
            repeated = np.zeros(self.time.size, dtype=bool)
            repeated[1:] = (np.diff(self.time) == 0) & (np.diff(values, axis=0) == 0).all(axis=1)
            self.drop(repeated, "duplicates of the row before", most=1.0)
        if (np.diff(self.time) <= 0).any():
            self.drop(
                ~_longest_rise(self.time), "out of order (the clock ran back or stood still)", MOST_BACKWARDS, "time"
            )

    def clock(self, units: Sequence[tuple[str, float]] = CLOCKS) -> None:
        """Bring time to seconds from 0, in order: see `ordered`.

        The unit is the first one that makes the median interval 20 us to 0.5 s.
        """
        self.ordered()
        step = np.diff(self.time)
        interval = float(np.median(step)) if step.size else 0.0
        for name, scale in units:
            if 2e-5 <= interval * scale <= 0.5:
                if name != units[0][0]:
                    self.note(f"time taken as {name}: its rows are {interval:g} apart")
                self.time = (self.time - self.time[0]) * scale
                self._seconds = True
                return
        raise self.refuse(
            f"time rises by {interval:g} a row (median), which is no clock of 2 Hz to 50 kHz in "
            f"{', '.join(name for name, _ in units)}",
            "time",
            interval,
            "a clock of 2 Hz to 50 kHz",
        )

    def unit(self, units: Sequence[Unit], *columns: str, advice: str = "") -> str:
        """Convert columns of a kind to SI from the unit that their magnitude shows, and return that unit's name.

        All are taken to be in one unit, which the column that moves most shows. The first unit is the format's own; any
        other is noted. Refused where no unit is plausible, several are, or no column moves. Plausible is judged on the
        spread of the middle 90 % of the values, and on whether most are integers. `advice` is what to do where
        magnitudes leave the unit open.
        """
        named, several = " and ".join(columns), len(columns) > 1
        spread, widest = max((spread_of(self.columns[column]), column) for column in columns)
        values = self.columns[widest]
        integer = bool((values == np.round(values)).mean() > 0.5) if values.size else False
        candidates = [u for u in units if u.integer is None or u.integer == integer]
        if not spread or (candidates and all(spread < u.least for u in candidates)):
            least = " or ".join(f"{u.least:.3g} {u.name}" for u in candidates)
            moves = "move by at most" if several else "moves by"
            reason = f"no excitation: {named} {moves} {spread:.3g}, and at least {least} is needed"
            raise self.refuse(reason, widest, spread, f"at least {least}")
        fits = [u for u in candidates if u.least <= spread <= u.most]
        if len(fits) != 1:
            kind = "integers" if integer else "fractions"
            ranges = "; ".join(f"{u.least:.4g} to {u.most:.4g} in {u.name}" for u in units)
            problem = "may be " + " or ".join(u.name for u in fits) if fits else "fits no unit"
            raise self.refuse(
                f"{named} ({kind} with a spread of {spread:.4g}) {problem}; a spread may be {ranges}"
                f"{f'; {advice}' if advice else ''}",
                widest,
                [u.name for u in fits],
                "in one unit",
            )
        if fits[0] is not units[0]:
            whose = "their values have a spread of up to" if several else "its values have a spread of"
            self.note(f"{named} taken as {fits[0].name}, not {units[0].name}: {whose} {spread:.4g}")
        for column in columns:
            self.columns[column] = self.columns[column] * fits[0].scale
        return fits[0].name

    def outliers(self, column: str, limit: float, window: int = 5) -> None:
        """Drop rows where a column is further than a limit (SI) from the median of the rows around it."""
        values = self.columns[column]
        if values.size < window:
            return
        # mirrored, for an end repeated would be its own median
        self.drop(
            np.abs(values - median_filter(values, window, mode="mirror")) > limit,
            f"outliers of {column} (over {limit:.3g} off the rows around them)",
            column=column,
        )

    def saturated(self, column: str, least: int = 20, *, may_rest_at_zero: bool = False) -> None:
        """Drop rows where a noisy sensor stays at its highest or lowest value, if at least `least` of them do.

        It stays where it reads the same three times and more, and at least twice as long as at any other value: one
        that holds those as well is not that noisy. A slack tendon rests at zero, which is no fault of its load cell.
        """
        values = self.columns[column]
        bad = np.zeros(values.size, dtype=bool)
        if values.size and values.max() > values.min():
            between = (values[1:] == values[:-1]) & (values[1:] > values.min()) & (values[1:] < values.max())
            longest = 1 + max((end - start for start, end in _stretches(between)), default=0)
            for extreme in (values.min(), values.max()):
                if may_rest_at_zero and abs(extreme) < 1e-3 * np.ptp(values):
                    continue
                long = [(i, j) for i, j in _stretches(values == extreme) if j - i >= max(3, 2 * longest)]
                if sum(j - i for i, j in long) >= least:
                    for i, j in long:
                        bad[i:j] = True
        self.drop(bad, f"saturated: {column} stays at its extreme", MOST_SATURATED, column)

    def tension(self, *columns: str) -> None:
        """Refuse tensions (N) of which more than half are negative by more than an offset: a tendon cannot push."""
        for column in columns:
            middle = float(np.median(self.columns[column]))
            if middle < -max(_OFFSET, _OFFSET_SHARE * spread_of(self.columns[column])):
                reason = f"tension {column} is negative: its median is {middle:.3g} N; reverse its sign"
                raise self.refuse(reason, column, middle, "positive")

    def frozen(self, columns: Sequence[str], moving: str, *, may_rest_at_zero: bool = False) -> None:
        """Note columns that stay constant for long while another changes, most likely because a sensor hangs.

        Long is a share of :data:`LONG_FROZEN` of the samples, and more than :data:`LEAST_FROZEN` of them. A slack
        tendon rests at zero, which is no fault of its load cell.
        """
        least = max(LEAST_FROZEN + 1, LONG_FROZEN * self.time.size)
        moved = spread_of(self.columns[moving])
        for column in columns:
            values = self.columns[column]
            # a mean of equal values differs from them by rounding
            same = _stretches(np.abs(np.diff(values)) <= 1e-12 * np.max(np.abs(values)))
            begin, end = max(same, key=lambda one: one[1] - one[0], default=(0, 0))
            if end - begin + 1 < least or spread_of(self.columns[moving][begin : end + 1]) < _MOVES * moved:
                continue
            if may_rest_at_zero and abs(values[begin]) <= 1e-3 * np.ptp(values):
                continue
            self.note(
                f"{column} stays exactly the same from {self.time[begin]:.6g} s to {self.time[end]:.6g} s while "
                f"{moving} moves: a frozen sensor, unless it was held"
            )

    def gaps(self, factor: float = WIDE) -> None:
        """Note intervals over `factor` times the median; refuse the file if they take too much of its duration."""
        step = np.diff(self.time)
        usual = float(np.median(step))
        wide = step > factor * usual
        if not wide.any():
            return
        missing, duration = float(step[wide].sum()), float(self.time[-1] - self.time[0])
        first = float(self.time[:-1][wide][0])
        found = (
            f"{counted(int(wide.sum()), 'gap')} of {missing:.3g} s together in {duration:.3g} s, first at {first:.6g} s"
        )
        if missing > MOST_MISSING * duration:
            allowed = f"at most {100 * MOST_MISSING:g} %"
            raise self.refuse(f"{found}; {allowed} may be missing", "gaps", missing, allowed)
        self.note(found)

    def enough(self, least: int = LEAST_SAMPLES) -> None:
        """Refuse too few samples."""
        if self.time.size < least:
            reason = f"{self.time.size} samples are left, which is too few; at least {least} are needed"
            raise self.refuse(reason, "samples", self.time.size, f"at least {least}")

    def excited(self, column: str, least: float, unit: str) -> None:
        """Refuse a column whose spread (SI, of its middle 90 %) is too small for identification."""
        spread = spread_of(self.columns[column])
        if spread < least:
            allowed = f"at least {least:.3g} {unit}"
            raise self.refuse(
                f"no excitation: {column} moves by {spread:.3g} {unit}, and {allowed} is needed",
                column,
                spread,
                allowed,
            )

    def done(self, source: Source | None = None, checksum: str = "") -> MeasuredRun:
        """Return the recording; the source is that of the format's published files, which may not include this file."""
        notes = tuple(self.notes)
        published = source if source is not None and source.published(checksum) else None
        if source is not None:
            notes = (source.note(checksum), *notes)
        return MeasuredRun(self.name, self.time, dict(self.columns), notes, published, checksum)


def spread_of(values: Array) -> float:
    """Return how far the middle 90 % of the values lie apart, 0 for none."""
    if not values.size:
        return 0.0
    low, high = np.quantile(values, _MIDDLE)
    return float(high - low)


def counted(number: int, thing: str) -> str:
    """Return a number with the thing it counts."""
    return f"{number} {thing}{'' if number == 1 else 's'}"


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


def _stretches(held: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return where a condition begins and ceases to hold."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], held, [False]]).astype(np.int8))).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))
