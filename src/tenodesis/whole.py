"""Files written whole or not at all: beside their place first, and moved there when all of it stands."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def together(folder: Path, *, last: str = "") -> Iterator[Path]:
    """Give a folder to write files to, and move them into another one at the end; what else is there stays.

    Parameters
    ----------
    folder
        Where to; made if absent. Files in folders of their own go into folders of the same names.
    last
        Name of the file that is moved last: where it stands, all that it was made with stands too.

    Raises
    ------
    OSError
        The folder cannot be written, or holds a device or pipe of a file's name; before the first file is moved, what
        was there is as it was.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder, prefix=".tenodesis-") as name:
        new = Path(name)
        yield new
        files = sorted(path.relative_to(new) for path in new.rglob("*") if path.is_file())
        for file in files:
            _check_regular(folder / file)
        for file in sorted(files, key=lambda path: path.name == last):
            (folder / file).parent.mkdir(exist_ok=True)
            (new / file).replace(folder / file)


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Give a place beside a path to write a file to, and move it to the path at the end.

    Raises
    ------
    OSError
        The folder cannot be written, or the path is a device or pipe; what was there is as it was.
    """
    _check_regular(path)
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".tenodesis-") as name:
        new = Path(name) / path.name
        yield new
        new.replace(path)


def _check_regular(path: Path) -> None:
    """Refuse what is there and would be replaced, but is no file: a device, a pipe or a socket."""
    if path.exists() and not path.is_file() and not path.is_dir():
        raise OSError(f"{path} is no regular file; allowed is the path of a file")
