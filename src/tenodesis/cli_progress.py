"""A progress bar that shows itself once a command takes long."""

import time
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

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
