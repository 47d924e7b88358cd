"""What commands share: arguments, what they print, and a progress bar."""

import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, TypeAlias, overload

import numpy as np
import typer
from numpy.typing import ArrayLike, NDArray
from pydantic import TypeAdapter, ValidationError
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from tenodesis import instrument
from tenodesis.cli import interrupts
from tenodesis.control.controller import LawName
from tenodesis.control.joints import JointLawName
from tenodesis.control.resolution import sentences, warnings
from tenodesis.errors import CommandError, Error, InstrumentError, ProtocolError
from tenodesis.instrument import Instrument, ShortForm

if TYPE_CHECKING:
    from rich.progress import Progress

    from tenodesis import simulate

console = Console()


class Settings:
    """What holds for a whole command."""

    quiet = False
    """Whether only results, warnings and errors are printed."""


PATIENCE = 1.0
"""Time after which a progress bar is shown, s."""

_LONGEST_NAME = 32
"""Of a table's text, characters up to which a word is kept whole."""

AnyLaw: TypeAlias = Literal[LawName, JointLawName]
InstrumentFile: TypeAlias = Annotated[
    str, typer.Argument(metavar="INSTRUMENT", help="Instrument file, or the name of a shipped instrument.")
]
AxisToCompute: TypeAlias = Annotated[
    str | None, typer.Option(help="One axis of two, with the chapters on planar instruments. Default: all joints.")
]
SerialAddress: TypeAlias = Annotated[
    str | None, typer.Option(help="Of a serial device: /dev/ttyACM0, or socket://127.0.0.1:5555.")
]


@overload
def load_instrument(name_or_path: str) -> Instrument: ...
@overload
def load_instrument(name_or_path: str, *, planar: Literal[True]) -> ShortForm: ...
def load_instrument(name_or_path: str, *, planar: bool = False) -> Instrument:
    """Return an instrument by its name or path.

    Raises
    ------
    InstrumentError
        There is none, it is not valid, or this is the name of a protocol; its file lists joints and tendons where a
        command takes planar instruments.
    """
    try:
        inst = instrument.load(name_or_path)
    except InstrumentError:
        _refuse_name(name_or_path, "a protocol", InstrumentError, "an instrument")
        raise
    if planar and inst.short_form is None:
        raise InstrumentError(
            f"{name_or_path} lists joints and tendons, and this command takes planar instruments; tenodesis check, "
            "loss, compare, bench, record, replay, console, devices test, scale, tolerance, transfer, identify, "
            "vertices, cad, export controller, export urdf and export mjcf take such files, and tn in Python.",
            key="file",
            value=name_or_path,
            allowed="a planar instrument",
        )
    return inst


def load_protocol(name_or_path: str) -> "simulate.Protocol":
    """Return a protocol by its name or path.

    Raises
    ------
    ProtocolError
        There is none, it is not valid, or this is the name of an instrument.
    """
    from tenodesis import simulate  # noqa: PLC0415 - most commands do without protocols

    _refuse_name(name_or_path, "an instrument", ProtocolError, "a protocol")
    return simulate.load(name_or_path)


def _refuse_name(given: str, kind: str, error: type[Error], wanted: str) -> None:
    """Raise an error if what is given is the shipped name of one kind of file where another is wanted."""
    from tenodesis import simulate  # noqa: PLC0415 - most commands do without protocols

    shipped = {"an instrument": instrument.shipped, "a protocol": simulate.shipped}
    if given in shipped[kind]() and not Path(given).exists():
        raise error(
            f"{given} is {kind}; it must be {wanted}: {', '.join(shipped[wanted]())}, or the path of {wanted} file.",
            key="file",
            value=given,
        ) from None


def say(sentence: str, style: str | None = None) -> None:
    """Print a sentence as it is."""
    console.print(sentence, style=style, markup=False, highlight=False, soft_wrap=True)


