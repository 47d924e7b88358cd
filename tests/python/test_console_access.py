"""Who may see the page, who may move a motor with it, and what those who should not are up against."""

import asyncio
import gzip
import html
import http.client
import math
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.console import Page, serve
from tenodesis.console.door import Door
from tenodesis.console.lockout import Lockout
from tenodesis.console.page import FRAMES
from tenodesis.console.session import plain
from tenodesis.console.wire import LoopEvent
from tenodesis.errors import LiveError
from tenodesis.instrument import Instrument
from tenodesis.instrument.text import to_toml

pytest.importorskip("viser", reason="the page needs viser")

from websockets.datastructures import Headers
from websockets.exceptions import InvalidStatus
from websockets.http11 import Request

from .console_guest import CAMERA, Guest, wait
from .console_stand_in import StandIn

HAND = "Handle yaw, °"


@pytest.fixture
def bench(scaled: Instrument, tmp_path: Path) -> Iterator[StandIn]:
    found = StandIn(scaled, tmp_path)
    yield found
    found.close()


@pytest.fixture
def page(bench: StandIn, tmp_path: Path) -> Iterator[Page]:
    with serve(bench.connect, port=0, recordings=tmp_path) as served:
        yield served


@pytest.fixture
def guarded(bench: StandIn, tmp_path: Path) -> Iterator[Page]:
    with serve(bench.connect, port=0, token="the token", recordings=tmp_path) as served:
        yield served


def get(page: Page, path: str = "/", **headers: str) -> http.client.HTTPResponse:
    connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=10)
    connection.request("GET", path, headers={name.replace("_", "-"): value for name, value in headers.items()})
    answer = connection.getresponse()
    answer.read()
    return answer


def asked_by(bench: StandIn, what: str) -> list[str]:
    return [origin for origin, asked in bench.commands if asked == what]


def operates(bench: StandIn, guest: Guest) -> bool:
    address = "{}:{}".format(*guest.socket.local_address[:2])
    return bench.operator is not None and bench.operator.endswith(address)


# ---------------------------------------------------------------------- the token


def test_ten_thousand_guesses_do_not_get_in_and_do_not_keep_the_operator_out() -> None:
    clock = SimpleNamespace(now=0.0)
    door = Door(
        "the page", loopback=False, token="right", stop=lambda _: None, lockout=Lockout(clock=lambda: clock.now)
    )

    async def ask(address: str, path: str, **headers: str) -> Any:
        connection: Any = SimpleNamespace(remote_address=(address, 1))
        request = Request(path, Headers({"Host": "bench:80", **headers}))
        return await door.answer(connection, request, lambda *_: None)

    async def attack() -> list[int]:
        came_in = await ask("10.0.0.1", "/?token=right")
        assert came_in.status_code == 303
        cookie = came_in.headers["Set-Cookie"].partition(";")[0]
        answers = []
        for number in range(10_000):
            clock.now += 0.05
            answers.append((await ask("10.0.0.66", f"/?token=guess{number}")).status_code)
            if number % 500 == 0:
                assert (await ask("10.0.0.66", "/", Cookie=cookie)).status_code == 200
        assert (await ask("10.0.0.66", "/?token=right")).status_code == 429
        assert (await ask("10.0.0.1", "/?token=right")).status_code == 303
        return answers

    answers = asyncio.run(attack())
    assert set(answers) == {401, 429}
    # In more than eight minutes: five for nothing, then one after 1, 2, 4 ... 300 s.
    assert answers.count(401) < 16


def test_a_lockout_grows_and_ends() -> None:
    clock = SimpleNamespace(now=0.0)
    lockout = Lockout(free=2, first=1.0, longest=5.0, most=3, clock=lambda: clock.now)
    seconds = []
    for _ in range(6):
        lockout.wrong("10.0.0.1")
        seconds.append(lockout.remaining("10.0.0.1"))
    assert seconds == [0, 0, 1, 2, 4, 5]
    clock.now = 5.0
    assert lockout.remaining("10.0.0.1") == 0
    lockout.right("10.0.0.1")
    lockout.wrong("10.0.0.1")
    assert lockout.remaining("10.0.0.1") == 0


