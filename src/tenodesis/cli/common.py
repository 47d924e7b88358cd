"""What commands share: arguments, what they print, where they may write, and a progress bar."""

import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Self, TypeAlias

import typer
from pydantic import TypeAdapter, ValidationError
from rich import box
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from tenodesis.control.resolution import sentences, warnings
from tenodesis.errors import CommandError, Error
from tenodesis.files import atomic_file
from tenodesis.instrument import Instrument

console = Console()

PATIENCE = 1.0
"""Time after which a progress bar is shown, s."""

InstrumentFile: TypeAlias = Annotated[
    str, typer.Argument(metavar="INSTRUMENT", help="Instrument file, or the name of a shipped instrument.")
]
Overwrite: TypeAlias = Annotated[bool, typer.Option("--overwrite", help="Replace files that exist.")]


def say(sentence: str, style: str | None = None) -> None:
    """Print a sentence as it is."""
    console.print(sentence, style=style, markup=False, highlight=False, soft_wrap=True)


def warn(sentence: str) -> None:
    """Print a warning."""
    say(f"warning: {sentence}", "yellow")


def say_resolution(inst: Instrument) -> None:
    """Print what an instrument's sensors resolve at its tip, and warn where they do not suffice."""
    for sentence in sentences(inst):
        say(sentence)
    for sentence in warnings(inst):
        warn(sentence)


def table(title: str | None = None, padding: tuple[int, int, int, int] = (0, 1, 0, 1)) -> Table:
    """Return a table without columns, in the style of all commands."""
    return Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, padding=padding)


class ProgressBar:
    """A context manager, to be called with how much is done and how much there is; shown after a second.

    Parameters
    ----------
    description
        What is counted, or what is being done.
    unit
        Unit of the count; None for a bar without one.
    """

    def __init__(self, description: str, unit: str | None = "") -> None:
        columns = [TextColumn("{task.description}"), BarColumn()]
        if unit is not None:
            columns.append(TextColumn(f"{{task.completed:.0f}}/{{task.total:.0f}}{unit}"))
        self._bar = Progress(*columns, TimeElapsedColumn(), console=console, transient=True)
        self._task = self._bar.add_task(description, total=1)
        self._begun = time.monotonic()
        self._shown = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._shown:
            self._bar.stop()

    def __call__(self, done: float, total: float, description: str | None = None) -> None:
        """Show how much is done, and what is being done if that changed."""
        if not self._shown and console.is_interactive and time.monotonic() > self._begun + PATIENCE:
            self._bar.start()
            self._shown = True
        self._bar.update(self._task, completed=done, total=max(total, 1), description=description)


def quantity(option: str, text: str, kind: Any) -> float:
    """Return an option's quantity in SI units, read as instrument files are: with its unit.

    Raises
    ------
    CommandError
        It has no unit, one of another dimension, or is out of range.
    """
    try:
        value: float = TypeAdapter(kind).validate_python(text, context={"file": True})
    except ValidationError as invalid:
        problem = invalid.errors(include_url=False)[0]["msg"].removeprefix("Value error, ")
        raise CommandError(f"{option} = {text!r}: {problem}.", key=option, value=text) from None
    return value


def check_choice(option: str, value: str, choices: Iterable[str]) -> None:
    """Refuse a value that is not among choices which are not known before the command runs.

    Raises
    ------
    CommandError
        It is not.
    """
    if value not in choices:
        raise CommandError(key=option, value=value, allowed=f"one of {', '.join(choices)}")


@contextmanager
def value_errors() -> Iterator[None]:
    """Raise a function's error about its arguments as an error of the command."""
    try:
        yield
    except Error:
        raise
    except ValueError as problem:
        raise CommandError(str(problem)) from problem


def refuse_existing(paths: Iterable[Path], overwrite: bool) -> None:
    """Refuse to replace files unless an option allows it.

    Raises
    ------
    CommandError
        A file exists and `overwrite` is not given.
    """
    existing = next((path for path in paths if path.exists()), None)
    if existing is not None and not overwrite:
        raise CommandError(f"{existing} exists already; give another path, or --overwrite.")


def write_text(path: Path, text: str) -> None:
    """Write a file completely or not at all.

    Raises
    ------
    CommandError
        It cannot be written.
    """
    with write_errors(path), atomic_file(path) as new:
        new.write_text(text, "utf-8")


@contextmanager
def write_errors(path: Path) -> Iterator[None]:
    """Raise an error of the operating system on writing a path as an error of the command."""
    try:
        yield
    except OSError as problem:
        raise CommandError(f"{path} cannot be written: {problem.strerror or problem}.") from None


def check_outputs(outputs: Iterable[tuple[str, Path]], inputs: Sequence[Path]) -> None:
    """Refuse outputs that are inputs or inside an input, coincide, are no regular files or cannot be written.

    Parameters
    ----------
    outputs
        Each with its option.
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
        if any(place == source.resolve() or _same_file(path, source) for source in inputs):
            raise _refused(option, path, "is an input; give another path")
        around = next((source for source in inputs if source.is_dir() and place.is_relative_to(source.resolve())), None)
        if around is not None:
            raise _refused(option, path, f"is inside the input {around}; give a path outside it")
        if place in taken:
            raise _refused(option, path, f"{taken[place]} writes; give another path")
        if path.is_dir():
            raise _refused(option, path, "is a folder; give the path of a file")
        if path.exists() and not path.is_file():
            raise _refused(option, path, "is no regular file; give the path of a file")
        try:
            # No file can be made in its folder, or the nearest one above that exists.
            with tempfile.TemporaryFile(dir=next(folder for folder in place.parents if folder.exists())):
                pass
        except OSError as problem:
            raise _refused(option, path, f"cannot be written: {problem.strerror or problem}") from None
        taken[place] = option


def _refused(option: str, path: Path, reason: str) -> CommandError:
    return CommandError(f"{option} would write {path}, which {reason}.", key=option, value=path)


def _same_file(path: Path, other: Path) -> bool:
    """Return whether two paths name the same file, hard links included."""
    return path.exists() and other.exists() and path.samefile(other)


def file_size(path: Path) -> str:
    """Return a file's size in words, in MB or kB."""
    size = path.stat().st_size
    return f"{size / 1e6:.3g} MB" if size >= 1e6 else f"{size / 1e3:.3g} kB"
