"""What commands share: where they may write, and a progress bar for what takes longer than a second."""

import tempfile
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from tenodesis.errors import CommandError

PATIENCE = 1.0
"""Time after which a bar is shown, s."""


class PatientBar:
    """A context manager, to be called with how much is done and how much there is.

    Parameters
    ----------
    console
        Where it shows itself, if that is a terminal.
    counted
        What is counted.
    """

    def __init__(self, console: Console, counted: str) -> None:
        columns = (TextColumn(counted), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
        self._console = console
        self._bar = Progress(*columns, console=console, transient=True)
        self._task = self._bar.add_task("", total=None)
        self._begun = time.monotonic()
        self._shown = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._shown:
            self._bar.stop()

    def __call__(self, done: int, whole: int) -> None:
        """Show how far it is."""
        if not self._shown and self._console.is_interactive and time.monotonic() > self._begun + PATIENCE:
            self._bar.start()
            self._shown = True
        self._bar.update(self._task, completed=done, total=whole)


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
