"""Where commands write: one rule for all of them, and it is tested before the work."""

import json
import os
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import Any

import typer

from tenodesis.errors import CommandError, CommandInterruptedError
from tenodesis.files import atomic_file, locked_file, locked_folder, write_errors

TABLES = {".csv": "a CSV table", ".parquet": "a Parquet table"}
"""Extensions of the tables that a recording is exported to."""
RECORDING = {".mcap": "an MCAP recording"}
FIGURE = {".png": "a figure", ".svg": "a figure", ".pdf": "a figure"}
HEADER = {".h": "a C header"}
URDF = {".urdf": "a URDF file", ".xml": "a URDF file"}
MJCF = {".xml": "a MuJoCo model"}
JSON = {".json": "a JSON file"}
INSTRUMENT = {".toml": "an instrument file"}

WRITTEN: list[Path] = []
"""What this process has written, for the sentence that an interrupt ends in."""


class Outputs:
    """Where a command may write.

    Parameters
    ----------
    inputs
        Files and folders that are read, or names of what is shipped; none is ever written over.
    overwrite
        Whether outputs that exist may be replaced.
    """

    def __init__(self, inputs: Iterable[Path | str], overwrite: bool) -> None:
        self._inputs = [Path(one) for one in inputs if isinstance(one, Path) or Path(one).is_file()]
        self.overwrite = overwrite

    def files(self, **paths: Path | None) -> AbstractContextManager[None]:
        """Do the work that makes files, each given by its option: ``plot_out=path`` for --plot-out; None for none.

        It is refused before it begins if they cannot, or must not, be written. Nobody else who uses this can write them
        meanwhile. A KeyboardInterrupt ends in an error that states what is written.

        Raises
        ------
        CommandError
            An output is an input or inside one, another output, a folder or no regular file, exists and may not be
            replaced, cannot be written, or is being written by somebody else; nothing was done.
        CommandInterruptedError
            The user interrupted the work.
        """
        return self._writing(_by_option(paths), None, (), self.overwrite)

    def folder(
        self,
        folder: Path,
        names: Iterable[str],
        subfolders: Sequence[str] = (),
        *,
        option: str = "--out",
        replace: bool = False,
        **paths: Path | None,
    ) -> AbstractContextManager[None]:
        """Do the work that makes files in a folder, which is made if absent, and others beside it; as :meth:`files`.

        Parameters
        ----------
        folder, names
            The folder, and the files within it.
        subfolders
            Names of folders within it, all of whose files may be written.
        option
            The folder's option.
        replace
            Whether what exists may be replaced without being asked for.
        paths
            Others, each by its option.
        """
        outputs = [*((option, folder / name) for name in names), *_by_option(paths)]
        return self._writing(outputs, folder, subfolders, self.overwrite or replace)

    @contextmanager
    def _writing(
        self, given: Sequence[tuple[str, Path]], folder: Path | None, subfolders: Sequence[str], overwrite: bool
    ) -> Iterator[None]:
        _check_outputs(given, self._inputs, folder, overwrite=overwrite)
        for place in [] if folder is None or overwrite else [folder / name for name in subfolders]:
            if place.is_dir() and any(place.iterdir()):
                raise CommandError(
                    f"{place} exists already; give another path, or --overwrite.",
                    key=given[0][0],
                    value=place,
                    allowed="a path that does not exist, or --overwrite",
                )
        before = {path: _version(path) for _, path in given}
        alone = [path for path in before if folder is None or not path.is_relative_to(folder)]
        with ExitStack() as locks:
            for path in alone if folder is None else [folder, *alone]:
                with write_errors(path, CommandError):
                    try:
                        locks.enter_context(locked_folder(path) if path is folder else locked_file(path))
                    except BlockingIOError:
                        raise CommandError(
                            f"{path} is being written by another command; wait for it, or give another path.",
                            key={one: option for option, one in given}.get(path, given[0][0]),
                            value=path,
                            allowed="written by nobody else",
                        ) from None
            try:
                yield
            except KeyboardInterrupt:
                changed = [path for path in before if _version(path) != before[path]]
                left = ", ".join(str(path) for path in before if path not in changed)
                if not changed:
                    raise CommandInterruptedError(f"interrupted; nothing is written to {folder or left}.") from None
                missing = f"; not written: {left}" if left else ""
                raise CommandInterruptedError(
                    f"interrupted; written: {', '.join(map(str, changed))}{missing}."
                ) from None
            finally:
                WRITTEN.extend(path for path in before if _version(path) != before[path])


