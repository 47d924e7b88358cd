"""A recording made by others, in SI units, and where published ones come from."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

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
        """Return whether a file of this checksum is one of the published ones, and if so under which licence."""
        place = f"{self.repository} at {self.commit[:10]}"
        name = self.published(checksum)
        if name is None:
            return f"none of the files published in {place}: another recording, or a changed one"
        return f"as published: {self.folder}/{name} of {place}; licence: {self.licence}"


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
    """Where the file was published; None for one that was not."""
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


def checksum(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
