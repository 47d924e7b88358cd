"""What a browser may send: messages of the view and of the panel, within limits; all else is refused unanswered.

The viewer keeps and passes on messages that this page does not use, whatever their size.
"""

import math
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Annotated, Any

import msgspec

from tenodesis.console.access import LARGEST_UPLOAD

if TYPE_CHECKING:
    from viser import ClientHandle
    from viser._messages import FileTransferPart, FileTransferStartUpload, GuiUpdateMessage
    from websockets.asyncio.server import ServerConnection

LARGEST_MESSAGE = 2**20
"""Largest message, bytes; files come in parts."""
_LARGEST_CONTROL = 2**14
"""Largest message but for the parts of files, bytes."""
_LEAST_PART = 1000
"""Least mean size of a file's parts, bytes."""

_Name = Annotated[str, msgspec.Meta(max_length=200)]
_Text = Annotated[str, msgspec.Meta(max_length=4096)]
_Count = Annotated[int, msgspec.Meta(ge=0, le=10**12)]
_Pixels = Annotated[int, msgspec.Meta(ge=1, le=10**5)]
_Vector = tuple[float, float, float]


class _Message(msgspec.Struct, tag_field="type", forbid_unknown_fields=True):
    """A message as the viewer's client encodes it."""


class _Camera(_Message, tag="ViewerCameraMessage"):
    wxyz: tuple[float, float, float, float]
    position: _Vector
    fov: float
    near: float
    far: float
    image_height: _Pixels
    image_width: _Pixels
    look_at: _Vector
    up_direction: _Vector

    @property
    def allowed(self) -> bool:
        numbers = (*self.wxyz, *self.position, self.fov, self.near, self.far, *self.look_at, *self.up_direction)
        return all(map(math.isfinite, numbers))


class _Updates(msgspec.Struct, forbid_unknown_fields=True):
    value: bool | float | _Text


class _Update(_Message, tag="GuiUpdateMessage"):
    uuid: _Name
    updates: _Updates
    allowed = True


class _Upload(_Message, tag="FileTransferStartUpload"):
    source_component_uuid: _Name
    transfer_uuid: _Name
    filename: _Text
    mime_type: _Text
    part_count: _Count
    size_bytes: _Count
    allowed = True


class _Part(_Message, tag="FileTransferPart"):
    source_component_uuid: _Name | None
    transfer_uuid: _Name
    part_index: _Count
    content: bytes
    allowed = True


_DECODER = msgspec.msgpack.Decoder(_Camera | _Update | _Upload | _Part)


def is_allowed(raw: str | bytes) -> bool:
    """Return whether the page accepts a message."""
    if isinstance(raw, str):
        return False
    try:
        message = _DECODER.decode(raw)
    except (msgspec.MsgspecError, RecursionError, ValueError):
        return False
    return message.allowed and (len(raw) <= _LARGEST_CONTROL or isinstance(message, _Part))


def filter_messages(connection: "ServerConnection") -> None:
    """Let a connection receive only messages that the page accepts."""
    receive: Callable[..., Awaitable[str | bytes]] = connection.recv

    async def receive_allowed(*arguments: Any, **options: Any) -> str | bytes:
        while not is_allowed(raw := await receive(*arguments, **options)):
            pass
        return raw

    connection.recv = receive_allowed  # type: ignore[assignment, method-assign]


def guard(client: "ClientHandle", operates: Callable[[], bool], notify: Callable[[str], None]) -> None:
    """Let a browser set only values that its panel offers, and the operator's browser send one file at a time.

    Parameters
    ----------
    client
        The browser.
    operates
        Whether it operates the instrument.
    notify
        Shows it a message.
    """
    from viser._messages import (  # noqa: PLC0415 - takes half a second
        FileTransferPart,
        FileTransferStartUpload,
        GuiUpdateMessage,
    )

    gui: Any = client.gui
    interface = gui._websock_interface
    uploads: dict[str, Any] = gui._current_file_upload_states

    async def update(number: int, message: "GuiUpdateMessage") -> None:
        handle = gui._gui_input_handle_from_uuid.get(message.uuid)
        if handle is None:
            return
        if fits(handle, message.updates["value"]):
            await gui._handle_gui_updates(number, message)
        elif isinstance(handle.value, bool | int | float | str):
            # The browser shows the value that holds.
            interface.queue_message(GuiUpdateMessage(message.uuid, {"value": handle.value}))

    def start(number: int, message: "FileTransferStartUpload") -> None:
        if not operates():
            notify("You only watch; take control first.")
            return
        if message.size_bytes > LARGEST_UPLOAD or message.part_count > 1 + message.size_bytes // _LEAST_PART:
            notify(
                f"{message.filename} has {message.size_bytes / 1e6:.0f} MB; a file must have at most "
                f"{LARGEST_UPLOAD / 1e6:g} MB."
            )
            return
        uploads.clear()
        gui._handle_file_transfer_start(number, message)

    def part(number: int, message: "FileTransferPart") -> None:
        state = uploads.get(message.transfer_uuid)
        if state is None:
            return
        if state["transferred_bytes"] + len(message.content) > state["total_bytes"]:
            del uploads[message.transfer_uuid]
            return
        gui._handle_file_transfer_part(number, message)

    for kind, handler in ((GuiUpdateMessage, update), (FileTransferStartUpload, start), (FileTransferPart, part)):
        interface.unregister_handler(kind)
        interface.register_handler(kind, handler)


def fits(handle: Any, value: bool | float | str) -> bool:
    """Return whether a control of the panel can have a value."""
    options = getattr(handle, "options", None)
    if options is not None:
        return value in options
    if isinstance(handle.value, bool | str):
        return isinstance(value, type(handle.value))
    return isinstance(handle.value, int | float) and not isinstance(value, bool | str) and math.isfinite(value)
