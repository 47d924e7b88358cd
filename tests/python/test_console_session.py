"""What browsers may do with the page: one operates, all others watch; whatever one sends, the page goes on."""

import asyncio
import html
import math
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.console import Page, serve
from tenodesis.console.page import FRAME_RATE
from tenodesis.console.server import LoopOnlyEvent
from tenodesis.console.session import as_plain
from tenodesis.errors import LiveError
from tenodesis.instrument import Instrument
from tenodesis.instrument.text import to_toml

from .conftest import until
from .console_guest import CAMERA, Guest, get, operates
from .console_stand_in import SHORT_PROTOCOL, StandIn

pytestmark = pytest.mark.process

HAND = "Handle yaw, °"


def asked_by(bench: StandIn, what: str) -> list[str]:
    return [origin for origin, asked in bench.commands if asked == what]


def test_the_second_browser_watches_until_it_takes_over(page: Page, bench: StandIn) -> None:
    with ExitStack() as both:
        first = both.enter_context(Guest(page))
        until(lambda: operates(bench, first))
        second = both.enter_context(Guest(page))
        until(lambda: HAND in second.parts)
        until(lambda: first.property(HAND, "disabled") is False and second.property(HAND, "disabled"))
        second.set(HAND, 20.0)
        until(lambda: any("only watches" in notice for notice in second.notices))
        assert bench.hands[0] == 0
        second.set("Take control", True)
        until(lambda: operates(bench, second))
        assert any(asked.startswith("acquire from browser") for _, asked in bench.commands)
        second.set(HAND, 21.0)
        until(lambda: bench.hands[0] == pytest.approx(np.radians(21)))
        first.set(HAND, -10.0)
        until(lambda: any("taken over" in notice for notice in first.notices))
        until(lambda: any("only watches" in notice for notice in first.notices))
        assert bench.hands[0] == pytest.approx(np.radians(21))
        origins = {origin for origin, asked in bench.commands if asked == "hand"}
        assert origins == {bench.operator}


def test_an_operator_who_goes_away_leaves_the_instrument_paused(page: Page, bench: StandIn) -> None:
    with Guest(page) as guest:
        until(lambda: operates(bench, guest))
        guest.set("Enable", True)
        until(lambda: bench.connect("test").status().state == "ENABLED")
    until(lambda: bench.connect("test").status().state == "PAUSED")
    assert bench.operator is None


def test_an_operator_whose_network_is_cut_is_noticed(page: Page, bench: StandIn) -> None:
    guest = Guest(page)
    until(lambda: operates(bench, guest))
    # From here on it does not even answer pings, as behind a network that is down.
    guest.socket.recv_messages.pause()
    guest.socket.pong = lambda *_: None  # type: ignore[method-assign]
    guest.socket.protocol.receive_data = lambda *_: None  # type: ignore[method-assign]
    until(lambda: bench.operator is None)


