"""The server of the page with a door in front of it."""

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

from tenodesis.console.door import Door, Inner
from tenodesis.errors import LiveError

if TYPE_CHECKING:
    from viser import ViserServer

MOST_CLIENTS = 12
"""Browsers at a time; more would take the loop's time from those that are there."""

# A browser that has gone without a word is noticed within the sum, and another wait.
_PING_EVERY = 1.0
_PING_WAIT = 1.5
_LARGEST_MESSAGE = 4 * 2**20

_NEWCOMER: contextvars.ContextVar[str] = contextvars.ContextVar("newcomer", default="unknown")
_PATCHING = threading.Lock()


def newcomer() -> str:
    """Return address and port of the browser on whose behalf a callback of the server's runs."""
    return _NEWCOMER.get()


def start(host: str, port: int, door: Door) -> "ViserServer":
    """Start the page's server behind a door.

    Raises
    ------
    LiveError
        There is no such address on this machine.
    """
    from viser import ViserServer  # noqa: PLC0415 - takes half a second

    _refuse_foreign(host)
    # A browser that goes while it is being drawn for is no news.
    warnings.filterwarnings("ignore", message="Queued a .* on a closed connection")
    # The library would print addresses of its own, which lack the token.
    with _guarded(door), contextlib.redirect_stdout(io.StringIO()):
        server = ViserServer(host=host, port=port, label="Tenodesis", verbose=False)
    # It can put the page on the internet at the wish of any browser, past the door.
    server.request_share_url = _share_nothing  # type: ignore[method-assign]
    return server


def stop(server: "ViserServer") -> None:
    """Stop the page's server."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


def _share_nothing(verbose: bool = True) -> None:
    """Share nothing."""


def _refuse_foreign(host: str) -> None:
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.bind(address)
    except OSError as problem:
        raise LiveError(
            f"host is {host!r}: {problem.strerror or problem}; allowed is an address of this machine, such as "
            "127.0.0.1 or 0.0.0.0."
        ) from None


@contextlib.contextmanager
def _guarded(door: Door) -> Iterator[None]:
    """Put the door before the server that is started within; the library has no place of its own for one."""
    serve: Any = websockets.serve
    inside = 0

    def guarded(
        handler: Callable[[ServerConnection], Awaitable[None]], *where: Any, process_request: Inner, **settings: Any
    ) -> Any:
        async def handled(connection: ServerConnection) -> None:
            nonlocal inside
            if inside >= MOST_CLIENTS:
                await connection.close(1013, "too many browsers")
                return
            inside += 1
            try:
                address: Any = connection.remote_address
                _NEWCOMER.set(f"{address[0]}:{address[1]}" if address else "unknown")
                await handler(connection)
            finally:
                inside -= 1

        async def asked(connection: ServerConnection, request: Request) -> Response | None:
            return await door.answer(connection, request, process_request)

        limits = {
            "ping_interval": _PING_EVERY,
            "ping_timeout": _PING_WAIT,
            "close_timeout": _PING_WAIT,
            "max_size": _LARGEST_MESSAGE,
        }
        return serve(handled, *where, process_request=asked, **(settings | limits))

    with _PATCHING:
        websockets.serve = guarded  # type: ignore[assignment,misc]
        try:
            yield
        finally:
            websockets.serve = serve  # type: ignore[misc]
