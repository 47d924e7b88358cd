"""A browser without a window: sends the page's server whatever a test asks for, whether a panel would or not."""

import http.client
import struct
import threading
import time
from contextlib import suppress
from typing import Any
from urllib.parse import quote

import msgspec
import zstandard
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from .conftest import until

CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (3.0, 3.0, 3.0),
    "fov": 1.3,
    "near": 0.01,
    "far": 1000.0,
    "image_height": 900,
    "image_width": 1400,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}


class Guest:
    """One connection; parts of the panel are known by their label."""

    def __init__(self, page: Any, **headers: str) -> None:
        import viser

        self.socket = connect(
            f"ws://127.0.0.1:{page.port}",
            subprotocols=[f"viser-v{viser.__version__}"],  # type: ignore[list-item]
            additional_headers={"Cookie": cookie(page), **headers},
            max_size=None,
            compression=None,
        )
        self.parts: dict[str, dict[str, Any]] = {}
        self.texts: dict[str, str] = {}
        """Markdown and HTML of the panel, by identifier."""
        self.notices: list[str] = []
        self.reader = threading.Thread(target=self._read, daemon=True)
        self.reader.start()
        # Whoever is sent away at once hears of it here.
        with suppress(ConnectionClosed):
            self.send(CAMERA)

    def __enter__(self) -> "Guest":
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()
        self.reader.join(timeout=5)

    def send(self, message: dict[str, Any]) -> None:
        self.socket.send(msgspec.msgpack.encode(message))

    def set(self, label: str, value: Any) -> None:
        """Say that a part of the panel has a value, or was pressed; its label may go on."""
        until(lambda: any(known.startswith(label) for known in list(self.parts)))
        part = next(part for known, part in self.parts.items() if known.startswith(label))
        self.send({"type": "GuiUpdateMessage", "uuid": part["uuid"], "updates": {"value": value}})

    def property(self, label: str, name: str) -> Any:
        return self.parts.get(label, {}).get(name)

    def upload(self, label: str, name: str, content: bytes, size: int | None = None, parts: int = 1) -> None:
        """Send the first part of a file to a part of the panel, said to be of a size."""
        until(lambda: label in self.parts)
        common = {"source_component_uuid": self.parts[label]["uuid"], "transfer_uuid": f"{name} {time.monotonic()}"}
        upload = {"filename": name, "mime_type": "", "size_bytes": len(content) if size is None else size}
        self.send({"type": "FileTransferStartUpload", **common, **upload, "part_count": parts})
        self.send({"type": "FileTransferPart", **common, "part_index": 0, "content": content})

    def sees(self, text: str) -> bool:
        """Return whether the panel says something."""
        return any(text in shown for shown in list(self.texts.values()))

    def _read(self) -> None:
        try:
            for raw in self.socket:
                assert isinstance(raw, bytes)
                _, size = struct.unpack_from("<QQ", raw)
                content = zstandard.ZstdDecompressor().decompress(raw[16 : 16 + size])
                for message in msgspec.msgpack.decode(content)["messages"]:
                    self._note(message)
        except ConnectionClosed:
            pass

    def _note(self, message: dict[str, Any]) -> None:
        props = message.get("props", {})
        if message["type"] == "NotificationShowMessage":
            self.notices.append(props["body"])
        elif "_markdown" in props or "content" in props:
            self.texts[message["uuid"]] = props.get("_markdown", props.get("content"))
        elif "label" in props:
            self.parts[props["label"]] = {"uuid": message["uuid"], **props}
        elif message["type"] == "GuiUpdateMessage" and message["uuid"] in self.texts:
            updates = message["updates"]
            self.texts[message["uuid"]] = updates.get("_markdown", updates.get("content", self.texts[message["uuid"]]))
        elif message["type"] == "GuiUpdateMessage":
            for part in self.parts.values():
                if part["uuid"] == message["uuid"]:
                    part.update(message["updates"])


def operates(bench: Any, guest: Guest) -> bool:
    address = "{}:{}".format(*guest.socket.local_address[:2])
    return bench.operator is not None and bench.operator.endswith(address)


def get(page: Any, path: str = "/", **headers: str) -> http.client.HTTPResponse:
    """Return the answer of the page to a request."""
    return get_without_token(page, path, **{"Cookie": cookie(page), **headers})


def get_without_token(page: Any, path: str = "/", **headers: str) -> http.client.HTTPResponse:
    connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=10)
    connection.request("GET", path, headers={name.replace("_", "-"): value for name, value in headers.items()})
    answer = connection.getresponse()
    answer.read()
    return answer


def cookie(page: Any) -> str:
    """Return the cookie that a browser with the token gets."""
    answer = get_without_token(page, f"/?token={quote(page.token)}")
    return str(answer.getheader("Set-Cookie")).partition(";")[0]