def note(sentence: str) -> None:
    """Print a sentence that is no result, unless the user wants only these."""
    if not Settings.quiet:
        say(sentence)


def warn(sentence: str) -> None:
    """Print a warning."""
    say(f"warning: {sentence}", "yellow")


def say_resolution(inst: ShortForm) -> None:
    """Print what an instrument's sensors resolve at its tip, and warn where they do not suffice."""
    for sentence in sentences(inst):
        say(sentence)
    warn_resolution(inst)


def warn_resolution(inst: ShortForm) -> None:
    """Warn where an instrument's sensors do not suffice."""
    for sentence in warnings(inst):
        warn(sentence)


def table(title: str | None = None, *columns: str, rows: Iterable[Sequence[str]] = ()) -> Table:
    """Return a table in the style of all commands.

    Parameters
    ----------
    title
        Above it.
    columns
        Their headings; ">" before one of numbers, which are to the right and, as names are, never broken over lines.
    rows
        Their cells.
    """
    shown = Table(title=title and escape(title), title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    cells = [list(row) for row in rows]
    for place, column in enumerate(columns):
        heading = escape(column.removeprefix(">"))
        if column.startswith(">"):
            shown.add_column(heading, justify="right", no_wrap=True)
        else:
            # names have no spaces, at which lines may end
            longest = max((len(word) for row in cells for word in row[place].split()), default=0)
            shown.add_column(heading, overflow="fold", min_width=min(longest, _LONGEST_NAME))
    for row in cells:
        shown.add_row(*map(escape, row))
    return shown


def matrix(rows: Sequence[str], columns: Sequence[str], values: NDArray[np.float64], corner: str = "") -> Table:
    """Return a table of numbers by row and column: NaN as a dash, zeros as dots."""
    shown = table()
    shown.add_column(escape(corner), no_wrap=True)
    for heading in columns:
        shown.add_column(escape(heading), justify="right", overflow="fold")
    none = 1e-9 * np.nanmax(np.abs(values), initial=0.0)
    for name, row in zip(rows, values, strict=True):
        shown.add_row(escape(name), *("–" if np.isnan(v) else "·" if abs(v) <= none else f"{v:.3g}" for v in row))
    return shown


def components(values: ArrayLike) -> str:
    """Return the components of a vector in words."""
    return " ".join(f"{value:.3g}" for value in np.asarray(values, float))


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
        self._description, self._unit = description, unit
        self._bar: Progress | None = None
        self._begun = time.monotonic()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def __call__(self, done: float, total: float, description: str | None = None) -> None:
        """Show how much is done, and what is being done if that changed; end what a dropped Ctrl-C did not."""
        if interrupts.CAME:
            raise KeyboardInterrupt
        if self._bar is None:
            if Settings.quiet or not console.is_interactive or time.monotonic() <= self._begun + PATIENCE:
                return
            self._bar = self._started()
        self._bar.update(self._bar.task_ids[0], completed=done, total=max(total, 1), description=description)

    def _started(self) -> "Progress":
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn  # noqa: PLC0415 - slow to load

        columns = [TextColumn("{task.description}"), BarColumn()]
        if self._unit is not None:
            columns.append(TextColumn(f"{{task.completed:.0f}}/{{task.total:.0f}}{self._unit}"))
        bar = Progress(*columns, TimeElapsedColumn(), console=console, transient=True)
        bar.add_task(self._description, total=1)
        bar.start()
        return bar


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


def file_size(path: Path) -> str:
    """Return a file's size in words, in MB or kB."""
    size = path.stat().st_size
    return f"{size / 1e6:.3g} MB" if size >= 1e6 else f"{size / 1e3:.3g} kB"


def refuse_choices(why: str, given: Mapping[str, str | None]) -> None:
    """Refuse options that are given, with why they have no meaning."""
    for option, text in given.items():
        if text is not None:
            raise CommandError(f"{option} is {text!r}, but {why}.", key=option)
