"""Names of recordings: a file's own, and as much of its folders as tells it from others of that name."""

import os
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from tenodesis.errors import IdentificationError
from tenodesis.identification.formats.measured import Measured

_Recording = TypeVar("_Recording", bound=Measured)


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


def load_all(load: Callable[[Path], _Recording], paths: Sequence[Path]) -> list[_Recording]:
    """Return the recordings of several files, each under a name of its own.

    Raises
    ------
    IdentificationError
        One of them cannot be used.
    """
    return [_named(load, path, name) for path, name in zip(paths, distinct_names(paths), strict=True)]


def _named(load: Callable[[Path], _Recording], path: Path, name: str) -> _Recording:
    try:
        return replace(load(path), name=name)
    except IdentificationError as problem:
        told = str(problem)
        if path.name and told.startswith(path.name):
            raise IdentificationError(name + told.removeprefix(path.name)) from None
        raise
