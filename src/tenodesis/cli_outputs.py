"""Where a command may write, asked before it begins what takes long."""

import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path

from tenodesis.cli_recording import CommandError


def check_outputs(outputs: Iterable[tuple[str, Path]], inputs: Sequence[Path]) -> None:
    """Refuse to write an input or within one, a file twice, what is no regular file, or where nothing can be written.

    Parameters
    ----------
    outputs
        Each with the option that asks for it.
    inputs
        Files and folders that are read.

    Raises
    ------
    CommandError
        An output is refused; nothing was written.
    """
    taken: dict[Path, str] = {}
    for option, path in outputs:
        place = path.resolve()
        if any(place == one.resolve() or _same(path, one) for one in inputs):
            raise CommandError(f"{option} would write {path}, which is an input; allowed is another path.")
        within = next((one for one in inputs if one.is_dir() and place.is_relative_to(one.resolve())), None)
        if within is not None:
            raise CommandError(
                f"{option} would write {path}, which is inside the input {within}; allowed is a path outside it."
            )
        if place in taken:
            raise CommandError(f"{option} would write {path}, which {taken[place]} writes; allowed is another.")
        if path.is_dir():
            raise CommandError(f"{option} would write {path}, which is a folder; allowed is the path of a file.")
        if path.exists() and not path.is_file():
            raise CommandError(f"{option} would write {path}, which is no regular file; allowed is the path of a file.")
        _check_writable(option, path)
        taken[place] = option


def _same(one: Path, other: Path) -> bool:
    """Return whether two paths are one file by different names, hard links included."""
    return one.exists() and other.exists() and one.samefile(other)


def _check_writable(option: str, path: Path) -> None:
    """Refuse a path in whose folder, or the nearest one above that is there already, no file can be made."""
    try:
        folder = next(one for one in path.resolve().parents if one.exists())
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as problem:
        raise CommandError(
            f"{option} would write {path}, which cannot be written: {problem.strerror or problem}."
        ) from None
