"""Which formats of recordings there are, how each is read, and which model is fitted to it.

A package adds a format of its own by an entry point of the group ``tenodesis.formats`` that names a `Format`.
"""

from collections import UserDict
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import EntryPoint, entry_points
from typing import Any, NamedTuple, Protocol, cast

from tenodesis.errors import IdentificationError
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.identification.problem import Problem
from tenodesis.identification.uncertainty import LossName
from tenodesis.instrument import ShortForm

GROUP = "tenodesis.formats"
"""Group of the entry points."""

OURS = {
    "davinci-tool": "tenodesis.identification.datasets.davinci_tool:FORMAT",
    "davinci-posture": "tenodesis.identification.datasets.davinci_posture:FORMAT",
    "endoscope-pair": "tenodesis.identification.datasets.endoscope_pair:FORMAT",
    "tendon-sheath": "tenodesis.identification.datasets.tendon_sheath:FORMAT",
    "joints": "tenodesis.identification.kinematic.recordings:FORMAT",
    "tendons": "tenodesis.identification.routing:FORMAT",
    "recording": "tenodesis.identification.twin_model.formats:RECORDING",
    "csv": "tenodesis.identification.twin_model.formats:CSV",
    "mcap": "tenodesis.identification.twin_model.formats:MCAP",
}
"""This package's own entry points, for when it runs from its sources without being installed."""


class BuildProblem(Protocol):
    """How recordings become a problem; its runs are those of train, then those of test."""

    def __call__(
        self, train: Sequence[MeasuredRun], test: Sequence[MeasuredRun], *, law: str, instrument: ShortForm | None
    ) -> Problem:
        """Return the model with its recordings."""


class Arranged(NamedTuple):
    """An arrangement to compare: its name, the instrument in it, and parameters that are fitted in addition."""

    name: str
    instrument: ShortForm
    unknowns: tuple[str, ...] = ()


class ListArrangements(Protocol):
    """Which arrangements of contacts are compared, the instrument's own first."""

    def __call__(
        self, runs: Sequence[MeasuredRun], *, law: str, instrument: ShortForm | None, fitted: Sequence[str]
    ) -> list[Arranged]:
        """Return the arrangements, given which parameters are fitted."""


class Format(NamedTuple):
    """How recordings of a format are read, and the model that is fitted to them."""

    load: Callable[..., MeasuredRun]
    """Takes a path, and the keyword `progress` where it `shows_progress`."""
    problem: BuildProblem
    laws: tuple[str, ...] = ()
    """Friction laws of the model, by name."""
    law: str = "capstan"
    """Default friction law."""
    loss: LossName = "linear"
    """Default loss."""
    arrangements: ListArrangements | None = None
    """Arrangements of the model's contacts, if it has several."""
    shows_progress: bool = False
    """Whether reading calls the keyword `progress` with the bytes that are read, and how many there are."""


class Formats(UserDict[str, Format]):
    """Formats by name; each is imported when it is first used, so that none waits for, or fails with, another."""

    data: dict[str, Any]

    def __init__(self, places: Mapping[str, EntryPoint]) -> None:
        super().__init__()
        self.data |= places

    def __getitem__(self, name: str) -> Format:
        """Return a format; raises IdentificationError if it cannot be imported."""
        found = self.data[name]
        if isinstance(found, EntryPoint):
            try:
                found = self.data[name] = found.load()
            except (ImportError, AttributeError) as problem:
                raise IdentificationError(
                    f"format {name} is not available here: {problem}.", key="format", value=name
                ) from problem
        return cast("Format", found)


def _entry_points() -> dict[str, EntryPoint]:
    """Return the formats of this package and of others, which cannot replace a format of this package."""
    ours = {name: EntryPoint(name, place, GROUP) for name, place in OURS.items()}
    return {**ours, **{entry.name: entry for entry in entry_points(group=GROUP) if entry.name not in ours}}


FORMATS = Formats(_entry_points())
"""Formats by name."""