def test_a_network_of_addresses_is_locked_out_as_one_and_memory_is_bounded() -> None:
    lockout = Lockout(free=0, most=10, clock=lambda: 0.0)
    lockout.wrong("2001:db8::1")
    assert lockout.remaining("2001:db8::ffff") > 0
    assert lockout.remaining("2001:db8:0:1::1") == 0
    for number in range(100):
        lockout.wrong(f"10.0.0.{number}")
    assert sum(lockout.remaining(f"10.0.0.{number}") > 0 for number in range(100)) == 10


def test_the_page_behind_a_token_answers_nothing_without_it(guarded: Page, bench: StandIn) -> None:
    assert get(guarded).status == 401
    assert get(guarded, "/stop", X_Tenodesis="stop").status == 401
    assert get(guarded, "/index.html").status == 401
    assert get(guarded, Cookie=f"tenodesis-{guarded.port}=wrong").status == 401
    with pytest.raises(InvalidStatus, match="401"):
        Guest(guarded.port)
    assert get(guarded, "/?token=wrong").status == 401
    assert bench.commands == []
    answer = get(guarded, "/?token=the%20token")
    assert answer.status == 303
    cookie = str(answer.getheader("Set-Cookie"))
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    shown = cookie.partition(";")[0]
    assert get(guarded, Cookie=shown).status == 200
    with Guest(guarded.port, Cookie=shown) as guest:
        wait(lambda: operates(bench, guest))


def test_another_address_gets_a_token_and_this_machine_none(page: Page, bench: StandIn, tmp_path: Path) -> None:
    assert page.token is None
    with serve(bench.connect, host="0.0.0.0", port=0, recordings=tmp_path) as open_page:
        assert open_page.token is not None
        assert len(open_page.token) >= 32
        assert open_page.token in open_page.url
        assert get(open_page).status == 401
    with pytest.raises(LiveError, match=r"host is '203\.0\.113\.1'"):
        serve(bench.connect, host="203.0.113.1")


# ---------------------------------------------------------------------- other sites


def test_a_page_of_another_site_can_neither_connect_nor_stop(page: Page, bench: StandIn) -> None:
    with pytest.raises(InvalidStatus, match="403"):
        Guest(page.port, Origin="http://elsewhere.example")
    assert get(page, Host="elsewhere.example").status == 403
    assert get(page, "/stop").status == 403
    assert bench.commands == []
    with Guest(page.port, Origin=f"http://127.0.0.1:{page.port}") as guest:
        wait(lambda: operates(bench, guest))


def test_the_page_cannot_be_put_on_the_internet_by_a_browser(page: Page, bench: StandIn) -> None:
    with Guest(page.port) as guest:
        wait(lambda: operates(bench, guest))
        guest.send({"type": "ShareUrlRequest"})
        guest.set(HAND, 3.0)
        wait(lambda: bench.hands[0] > 0)
        assert page._server._share_tunnel is None


@pytest.mark.parametrize("path", ["/index.html", "//", "/./", "/?/../index.html", "/..%2f..%2fsetup.py", "//[", "/%00"])
def test_no_address_gives_a_page_without_the_stop_button(page: Page, path: str) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=10)
    connection.request("GET", path, headers={"Accept-Encoding": "identity"})
    answer = connection.getresponse()
    body = answer.read()
    if answer.status == 200:
        body = gzip.decompress(body)
        assert b"tenodesis-stop" in body
    else:
        assert answer.status in {400, 404}
        assert b"<html" not in body.lower()


