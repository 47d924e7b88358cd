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

from tenodesis.console.access import LARGEST_UPLOAD, AccessControl, ProcessRequest
from tenodesis.errors import LiveError

if TYPE_CHECKING:
    from viser import ClientHandle, ViserServer

MOST_CLIENTS = 12
"""Browsers at a time; more would take processor time that the loop needs."""
_LIMITS = {
    # A browser that has gone without closing its connection is noticed within the sum, and another timeout, s.
    "ping_interval": 1.0,
    "ping_timeout": 1.5,
    "close_timeout": 1.5,
    "max_size": 4 * 2**20,
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


def limit_uploads(client: "ClientHandle", notify: Callable[[str], None]) -> None:
    """Let a browser send one file at a time, of limited size; the library keeps all of it in memory."""
    from viser._messages import FileTransferPart, FileTransferStartUpload  # noqa: PLC0415 - takes half a second

    gui: Any = client.gui
    uploads: dict[str, Any] = gui._current_file_upload_states

    # These run after the library's own handlers.
    def started(_: int, message: FileTransferStartUpload) -> None:
        for other in [upload for upload in uploads if upload != message.transfer_uuid]:
            del uploads[other]
        if message.size_bytes > LARGEST_UPLOAD:
            uploads.pop(message.transfer_uuid, None)
            notify(
                f"{message.filename} has {message.size_bytes / 1e6:.0f} MB; a file must have at most "
                f"{LARGEST_UPLOAD / 1e6:g} MB."
            )

    def continued(_: int, message: FileTransferPart) -> None:
        state = uploads.get(message.transfer_uuid)
        if state is not None and state["transferred_bytes"] > state["total_bytes"]:
            del uploads[message.transfer_uuid]

    gui._websock_interface.register_handler(FileTransferStartUpload, started)
    gui._websock_interface.register_handler(FileTransferPart, continued)


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
                await handler(connection)
            finally:
                connected -= 1

        async def check(connection: ServerConnection, request: Request) -> Response | None:
            return await access.answer(connection, request, process_request)

        return serve(handle, *where, process_request=check, **(settings | _LIMITS))

    with _STARTING:
        websockets.serve = guarded  # type: ignore[assignment,misc]
        try:
            yield
        finally:
            websockets.serve = serve  # type: ignore[misc]
