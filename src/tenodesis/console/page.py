"""The page: its server, its browsers, and the thread that keeps them up to date."""

import ipaddress
import queue
import secrets
import socket
import threading
import time
from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from tenodesis.console import server
from tenodesis.console.access import AccessControl, is_loopback, page_html
from tenodesis.console.assembly import Assembly
from tenodesis.console.browser import Browser
from tenodesis.console.display import shown_signals
from tenodesis.console.incoming import guard
from tenodesis.console.log import rare_log
from tenodesis.console.plots import ROWS, WINDOW
from tenodesis.console.session import Folders, PageState, Session
from tenodesis.console.workers import Workers
from tenodesis.errors import ArgumentError, LiveError
from tenodesis.live.commands import Connect
from tenodesis.live.status import Status

if TYPE_CHECKING:
    import viser

FRAME_RATE = 45.0
"""Frames that are sent to every browser, Hz."""
_STATUS_PERIOD = 0.1  # s
_HEARTBEAT_PERIOD = 0.2  # s
_RETRY_PERIOD = 0.5  # s
_HANGS_AFTER = 3.0
"""Time without a tick after which the page counts as hanging, s."""
_SHORTEST_TOKEN = 16
_log = rare_log(__name__)


class Page:
    """The page while it is served, made by :func:`serve`; a context manager that closes it."""

    def __init__(self, connect: Connect, *, host: str, port: int, token: str | None, folders: Folders) -> None:
        if token is not None and len(token) < _SHORTEST_TOKEN:
            raise ArgumentError(key="token", value=token, allowed=f"at least {_SHORTEST_TOKEN} characters")
        self.token = token or secrets.token_urlsafe(24)
        """Token that a browser must show."""
        self._connect, self._folders = connect, folders
        self._watch = connect("page")
        self._workers = Workers(2)
        self._changes: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._browsers: dict[int, Browser] = {}
        self._waiting: dict[int, tuple[viser.ClientHandle, str]] = {}
        """Browsers that connected while there was no runtime."""
        self._retried = 0.0
        self._closing = threading.Event()
        self._ticked = time.monotonic()
        self.frames = 0
        """Frames sent so far."""
        try:
            access = AccessControl(
                page_html(), loopback=is_loopback(host), token=self.token, stop=self._stop, alive=self._alive
            )
            self._server = server.start(host, port, access)
        except LiveError:
            self._watch.close()
            raise
        self._host = host
        self._server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(31, 95, 168))

        @self._server.on_client_connect
        async def _connected(client: "viser.ClientHandle") -> None:
            # The address is known in this callback only.
            origin = f"browser {client.client_id} at {server.client_address()}"
            self._changes.put(lambda: self._add(client, origin))

        @self._server.on_client_disconnect
        async def _disconnected(client: "viser.ClientHandle") -> None:
            self._changes.put(lambda: self._remove(client.client_id))

        self._threads = [
            threading.Thread(target=run, name=f"console {run.__name__}", daemon=True)
            for run in (self._run, self._send_heartbeats)
        ]
        for thread in self._threads:
            thread.start()

    @property
    def port(self) -> int:
        """The port."""
        return self._server.get_port()

    @property
    def url(self) -> str:
        """Link that opens the page: it contains the token."""
        name = socket.gethostname() if _every_address(self._host) else self._host
        name = f"[{name}]" if ":" in name else name
        return f"http://{name}:{self.port}/?token={quote(self.token)}"

    def close(self) -> None:
        """Stop serving and release the operator, which pauses the instrument; a second call does nothing."""
        if self._closing.is_set():
            return
        self._closing.set()
        for thread in self._threads:
            thread.join(timeout=5)
        for number in list(self._browsers):
            self._remove(number)
        server.stop(self._server)
        self._workers.close()
        self._watch.close()

    def __enter__(self) -> "Page":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _run(self) -> None:
        """Tick at the frame rate until closed."""
        due = time.monotonic()
        while not self._closing.is_set():
            try:
                self._tick()
            except Exception:
                _log.exception("a tick of the page failed")
                self._closing.wait(0.2)
            due = max(due + 1 / FRAME_RATE, time.monotonic())
            self._closing.wait(due - time.monotonic())

    def _send_heartbeats(self) -> None:
        """Send the heartbeat of every operator: long drawing must not delay it, a page that hangs must end it."""
        while not self._closing.wait(_HEARTBEAT_PERIOD):
            if not self._alive():
                continue
            for browser in list(self._browsers.values()):
                if browser.operating:
                    browser.session.attempt(browser.session.link.heartbeat)

    def _alive(self) -> bool:
        return time.monotonic() - self._ticked <= _HANGS_AFTER

    def _tick(self) -> None:
        self._ticked = time.monotonic()
        while not self._changes.empty():
            self._changes.get()()
        if not self._browsers and not self._waiting:
            return
        due = [browser for browser in self._browsers.values() if browser.needs_history()]
        try:
            status, inst, latest = self._status(), self._watch.inst, self._watch.latest()
            history = self._watch.history(WINDOW, ROWS) if due else None
        except LiveError:
            # There is no runtime while another one starts.
            return
        if self._waiting and status.state != "GONE":
            self._retry()
        if not latest:
            return
        shown = shown_signals(inst, latest)
        seconds = None if history is None else shown_signals(inst, history)
        for browser in self._browsers.values():
            try:
                if browser.outdated:
                    browser.build()
                browser.tick(PageState(status, shown, status.operator == browser.session.origin))
                if seconds is not None and browser in due:
                    browser.draw(seconds)
            except LiveError:
                # Another runtime is starting.
                continue
            except Exception:
                # An error of one browser must not end the others' heartbeats.
                _log.exception("%s could not be served", browser.session.origin)
        self.frames += 1

    _status_time = 0.0
    _last_status: Status | None = None

    def _status(self) -> Status:
        """Return the status, at most a period old: it comes through a socket, the signals through shared memory."""
        now = time.monotonic()
        if self._last_status is None or now - self._status_time >= _STATUS_PERIOD:
            self._status_time, self._last_status = now, self._watch.status()
        return self._last_status

    def _add(self, client: "viser.ClientHandle", origin: str) -> None:
        server.make_sending_thread_safe(client)
        try:
            link = self._connect(origin)
        except LiveError as problem:
            if client.client_id not in self._waiting:
                self._waiting[client.client_id] = (client, origin)
                self._offer_restart(client, str(problem))
            return
        self._waiting.pop(client.client_id, None)
        session = Session(client, link, origin, self._workers, self._folders)
        guard(client, lambda: browser.operating, session.notify)
        browser = Browser(session)
        self._browsers[client.client_id] = browser
        # No real motor moves: the first browser may operate at once.
        if link.capabilities.simulated and link.status().operator is None:
            browser.session.attempt(browser.operate)

    def _offer_restart(self, client: "viser.ClientHandle", problem: str) -> None:
        """Report to a browser that there is no runtime, and offer to start it."""
        gui: Any = client.gui
        text = f"There is no instrument to show; its motors are stopped by their own watchdogs. {problem}"
        gui.add_html(f'<div style="padding:.5em .8em;font-size:.8rem" role="alert">{escape(text)}</div>')
        button = gui.add_button("Start the instrument again", color="orange")
        button.on_click(lambda _: self._workers.submit(lambda: self._restart(client)))

    def _restart(self, client: "viser.ClientHandle") -> None:
        try:
            self._watch.restart()
        except (LiveError, OSError) as problem:
            client.add_notification(title="That did not work", body=str(problem), color="red")

    def _retry(self) -> None:
        """Add the browsers that connected while there was no runtime."""
        if time.monotonic() - self._retried >= _RETRY_PERIOD:
            self._retried = time.monotonic()
            for client, origin in list(self._waiting.values()):
                self._add(client, origin)

    def _remove(self, number: int) -> None:
        self._waiting.pop(number, None)
        browser = self._browsers.pop(number, None)
        if browser is None:
            return
        link = browser.session.link
        try:
            if link.status().operator == browser.session.origin:
                link.release()
        except LiveError:
            _log.warning("%s disconnected, but may still be the operator", browser.session.origin)
        finally:
            link.close()

    def _stop(self, origin: str) -> str | None:
        """Stop the motors in the name of an origin; return what went wrong, or None."""
        try:
            self._watch.stop_for(origin)
        except (LiveError, OSError) as problem:
            return f"Not stopped: {problem} Switch the motors' supply off."
        return None


def _every_address(host: str) -> bool:
    """Return whether a host stands for every address of this machine, which no browser can open."""
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
    instruments: Sequence[Path] = (Path(),),
    parts: Assembly | None = None,
) -> Page:
    """Serve the page of a live instrument.

    Parameters
    ----------
    connect
        Opens a connection to the runtime in the name of an origin: one for the page itself, one for every browser.
    host
        Address to listen on.
    port
        Port; the next free one if it is taken.
    token
        The token that browsers need; by default a random one.
    recordings
        Folder of the recordings.
    instruments
        Folders from which browsers may run instrument files; those that are shipped they may in any case.
    parts
        Parts of the instrument, from :func:`load_parts`, to draw instead of plain solids.

    Raises
    ------
    ArgumentError
        The token is too short.
    LiveError
        This machine does not have the address, or the runtime cannot be reached.
    """
    return Page(connect, host=host, port=port, token=token, folders=Folders(recordings, tuple(instruments), parts))
