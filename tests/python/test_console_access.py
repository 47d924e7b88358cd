"""Who may reach the page: tokens, other sites, and the stop button, which works for everybody."""

import asyncio
import gzip
import http.client
import os
from pathlib import Path
from types import SimpleNamespace

import pytest
from websockets.datastructures import Headers
from websockets.exceptions import InvalidStatus
from websockets.http11 import Request

from tenodesis import simulate
from tenodesis.console import Page, link_page, serve
from tenodesis.console.access import AccessControl
from tenodesis.console.tab_setup import read_instrument
from tenodesis.errors import InstrumentError, LiveError, ProtocolError
from tenodesis.instrument import Instrument
from tenodesis.instrument.text import to_toml
from tenodesis.live import folder as folders

from .conftest import refused, until
from .console_guest import Guest, cookie, get, operates
from .console_stand_in import StandIn

pytestmark = pytest.mark.process

HAND = "Handle yaw, °"


@pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0"])
def test_the_page_answers_nothing_without_the_token_wherever_it_listens(
    bench: StandIn, tmp_path: Path, host: str
) -> None:
    """Any account of this computer reaches its loopback addresses."""
    with serve(bench.connect, host=host, port=0, recordings=tmp_path) as page:
        assert len(page.token) >= 32
        assert page.token in page.url
        for wrong in ("", f"tenodesis-{page.port}=wrong"):
            assert get(page, Cookie=wrong).status == 401
            assert get(page, "/stop", X_Tenodesis="stop", Cookie=wrong).status == 401
            assert get(page, "/index.html", Cookie=wrong).status == 401
            with pytest.raises(InvalidStatus, match="401"):
                Guest(page, Cookie=wrong)
        assert get(page, "/?token=wrong", Cookie="").status == 401
        assert bench.commands == []
        assert get(page).status == 200
        with Guest(page) as guest:
            until(lambda: operates(bench, guest))


def test_the_token_is_shown_once_and_the_cookie_stays_with_the_page(page: Page) -> None:
    answer = get(page, f"/?token={page.token}", Cookie="")
    assert answer.status == 200
    cookie = str(answer.getheader("Set-Cookie"))
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert page.token not in cookie


def test_a_token_that_can_be_guessed_is_refused(bench: StandIn) -> None:
    with refused("token", "1234"):
        serve(bench.connect, port=0, token="1234")


def test_an_address_of_another_machine_is_refused(bench: StandIn) -> None:
    with refused("host", "203.0.113.1", kind=LiveError):
        serve(bench.connect, host="203.0.113.1")


def test_the_link_is_for_its_user_alone(tmp_path: Path) -> None:
    opener = folders.write_link(tmp_path, "http://127.0.0.1:1/?token=x", link_page("http://127.0.0.1:1/?token=x"))
    assert {path.stat().st_mode & 0o777 for path in tmp_path.iterdir()} == {0o600}
    assert folders.read_link(tmp_path) == "http://127.0.0.1:1/?token=x"
    assert "url=http://127.0.0.1:1/?token=x" in opener.read_text()
    assert folders.read_link(tmp_path / "elsewhere") is None


def test_only_instrument_files_of_the_given_folders_are_read(tmp_path: Path, scaled: Instrument) -> None:
    inside, outside = tmp_path / "inside", tmp_path / "outside"
    for folder in (inside, outside):
        folder.mkdir()
        (folder / "own.toml").write_text(to_toml(scaled))
        (folder / "notes.txt").write_text("secret")
    (inside / "way.toml").symlink_to(outside / "own.toml")
    (inside / "away").symlink_to(outside)
    (inside / "large.toml").write_bytes(b"#" * 1_000_001)
    os.mkfifo(inside / "pipe.toml")
    assert read_instrument(str(inside / "own.toml"), (inside,)) == to_toml(scaled)
    assert read_instrument(str(inside / "away" / "own.toml"), (inside, outside)) == to_toml(scaled)
    for path in ("own.toml", "../outside/own.toml", "way.toml", "away/own.toml", "notes.txt", "a\0b"):
        given = str(outside / path) if path == "own.toml" else str(inside / path)
        with refused("path", given, kind=InstrumentError):
            read_instrument(given, (inside,))
    for path, says in (("large.toml", "more than 1 MB"), ("pipe.toml", "no regular file"), ("no.toml", "no such file")):
        with pytest.raises(InstrumentError, match=says):
            read_instrument(str(inside / path), (inside,))


