"""The server of the page with a door in front of it."""

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

from tenodesis.console.door import Door, Inner
from tenodesis.errors import LiveError

if TYPE_CHECKING:
    from viser import ClientHandle, ViserServer

MOST_CLIENTS = 12
"""Browsers at a time; more would take the loop's time from those that are there."""

# A browser that has gone without a word is noticed within the sum, and another wait.
_PING_EVERY = 1.0
_PING_WAIT = 1.5
LARGEST_UPLOAD = 8_000_000
"""Of a file from a browser, bytes; the page itself refuses larger ones before they are sent."""
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


class LoopEvent(asyncio.Event):
    """An event that other threads leave alone: set by one of them just when it is waited for, it would never come."""

    def set(self) -> None:
        """Set it, if this is the loop's own thread."""
        try:
            asyncio.get_running_loop()
        except RuntimeError:
            return
        super().set()


def wake_safely(client: "ClientHandle") -> None:
    """Let what is sent to a browser be noticed by the server's own thread.

    The library sets its event from whichever thread sends, and from its own right after: the first is one too many.
    """
    buffer: Any = client.gui._websock_interface.get_message_buffer()
    buffer.message_event.__class__ = LoopEvent


def limit_uploads(client: "ClientHandle", tell: Callable[[str], None]) -> None:
    """Let a browser send one file at a time, of a bounded length; the library keeps all that comes in memory."""
    from viser._messages import FileTransferPart, FileTransferStartUpload  # noqa: PLC0415 - takes half a second

    gui: Any = client.gui
    coming: dict[str, Any] = gui._current_file_upload_states

    # These run after the library's own.
    def begins(_: int, message: FileTransferStartUpload) -> None:
        for number in [number for number in coming if number != message.transfer_uuid]:
            del coming[number]
        if message.size_bytes > LARGEST_UPLOAD:
            coming.pop(message.transfer_uuid, None)
            tell(
                f"{message.filename} has {message.size_bytes / 1e6:.0f} MB; allowed are files of up to "
                f"{LARGEST_UPLOAD / 1e6:g} MB."
            )

    def goes_on(_: int, message: FileTransferPart) -> None:
        state = coming.get(message.transfer_uuid)
        if state is not None and state["transferred_bytes"] > state["total_bytes"]:
            del coming[message.transfer_uuid]

    gui._websock_interface.register_handler(FileTransferStartUpload, begins)
    gui._websock_interface.register_handler(FileTransferPart, goes_on)


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
