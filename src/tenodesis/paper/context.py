"""Data shared by the sections of the report: the instruments, the loads of the figures, and the results."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from tenodesis import instrument as instruments
from tenodesis import statics
from tenodesis.control import Controller
from tenodesis.control.pairs import compensated
from tenodesis.errors import ArgumentError, InstrumentError, NoSolutionError, ProtocolError
from tenodesis.instrument import FullForm, Instrument, ShortForm, as_short_form, expanded
from tenodesis.paper.subject import Subject
from tenodesis.report.content import Published, Result, ResultColumn, ResultTable
from tenodesis.report.curves import forces
from tenodesis.run import Run
from tenodesis.simulate import Protocol, execute
from tenodesis.twin import Twin

SEEDS = 20
"""Noise seeds of the robust law's campaign."""


DRAWN = slice(None, None, 20)
"""Samples of a run that are drawn."""
WAYS = np.linspace(0.15, 0.9, 61)
"""Shares of the way at which the halves of a cycle are compared, clear of the reversals."""
COEFFICIENTS = ("vertex_coefficient", "sheath_coefficient", "constant")
"""What an instrument's friction is made of, and a controller may assume wrong."""


@dataclass(frozen=True)
class RecordedRun:
    """A protocol that was run on the twin of an instrument, with the seed of its noise."""

    inst: ShortForm | FullForm
    protocol: Protocol
    seed: int
    run: Run

    @classmethod
    def of(
        cls, inst: ShortForm | FullForm, protocol: Protocol, seed: int, controller: Controller | None = None
    ) -> "RecordedRun | None":
        """Run a protocol; None if the joints cannot hold its loads, or the handle not do it."""
        try:
            return cls(inst, protocol, seed, execute(Twin(inst, seed=seed), protocol, controller))
        except (NoSolutionError, ProtocolError):
            return None


def _ignore(_: str) -> None:
    pass


@dataclass
class Context:
    """Input of the sections, and their results."""

    given: Instrument
    scaled: Instrument | None
    is_paper: bool
    """Whether both instruments are the paper's own, so that its printed numbers apply."""
    seeds: int = SEEDS
    """Noise seeds of the robust law's campaign; 0 omits it."""
    progress: Callable[[str], None] = _ignore
    """Called with the name of what is being computed."""
    results: dict[str, Result] = field(default_factory=dict)
    recordings: dict[str, RecordedRun] = field(default_factory=dict)
    """Runs of the twin that are written as recordings, by name of the file."""
    is_own: bool = False
    """Whether the instrument is none of the paper's, whose figures, targets and pitfalls then do not concern it."""
    chapters: frozenset[str] = frozenset()
    """Names of the chapters that the report has; empty for all."""
    left_out: Mapping[str, str] = field(default_factory=dict)
    """Why the report does not have the others, a sentence each, by name."""

    @classmethod
    def of(
        cls,
        inst: Instrument,
        scaled: Instrument | None = None,
        *,
        seeds: int = SEEDS,
        progress: Callable[[str], None] = _ignore,
    ) -> "Context":
        """Return the context of a report on an instrument and its scale model.

        The working range of a planar instrument whose handle does not reach its end is shortened to what it reaches.
        """
        real, prototype = (instruments.load(name) for name in ("real-size", "scaled-up"))
        is_paper = inst == real and scaled == prototype
        context = cls(inst, scaled, is_paper, seeds, progress, is_own=inst not in (real, prototype))
        if context.short is not None:
            reached = statics.output_angle(context.short, np.array([inst.handle_range]))[0]
            if reached < inst.output_range:
                return replace(context, given=inst.replace(output_range=reached))
        return context

    @property
    def short(self) -> ShortForm | None:
        """The instrument in the short form; None if its file lists joints and tendons."""
        return self.given.short_form

    @property
    def inst(self) -> ShortForm:
        """The planar instrument; raises InstrumentError if its file lists joints and tendons."""
        return as_short_form(self.given)

    @cached_property
    def whole(self) -> FullForm:
        """The instrument as joints and tendons."""
        return expanded(self.given)

    @property
    def controlled(self) -> ShortForm | None:
        """The one-axis instrument of the experiments, or the axes that a controller compensates; None without any."""
        if self.short is not None:
            return self.tested
        try:
            return compensated(self.given)
        except (ArgumentError, InstrumentError):
            return None

    @cached_property
    def subject(self) -> Subject:
        """What the chapters on statics study."""
        return Subject.of(self.given)

    @cached_property
    def bench(self) -> Subject:
        """What the experiments study: in the paper's report its scale model."""
        return Subject.of(self.scaled if self.is_paper and self.scaled is not None else self.given)

    @property
    def tested(self) -> ShortForm:
        """The planar instrument of the experiments."""
        return as_short_form(self.bench.given)

    def figure_of(self, name: str, rest: str = "") -> str:
        """Return how a caption refers to a figure of the paper, in brackets; empty for an instrument of one's own."""
        if self.is_own:
            return ""
        return f" (paper: {name}{rest})" if self.is_paper else f" (as {name} of the paper{rest})"

    def file_name(self, figure: str, name: str) -> str:
        """Return the name of a file: with its figure of the paper before it, unless the instrument is one's own."""
        return name if self.is_own else f"{figure}_{name}"

    def has_chapter(self, name: str) -> bool:
        """Return whether the report has a chapter."""
        return not self.chapters or name in self.chapters

    def add(self, key: str, value: float, unit: str, description: str, published: Published | None = None) -> float:
        """Record a result under a new key and return its value."""
        if key in self.results:
            raise KeyError(f"result {key} is recorded twice")
        self.results[key] = Result(key, float(value), unit, description, published if self.is_paper else None)
        return float(value)

    def table(self, caption: str, *columns: str | ResultColumn) -> ResultTable:
        """Return an empty table whose numbers become results of this report."""
        return ResultTable(caption, columns, self.add)


def shown_force(inst: ShortForm) -> float:
    """Return the load of single-load figures, N."""
    loads = forces(inst)[1:]
    return loads[min(1, len(loads) - 1)]


def has_friction(inst: Instrument) -> bool:
    """Return whether an instrument's tendons have friction."""
    return inst.friction.law != "none" and any(getattr(inst.friction, key) for key in COEFFICIENTS)


def held_angles(inst: ShortForm) -> Sequence[float]:
    """Return the output angles (rad) of the held states: those of the conditions, or four over the working range."""
    return inst.conditions.output_angles or tuple(np.linspace(0.0, 0.9 * inst.output_range, 4))
