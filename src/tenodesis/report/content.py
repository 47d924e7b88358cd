"""What a report is made of: results, figures with their curves, tables, and sections that hold them."""

import html
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from tenodesis.instrument import Instrument


class Published(NamedTuple):
    """A printed number, in the unit it is compared in, and where it is printed."""

    value: float
    source: str


@dataclass(frozen=True)
class Result:
    """One number of the report, by name in results.json."""

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
    """A figure and the curves in it, as columns of equal length by heading."""

    name: str
    caption: str
    figure: Figure
    curves: Mapping[str, ArrayLike]


@dataclass(frozen=True)
class Table:
    """A table of text cells; the first column names the rows."""

    caption: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]


@dataclass(frozen=True)
class CarePoint:
    """A place where the paper needs care, with what it is and what it costs."""

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


def named(inst: Instrument) -> str:
    """Return an instrument's name as it may stand in HTML."""
    return html.escape(inst.name)


def number(value: float, digits: int = 4) -> str:
    """Return a number for reading: significant digits, a true minus, and a dash where there is none."""
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
    """Return a number with fixed decimals, so that columns line up; a dash where there is none."""
    return f"{value:.{decimals}f}".replace("-", "−") if np.isfinite(value) else "–"
