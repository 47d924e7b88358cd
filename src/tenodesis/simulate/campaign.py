"""Campaigns: a trial over many cases, in parallel and resumable, and its outcomes as rows and as tables.

A trial is a function that takes the values of a case by name and returns metrics by name; case and metrics together
are a row::

    def trial(friction, seed):
        run = tn.twin.Twin(inst, seed=seed).run(handle, force, controller=Controller(known(friction)))
        return {"final": np.degrees(run["output_angle"][-1])}

    rows = campaign.run(trial, campaign.cases(friction=(0.7, 1.0, 1.3), seed=range(20)), results="trials.json")
    print(campaign.table(rows.by("friction"), [campaign.Column("final, RMS", "final", campaign.rms)]))
"""

import json
import os
import signal
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Literal, Protocol, TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from tenodesis.errors import FaultWarning, NoSolutionError, StudyError
from tenodesis.files import atomic_file, locked_file, read_regular, write_errors
from tenodesis.magnitude import rms
from tenodesis.run import Array
from tenodesis.threads import set_threads, threads
from tenodesis.version import __version__

__all__ = ["Column", "Rows", "cases", "farthest", "names", "rms", "run", "table", "verdict"]

Case: TypeAlias = Mapping[str, Any]
Trial: TypeAlias = Callable[..., Mapping[str, Any] | None]


class SharedOut(Protocol):
    """What cases are shared out over, such as a :class:`tenodesis.cluster.Cluster`."""

    def stream(
        self, function: Callable[[Any, Any], Any], shared: Any, chunks: Sequence[Any], sizes: Sequence[int]
    ) -> Iterator[tuple[int, Any]]:
        """Yield the number of each chunk and the function of what all share and of it, as they are done."""


