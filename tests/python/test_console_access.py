"""Who may see the page, who may move a motor with it, and what those who should not are up against."""

import asyncio
import http.client
import math
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tenodesis.console import Page, serve
from tenodesis.console.door import Door
from tenodesis.console.lockout import Lockout
from tenodesis.console.page import FRAMES
from tenodesis.errors import LiveError
from tenodesis.instrument import Instrument

pytest.importorskip("viser", reason="the page needs viser")

from websockets.datastructures import Headers
from websockets.exceptions import InvalidStatus
from websockets.http11 import Request

from .console_guest import Guest, wait
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
