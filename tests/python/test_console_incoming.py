"""What a browser sends that its panel does not offer is refused: it is neither kept nor passed on, and fills no log."""

import logging
import math
import resource
import socket
import threading
import time
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from tenodesis.console import Page, serve
from tenodesis.console.incoming import LARGEST_MESSAGE, fits, is_allowed
from tenodesis.console.log import rare_log

from .conftest import until
from .console_guest import CAMERA, Guest, get, operates
from .console_stand_in import StandIn

HAND = "Handle yaw, °"
UPDATE = {"type": "GuiUpdateMessage", "uuid": "x", "updates": {"value": 1.0}}
UPLOAD = {
    "type": "FileTransferStartUpload",
    "source_component_uuid": "x",
    "transfer_uuid": "y",
    "filename": "a.csv",
    "mime_type": "",
    "part_count": 1,
    "size_bytes": 10,
}
PART = {
    "type": "FileTransferPart",
    "source_component_uuid": "x",
    "transfer_uuid": "y",
    "part_index": 0,
    "content": bytes(600_000),
}


@pytest.mark.parametrize("message", [CAMERA, UPDATE, UPLOAD, PART], ids=lambda message: str(message["type"]))
def test_what_the_panel_sends_is_accepted(message: dict[str, Any]) -> None:
    assert is_allowed(msgspec.msgpack.encode(message))


@pytest.mark.parametrize(
    "message",
    [
        {"type": "GuiFormDirtyMessage", "uuid": "x"},
        {"type": "GuiFormSubmitMessage", "uuid": "x"},
        {"type": "ShareUrlRequest"},
        {**CAMERA, "position": (0.0, math.nan, 0.0)},
        {**CAMERA, "image_width": 0},
        {**CAMERA, "more": "x"},
        {**UPDATE, "updates": {"value": 1.0, "visible": False}},
        {**UPDATE, "updates": {"value": "x" * 5000}},
        {**UPDATE, "updates": {"value": None}},
        {**UPDATE, "uuid": "x" * 201},
        {**UPLOAD, "part_count": -1},
        {**PART, "content": "text"},
        [],
        {},
    ],
)
def test_what_the_panel_never_sends_is_refused(message: Any) -> None:
    assert not is_allowed(msgspec.msgpack.encode(message))


@pytest.mark.parametrize("raw", ["text", b"", b"\x00malformed", b"\x91" * 10_000])
def test_what_is_no_message_is_refused(raw: Any) -> None:
    assert not is_allowed(raw)


@pytest.mark.parametrize(
    ("control", "value", "allowed"),
    [
        (SimpleNamespace(value="off", options=("off", "paper")), "paper", True),
        (SimpleNamespace(value="off", options=("off", "paper")), "none of them", False),
        (SimpleNamespace(value="off", options=("off", "paper")), 1.0, False),
        (SimpleNamespace(value=0.0), 1, True),
        (SimpleNamespace(value=0.0), math.inf, False),
        (SimpleNamespace(value=0.0), True, False),
        (SimpleNamespace(value=0.0), "1", False),
        (SimpleNamespace(value=False), True, True),
        (SimpleNamespace(value=False), 1.0, False),
        (SimpleNamespace(value=""), "text", True),
        (SimpleNamespace(value=None), "text", False),
    ],
)
def test_a_control_takes_only_values_that_it_offers(control: Any, value: Any, allowed: bool) -> None:
    assert fits(control, value) is allowed


@pytest.mark.process
def test_a_watcher_that_floods_takes_no_memory_and_moves_nothing(page: Page, bench: StandIn) -> None:
    with Guest(page) as one, Guest(page) as other:
        until(lambda: operates(bench, one) or operates(bench, other))
        guest, watcher = (one, other) if operates(bench, one) else (other, one)
        until(lambda: HAND in watcher.parts)
        kept: Any = page._server._websock_server._broadcast_buffer.message_from_id
        before, memory = len(kept), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        for number in range(100):
            watcher.send({"type": "GuiFormDirtyMessage", "uuid": f"{number}" * 300_000})
        guest.set(HAND, 5.0)
        until(lambda: bench.hands[0] > 0)
        assert len(kept) == before
        # The messages together have 57 MB.
        grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory) / 1024
        assert grown < 40
        assert watcher.socket.close_code is None
        print(f"57 MB of messages: {grown:.0f} MB more")


@pytest.mark.process
def test_a_watcher_uploads_nothing(page: Page, bench: StandIn) -> None:
    with Guest(page) as one, Guest(page) as other:
        until(lambda: operates(bench, one) or operates(bench, other))
        watcher = other if operates(bench, one) else one
        watcher.upload("Motion from a CSV file", "a.csv", bytes(LARGEST_MESSAGE // 2), parts=2)
        until(lambda: "You only watch; take control first." in watcher.notices)
        for browser in page._browsers.values():
            kept: Any = browser.session.client.gui
            assert kept._current_file_upload_states == {}


@pytest.mark.process
def test_values_that_a_list_does_not_offer_are_taken_back_and_logged_by_nobody(
    page: Page, bench: StandIn, caplog: pytest.LogCaptureFixture
) -> None:
    with Guest(page) as guest, caplog.at_level(logging.INFO):
        until(lambda: operates(bench, guest))
        for label in ("Law", "Motors", "Fault", "Recording", "Compare with", "Step on", "Motion", "Simulated speed"):
            guest.set(label, "none of them")
        for label in ("Inject it into the twin", "Play the motion", "Open", "Compare the tip angles"):
            guest.set(label, True)
        until(lambda: guest.property("Law", "value") == "robust")
        guest.set(HAND, 5.0)
        until(lambda: bench.hands[0] > 0)
        time.sleep(0.5)
    assert caplog.text == ""


@pytest.mark.process
def test_connections_that_begin_with_anything_fill_no_log(page: Page, capfd: pytest.CaptureFixture[str]) -> None:
    for beginning in (b"garbage\r\n\r\n", b"", b"\x16\x03\x01", b"POST /stop HTTP/1.1\r\n\r\n"):
        with socket.create_connection(("127.0.0.1", page.port)) as connection:
            connection.sendall(beginning)
    time.sleep(0.5)
    assert capfd.readouterr().err == ""


@pytest.mark.process
def test_connections_that_send_nothing_leave_room_for_a_stop(page: Page, bench: StandIn) -> None:
    with ExitStack() as silent:
        for _ in range(200):
            silent.enter_context(socket.create_connection(("127.0.0.1", page.port)))
        assert get(page, "/stop", X_Tenodesis="stop").status == 200
        with Guest(page) as guest:
            until(lambda: operates(bench, guest))
        opened = sum(1 for _ in Path("/proc/self/fd").iterdir())
        # Of 200 connections to itself the process still holds its own ends, and 64 of the others.
        assert opened < 200 + 64 + 100


def test_a_message_is_logged_once_however_often_it_comes(caplog: pytest.LogCaptureFixture) -> None:
    log = rare_log("tenodesis.console.test")
    for number in range(1000):
        log.warning("%s failed", number)
    log.warning("something else")
    assert [record.getMessage() for record in caplog.records] == ["0 failed", "something else"]


@pytest.mark.process
def test_a_page_ends_while_a_file_is_read(bench: StandIn, tmp_path: Path) -> None:
    held = threading.Event()
    page = serve(bench.connect, port=0, recordings=tmp_path)
    page._workers.submit(lambda: held.wait(60))
    begun = time.monotonic()
    page.close()
    assert time.monotonic() - begun < 20
    held.set()
