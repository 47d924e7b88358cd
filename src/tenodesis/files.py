"""Files: read if they are regular, and written atomically, first to a temporary place, then moved."""

import errno
import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from tenodesis.errors import Error

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]


def read_regular(path: Path, most: int | None = None) -> bytes:
    """Return the content of a regular file: a device or a pipe may never end, and to open it may act on it.

    Parameters
    ----------
    path
        The file.
    most
        Largest size, bytes; None for any.

    Raises
    ------
    OSError
        It cannot be read, is no regular file, or is larger; `strerror` states which.
    """
    file, size = open_regular(path)
    with file:
        if most is not None and size > most:
            raise OSError(errno.EFBIG, f"it has {size / 1e6:.3g} MB, more than {most / 1e6:g} MB", str(path))
        return file.read(size)


def as_text(content: bytes, name: object, error: type[Error], kind: str, key: str = "file") -> str:
    """Return content as text, or raise an error about a file that is no UTF-8 text and must be of a kind."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise error(f"{name} is not UTF-8 text; it must be {kind}.", key=key, value=str(name), allowed=kind) from None


def open_regular(path: Path) -> tuple[IO[bytes], int]:
    """Return a regular file, open to be read, and its size, bytes; raises as :func:`read_regular`."""
    _refuse_irregular(path, path.stat().st_mode)
    file = os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb")
    found = os.fstat(file.fileno())
    try:
        _refuse_irregular(path, found.st_mode)
    except OSError:
        file.close()
        raise
    return file, found.st_size


def _refuse_irregular(path: Path, mode: int) -> None:
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, "it is no regular file", str(path))


@contextmanager
def write_errors(path: Path, error: type[Error], key: str = "path") -> Iterator[None]:
    """Raise an error of the operating system on writing a path as an error of this package."""
    try:
        yield
    except OSError as problem:
        raise error(f"{path} cannot be written: {problem.strerror or problem}.", key=key, value=path) from problem


@contextmanager
def locked_folder(folder: Path) -> Iterator[None]:
    """Make a folder, and keep others who lock it out of it; delete it in the end if it was made and nothing is in it.

    The lock ends with its process. Where the system or the file system has no locks, there is none.

    Raises
    ------
    BlockingIOError
        Somebody else has it.
    OSError
        It cannot be made or read.
    """
    made = [place for place in (folder, *folder.parents) if not place.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    descriptor = None
    try:
        if fcntl is not None:
            descriptor = os.open(folder, os.O_RDONLY)
            _flock(descriptor)
        yield
    finally:
        with suppress(OSError):
            for place in made:
                place.rmdir()
        if descriptor is not None:
            os.close(descriptor)


@contextmanager
def locked_file(path: Path) -> Iterator[None]:
    """Keep others who lock the path of a file from writing it, by a hidden file beside it, as :func:`locked_folder`."""
    if fcntl is None:
        yield
        return
    lock = path.with_name(f".{path.name}.lock")
    descriptor = _lock_file(lock)
    try:
        yield
    finally:
        lock.unlink(missing_ok=True)
        os.close(descriptor)


def _lock_file(lock: Path) -> int:
    """Return the descriptor of a file that is locked, and still has that path."""
    while True:
        descriptor = os.open(lock, os.O_RDWR | os.O_CREAT, 0o600)
        try:
            _flock(descriptor)
            if lock.exists() and os.path.samestat(os.fstat(descriptor), lock.stat()):
                return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)


def _flock(descriptor: int) -> None:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError:
        pass  # A network's file system may have no locks.


@contextmanager
def atomic_files(folder: Path, *, last: str = "") -> Iterator[Path]:
    """Yield a temporary folder to write files to, and move them to their folder at the end; its other files stay.

    Parameters
    ----------
    folder
        Where the files go; made if absent. Files in subfolders go to subfolders of the same names.
    last
        Name of the file that is moved last: once it is there, all others are.

    Raises
    ------
    OSError
        The folder cannot be written, or holds a device or pipe by the name of a file. What fails before the first file
        is moved leaves the folder unchanged.
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
def atomic_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path to write a file to, and move the file to its path at the end.

    Raises
    ------
    OSError
        The folder cannot be written, or the path is a device or pipe; the path is unchanged then.
    """
    _check_regular(path)
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".tenodesis-") as name:
        new = Path(name) / path.name
        yield new
        new.replace(path)


def _check_regular(path: Path) -> None:
    """Raise OSError for a path to replace that is a device, a pipe or a socket."""
    if path.exists() and not path.is_file() and not path.is_dir():
        raise OSError(f"{path} is no regular file; it must be the path of a file")