@pytest.mark.parametrize(
    "headers",
    [
        [("Host", "127.0.0.1"), ("Host", "elsewhere.example")],
        [("Host", "127.0.0.1"), ("Origin", "http://[")],
        [("Host", "127.0.0.1"), ("Origin", "null")],
        [("Host", "127.0.0.1.elsewhere.example")],
        [("Host", "127.0.0.1@elsewhere.example")],
        [("Host", "")],
        [],
    ],
)
def test_forged_headers_do_not_get_in(page: Page, bench: StandIn, headers: list[tuple[str, str]]) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=10)
    connection.putrequest("GET", "/stop", skip_host=True)
    for name, value in [*headers, ("X-Tenodesis", "stop")]:
        connection.putheader(name, value)
    connection.endheaders()
    assert connection.getresponse().status in {400, 403}
    assert bench.commands == []


def test_a_pass_of_any_bytes_is_only_wrong(guarded: Page) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", guarded.port, timeout=10)
    connection.putrequest("GET", "/")
    connection.putheader("Cookie", f"tenodesis-{guarded.port}=".encode() + b"\xff\xfe")
    connection.endheaders()
    assert connection.getresponse().status == 401


def test_browsers_are_told_to_ask_nobody_else(page: Page) -> None:
    policy = str(get(page).getheader("Content-Security-Policy"))
    assert "default-src 'self'" in policy
    assert "http" not in policy


# ---------------------------------------------------------------------- one operator


def test_the_second_browser_watches_until_it_takes_over(page: Page, bench: StandIn) -> None:
    with ExitStack() as both:
        first = both.enter_context(Guest(page.port))
        wait(lambda: operates(bench, first))
        second = both.enter_context(Guest(page.port))
        wait(lambda: HAND in second.parts)
        wait(lambda: first.property(HAND, "disabled") is False and second.property(HAND, "disabled"))
        second.set(HAND, 20.0)
        wait(lambda: any("does not operate" in told for told in second.told))
        assert bench.hands[0] == 0
        second.set("Take control", True)
        wait(lambda: operates(bench, second))
        assert any(asked.startswith("acquire from browser") for _, asked in bench.commands)
        second.set(HAND, 21.0)
        wait(lambda: bench.hands[0] == pytest.approx(np.radians(21)))
        first.set(HAND, -10.0)
        wait(lambda: any("taken over" in told for told in first.told))
        wait(lambda: any("does not operate" in told for told in first.told))
        assert bench.hands[0] == pytest.approx(np.radians(21))
        origins = {origin for origin, asked in bench.commands if asked == "hand"}
        assert origins == {bench.operator}


def test_an_operator_who_goes_away_leaves_the_instrument_paused(page: Page, bench: StandIn) -> None:
    with Guest(page.port) as guest:
        wait(lambda: operates(bench, guest))
        guest.set("Enable", True)
        wait(lambda: bench.connect("test").status().state == "ENABLED")
    wait(lambda: bench.connect("test").status().state == "PAUSED")
    assert bench.operator is None


def test_an_operator_whose_network_is_cut_is_noticed(page: Page, bench: StandIn) -> None:
    guest = Guest(page.port)
    wait(lambda: operates(bench, guest))
    # From here on it does not even answer pings, as behind a network that is down.
    guest.socket.recv_messages.pause()
    guest.socket.pong = lambda *_: None  # type: ignore[method-assign]
    guest.socket.protocol.receive_data = lambda *_: None  # type: ignore[method-assign]
    wait(lambda: bench.operator is None)


def test_nobody_operates_motors_of_this_world_without_asking(scaled: Instrument, tmp_path: Path) -> None:
    bench = StandIn(scaled, tmp_path, simulated=False)
    try:
        with serve(bench.connect, port=0, recordings=tmp_path) as page, Guest(page.port) as guest:
            wait(lambda: HAND in guest.parts)
            assert bench.operator is None
            guest.set("Take control", True)
            wait(lambda: operates(bench, guest))
    finally:
        bench.close()


