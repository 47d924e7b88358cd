"""Which formats of recordings there are, how each is read, and which model is fitted to it."""

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, NamedTuple, Protocol

from tenodesis.errors import IdentificationError
from tenodesis.identification.problem import Problem
from tenodesis.identification.uncertainty import LossName
from tenodesis.instrument import Instrument

if TYPE_CHECKING:
    from tenodesis.identification.formats.measured import Measured


class Load(Protocol):
    """How recordings of a format are read."""

    def __call__(self, path: Path) -> "Measured":
        """Return the recording of a file."""


class Factory(Protocol):
    """How recordings become a problem; its runs are those of train, then those of test."""

    def __call__(
        self, train: "Sequence[Measured]", test: "Sequence[Measured]", *, law: str, instrument: Instrument | None
    ) -> Problem:
        """Return the model with its recordings."""


class Format(NamedTuple):
    """How a format is read, and the model that is fitted to it."""

    load: Load
    problem: Factory


class Usual(NamedTuple):
    """What a format takes unless told."""

    law: str
    """Friction law."""
    loss: LossName


def usual(name: str) -> Usual:
    """Return the friction law and the loss that a format takes unless told.

    Raises
    ------
    IdentificationError
        There is no such format.
    """
    model = _module(name, _MODULES[_known(name)][1])
    return Usual(getattr(model, "DEFAULT_LAW", _USUAL.law), getattr(model, "DEFAULT_LOSS", _USUAL.loss))


_USUAL = Usual("capstan", "linear")
_MODULES = {
    "davinci-tool": ("formats.davinci_tool", "models.tool"),
    "endoscope-pair": ("formats.endoscope_pair", "models.pair"),
    "tendon-sheath": ("formats.tendon_sheath", "models.sheath"),
    "csv": ("formats.csv", "models.twin"),
    "mcap": ("formats.mcap", "models.twin"),
}


def _known(name: str) -> str:
    if name not in _MODULES:
        raise IdentificationError(f"format is {name!r}; allowed are {', '.join(_MODULES)}.")
    return name


def _module(name: str, place: str) -> ModuleType:
    """Import what a format needs only when it is asked for, so that one does not wait for, or fail with, another."""
    try:
        return import_module(f"tenodesis.identification.{place}")
    except ImportError as problem:
        raise IdentificationError(f"format {name} is not available here: {problem}.") from problem


def _lazy(name: str, loader: str, model: str) -> Format:
    def load(path: Path) -> "Measured":
        measured: Measured = _module(name, loader).load(path)
        return measured

    def problem(
        train: "Sequence[Measured]", test: "Sequence[Measured]", *, law: str, instrument: Instrument | None
    ) -> Problem:
        built: Problem = _module(name, model).problem(train, test, law=law, instrument=instrument)
        return built

    return Format(load, problem)


FORMATS: dict[str, Format] = {name: _lazy(name, *places) for name, places in _MODULES.items()}
"""Formats by name."""
