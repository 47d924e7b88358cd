"""A script joins the live instrument that runs here, by the folder that only its owner can enter."""

import tempfile
import threading
from pathlib import Path
from types import TracebackType
from typing import Self

from tenodesis.errors import LiveError
from tenodesis.live import folder as folders
from tenodesis.live.client import Client
from tenodesis.live.lease import SECONDS
from tenodesis.live.ticks import Reader

_PLACES = (Path("/dev/shm"), Path(tempfile.gettempdir()))
"""Where folders of runtimes are."""


class Joined(Client):
    """A client that operates: it holds the lease, and renews it until it is closed, best as a context."""

    def __init__(self, folder: Path, origin: str, *, force: bool = False) -> None:
        super().__init__(folder, origin)
        self._ended = threading.Event()
        if not self.acquire(force=force):
            operator = self.status().operator
            self.close()
            raise LiveError(
                f"{operator} operates the instrument: release it there, or take it with force=True.",
                key="operator",
                value=operator,
                allowed="none, or force=True",
            )
        threading.Thread(target=self._renew, daemon=True).start()

    def _renew(self) -> None:
        try:
            while not self._ended.wait(SECONDS / 4) and self.heartbeat():
                pass
        except LiveError:
            return  # the next command says so

    def close(self) -> None:
        """Close the connection; the controller pauses."""
        self._ended.set()
        super().close()

    def __enter__(self) -> Self:
        """Return this."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Close the connection."""
        self.close()


def connect(folder: str | Path | None = None, origin: str = "script", *, force: bool = False) -> Joined:
    """Join a live instrument, such as that of ``tenodesis console``, and operate it.

    Parameters
    ----------
    folder
        Folder of the runtime; by default that of the only runtime of this user. Its files are the key: only their owner
        can enter.
    origin
        Name in events and on the page.
    force
        Take over from another operator.

    Raises
    ------
    LiveError
        None runs, several do, or another operates it.
    """
    return Joined(running() if folder is None else Path(folder), origin, force=force)


def running() -> Path:
    """Return the folder of the only runtime that this user runs; raises LiveError if there is none, or another."""
    found = []
    for place in _PLACES:
        for ring in place.glob(f"tenodesis-*/*/{folders.RING}"):
            try:
                if Reader(ring.parent).alive:
                    found.append(ring.parent)
            except LiveError:
                continue
    if not found:
        raise LiveError(
            "no live instrument runs here; start one with `tenodesis console`, or give its FOLDER.",
            key="FOLDER",
            allowed="of a live instrument that runs",
        )
    if found[1:]:
        raise LiveError(
            f"several live instruments run: {', '.join(map(str, sorted(found)))}; give one as FOLDER.",
            key="FOLDER",
            value=sorted(found),
            allowed="one folder",
        )
    return found[0]
