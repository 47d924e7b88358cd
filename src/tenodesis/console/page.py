"""The page: its server, its browsers, and the thread that keeps them up to date."""

import ipaddress
import logging
import queue
import secrets
import socket
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tenodesis.console import wire
from tenodesis.console.browser import Browser
from tenodesis.console.access import AccessControl, is_loopback
from tenodesis.console.html import page
from tenodesis.console.link import Connect
from tenodesis.console.plots import ROWS, WINDOW
from tenodesis.console.session import PageState, Session
from tenodesis.console.display import shown_signals
from tenodesis.errors import LiveError
from tenodesis.live.status import Status

if TYPE_CHECKING:
    import viser

FRAMES = 45.0
"""Frames per second that are sent to every browser."""
_STATUS_EVERY = 0.1
_BEAT_EVERY = 0.2
_TAKE_IN_EVERY = 0.5
_PATIENCE = 3.0
"""Time after which a page that does not tick is taken to hang, s."""
_log = logging.getLogger(__name__)


class Page:
    """A page that is being served; a context manager that closes it. Use :func:`serve`."""

    def __init__(self, connect: Connect, *, host: str, port: int, token: str | None, recordings: Path) -> None:
        loopback = is_loopback(host)
        self.token = token or (None if loopback else secrets.token_urlsafe(24))
        """What a browser must show; None where the page is this machine's alone."""
        self._connect, self._recordings = connect, recordings
        self._watch = connect("page")
        self._workers = ThreadPoolExecutor(2, thread_name_prefix="console")
        self._changes: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._browsers: dict[int, Browser] = {}
        self._absent: dict[int, tuple[viser.ClientHandle, str]] = {}
        """Browsers that came while there was no runtime."""
        self._tried = 0.0
        self._closing = threading.Event()
        self._ticked = time.monotonic()
        self.frames = 0
        """Frames sent so far."""
        try:
            door = AccessControl(page(), loopback=loopback, token=self.token, stop=self._stop, alive=self._alive)
            self._server = wire.start(host, port, door)
        except LiveError:
            self._watch.close()
            raise
        self._name = host
        self._server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(31, 95, 168))

        @self._server.on_client_connect
        async def _came(client: "viser.ClientHandle") -> None:
            # Only here is it known on whose behalf the server speaks.
            origin = f"browser {client.client_id} at {wire.newcomer()}"
            self._changes.set_properties(lambda: self._came(client, origin))

        @self._server.on_client_disconnect
        async def _left(client: "viser.ClientHandle") -> None:
            self._changes.set_properties(lambda: self._left(client.client_id))

        self._threads = [
            threading.Thread(target=run, name=f"console {run.__name__}", daemon=True) for run in (self._run, self._beat)
        ]
        for thread in self._threads:
            thread.start()

    @property
    def port(self) -> int:
        """The port."""
        return self._server.get_port()

    @property
    def url(self) -> str:
        """Where to open the page, the token included."""
        name = socket.gethostname() if _everywhere(self._name) else self._name
        name = f"[{name}]" if ":" in name else name
        return f"http://{name}:{self.port}/" + (f"?token={self.token}" if self.token else "")

    def close(self) -> None:
        """Stop serving; whoever operates is let go, which pauses the instrument. A second time does nothing."""
        if self._closing.is_set():
            return
        self._closing.set()
        for thread in self._threads:
            thread.join(timeout=5)
        for number in list(self._browsers):
            self._left(number)
        wire.stop(self._server)
        self._workers.shutdown(wait=True, cancel_futures=True)
        self._watch.close()

    def __enter__(self) -> "Page":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _run(self) -> None:
        """Go on until closed: a tick, and what is left of its time to wait."""
        due = time.monotonic()
        while not self._closing.is_set():
            try:
                self._tick()
            except Exception:
                _log.exception("a tick of the page failed")
                self._closing.wait(0.2)
            due = max(due + 1 / FRAMES, time.monotonic())
            self._closing.wait(due - time.monotonic())

    def _beat(self) -> None:
        """Say for every browser that is there that it is; drawing much must not hold that up, standing still must."""
        while not self._closing.wait(_BEAT_EVERY):
            if not self._alive():
                continue
            for browser in list(self._browsers.values()):
                if browser.operating:
                    browser.session.attempt(browser.session.link.heartbeat)

    def _alive(self) -> bool:
        return time.monotonic() - self._ticked <= _PATIENCE

    def _tick(self) -> None:
        self._ticked = time.monotonic()
        while not self._changes.empty():
            self._changes.get()()
        if not self._browsers and not self._absent:
            return
        due = [browser for browser in self._browsers.values() if browser.wants_history()]
        try:
            status, inst, latest = self._status(), self._watch.inst, self._watch.latest()
            history = self._watch.history(WINDOW, ROWS) if due else None
        except LiveError:
            # While another runtime begins there is none.
            return
        if self._absent and status.state != "GONE":
            self._take_in()
        if not latest:
            return
        seen = shown_signals(inst, latest)
        seconds = None if history is None else shown_signals(inst, history)
        for browser in self._browsers.values():
            try:
                if browser.outdated:
                    browser.build()
                browser.tick(PageState(status, seen, status.operator == browser.session.origin))
                if seconds is not None and browser in due:
                    browser.draw(seconds)
            except LiveError:
                # Another runtime begins just now.
                continue
            except Exception:
                # What goes wrong for one must not take the others' heartbeats.
                _log.exception("%s could not be served", browser.session.origin)
        self.frames += 1

    _asked = 0.0
    _known: Status | None = None

    def _status(self) -> Status:
        """Return the state, which a socket away is dearer than the signals."""
        at = time.monotonic()
        if self._known is None or at - self._asked >= _STATUS_EVERY:
            self._asked, self._known = at, self._watch.status()
        return self._known

    def _came(self, client: "viser.ClientHandle", origin: str) -> None:
        wire.wake_safely(client)
        try:
            link = self._connect(origin)
        except LiveError as problem:
            if client.client_id not in self._absent:
                self._absent[client.client_id] = (client, origin)
                self._offer_restart(client, str(problem))
            return
        self._absent.pop(client.client_id, None)
        browser = Browser(Session(client, link, origin, self._workers, self._recordings))
        self._browsers[client.client_id] = browser
        wire.limit_uploads(client, browser.session.tell)
        # No motor of this world moves: whoever comes first may try at once.
        if link.capabilities.simulated and link.status().operator is None:
            browser.session.attempt(browser.operate)

    def _offer_restart(self, client: "viser.ClientHandle", problem: str) -> None:
        """Show a browser that came while there is no runtime what is wrong, and the way on."""
        gui: Any = client.gui
        told = f"There is no instrument to show; its motors are stopped by their own watchdogs. {problem}"
        gui.add_html(f'<div style="padding:.5em .8em;font-size:.8rem" role="alert">{escape(told)}</div>')
        button = gui.add_button("Start the instrument again", color="orange")
        button.on_click(lambda _: self._workers.submit(self._restart, client))

    def _restart(self, client: "viser.ClientHandle") -> None:
        try:
            self._watch.restart()
        except (LiveError, OSError) as problem:
            client.add_notification(title="That did not work", body=str(problem), color="red")

    def _take_in(self) -> None:
        """Let those in who came while there was no runtime, if there is one now."""
        if time.monotonic() - self._tried >= _TAKE_IN_EVERY:
            self._tried = time.monotonic()
            for client, origin in list(self._absent.values()):
                self._came(client, origin)

    def _left(self, number: int) -> None:
        self._absent.pop(number, None)
        browser = self._browsers.pop(number, None)
        if browser is None:
            return
        link = browser.session.link
        try:
            if link.status().operator == browser.session.origin:
                link.release()
        except LiveError:
            _log.warning("%s left, and could not be taken off", browser.session.origin)
        finally:
            link.close()

    def _stop(self, origin: str) -> str | None:
        """Stop the motors in the name of an origin; return what went wrong, or None."""
        try:
            try:
                link = self._connect(origin)
            except LiveError:
                # Better in the page's name than not at all.
                self._watch.stop()
                return None
            try:
                link.stop()
            finally:
                link.close()
        except (LiveError, OSError) as problem:
            return f"Not stopped: {problem} Switch the motors' supply off."
        return None


def _everywhere(host: str) -> bool:
    """Return whether a host means every address of this machine, which is none to open."""
    try:
        return ipaddress.ip_address(host).is_unspecified
    except ValueError:
        return host == ""


def serve(
    connect: Connect,
    host: str = "127.0.0.1",
    port: int = 8080,
    token: str | None = None,
    *,
    recordings: Path = Path("recordings"),
) -> Page:
    """Serve the page of a live instrument.

    Parameters
    ----------
    connect
        Opens a link to the runtime in somebody's name: one for the page itself, one for every browser.
    host
        Address to listen on. On any but this machine's own, browsers need the token.
    port
        Port; the next free one is taken if it is not.
    token
        The token; by default one is made up where one is needed.
    recordings
        Folder of the recordings.

    Raises
    ------
    LiveError
        There is no such address on this machine, or the runtime cannot be reached.
    """
    return Page(connect, host=host, port=port, token=token, recordings=recordings)
