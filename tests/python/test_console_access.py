"""Who may reach the page: tokens, other sites, and the stop button, which works for everybody."""

import asyncio
import gzip
import http.client
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
from websockets.datastructures import Headers
from websockets.exceptions import InvalidStatus
from websockets.http11 import Request

from tenodesis.console import Page, serve
from tenodesis.console.access import AccessControl
from tenodesis.errors import LiveError
from tenodesis.instrument import Instrument

from .console_guest import Guest, get, operates, wait
from .console_stand_in import StandIn

pytestmark = pytest.mark.process

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


def test_stop_works_for_everybody_under_a_name_of_its_own(page: Page, bench: StandIn) -> None:
    assert get(page, "/stop", X_Tenodesis="stop").status == 200
    assert bench.commands == [("stop button at 127.0.0.1", "stop")]


def test_a_stop_that_does_not_get_through_says_so(page: Page, bench: StandIn, monkeypatch: pytest.MonkeyPatch) -> None:
    def gone(*_: object) -> None:
        raise LiveError("The runtime has ended.")

    monkeypatch.setattr("tests.python.console_stand_in.StandInConnection.stop", gone)
    assert get(page, "/stop", X_Tenodesis="stop").status == 503


def test_a_page_that_hangs_says_so_to_those_who_ask() -> None:
    async def ask(alive: bool) -> bytes:
        access = AccessControl("the page", loopback=True, token=None, stop=lambda _: None, alive=lambda: alive)
        request = Request("/alive", Headers({"Host": "localhost"}))
        answer = await access.answer(SimpleNamespace(remote_address=None), request, lambda *_: None)  # type: ignore[arg-type]
        assert answer is not None
        assert answer.status_code == 200
        return bytes(answer.body)

    assert asyncio.run(ask(True)) == b"alive"
    assert asyncio.run(ask(False)) == b"hangs"
