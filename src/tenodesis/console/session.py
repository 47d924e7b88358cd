"""A browser's session: its connection to the runtime, and the requests of its panel."""

import threading
import time
from collections.abc import Callable, Iterable
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeAlias

from tenodesis.console.assembly import Assembly
from tenodesis.console.display import ShownSignals
from tenodesis.console.log import rare_log
from tenodesis.console.workers import Workers
from tenodesis.errors import Error
from tenodesis.live.commands import RestartableConnection
from tenodesis.live.status import Status

if TYPE_CHECKING:
    import viser

_EXPECTED = (Error, ValueError, OSError)
_SETTLING_TIME = 1.0
"""Time for which a control keeps the value that its browser chose, until the runtime has it, s."""
_PHONE_ASPECT, _PHONE_WIDTH = 0.8, 450
"""Largest ratio of width to height, and largest width in pixels, of a phone's screen."""
_log = rare_log(__name__)

Action: TypeAlias = Callable[[], object]


class PageState(NamedTuple):
    """What the page shows at a tick."""

    status: Status
    shown: ShownSignals
    operating: bool
    """Whether the browser operates the instrument."""


class Folders(NamedTuple):
    """Folders from which the page reads, and the parts that it has read."""

    recordings: Path
    instruments: tuple[Path, ...]
    parts: Assembly | None = None


class PanelSection(Protocol):
    """A section of the panel."""

    def update(self, state: PageState) -> None:
        """Show the state."""
        ...


class RequestQueue:
    """The requests of a browser until the page's next tick: of each kind only the latest."""

    def __init__(self) -> None:
        self._actions: dict[str, Action] = {}
        self._lock = threading.Lock()

    def put(self, kind: str, action: Action) -> None:
        """Add an action for the next tick, replacing an earlier action of its kind."""
        with self._lock:
            self._actions.pop(kind, None)
            self._actions[kind] = action

    def take_all(self) -> list[Action]:
        """Return and remove all actions, in the order in which they were added last."""
        with self._lock:
            actions, self._actions = self._actions, {}
        return list(actions.values())


class Session:
    """A browser's session.

    Parameters
    ----------
    client
        The browser.
    link
        Connection to the runtime, in the browser's name.
    origin
        That name.
    workers
        Run what takes longer than a tick of the page.
    folders
        Folders from which the page reads.
    """

    def __init__(
        self, client: "viser.ClientHandle", link: RestartableConnection, origin: str, workers: Workers, folders: Folders
    ) -> None:
        self.client, self.link, self.origin, self.folders = client, link, origin, folders
        self.requests = RequestQueue()
        camera = client.camera
        self.small = camera.aspect < _PHONE_ASPECT and camera.image_width < _PHONE_WIDTH
        """Whether the screen is a phone's, at first: later, panels make the picture of other screens upright too."""
        self.replaying = False
        """Whether the view shows a recording."""
        self._workers = workers
        self._busy: set[str] = set()
        self._changed: dict[int, float] = {}

    def reset(self) -> None:
        """Forget the controls of the panel, before others are built."""
        self.replaying = False
        self._changed.clear()

    def on(self, handle: Any, kind: str, action: Action) -> None:
        """Run an action at the page's next tick whenever the browser changes or presses a control."""

        async def queue(event: Any) -> None:
            # Events of values that the page itself sets have no client.
            if event.client_id is not None:
                self._changed[id(handle)] = time.monotonic()
                self.requests.put(kind, lambda: self.attempt(action))

        name = next(name for name in ("on_click", "on_upload", "on_update") if hasattr(handle, name))
        getattr(handle, name)(queue)

    def changed_at(self, *handles: Any) -> float:
        """Return when the browser last changed any of these controls, on the monotonic clock, s."""
        return max(self._changed.get(id(handle), -inf) for handle in handles)

    def just_changed(self, *handles: Any) -> bool:
        """Return whether a control was changed so recently that the runtime may not have its value yet."""
        return time.monotonic() - self.changed_at(*handles) < _SETTLING_TIME

    def attempt(self, action: Action) -> None:
        """Run an action, and show the browser its error."""
        try:
            action()
        except _EXPECTED as problem:
            self.notify(str(problem))
        except Exception:
            # A browser may send what its panel does not offer; the page goes on.
            _log.exception("a request of %s failed", self.origin)
            self.notify("The page failed; its log shows where.")

    def is_busy(self, *kinds: str) -> bool:
        """Return whether an action of any of these kinds runs in the background."""
        return not self._busy.isdisjoint(kinds)

    def run_in_background(self, kind: str, action: Action) -> None:
        """Run an action that takes longer than a tick, at most one action of a kind at a time."""
        if kind in self._busy:
            self.notify("This is already in progress.")
            return
        self._busy.add(kind)

        def run() -> None:
            try:
                self.attempt(action)
            finally:
                self._busy.discard(kind)

        self._workers.submit(run)

    def notify(self, text: str, title: str = "That did not work", *, good: bool = False) -> None:
        """Show the browser a message."""
        self.client.add_notification(
            title=title, body=text, color="green" if good else "red", auto_close_seconds=4 if good else 12
        )


def as_plain(text: object) -> str:
    """Return Markdown that shows text literally: names in files come from others, and may hold HTML."""
    return "".join(c if c.isalnum() or c in " ,-" else f"&#{ord(c)};" for c in " ".join(str(text).split()))


def enable(handles: Iterable[Any], enabled: bool) -> None:
    """Enable or disable controls."""
    for handle in handles:
        if handle.disabled == enabled:
            handle.disabled = not enabled


def set_properties(handle: Any, **values: Any) -> None:
    """Set those properties of a control that have changed."""
    for name, value in values.items():
        if getattr(handle, name) != value:
            setattr(handle, name, value)
