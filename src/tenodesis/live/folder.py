"""The folder of a live runtime: its files, and the file that describes the runtime."""

import json
import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from tenodesis.errors import LiveError
from tenodesis.extras import require_live
from tenodesis.files import atomic_file
from tenodesis.instrument import Instrument, as_instrument

# Every part of the live runtime that needs the C++ module's imports this module.
require_live()

import fcntl  # noqa: E402 - Windows has none

Columns: TypeAlias = Sequence[tuple[str, int]]
"""Names of columns, and how many each has."""

RING = "ring"
"""The ticks, in shared memory."""
SOCKET = "control.sock"
"""Socket that accepts commands."""
INSTRUMENT = "instrument.toml"
LOCK = "lock"
"""Held in the folder around those of a host's runtimes by every process that works in them."""
_LINK = "link"
_SESSION = "session.json"


class About(NamedTuple):
    """The description of a runtime."""

    inst: Instrument
    device: str
    period: float
    """Between ticks, s."""
    simulated: bool
    distal_encoder: bool
    started: str
    """Time and date, ISO 8601."""
    pid: int
    commands: Columns
    """Columns of its device's commands."""
    signals: Columns
    """Columns of its device's signals."""


def write(folder: Path, about: About) -> None:
    """Write the description of a runtime; the instrument file is in the folder already.

    Raises
    ------
    OSError
        The folder cannot be written.
    """
    content: dict[str, Any] = about._asdict()
    del content["inst"]
    with atomic_file(folder / _SESSION) as new:
        new.write_text(json.dumps(content, indent=2), "utf-8")


def read(folder: Path) -> About:
    """Return the description of the runtime of a folder.

    Raises
    ------
    LiveError
        It is no such folder.
    """
    try:
        content = json.loads((folder / _SESSION).read_text("utf-8"))
        return About(as_instrument(folder / INSTRUMENT), **content)
    except (OSError, ValueError, TypeError) as problem:
        raise LiveError(
            f"{folder} is no folder of a live instrument ({problem}); start one with `tenodesis console`.",
            key="folder",
            value=folder,
            allowed="the folder of a live instrument",
        ) from None


def write_link(home: Path, url: str, page: str) -> Path:
    """Write the link to the page of a host for tools of the same user, and a page that opens it; return the latter.

    The link contains a token, which the arguments of a program that opens it would show to every account.
    """
    for name, text in ((_LINK, url), (f"{_LINK}.html", page)):
        with atomic_file(home / name) as new, os.fdopen(os.open(new, os.O_WRONLY | os.O_CREAT, 0o600), "w") as file:
            file.write(text)
    return home / f"{_LINK}.html"


def read_link(home: Path) -> str | None:
    """Return the link to the page of a host, or None if it has no page."""
    try:
        return (home / _LINK).read_text("utf-8")
    except OSError:
        return None


def hold(home: Path) -> int | None:
    """Return a descriptor that holds a host's folder in use until it is closed, also in processes that inherit it.

    A lock of the file system is seen from every namespace of processes, in which the numbers of processes differ.
    None where the folder has no lock.
    """
    try:
        lock = os.open(home / LOCK, os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        return None
    fcntl.flock(lock, fcntl.LOCK_SH)
    return lock


def make_lock(home: Path) -> int:
    """Make the lock of a host's folder, and return a descriptor that holds it as :func:`hold` does."""
    made = home / f"{LOCK}.new"
    lock = os.open(made, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
    fcntl.flock(lock, fcntl.LOCK_SH)
    # Under its name it is held from the first moment on.
    made.rename(home / LOCK)
    return lock


def is_left(home: Path) -> bool:
    """Return whether a folder is a host's in which no process works any more."""
    try:
        lock = os.open(home / LOCK, os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    else:
        return True
    finally:
        with suppress(OSError):
            os.close(lock)
