"""The parts of a report: results, figures with their curves, tables, and sections that contain them."""

import html
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from tenodesis.instrument import Instrument
from tenodesis.report import style

Array: TypeAlias = NDArray[np.float64]


def named(inst: Instrument) -> str:
    """Return an instrument's name escaped for HTML."""
    return html.escape(inst.name)


def number(value: float, digits: int = 4) -> str:
    """Return a number as text: significant digits, a true minus, and a dash if there is no number."""
    if not np.isfinite(value):
        return "–"
    if value and not 1e-4 <= abs(value) < 1e7:
        mantissa, exponent = f"{value:.1e}".split("e")
        power = f"10<sup>{int(exponent)}</sup>".replace("-", "−")
        return f"{mantissa.replace('-', '−')} × {power}"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value)))) if value else 0
    text = f"{value:.{decimals}f}"
    if "." in text:
        text = text.rstrip("0").rstrip(".")
    return text.replace("-", "−")


def fixed(value: float, decimals: int = 2) -> str:
    """Return a number as text with fixed decimals, a dash if there is no number, no minus before a zero."""
    return f"{round(value, decimals) + 0.0:.{decimals}f}".replace("-", "−") if np.isfinite(value) else "–"


def unit_text(unit: str) -> str:
    """Return a unit as pages write it: N·m² for N*m^2."""
    return unit.replace("*", "·").replace("^2", "²")


class Published(NamedTuple):
    """A published number, in the unit of the comparison, and where it is printed."""

    value: float
    source: str


@dataclass(frozen=True)
class Result:
    """A number of the report, by name in results.json."""

    key: str
    value: float
    unit: str
    description: str
    published: Published | None = None

    @property
    def residual(self) -> float | None:
        """Ours minus the published number."""
        return None if self.published is None else self.value - self.published.value


@dataclass(frozen=True)
class Plot:
    """A figure and the curves in it, as columns by heading."""

    name: str
    caption: str
    figure: Figure
    curves: Mapping[str, ArrayLike]


class Chart:
    """A figure while it is drawn, and the columns of its CSV file, which get the same curves."""

    def __init__(self, figure: Figure) -> None:
        self.figure = figure
        self.columns: dict[str, Array] = {}

    @classmethod
    def panels(cls, count: int = 1, **size: float) -> tuple["Chart", Sequence[Axes]]:
        """Return a chart of this many panels side by side, and the panels; the size is as for `style.figure`."""
        figure, axes = style.figure(count, **size)
        return cls(figure), axes

    def keep(self, heading: str, values: ArrayLike) -> Array:
        """Keep values as a column of the CSV file, and return them as an array."""
        self.columns[heading] = np.asarray(values, float)
        return self.columns[heading]

    def curve(self, axis: Axes, x: Array, heading: str, y: ArrayLike, line: str = "-", **look: Any) -> None:
        """Draw a curve and keep its ordinates as a column; x is (n,), y is (n,), look is as for `Axes.plot`."""
        axis.plot(x, self.keep(heading, y), line, **look)

    def plot(self, name: str, caption: str) -> Plot:
        """Return the finished figure with its columns."""
        return Plot(name, caption, self.figure, self.columns)


@dataclass
class Table:
    """A table of text cells; the first column names the rows."""

    caption: str
    columns: Sequence[str]
    rows: list[list[str]]


@dataclass(frozen=True)
class ResultColumn:
    """A column of numbers in a table, which may also be results of the report.

    Key, unit and description are patterns for `str.format`, filled in from the labels of each row.
    """

    heading: str
    key: str = ""
    """Name of the result; empty if the numbers are shown only."""
    unit: str = ""
    description: str = ""
    digits: int = 2
    """Decimals that are shown."""
    form: Callable[[float], str] | None = None
    """Converts a number to text, in place of the decimals."""
    optional: bool = False
    """Whether a number that is not finite is left out of the results."""


Cell: TypeAlias = str | float | tuple[float, Published | None]
"""Text, a number, or a number and the published number that it is compared with."""


class ResultTable(Table):
    """A table that is filled row by row and records the numbers of its rows as results.

    In its layout a heading alone means text, or numbers with two decimals that are not results; `record` takes key,
    value, unit, description and published number of each result.
    """

    def __init__(self, caption: str, layout: Sequence[str | ResultColumn], record: Callable[..., float]) -> None:
        self._layout = [ResultColumn(column) if isinstance(column, str) else column for column in layout]
        self._record = record
        super().__init__(caption, [column.heading for column in self._layout], [])

    def row(self, *cells: Cell, **labels: object) -> None:
        """Add a row; labels fill in the names and descriptions of its results."""
        texts = []
        for column, cell in zip(self._layout, cells, strict=True):
            if isinstance(cell, str):
                texts.append(cell)
                continue
            value, printed = cell if isinstance(cell, tuple) else (cell, None)
            if column.key and (np.isfinite(value) or not column.optional):
                description = column.description.format(**labels)
                self._record(column.key.format(**labels), value, column.unit.format(**labels), description, printed)
            texts.append(fixed(value, column.digits) if column.form is None else column.form(float(value)))
        self.rows.append(texts)


@dataclass(frozen=True)
class CarePoint:
    """A place where the paper needs care, with its description and its effect."""

    number: int
    title: str
    text: str


@dataclass(frozen=True)
class Section:
    """A part of the report; text is HTML."""

    key: str
    title: str
    text: str = ""
    plots: Sequence[Plot] = ()
    tables: Sequence[Table] = ()
    care: Sequence[CarePoint] = ()

    @classmethod
    def not_run(cls, key: str, title: str, why: str) -> "Section":
        """Return the section of an experiment that was not made, with the reason in words."""
        return cls(key, title, f"<p>Not run: {why}.</p>")
