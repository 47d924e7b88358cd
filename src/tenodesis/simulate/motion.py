"""Recorded motions of the handle: columns of a CSV file, and the phase that follows them."""

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationInfo, field_validator, model_validator

from tenodesis.errors import ArgumentError, ProtocolError
from tenodesis.files import read_regular
from tenodesis.run import Array
from tenodesis.simulate.command import Segment
from tenodesis.simulate.joint import REST, Edge, joint_speed
from tenodesis.simulate.model import check_choice
from tenodesis.simulate.phases import Loaded, Start
from tenodesis.simulate.reach import check_handle_angles
from tenodesis.units import Angle

_LARGEST = 100_000_000
"""Largest CSV file, bytes."""
_RADIANS = {"rad": 1.0, "deg": math.radians(1)}


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of a recorded motion, each of shape (n,): times (s), values, and the lines of the file they are on."""

    times: Array
    values: Array
    lines: tuple[int, ...]


class Motion(Loaded):
    """The handle follows a recording: `scale` times the recorded angle plus `offset`.

    Between samples it follows a monotone piecewise cubic (Fritsch and Butland 1984): it passes through the samples,
    turns where they do, and its speed has no jumps. At either end it has the speed of the neighbouring phase of its
    axis, or of the move to its start, if that meets it at the same angle and in the same direction, and is no faster
    than `approach` if it is that move; otherwise it begins or ends at rest.
    """

    kind: Literal["motion"] = "motion"
    file: Path | None = Field(default=None, description="CSV file, relative to the protocol's file")
    data: str | None = Field(default=None, description="Content of such a file, in place of its name")
    time_column: str = Field(default="time", description="Column of times, s")
    angle_column: str = Field(default="angle", description="Column of angles")
    angle_unit: Literal["deg", "rad"] = Field(description="Unit of that column")
    scale: float = Field(default=1.0, strict=True, description="Handle angle by recorded angle")
    offset: Angle = Field(default=0.0, description="Handle angle at a recorded angle of 0")
    limit: bool = Field(default=False, strict=True, description="Limit angles to the ranges; otherwise an error")

    @field_validator("file")
    @classmethod
    def _resolve_file(cls, file: Path | None, info: ValidationInfo) -> Path | None:
        return file and Path((info.context or {}).get("folder") or "") / file

    @model_validator(mode="after")
    def _check_readable(self, info: ValidationInfo) -> Self:
        check_choice(self, "file", "data")
        if self.file is not None and (info.context or {}).get("folder", Path()) is None:
            raise ArgumentError(
                "file is given in a text that is no file itself; it must be data", key="file", allowed="data"
            )
        _ = self.samples
        return self

    @cached_property
    def samples(self) -> Samples:
        """The samples of the file."""
        if self.file is None:
            return _parse(self.data or "", "data", self.time_column, self.angle_column)
        return _read(self.file, self.time_column, self.angle_column)

    def with_data(self) -> Self:
        """Return the same phase with its samples in place of the file name."""
        data = csv_text(self.samples.times, self.samples.values, self.time_column, self.angle_column)
        given = {key: getattr(self, key) for key in self.model_fields_set if key != "file"}
        return type(self)(**{**given, "data": data})

    def segments(self, start: Start) -> Iterator[Segment]:
        """Yield the move to the first sample, and the motion."""
        # Slow to load, and seldom needed.
        from scipy.interpolate import CubicHermiteSpline, PchipInterpolator  # noqa: PLC0415

        angles = self._handle_angles(start)
        self._check_angles(start, angles)
        times = self.samples.times - self.samples.times[0]
        first, last, end = float(angles[0]), float(angles[-1]), float(times[-1])
        arrival = self._arrival(start)
        yield from self.approached(start, first, arrival)
        slopes = np.zeros_like(angles)
        if len(times) > 2:
            slopes[1:-1] = PchipInterpolator(times, angles).derivative()(times[1:-1])
        opening, closing = self.edges(start)
        slopes[0] = arrival or joint_speed(start.before, opening)
        slopes[-1] = joint_speed(closing, _opening_after(start, last))
        curve = CubicHermiteSpline(times, angles, slopes)
        steps = start.steps(end)
        # A handle that moves on is at the end with the last step, not within it.
        between_steps = end / steps if slopes[-1] else start.time_step

        def path(done: NDArray[np.int64]) -> Array:
            # The curve does not overshoot, but its values are rounded.
            return np.clip(curve(np.minimum(done * between_steps, end)), angles.min(), angles.max())

        yield self.moved(start, (first, last), steps, path)

    def edges(self, start: Start) -> tuple[Edge, Edge]:
        """Return the mean speeds of the first and the last interval; an approach ends at rest."""
        angles, times = self._handle_angles(start), self.samples.times
        speeds, intervals = np.diff(angles) / np.diff(times), np.diff(times)
        opening = Edge(float(speeds[0]), float(intervals[0])) if start.at(float(angles[0])) else REST
        return opening, Edge(float(speeds[-1]), float(intervals[-1]))

    def _arrival(self, start: Start) -> float:
        """Return the handle speed (rad/s) at which an approach passes into the motion: 0 if it must turn there."""
        angles, times = self._handle_angles(start), self.samples.times
        speed = float((angles[1] - angles[0]) / (times[1] - times[0]))
        way = float(angles[0]) - start.handle_angle
        return speed if way * speed > 0 and abs(speed) <= self.approach and not start.at(float(angles[0])) else 0.0

    @property
    def _source(self) -> str:
        """The key that gives the samples."""
        return "file" if self.file else "data"

    def _handle_angles(self, start: Start) -> Array:
        """Return the handle angle at every sample, rad, shape (n,)."""
        angles = self.scale * _RADIANS[self.angle_unit] * self.samples.values + self.offset
        if not self.limit:
            return angles
        reach = start.place.reach
        return np.clip(angles, -reach, reach)

    def _check_angles(self, start: Start, angles: Array) -> None:
        places = zip(self.samples.lines, self.samples.times, strict=True)
        names = [f"{self.file or 'data'}: line {line} ({time:g} s): the handle angle" for line, time in places]
        check_handle_angles(start.place, names, angles)


def _opening_after(start: Start, angle: float) -> Edge:
    """Return how the next phase begins at a handle angle (rad); its own plan reports what is wrong with it."""
    if start.after is None:
        return REST
    try:
        return start.after.edges(start._replace(command=start.command.on(start.place, handle_angle=angle)))[0]
    except ProtocolError:
        return REST


def csv_text(times: Array, values: Array, time_column: str, value_column: str) -> str:
    """Return two columns (n,) as CSV text that a motion takes as its data, to the last bit."""
    lines = [",".join('"' + name.replace('"', '""') + '"' for name in (time_column, value_column))]
    rows = zip(times.tolist(), values.tolist(), strict=True)
    return "\n".join([*lines, *(f"{time!r},{value!r}" for time, value in rows), ""])


def _read(file: Path, time_column: str, value_column: str) -> Samples:
    try:
        text = read_regular(file, _LARGEST).decode("utf-8-sig")
    except (FileNotFoundError, IsADirectoryError, NotADirectoryError):
        raise _unreadable(file, "there is no such file", "the path of a CSV file") from None
    except UnicodeDecodeError:
        raise _unreadable(file, "it is not UTF-8 text", "a CSV file") from None
    except OSError as problem:
        raise _unreadable(file, f"it cannot be read: {problem.strerror}") from None
    return _parse(text, str(file), time_column, value_column)


def _unreadable(file: Path, why: str, allowed: str = "") -> ProtocolError:
    must = f"; it must be {allowed}" if allowed else ""
    return ProtocolError(f"file is {str(file)!r}: {why}{must}", key="file", value=str(file), allowed=allowed)


def _parse(text: str, source: str, time_column: str, value_column: str) -> Samples:
    """Return two columns of CSV: commas, a header of names, comments after # in lines of their own."""
    rows = _rows(text)
    _, header = next(rows, (0, []))
    columns = [_column(source, header, name) for name in (time_column, value_column)]
    numbers, lines = [], []
    for line, row in rows:
        numbers.append([_number(f"{source}: line {line}", header, row, column) for column in columns])
        lines.append(line)
    if len(numbers) < 2:
        raise ProtocolError(
            f"{source} has {len(numbers)} rows of numbers; it must have two or more",
            key="rows",
            value=len(numbers),
            allowed="two or more",
        )
    times, values = np.array(numbers).T
    late = np.flatnonzero(np.diff(times) <= 0)
    if late.size:
        at = int(late[0]) + 1
        raise ProtocolError(
            f"{source}: line {lines[at]}: {time_column} is {times[at]:g} after {times[at - 1]:g}; "
            "times must increase strictly",
            key=time_column,
            value=times[at],
            allowed=f"above {times[at - 1]:g}",
        )
    return Samples(times, values, tuple(lines))


def _rows(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield line number and cells of each line that is neither empty nor a comment."""
    for line, content in enumerate(text.splitlines(), 1):
        if content.strip() and not content.lstrip().startswith("#"):
            yield line, [cell.strip() for cell in next(csv.reader([content]))]


def _column(source: str, header: list[str], name: str) -> int:
    if name not in header:
        raise ProtocolError(
            f"{source} has no column {name!r}; it has {', '.join(header) or 'none'}",
            key="column",
            value=name,
            allowed=", ".join(header),
        )
    return header.index(name)


def _number(place: str, header: list[str], row: list[str], column: int) -> float:
    cell = row[column] if column < len(row) else ""
    try:
        number = float(cell)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise ProtocolError(
            f"{place}: {header[column]} is {cell!r}; it must be a finite number",
            key=header[column],
            value=cell,
            allowed="a finite number",
        )
    return number