SCHEMA = 1
"""Version of the layout of a file of results."""
_SAVED_EVERY = 5.0
"""Time between two savings of the results, s."""
_WORST = 3
"""Rows that a verdict names."""
_OF_ALGEBRA = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables from which libraries of linear algebra read, when they are loaded, how many threads they may use."""


class Rows(Sequence[dict[str, Any]]):
    """Rows of a campaign: ``rows[3]`` is a case with its metrics, ``rows["final"]`` the values of a column."""

    def __init__(self, rows: Iterable[Mapping[str, Any]] = ()) -> None:
        self._rows = [dict(row) for row in rows]

    def __len__(self) -> int:
        return len(self._rows)

    def __iter__(self) -> Iterator[dict[str, Any]]:
        return iter(self._rows)

    @overload
    def __getitem__(self, key: int) -> dict[str, Any]: ...
    @overload
    def __getitem__(self, key: slice) -> "Rows": ...
    @overload
    def __getitem__(self, key: str) -> Array: ...
    def __getitem__(self, key: int | slice | str) -> Any:
        if isinstance(key, str):
            return np.array([row[key] for row in self._rows])
        return Rows(self._rows[key]) if isinstance(key, slice) else self._rows[key]

    def where(self, **values: Any) -> "Rows":
        """Return the rows that have these values."""
        return Rows(row for row in self._rows if all(row[key] == value for key, value in values.items()))

    def by(self, *keys: str) -> dict[Any, "Rows"]:
        """Return the rows by the values that they have of a column, or of several, in the order of the rows."""
        groups: dict[Any, list[dict[str, Any]]] = {}
        for row in self._rows:
            groups.setdefault(row[keys[0]] if len(keys) == 1 else tuple(row[key] for key in keys), []).append(row)
        return {value: Rows(group) for value, group in groups.items()}


def cases(**axes: Iterable[Any]) -> list[dict[str, Any]]:
    """Return every combination of values, each a case by name; the last name changes fastest."""
    return [dict(zip(axes, values, strict=True)) for values in product(*axes.values())]


def run(
    trial: Trial,
    given: Iterable[Case],
    title: str = "",
    *,
    results: str | Path | None = None,
    on: Literal["processes", "threads"] | SharedOut = "processes",
    progress: Callable[[int, int], None] | None = None,
    size: int = 1,
) -> Rows:
    """Return a row for each case, in the cases' order; one that the joints cannot hold, or without metrics, has none.

    Parameters
    ----------
    trial
        A function of a case's values by name, which returns metrics by name or None; for processes and clusters of a
        module that can be imported. It computes with a single thread, and is not warned of controllers' faults.
    given
        The cases.
    title
        Of a progress bar on the terminal; without one there is no bar.
    results
        JSON file of the rows, written every few seconds and when the campaign ends or is stopped, whole or not at all.
        What it has of these cases is not run again. Values of cases and metrics must be text, numbers, or lists.
    on
        What the cases are shared out over: processes or threads of this machine, as many as
        :func:`tenodesis.set_threads` says, a Ray cluster, or another object with its method ``stream``.
    progress
        Called with how many cases are done, and of how many.
    size
        What a case adds to the share of the cluster's node that has run it.

    Raises
    ------
    StudyError
        The file of results is that of another trial or version, cannot be read or written, or is in use.
    """
    todo = [dict(case) for case in given]
    path = None if results is None else Path(results)
    with ExitStack() as stack:
        if path is not None:
            with write_errors(path, StudyError, "results"):
                try:
                    stack.enter_context(locked_file(path))
                except BlockingIOError:
                    raise StudyError(
                        f"{path} is being written by another campaign; give another file.", key="path", value=path
                    ) from None
        store = _Store(path, f"{trial.__module__}.{getattr(trial, '__qualname__', trial)}")
        # A file that cannot be written is reported before hours of work, not after them.
        store.save()
        stack.callback(store.save)
        bar = stack.enter_context(_bar(title))
        keys = map(_key, todo) if store.rows else ()
        found = {n: store.rows[key] for n, key in enumerate(keys) if key in store.rows}
        for n, metrics in _outcomes(trial, {n: case for n, case in enumerate(todo) if n not in found}, on, size):
            found[n] = store.keep(todo[n], metrics)
            for tell in filter(None, (bar, progress)):
                tell(len(found), len(todo))
    return Rows({**todo[n], **metrics} for n, metrics in sorted(found.items()) if metrics is not None)


def _outcomes(
    trial: Trial, todo: Mapping[int, Case], on: Any, size: int
) -> Iterator[tuple[int, Mapping[str, Any] | None]]:
    """Yield the metrics of cases by their numbers, as they are done."""
    if not isinstance(on, str):
        numbers = list(todo)
        for n, metrics in on.stream(_tried, trial, list(todo.values()), [size] * len(todo)):
            yield numbers[n], metrics
        return
    count = min(threads(), max(len(todo), 1))
    processes = on == "processes"
    pool = ProcessPoolExecutor(count, get_context("spawn"), _alone) if processes else ThreadPoolExecutor(count)
    with pool, warnings.catch_warnings():
        warnings.simplefilter("ignore", FaultWarning)
        work: dict[Future[Mapping[str, Any] | None], int] = {}
        try:
            with _single_threads() if processes else nullcontext():
                work = {pool.submit(_tried, trial, case): n for n, case in todo.items()}
            for done in as_completed(work):
                yield work[done], done.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


@contextmanager
def _single_threads() -> Iterator[None]:
    """Begin processes whose linear algebra computes with a single thread, unless the environment says otherwise."""
    own = [name for name in _OF_ALGEBRA if name not in os.environ]
    os.environ.update(dict.fromkeys(own, "1"))
    try:
        yield
    finally:
        for name in own:
            os.environ.pop(name, None)


def _tried(trial: Trial, case: Case) -> Mapping[str, Any] | None:
    try:
        return trial(**case)
    except NoSolutionError:
        return None
    except Exception as problem:
        problem.add_note(f"In the case {dict(case)}.")
        raise


def _alone() -> None:
    """Prepare a process that computes with a single thread, and that Ctrl-C stops by the one that began it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    set_threads(1)
    warnings.simplefilter("ignore", FaultWarning)