def test_a_page_that_closes_lets_the_operator_go(bench: StandIn, tmp_path: Path) -> None:
    page = serve(bench.connect, port=0, recordings=tmp_path)
    with Guest(page.port) as guest:
        wait(lambda: operates(bench, guest))
        page.close()
        page.close()
    assert bench.operator is None
    assert "release" in [asked for _, asked in bench.commands]


# ---------------------------------------------------------------------- stop, and floods


def test_stop_works_for_everybody_under_a_name_of_its_own(page: Page, bench: StandIn) -> None:
    assert get(page, "/stop", X_Tenodesis="stop").status == 200
    assert bench.commands == [("stop button at 127.0.0.1", "stop")]


def test_a_stop_that_does_not_get_through_says_so(page: Page, bench: StandIn, monkeypatch: pytest.MonkeyPatch) -> None:
    def gone(*_: object) -> None:
        raise LiveError("The runtime has gone.")

    monkeypatch.setattr("tests.python.console_stand_in.StandInLink.stop", gone)
    assert get(page, "/stop", X_Tenodesis="stop").status == 503


def test_a_flood_comes_down_to_the_latest_value_per_tick(page: Page, bench: StandIn) -> None:
    with Guest(page.port) as guest:
        wait(lambda: operates(bench, guest))
        wait(lambda: HAND in guest.parts)
        ticks = page.frames
        for number in range(5000):
            guest.set(HAND, number % 40 / 2)
            if number == 2500:
                assert get(page, "/stop", X_Tenodesis="stop").status == 200
        guest.set(HAND, 12.3)
        wait(lambda: bench.hands[0] == pytest.approx(np.radians(12.3)))
        commands = len(asked_by(bench, "hand"))
        assert 1 <= commands <= page.frames - ticks + 2
        assert operates(bench, guest)
    print(f"5001 slider events: {commands} commands at {FRAMES:g} ticks a second")


def test_a_page_that_hangs_says_so_to_those_who_ask() -> None:
    async def ask(alive: bool) -> bytes:
        door = Door("the page", loopback=True, token=None, stop=lambda _: None, alive=lambda: alive)
        request = Request("/alive", Headers({"Host": "localhost"}))
        answer = await door.answer(SimpleNamespace(remote_address=None), request, lambda *_: None)  # type: ignore[arg-type]
        assert answer is not None
        assert answer.status_code == 200
        return bytes(answer.body)

    assert asyncio.run(ask(True)) == b"alive"
    assert asyncio.run(ask(False)) == b"hangs"


def test_a_file_that_is_too_large_or_never_ends_is_not_kept(page: Page, bench: StandIn) -> None:
    with Guest(page.port) as guest:
        wait(lambda: operates(bench, guest))
        guest.upload("Motion from a CSV file", "large.csv", b"", size=5_000_000_000)
        wait(lambda: "large.csv has 5000 MB; allowed are files of up to 8 MB." in guest.told)
        (browser,) = page._browsers.values()
        kept: Any = browser.session.client.gui
        guest.upload("Motion from a CSV file", "longer.csv", bytes(1000), size=10, parts=3)
        guest.upload("Motion from a CSV file", "first.csv", b"time_s,angle_deg\n0,0\n1,5\n")
        wait(lambda: "first.csv" in guest.told)
        for number in range(20):
            guest.upload("Motion from a CSV file", f"{number}.csv", b"", size=1000, parts=2)
        guest.set(HAND, 2.0)
        wait(lambda: bench.hands[0] > 0)
        assert len(kept._current_file_upload_states) <= 1


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e300, "text", None, [1, 2]])
def test_a_browser_that_sends_what_its_panel_would_not_moves_nothing(page: Page, bench: StandIn, value: Any) -> None:
    with Guest(page.port) as guest:
        wait(lambda: operates(bench, guest))
        for label in (HAND, "Load yaw, N", "Law", "Recording", "Open", "Motion", "Move the handle so"):
            guest.set(label, value)
        guest.send({"type": "GuiUpdateMessage", "uuid": guest.parts[HAND]["uuid"], "updates": {"props": None}})
        guest.socket.send(b"\x00malformed")
        with Guest(page.port) as other:
            wait(lambda: HAND in other.parts)
        assert np.isfinite(bench.hands).all()
        assert abs(bench.hands[0]) <= bench.inst.handle_range
        assert np.isfinite(bench.forces).all()