def test_the_page_renews_its_operators_lease_until_it_hangs(
    page: Page, bench: StandIn, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Guest(page) as guest:
        until(lambda: operates(bench, guest))
        for _ in range(3):
            last = bench.beat
            until(lambda last=last: bench.beat > last)
        assert operates(bench, guest)
        # However long ago its last tick was, it counts as hanging.
        monkeypatch.setattr("tenodesis.console.page._HANGS_AFTER", -1.0)
        monkeypatch.setattr("tests.python.console_stand_in.LEASE", 1.0)
        until(lambda: bench.operator is None)
        assert "lease ran out" in [asked for _, asked in bench.commands]


def test_nobody_operates_motors_of_this_world_without_asking(scaled: Instrument, tmp_path: Path) -> None:
    bench = StandIn(scaled, tmp_path, simulated=False)
    try:
        with serve(bench.connect, port=0, recordings=tmp_path) as page, Guest(page) as guest:
            until(lambda: HAND in guest.parts)
            assert bench.operator is None
            guest.set("Take control", True)
            until(lambda: operates(bench, guest))
    finally:
        bench.close()


def test_a_page_that_closes_lets_the_operator_go(bench: StandIn, tmp_path: Path) -> None:
    page = serve(bench.connect, port=0, recordings=tmp_path)
    with Guest(page) as guest:
        until(lambda: operates(bench, guest))
        page.close()
        page.close()
    assert bench.operator is None
    assert "release" in [asked for _, asked in bench.commands]


def test_a_flood_comes_down_to_the_latest_value_per_tick(page: Page, bench: StandIn) -> None:
    with Guest(page) as guest:
        until(lambda: operates(bench, guest))
        until(lambda: HAND in guest.parts)
        ticks = page.frames
        for number in range(5000):
            guest.set(HAND, number % 40 / 2)
            if number == 2500:
                assert get(page, "/stop", X_Tenodesis="stop").status == 200
        guest.set(HAND, 12.3)
        until(lambda: bench.hands[0] == pytest.approx(np.radians(12.3)))
        commands = len(asked_by(bench, "hand"))
        assert 1 <= commands <= page.frames - ticks + 2
        assert operates(bench, guest)
    print(f"5001 slider events: {commands} commands at {FRAME_RATE:g} ticks a second")


def test_a_file_that_is_too_large_or_never_ends_is_not_kept(page: Page, bench: StandIn) -> None:
    with Guest(page) as guest:
        until(lambda: operates(bench, guest))
        guest.upload("Motion from a CSV file", "large.csv", b"", size=5_000_000_000)
        until(lambda: "large.csv has 5000 MB; a file must have at most 8 MB." in guest.notices)
        (browser,) = page._browsers.values()
        kept: Any = browser.session.client.gui
        guest.upload("Motion from a CSV file", "longer.csv", bytes(1000), size=10, parts=3)
        guest.upload("Motion from a CSV file", "first.csv", b"time_s,angle_deg\n0,0\n1,5\n")
        until(lambda: "first.csv" in guest.notices)
        for number in range(20):
            guest.upload("Motion from a CSV file", f"{number}.csv", b"", size=1000, parts=2)
        guest.set(HAND, 2.0)
        until(lambda: bench.hands[0] > 0)
        assert len(kept._current_file_upload_states) <= 1


def test_a_browser_that_sends_what_its_panel_would_not_moves_nothing(page: Page, bench: StandIn) -> None:
    with Guest(page) as guest:
        until(lambda: operates(bench, guest))
        for value in (math.nan, math.inf, 1e300, "text", None, [1, 2]):
            for label in (HAND, "Load yaw, N", "Law", "Recording", "Open", "Motion", "Play the motion"):
                guest.set(label, value)
        guest.send({"type": "GuiUpdateMessage", "uuid": guest.parts[HAND]["uuid"], "updates": {"props": None}})
        guest.socket.send(b"\x00malformed")
        with Guest(page) as other:
            until(lambda: HAND in other.parts)
        assert np.isfinite(bench.hands).all()
        assert abs(bench.hands[0]) <= bench.inst.handle_range
        assert np.isfinite(bench.forces).all()


def test_more_browsers_than_there_is_room_for_are_sent_away(page: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tenodesis.console.server.MOST_CLIENTS", 1)
    with ExitStack() as both:
        first = both.enter_context(Guest(page))
        until(lambda: HAND in first.parts)
        second = both.enter_context(Guest(page))
        until(lambda: second.socket.close_code == 1013)
        assert first.socket.close_code is None


EVIL = "<iframe srcdoc='<script>parent.fetch(1)</script>'></iframe>"


def test_names_in_files_are_shown_and_not_obeyed(bench: StandIn, page: Page, tmp_path: Path) -> None:
    evil = bench.inst.replace(name=EVIL[:60], description=f"![x](/etc/hostname) {EVIL}")
    bench.begin(evil)
    (tmp_path / "<img src=x>.mcap").write_bytes(b"nothing")
    with Guest(page) as guest:
        until(lambda: operates(bench, guest))
        guest.upload("Protocol file from here", "p.toml", PROTOCOL.replace("NAME", "<img src=x>**[a](b)").encode())
        until(lambda: guest.sees("runs&") or guest.sees("** runs: "))
        guest.set("Recording", "<img src=x>.mcap")
        guest.set("Open", True)
        until(lambda: guest.sees("could not be opened"))
        until(lambda: any("is no MCAP file" in notice for notice in guest.notices))
        for text in guest.texts.values():
            assert "<iframe" not in text
            assert "<img" not in text
            assert "![" not in text


PROTOCOL = SHORT_PROTOCOL.replace("short", "NAME")


def test_markdown_of_others_is_text() -> None:
    assert html.unescape(as_plain("<b> *x* [a](b) `c` _d_")) == "<b> *x* [a](b) `c` _d_"
    assert set("<>*[]()`_!\\") & set(as_plain("<b> *x* ![a](b) `c` _d_ \\<")) == set()
    assert as_plain("one\n\n# two") == "one &#35; two"


def test_a_browser_that_comes_while_there_is_no_runtime_can_start_one(bench: StandIn, tmp_path: Path) -> None:
    gone = True

    def connect(origin: str) -> Any:
        if gone and origin != "page":
            raise LiveError("The runtime has ended.")
        link = bench.connect(origin)
        if origin == "page":
            link.restart = restart  # type: ignore[method-assign]
        return link

    def restart() -> None:
        nonlocal gone
        gone = False

    with serve(connect, port=0, recordings=tmp_path) as page, Guest(page) as guest:
        until(lambda: "Start the instrument again" in guest.parts)
        until(lambda: guest.sees("The runtime has ended."))
        assert HAND not in guest.parts
        guest.set("Start the instrument again", True)
        until(lambda: operates(bench, guest))
        until(lambda: HAND in guest.parts)


def test_sliders_begin_where_the_handle_and_the_load_are(scaled: Instrument, tmp_path: Path) -> None:
    bench = StandIn(scaled, tmp_path)
    bench.hands, bench.forces = np.array([np.radians(12.0)]), np.array([0.5])
    try:
        with serve(bench.connect, port=0, recordings=tmp_path) as page, Guest(page) as guest:
            until(lambda: guest.property(HAND, "value") == pytest.approx(12.0))
            until(lambda: guest.property("Load yaw, N", "value") == pytest.approx(0.5))
            until(lambda: "Remove the load as a step" in [part["label"] for part in guest.parts.values()])
    finally:
        bench.close()


def test_looking_again_is_not_put_off_by_panels_that_leave_an_upright_picture(page: Page, bench: StandIn) -> None:
    with Guest(page) as guest:
        until(lambda: operates(bench, guest))
        (browser,) = page._browsers.values()
        camera = browser.session.client.camera
        first = np.array(camera.look_at)
        guest.send({**CAMERA, "image_width": 512, "image_height": 800})
        until(lambda: camera.image_width == 512 and not np.any(camera.look_at))
        guest.set("Look at", "whole")
        # On its way the camera looks elsewhere: it moves before it turns.
        until(lambda: np.array(camera.look_at) == pytest.approx(first))


def test_other_threads_do_not_touch_an_event_of_the_loop() -> None:
    async def watched() -> list[bool]:
        event = asyncio.Event()
        event.__class__ = LoopOnlyEvent
        await asyncio.to_thread(event.set)
        seen = [event.is_set()]
        event.set()
        return [*seen, event.is_set()]

    assert asyncio.run(watched()) == [False, True]


def test_all_browsers_have_such_an_event(page: Page, bench: StandIn) -> None:
    with Guest(page) as guest:
        until(lambda: operates(bench, guest))
        (browser,) = page._browsers.values()
        interface: Any = browser.session.client.gui._websock_interface
        assert isinstance(interface.get_message_buffer().message_event, LoopOnlyEvent)


def test_who_watches_does_not_open_instrument_files(page: Page, bench: StandIn) -> None:
    with Guest(page) as first, Guest(page) as second:
        until(lambda: operates(bench, first) or operates(bench, second))
        watcher = second if operates(bench, first) else first
        watcher.set("Path", "/etc/passwd")
        watcher.set("Run the file at this path", True)
        until(lambda: "You only watch; take control first." in watcher.notices)
        assert not any("passwd" in notice for notice in watcher.notices)


def test_what_is_no_instrument_file_is_refused_by_its_name(page: Page, bench: StandIn) -> None:
    with Guest(page) as guest:
        until(lambda: operates(bench, guest))
        for path in ("/dev/zero", "/tmp", "/etc/passwd", "a\0b", "no such file"):
            guest.set("Path", path)
            guest.set("Run the file at this path", True)
            known = path.partition("\0")[0]
            until(lambda known=known: guest.sees(known) or any(known in notice for notice in guest.notices))
        assert asked_by(bench, "load") == []


@pytest.fixture
def recordings(scaled: Instrument, tmp_path: Path) -> Path:
    """A folder of recordings: whole, cut, without a row, and of two axes."""
    run = tn.twin.Twin(scaled, time_step=5e-4).run(np.linspace(0, 0.3, 1200))
    metadata = {"instrument": to_toml(scaled)}
    with tn.Recorder(tmp_path / "whole.mcap", axes=("yaw",), metadata=metadata) as recorder:
        recorder.write(run)
    whole = (tmp_path / "whole.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) * 2 // 3])
    with tn.Recorder(tmp_path / "empty.mcap", axes=("yaw",), metadata=metadata):
        pass
    two = tn.load("real-size")
    both = tn.twin.Twin(two, time_step=5e-4).run(np.zeros((400, 2)))
    with tn.Recorder(tmp_path / "two.mcap", axes=two.axes, metadata={"instrument": to_toml(two)}) as recorder:
        recorder.write(both)
    with tn.Recorder(tmp_path / "foreign.mcap", axes=two.axes) as recorder:
        recorder.write(both)
    return tmp_path


def test_a_recording_says_what_it_is_or_why_it_cannot_be_opened(recordings: Path, page: Page, bench: StandIn) -> None:
    with Guest(page) as guest:
        until(lambda: operates(bench, guest))
        until(lambda: "whole.mcap" in (guest.property("Recording", "options") or ()))
        for name, says, replays in (
            ("whole.mcap", "rows, scaled-up, yaw.", True),
            ("empty.mcap", "0.0 s, 0 rows, scaled-up, yaw.", False),
            ("cut.mcap", "only&#58;", True),
            ("two.mcap", "To replay it, run an instrument with yaw and pitch first", False),
            ("foreign.mcap", "foreign.mcap has yaw and pitch and does not contain its instrument", False),
        ):
            guest.set("Recording", name)
            guest.set("Open", True)
            until(lambda says=says: guest.sees(says) or any(says in notice for notice in guest.notices))
            until(lambda replays=replays: guest.property("Replay in the view", "disabled") is not replays)