class _Store:
    """The file of results, or nothing."""

    def __init__(self, path: Path | None, trial: str) -> None:
        self.path, self.saved = path, time.monotonic()
        self.head = {"schema": SCHEMA, "version": __version__, "trial": trial}
        self.rows: dict[str, Mapping[str, Any] | None] = {}
        if path is None or not path.exists():
            return
        try:
            content = json.loads(read_regular(path))
            head, rows = {key: content[key] for key in self.head}, content["rows"]
            self.rows = {_key(case): metrics for case, metrics in rows}
        except (OSError, ValueError, KeyError, TypeError) as problem:
            raise StudyError(f"{path} cannot be read as results of a campaign: {problem}.", key="results") from None
        for key, value in self.head.items():
            if head[key] != value:
                raise StudyError(
                    f"{path} has results with {key} {head[key]}, this campaign {value}; give another file.",
                    key="results",
                    value=str(path),
                )

    def keep(self, case: Case, metrics: Mapping[str, Any] | None) -> Mapping[str, Any] | None:
        """Return metrics as the file has them, and keep them."""
        if self.path is None:
            return metrics
        kept: Mapping[str, Any] | None = json.loads(_key(metrics))
        self.rows[_key(case)] = kept
        if time.monotonic() > self.saved + _SAVED_EVERY:
            self.save()
        return kept

    def save(self) -> None:
        """Write the file, whole or not at all."""
        if self.path is None:
            return
        rows = [[json.loads(case), metrics] for case, metrics in self.rows.items()]
        with write_errors(self.path, StudyError, "results"), atomic_file(self.path) as new:
            new.write_text(json.dumps(self.head | {"rows": rows}), "utf-8")
        self.saved = time.monotonic()


def _key(values: Any) -> str:
    return json.dumps(values, default=lambda value: np.asarray(value).tolist())


@contextmanager
def _bar(title: str) -> Iterator[Callable[[int, int], None]]:
    """Yield what a progress bar is told: how much is done, and of how much; it is shown on a terminal, with a title."""
    terminal = Console(stderr=True)
    parts = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()
    shown = bool(title) and terminal.is_interactive
    with Progress(
        *parts, TimeElapsedColumn(), TimeRemainingColumn(), console=terminal, transient=True, disable=not shown
    ) as bar:
        task = bar.add_task(title)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def farthest(values: ArrayLike) -> float:
    """Return the largest size."""
    return float(np.abs(values).max())


def names(values: Iterable[Iterable[str]]) -> str:
    """Return all names of a column of lists of names, each once."""
    return ", ".join(dict.fromkeys(name for row in values for name in row))


@dataclass(frozen=True)
class Column:
    """A column of a table: a statistic of a column of rows, or a function of rows."""

    heading: str
    of: str | Callable[[Rows], Any]
    """Name of a column of the rows, or what computes the value from the rows"""
    statistic: Callable[[Any], Any] = np.mean
    """Of the values of the column"""
    form: str = ".2f"
    """As :func:`format` takes it, of numbers; empty for a column of text"""

    def value(self, rows: Rows) -> Any:
        """Return the statistic of rows."""
        return self.of(rows) if callable(self.of) else self.statistic([row[self.of] for row in rows])

    def cell(self, rows: Rows) -> str:
        """Return the statistic of rows as text."""
        value = self.value(rows)
        return value if isinstance(value, str) else format(value, self.form)


def table(groups: Mapping[Any, Rows], columns: Sequence[Column], heading: str | Sequence[str] = "") -> str:
    """Return a table of text: a line for each group of rows, after its label or the parts of it."""
    parts = 1 if isinstance(heading, str) else len(heading)
    lines = [[*([heading] if isinstance(heading, str) else heading), *(one.heading for one in columns)]]
    for label, rows in groups.items():
        shown = map(str, label) if isinstance(label, tuple) and parts > 1 else [str(label)]
        lines.append([*shown, *(one.cell(rows) for one in columns)])
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    aligned = [str.ljust] * parts + [str.rjust if one.form else str.ljust for one in columns]
    return "\n".join(
        "  ".join(f(cell, n) for f, cell, n in zip(aligned, line, widths, strict=True)).rstrip() for line in lines
    )


def verdict(target: str, rows: Rows, excess: str | Callable[[Mapping[str, Any]], float], most: float = 0.0) -> str:
    """Return how many rows have an excess beyond a target, reached if none has, and the worst by their words."""

    def size(row: Mapping[str, Any]) -> float:
        return float(row[excess] if isinstance(excess, str) else excess(row))

    beyond = sorted((row for row in rows if size(row) > most), key=size, reverse=True)
    found = [f"  {target}: {len(beyond)} of {len(rows)}   target 0   {'MISSED' if beyond else 'reached'}"]
    return "\n".join(found + [f"    {size(row):+.2f}: {row['words']}" for row in beyond[:_WORST] if "words" in row])
