"""A measured run in SI units, the sources of published runs, and names that distinguish several runs."""

import hashlib
import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from tenodesis.errors import IdentificationError
from tenodesis.run import Array


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
            return f"none of the files published in {place}: another recording, or a changed one"
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
    """What was dropped, converted or is doubtful."""
    source: Source | None = None
    """Where the file was published; None for a file that was not."""
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
            raise IdentificationError(name + sentence.removeprefix(path.name)) from None
        raise
