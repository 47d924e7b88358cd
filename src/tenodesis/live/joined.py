"""A script joins the live instrument that runs here, by the folder that only its owner can enter."""

import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from tenodesis.errors import LiveError
from tenodesis.live import folder as folders
from tenodesis.live.client import Client
from tenodesis.live.commands import ControllerRequest
from tenodesis.live.lease import SECONDS
from tenodesis.live.status import RuntimeState, Status
from tenodesis.live.ticks import Reader

_PLACES = (Path("/dev/shm"), Path(tempfile.gettempdir()))
"""Where folders of runtimes are."""
_ENABLED_WITHIN = 60.0
"""Longest wait for a controller that may have to home first, s."""
_FAULT_STANDS = 0.2
"""Wait after which a fault is no longer one that is just being cleared, s."""
_RECORDER_WITHIN = 15.0
"""Longest wait for a recorder to begin or to end, s."""


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

    def request(self, what: ControllerRequest) -> None:
        """Request the controller to enable, disable, pause, resume, home or clear.

        To enable one that is paused, as a script leaves it, is to resume; both return once it is enabled. Raises
        LiveError where it does not come to that, for example by a fault.
        """
        if what == "enable" and self.status().state == RuntimeState.PAUSED:
            what = "resume"
        super().request(what)
        if what in ("enable", "resume"):
            self._wait(lambda now: now.state == RuntimeState.ENABLED, _ENABLED_WITHIN, "come to be enabled")

    def record(self, on: bool, called: str = "live") -> Path | None:
        """Begin to record, and return the file as soon as it is written to; or end the recording and close its file."""
        path = super().record(on, called)
        if path is None:
            self._wait(lambda now: now.recording is None, _RECORDER_WITHIN, "close its recording")
        else:
            self._wait(lambda now: path.exists() or now.recording is None, _RECORDER_WITHIN, "begin to record")
            if not path.exists():
                raise LiveError(self.status().problem or f"{path} is not recorded.", key="path", value=path)
        return path

    def hand(self, angles: ArrayLike) -> None:
        """Move the handle's joints or, without a handle, those at the tip by their motors, to angles, rad.

        Raises LiveError for an angle beyond the handle's range, to which the runtime would limit it.
        """
        joints, wanted = self.inst.handle_joints, np.asarray(angles, float).reshape(-1)
        for joint, angle in zip(joints, wanted, strict=False):
            if abs(angle) > joint.range * (1 + 1e-9):
                raise LiveError(
                    key=f"angles, of {joint.name}",
                    value=float(angle),
                    allowed=f"{joint.range:.4g} rad ({np.degrees(joint.range):.4g} deg) to either side at most",
                )
        super().hand(angles)

    def _wait(self, until: Callable[[Status], bool], longest: float, what: str) -> None:
        """Wait until something is so of the status; raises LiveError after the longest time, s, and at a fault."""
        begun = time.monotonic()
        while not until(now := self.status()):
            waited = time.monotonic() - begun
            stands = now.state == RuntimeState.FAULT and waited > _FAULT_STANDS
            if stands or now.state == RuntimeState.GONE or waited > longest:
                why = now.problem or ", ".join((*now.faults, *now.homing_failures.values()))
                remedy = '; request("clear") first' if now.state == RuntimeState.FAULT else ""
                raise LiveError(
                    f"{self.inst.name} does not {what}: it is {now.state}{f' ({why})' if why else ''}{remedy}.",
                    key="state",
                    value=str(now.state),
                )
            time.sleep(0.02)

    def close(self) -> None:
        """Close the connection; the controller pauses."""
        self._ended.set()
        super().close()

    def __enter__(self) -> Self:
        """Return this."""
        return self

    def __exit__(self, *_: object) -> None:
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
    found = {}
    for place in _PLACES:
        for ring in place.glob(f"tenodesis-*/*/{folders.RING}"):
            try:
                reader = Reader(ring.parent)
            except LiveError:
                continue
            if reader.alive:
                found[ring.parent] = reader.inst.name
    if not found:
        raise LiveError(
            "no live instrument runs here; start one with `tenodesis console`, or give its FOLDER.",
            key="FOLDER",
            allowed="of a live instrument that runs",
        )
    if len(found) > 1:
        named = ", ".join(f"{name} in {folder}" for folder, name in sorted(found.items()))
        raise LiveError(
            f"several live instruments run: {named}; give one as FOLDER.",
            key="FOLDER",
            value=sorted(found),
            allowed="one folder",
        )
    return next(iter(found))