def test_a_protocol_of_a_browser_names_no_file() -> None:
    text = 'name = "p"\n[[phases]]\nkind = "motion"\nfile = "/etc/passwd"\nangle_unit = "deg"\n'
    with refused("file", kind=ProtocolError, allowed="data") as caught:
        simulate.parse(text)
    assert "root" not in str(caught.value)


def test_a_page_of_another_site_can_neither_connect_nor_stop(page: Page, bench: StandIn) -> None:
    with pytest.raises(InvalidStatus, match="403"):
        Guest(page, Origin="http://elsewhere.example")
    assert get(page, Host="elsewhere.example").status == 403
    assert get(page, "/stop").status == 403
    assert bench.commands == []
    with Guest(page, Origin=f"http://127.0.0.1:{page.port}") as guest:
        until(lambda: operates(bench, guest))


def test_the_page_cannot_be_put_on_the_internet_by_a_browser(page: Page, bench: StandIn) -> None:
    with Guest(page) as guest:
        until(lambda: operates(bench, guest))
        guest.send({"type": "ShareUrlRequest"})
        guest.set(HAND, 3.0)
        until(lambda: bench.hands[0] > 0)
        assert page._server._share_tunnel is None


def test_no_address_gives_a_page_without_the_stop_button(page: Page) -> None:
    for path in ("/index.html", "//", "/./", "/?/../index.html", "/..%2f..%2fsetup.py", "//[", "/%00"):
        connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=10)
        connection.request("GET", path, headers={"Accept-Encoding": "identity", "Cookie": cookie(page)})
        answer = connection.getresponse()
        body = answer.read()
        if answer.status == 200:
            assert b"tenodesis-stop" in gzip.decompress(body), path
        else:
            assert answer.status in {400, 404}, path
            assert b"<html" not in body.lower(), path


def test_forged_headers_do_not_get_in(page: Page, bench: StandIn) -> None:
    for headers in (
        [("Host", "127.0.0.1"), ("Host", "elsewhere.example")],
        [("Host", "127.0.0.1"), ("Origin", "http://[")],
        [("Host", "127.0.0.1"), ("Origin", "null")],
        [("Host", "127.0.0.1.elsewhere.example")],
        [("Host", "127.0.0.1@elsewhere.example")],
        [("Host", "")],
        [],
    ):
        connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=10)
        connection.putrequest("GET", "/stop", skip_host=True)
        for name, value in [*headers, ("X-Tenodesis", "stop"), ("Cookie", cookie(page))]:
            connection.putheader(name, value)
        connection.endheaders()
        assert connection.getresponse().status in {400, 403}, headers
    assert bench.commands == []


def test_a_pass_of_any_bytes_is_only_wrong(page: Page) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=10)
    connection.putrequest("GET", "/")
    connection.putheader("Cookie", f"tenodesis-{page.port}=".encode() + b"\xff\xfe")
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

    monkeypatch.setattr("tests.python.console_stand_in.StandInConnection.stop_for", gone)
    assert get(page, "/stop", X_Tenodesis="stop").status == 503


def test_a_page_that_hangs_says_so_to_those_who_ask() -> None:
    async def ask(alive: bool) -> bytes:
        access = AccessControl("the page", loopback=True, token="x", stop=lambda _: None, alive=lambda: alive)
        pass_ = f"tenodesis-80={access._cookie_value}"
        request = Request("/alive", Headers({"Host": "localhost", "Cookie": pass_}))
        answer = await access.answer(SimpleNamespace(remote_address=None), request, lambda *_: None)  # type: ignore[arg-type]
        assert answer is not None
        assert answer.status_code == 200
        return bytes(answer.body)

    assert asyncio.run(ask(True)) == b"alive"
    assert asyncio.run(ask(False)) == b"hangs"
