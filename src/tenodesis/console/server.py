"""The page's server: the viewer's own, behind the access control, with its limits."""

import asyncio
import contextlib
import contextvars
import io
import socket
import threading
import warnings
from collections.abc import Awaitable, Callable, Iterator
from typing import TYPE_CHECKING, Any

from websockets.asyncio import server as websockets
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from tenodesis.console.access import AccessControl, ProcessRequest
from tenodesis.console.incoming import LARGEST_MESSAGE, filter_messages
from tenodesis.console.log import connection_log
from tenodesis.errors import LiveError

if TYPE_CHECKING:
    from viser import ClientHandle, ViserServer

MOST_CLIENTS = 12
"""Browsers at a time; more would take processor time that the loop needs."""
_MOST_SILENT = 64
"""Connections at a time that have sent no request yet."""
_LIMITS = {
    # A browser that has gone without closing its connection is noticed within the sum, and another timeout, s.
    "ping_interval": 1.0,
    "ping_timeout": 1.5,
    "close_timeout": 1.5,
    "max_size": LARGEST_MESSAGE,
    "max_queue": 4,
}
"""Of every connection; sizes in bytes."""

_CLIENT_ADDRESS: contextvars.ContextVar[str] = contextvars.ContextVar("client_address", default="unknown")
_STARTING = threading.Lock()


def client_address() -> str:
    """Return address and port of the browser for which a callback of the server runs."""
    return _CLIENT_ADDRESS.get()


def start(host: str, port: int, access: AccessControl) -> "ViserServer":
    """Start the page's server behind the access control.

    Raises
    ------
    LiveError
        This machine does not have the address.
    """
    from viser import ViserServer  # noqa: PLC0415 - takes half a second

    _check_address(host)
    # It is normal that a browser disconnects while the page draws for it.
    warnings.filterwarnings("ignore", message="Queued a .* on a closed connection")
    # The library would print addresses of its own, which lack the token.
    with _behind(access), contextlib.redirect_stdout(io.StringIO()):
        server = ViserServer(host=host, port=port, label="Tenodesis", verbose=False)
    # Any browser could ask it to publish the page on the internet, past the access control.
    server.request_share_url = lambda verbose=True: None  # type: ignore[method-assign]
    return server


def stop(server: "ViserServer") -> None:
    """Stop the page's server."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


class LoopOnlyEvent(asyncio.Event):
    """An event that ignores other threads: set by another thread as the loop starts to wait, it might not wake it."""

    def set(self) -> None:
        """Set it, if this is the thread of the event loop."""
        try:
            asyncio.get_running_loop()
        except RuntimeError:
            return
        super().set()


def make_sending_thread_safe(client: "ClientHandle") -> None:
    """Let the server notice what another thread sends to a browser.

    The library sets its event twice, from the thread that sends and then from the event loop; the first is not thread
    safe, and could leave a browser without updates for ever. The library offers no other event.
    """
    buffer: Any = client.gui._websock_interface.get_message_buffer()
    buffer.message_event.__class__ = LoopOnlyEvent


def _check_address(host: str) -> None:
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.bind(address)
    except OSError as problem:
        raise LiveError(
            f"host is {host!r}: {problem.strerror or problem}; it must be an address of this machine, such as "
            "127.0.0.1 or 0.0.0.0.",
            key="host",
            value=host,
        ) from None


def _yielding(silent: dict[ServerConnection, None]) -> type[ServerConnection]:
    """Return a kind of connection that gives its place to a later one while it is silent.

    Anybody can open connections and send nothing; they must not take the place of one that stops the motors.
    """

    class Yielding(ServerConnection):
        def connection_made(self, transport: Any) -> None:
            while len(silent) >= _MOST_SILENT:
                oldest = next(iter(silent))
                del silent[oldest]
                oldest.transport.abort()
            silent[self] = None
            super().connection_made(transport)

        def connection_lost(self, exc: Exception | None) -> None:
            silent.pop(self, None)
            super().connection_lost(exc)

    return Yielding


@contextlib.contextmanager
def _behind(access: AccessControl) -> Iterator[None]:
    """Put the access control before the server that is started within.

    The viewer starts its WebSocket server itself and offers no place for a check of requests. A proxy in front of it
    would leave the viewer's own port open to every program of this machine and to pages of other sites.
    """
    serve: Any = websockets.serve
    connected = 0

    def guarded(
        handler: Callable[[ServerConnection], Awaitable[None]],
        *where: Any,
        process_request: ProcessRequest,
        **settings: Any,
    ) -> Any:
        async def handle(connection: ServerConnection) -> None:
            nonlocal connected
            if connected >= MOST_CLIENTS:
                await connection.close(1013, "too many browsers")
                return
            connected += 1
            try:
                address: Any = connection.remote_address
                _CLIENT_ADDRESS.set(f"{address[0]}:{address[1]}" if address else "unknown")
                filter_messages(connection)
                await handler(connection)
            finally:
                connected -= 1

        async def check(connection: ServerConnection, request: Request) -> Response | None:
            silent.pop(connection, None)
            return await access.answer(connection, request, process_request)

        silent: dict[ServerConnection, None] = {}
        kind = _yielding(silent)
        own = {"process_request": check, "logger": connection_log(), "create_connection": kind}
        return serve(handle, *where, **(settings | _LIMITS | own))

    with _STARTING:
        websockets.serve = guarded  # type: ignore[assignment,misc]
        try:
            yield
        finally:
            websockets.serve = serve  # type: ignore[misc]