def _by_option(paths: Mapping[str, Path | None]) -> list[tuple[str, Path]]:
    return [
        (name if name.isupper() else f"--{name.replace('_', '-')}", path)
        for name, path in paths.items()
        if path is not None
    ]


def written_by_us(numbers: Path, key: str, *, chapters: Sequence[str] = ()) -> bool:
    """Return whether a file has the numbers of a report of ours, by a key that only this kind of report has.

    With chapters, it must be a report of no others.
    """
    try:
        content = json.loads(numbers.read_text("utf-8"))
    except (OSError, ValueError):
        return False
    if not (isinstance(content, dict) and key in content and "tenodesis" in content.get("about", ())):
        return False
    return not chapters or set(content.get("chapters") or ["all"]) <= set(chapters)


def _check_outputs(
    outputs: Iterable[tuple[str, Path]], inputs: Sequence[Path], folder: Path | None, *, overwrite: bool
) -> None:
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
        if path.exists() and not overwrite:
            raise CommandError(f"{path} exists already; give another path, or --overwrite.", key=option, value=path)
        if path.exists() and not os.access(path, os.W_OK):
            raise _refused(option, path, "is read-only; give another path")
        within = folder is not None and path.is_relative_to(folder)
        if not within and not path.parent.exists():
            raise CommandError(f"{path} cannot be written: there is no folder {path.parent}.", key=option, value=path)
        nearest = next(one for one in place.parents if one.exists())
        with (
            write_errors(folder if folder is not None and within else path, CommandError, option),
            tempfile.TemporaryFile(dir=nearest),
        ):
            pass
        taken[place] = option


def _version(path: Path) -> tuple[int, int] | None:
    """Return what changes when a file is written; None if there is none."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_ino, found.st_mtime_ns


def output(kinds: Mapping[str, str], help_: str, *names: str, **settings: Any) -> Any:
    """Return the option of a file that is written, which refuses a path by its extension.

    Parameters
    ----------
    kinds
        What is written, by extension.
    help_, names, settings
        Of the option.
    """

    def check(parameter: typer.CallbackParam, path: Path | None) -> Path | None:
        check_suffix(parameter.opts[0], path, kinds)
        return path

    return typer.Option(*names, help=help_, callback=check, **settings)


def check_suffix(option: str, path: Path | None, kinds: Mapping[str, str]) -> None:
    """Refuse the path of an output by its extension; raises CommandError."""
    if path is None or path.suffix in kinds:
        return
    must = f"must end in {' or '.join(kinds)}"
    written = " or ".join(dict.fromkeys(kinds.values()))
    hint = ""
    if ".mcap" in kinds and path.suffix in TABLES:
        hint = f"; for a table: tenodesis export recording {path.with_suffix('.mcap')} --out {path}"
    raise CommandError(
        f"{path}: {option} writes {written}, whose name {must}{hint}.", key=option, value=path, allowed=must
    )


def _refused(option: str, path: Path, reason: str) -> CommandError:
    return CommandError(f"{option} would write {path}, which {reason}.", key=option, value=path)


def _same_file(path: Path, other: Path) -> bool:
    """Return whether two paths name the same file, hard links included."""
    return path.exists() and other.exists() and path.samefile(other)


def write_text(path: Path, text: str) -> None:
    """Write a file completely or not at all.

    Raises
    ------
    CommandError
        It cannot be written.
    """
    with write_errors(path, CommandError), atomic_file(path) as new:
        new.write_text(text, "utf-8")
