"""What a report is made of: results, figures with their curves, tables, and sections that hold them."""

import html
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from tenodesis.instrument import Instrument
from tenodesis.protocols import Protocol
from tenodesis.published import Published


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


@dataclass(frozen=True)
class Session:
    """A protocol run on the twin of an instrument, so that it can be run again and recorded."""

    inst: Instrument
    protocol: Protocol
    seed: int


@dataclass
class Context:
    """What the sections work on, and the results they leave."""

    inst: Instrument
    scaled: Instrument | None
    is_paper: bool
    """Whether both instruments are the paper's own, so that its printed numbers apply."""
    results: dict[str, Result] = field(default_factory=dict)
    recordings: dict[str, Session] = field(default_factory=dict)
    """What the twin did, to be recorded, by name of the file."""

    @property
    def tested(self) -> Instrument:
        """The instrument that the experiments are done on, one axis: in the paper's report its scale model."""
        inst = self.scaled if self.is_paper and self.scaled is not None else self.inst
        return inst if len(inst.axes) == 1 else inst.axis(inst.axes[0])

    def figure_of(self, name: str) -> str:
        """Return how a caption refers to a figure of the paper."""
        return f"paper: {name}" if self.is_paper else f"as {name} of the paper"

    def add(self, key: str, value: float, unit: str, description: str, published: Published | None = None) -> float:
        """Record a result under a new key and return its value."""
        if key in self.results:
            raise KeyError(f"result {key} is recorded twice")
        self.results[key] = Result(key, float(value), unit, description, published if self.is_paper else None)
        return float(value)


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