def test_more_browsers_than_there_is_room_for_are_sent_away(page: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tenodesis.console.wire.MOST_CLIENTS", 1)
    with ExitStack() as both:
        first = both.enter_context(Guest(page.port))
        wait(lambda: HAND in first.parts)
        second = both.enter_context(Guest(page.port))
        wait(lambda: second.socket.close_code == 1013)
        assert first.socket.close_code is None


# ---------------------------------------------------------------------- what others wrote


EVIL = "<iframe srcdoc='<script>parent.fetch(1)</script>'></iframe>"


def test_names_in_files_are_shown_and_not_obeyed(bench: StandIn, page: Page, tmp_path: Path) -> None:
    evil = bench.inst.replace(name=EVIL[:60], description=f"![x](/etc/hostname) {EVIL}")
    bench.begin(evil)
    (tmp_path / "<img src=x>.mcap").write_bytes(b"nothing")
    with Guest(page.port) as guest:
        wait(lambda: operates(bench, guest))
        guest.upload("A protocol file of your own", "p.toml", PROTOCOL.replace("NAME", "<img src=x>**[a](b)").encode())
        wait(lambda: guest.sees("runs&") or guest.sees("** runs: "))
        guest.set("Recording", "<img src=x>.mcap")
        guest.set("Open", True)
        wait(lambda: guest.sees("could not be opened"))
        wait(lambda: any("is no MCAP file" in told for told in guest.told))
        for text in guest.texts.values():
            assert "<iframe" not in text
            assert "<img" not in text
            assert "![" not in text


PROTOCOL = """
name = "NAME"
[[phases]]
kind = "step-load"
output_angle = "20 deg"
delay = "0.2 s"
force = "1 N"
duration = "0.5 s"
release = "0.3 s"
"""


def test_markdown_of_others_is_text() -> None:
    assert html.unescape(plain("<b> *x* [a](b) `c` _d_")) == "<b> *x* [a](b) `c` _d_"
    assert set("<>*[]()`_!\\") & set(plain("<b> *x* ![a](b) `c` _d_ \\<")) == set()
    assert plain("one\n\n# two") == "one &#35; two"


# ---------------------------------------------------------------------- coming, going and watching


def test_a_browser_that_comes_while_there_is_no_runtime_can_start_one(bench: StandIn, tmp_path: Path) -> None:
    gone = True

    def connect(origin: str) -> Any:
        if gone and origin != "page":
            raise LiveError("The runtime has gone.")
        link = bench.connect(origin)
        if origin == "page":
            link.restart = restart  # type: ignore[method-assign]
        return link

    def restart() -> None:
        nonlocal gone
        gone = False

    with serve(connect, port=0, recordings=tmp_path) as page, Guest(page.port) as guest:
        wait(lambda: "Start the instrument again" in guest.parts)
        wait(lambda: guest.sees("The runtime has gone."))
        assert HAND not in guest.parts
        guest.set("Start the instrument again", True)
        wait(lambda: operates(bench, guest))
        wait(lambda: HAND in guest.parts)


def test_sliders_begin_where_the_handle_and_the_load_are(scaled: Instrument, tmp_path: Path) -> None:
    bench = StandIn(scaled, tmp_path)
    bench.hands, bench.forces = np.array([np.radians(12.0)]), np.array([0.5])
    try:
        with serve(bench.connect, port=0, recordings=tmp_path) as page, Guest(page.port) as guest:
            wait(lambda: guest.property(HAND, "value") == pytest.approx(12.0))
            wait(lambda: guest.property("Load yaw, N", "value") == pytest.approx(0.5))
            wait(lambda: "Take the load off at once" in [part["label"] for part in guest.parts.values()])
    finally:
        bench.close()


def test_looking_again_is_not_put_off_by_panels_that_leave_an_upright_picture(page: Page, bench: StandIn) -> None:
    with Guest(page.port) as guest:
        wait(lambda: operates(bench, guest))
        (browser,) = page._browsers.values()
        camera = browser.session.client.camera
        first = np.array(camera.look_at)
        guest.send({**CAMERA, "image_width": 512, "image_height": 800})
        wait(lambda: camera.image_width == 512)
        guest.set("Look at", "whole")
        wait(lambda: np.any(np.array(camera.look_at) != 0))
        assert np.array(camera.look_at) == pytest.approx(first)


def test_other_threads_do_not_touch_an_event_of_the_loop() -> None:
    async def told() -> list[bool]:
        event = asyncio.Event()
        event.__class__ = LoopEvent
        await asyncio.to_thread(event.set)
        seen = [event.is_set()]
        event.set()
        return [*seen, event.is_set()]

    assert asyncio.run(told()) == [False, True]


def test_all_browsers_have_such_an_event(page: Page, bench: StandIn) -> None:
    with Guest(page.port) as guest:
        wait(lambda: operates(bench, guest))
        (browser,) = page._browsers.values()
        interface: Any = browser.session.client.gui._websock_interface
        assert isinstance(interface.get_message_buffer().message_event, LoopEvent)


def test_who_watches_does_not_open_instrument_files(page: Page, bench: StandIn) -> None:
    with Guest(page.port) as first, Guest(page.port) as second:
        wait(lambda: operates(bench, first) or operates(bench, second))
        watcher = second if operates(bench, first) else first
        watcher.set("Path", "/etc/passwd")
        watcher.set("Run the one of this path", True)
        wait(lambda: "You only watch; take control first." in watcher.told)
        assert not any("passwd" in told for told in watcher.told)


@pytest.mark.parametrize("path", ["/dev/zero", "/tmp", "no such file", "a\0b"])
def test_what_is_no_instrument_file_is_refused_by_its_name(page: Page, bench: StandIn, path: str) -> None:
    with Guest(page.port) as guest:
        wait(lambda: operates(bench, guest))
        guest.set("Path", path)
        guest.set("Run the one of this path", True)
        known = path.partition("\0")[0]
        wait(lambda: guest.sees(known) or any(known in told for told in guest.told))
        assert asked_by(bench, "load") == []


# ---------------------------------------------------------------------- recordings


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


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("whole.mcap", "rows, scaled-up, yaw."),
        ("cut.mcap", "only&#58;"),
        ("empty.mcap", "0.0 s, 0 rows, scaled-up, yaw."),
        ("two.mcap", "To replay it, run an instrument with yaw and pitch first"),
        ("foreign.mcap", "foreign.mcap has yaw and pitch and does not say of which instrument"),
        ("../secret.mcap", "is not among the recordings"),
    ],
)
def test_a_recording_says_what_it_is_or_why_it_cannot_be_opened(
    recordings: Path, page: Page, bench: StandIn, name: str, says: str
) -> None:
    (recordings.parent / "secret.mcap").write_bytes((recordings / "whole.mcap").read_bytes())
    with Guest(page.port) as guest:
        wait(lambda: operates(bench, guest))
        wait(lambda: "whole.mcap" in (guest.property("Recording", "options") or ()))
        guest.set("Recording", name)
        guest.set("Open", True)
        wait(lambda: guest.sees(says) or any(says in told for told in guest.told))
        assert guest.property("Replay in the view", "disabled") is (name not in {"whole.mcap", "cut.mcap"})
