"""One browser: what it sees, what it may do, and what it asks for."""

import logging
import time
from collections.abc import Iterable
from concurrent.futures import Executor
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from tenodesis.console.inbox import Action, Inbox
from tenodesis.console.link import Link
from tenodesis.console.view import View
from tenodesis.errors import DeviceError, InstrumentError, LiveError, NoSolutionError, ProtocolError, RecordingError
from tenodesis.live.status import Status

if TYPE_CHECKING:
    import viser

_EXPECTED = (
    DeviceError,
    InstrumentError,
    LiveError,
    NoSolutionError,
    ProtocolError,
    RecordingError,
    ValueError,
    OSError,
)
_MOMENT = 1.0
"""Time for which a part of the panel keeps to what its browser chose, until what is chosen is so, s."""
_UPRIGHT, _NARROW = 0.8, 450
"""Width by height, and width in pixels, that a phone's picture stays below."""
_log = logging.getLogger(__name__)


class Now(NamedTuple):
    """The state of things at a tick of the page."""

    status: Status
    view: View
    operating: bool
    """Whether the browser operates."""


class Part(Protocol):
    """A part of the panel."""

    def show(self, now: Now) -> None:
        """Show how things stand."""
        ...


class Session:
    """One browser's link, and the ways from its panel to it.

    Parameters
    ----------
    client
        The browser.
    link
        To the runtime, in the browser's name.
    origin
        That name.
    workers
        Do what takes long.
    folder
        Where recordings are.
    """

    def __init__(self, client: "viser.ClientHandle", link: Link, origin: str, workers: Executor, folder: Path) -> None:
        self.client, self.link, self.origin, self.folder = client, link, origin, folder
        self.inbox = Inbox()
        camera = client.camera
        self.small = camera.aspect < _UPRIGHT and camera.image_width < _NARROW
        """Whether the screen is a phone's, as it is at first: later, panels leave an upright picture of others too."""
        self.replaying = False
        """Whether the view is given over to a recording."""
        self._workers = workers
        self._busy: set[str] = set()
        self._chosen: dict[int, float] = {}

    def begin(self) -> None:
        """Forget the panel's parts, in place of which others are built."""
        self.replaying = False
        self._chosen.clear()

    def on(self, handle: Any, kind: str, action: Action) -> None:
        """Do something with the page's next tick whenever the browser changes or presses a part of its panel."""

        async def asked(event: Any) -> None:
            # What the page itself sets has no browser.
            if event.client_id is not None:
                self._chosen[id(handle)] = time.monotonic()
                self.inbox.ask(kind, lambda: self.attempt(action))

        name = next(name for name in ("on_click", "on_upload", "on_update") if hasattr(handle, name))
        getattr(handle, name)(asked)

    def chosen(self, *handles: Any) -> float:
        """Return when the browser last changed one of some parts of its panel, on the monotonic clock, s."""
        return max(self._chosen.get(id(handle), -inf) for handle in handles)

    def keeps(self, *handles: Any) -> bool:
        """Return whether parts of the panel show what the browser has just chosen, which may not be so yet."""
        return time.monotonic() - self.chosen(*handles) < _MOMENT

    def attempt(self, action: Action) -> None:
        """Do something, and say so if it does not work."""
        try:
            action()
        except _EXPECTED as problem:
            self.tell(str(problem))
        except Exception:
            # A browser may send what its panel does not offer; the page goes on.
            _log.exception("what %s asked for failed", self.origin)
            self.tell("The page failed at this; its log says where.")

    def works(self, *kinds: str) -> bool:
        """Return whether something of one of some kinds is being done."""
        return not self._busy.isdisjoint(kinds)

    def work(self, kind: str, action: Action) -> None:
        """Do something that takes long beside the page's ticks, one of a kind at a time."""
        if kind in self._busy:
            self.tell("That is being done already.")
            return
        self._busy.add(kind)

        def done() -> None:
            try:
                self.attempt(action)
            finally:
                self._busy.discard(kind)

        self._workers.submit(done)

    def tell(self, text: str, title: str = "That did not work", *, good: bool = False) -> None:
        """Show the browser a message."""
        self.client.add_notification(
            title=title, body=text, color="green" if good else "red", auto_close_seconds=4 if good else 12
        )


def plain(text: object) -> str:
    """Return text as Markdown that shows it as it is: names in files are others' words, and may hold HTML."""
    return "".join(c if c.isalnum() or c in " ,-" else f"&#{ord(c)};" for c in " ".join(str(text).split()))


def enable(handles: Iterable[Any], allowed: bool) -> None:
    """Let parts of a panel be used, or not."""
    for handle in handles:
        if handle.disabled == allowed:
            handle.disabled = not allowed


def put(handle: Any, **values: Any) -> None:
    """Set properties of a part of a panel that have changed."""
    for name, value in values.items():
        if getattr(handle, name) != value:
            setattr(handle, name, value)
