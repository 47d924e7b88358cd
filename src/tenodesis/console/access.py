"""Access to the page: what every request must show before anything answers it, and the HTML that it gets."""

import asyncio
import gzip
import hmac
import http
import ipaddress
import secrets
from collections.abc import Callable, Mapping
from html import escape
from importlib import resources
from pathlib import Path
from typing import Any, TypeAlias
from urllib.parse import parse_qs, urlsplit

from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

LARGEST_UPLOAD = 8_000_000
"""Largest file that a browser may send, bytes; the page refuses larger files before they are sent."""

# Browsers themselves refuse requests to any other site.
_POLICY = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; connect-src 'self' data: blob:; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'self'"
)
_HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Content-Security-Policy": _POLICY,
}

ProcessRequest: TypeAlias = Callable[[ServerConnection, Request], Response | None]


class AccessControl:
    """Answers requests, or lets a WebSocket connection of an authorised browser begin.

    Parameters
    ----------
    page
        The HTML page.
    loopback
        Whether only this machine can reach the page; requests must then name this machine as their host, so that no
        page of another site can be resolved to it.
    token
        Token that a browser must show once.
    stop
        Stops the motors in the name of an origin; returns the problem, or None.
    alive
        Returns whether the page still ticks.
    """

    def __init__(
        self,
        page: str,
        *,
        loopback: bool,
        token: str,
        stop: Callable[[str], str | None],
        alive: Callable[[], bool] = lambda: True,
    ) -> None:
        self._page = gzip.compress(page.encode())
        self._loopback, self._token, self._stop, self._alive = loopback, token, stop, alive
        self._cookie_value = secrets.token_urlsafe(32)

    async def answer(self, connection: ServerConnection, request: Request, inner: ProcessRequest) -> Response | None:
        """Return the answer to a request; None lets a WebSocket connection begin."""
        headers = request.headers
        try:
            host, origin = headers.get("Host", ""), headers.get("Origin")
            target, site = urlsplit(request.path), None if origin is None else urlsplit(origin).netloc
        except (LookupError, ValueError):
            return _text(http.HTTPStatus.BAD_REQUEST, "This request is malformed.")
        if self._loopback and not is_loopback(_name(host)):
            return _text(http.HTTPStatus.FORBIDDEN, "This page answers requests to localhost and 127.0.0.1 only.")
        if site not in (None, host):
            return _text(http.HTTPStatus.FORBIDDEN, "This page does not answer requests of other sites.")
        if not self._has_cookie(headers, host):
            return self._check_token(host, parse_qs(target.query).get("token", [""])[0])
        if "websocket" in headers.get_all("Upgrade"):
            return inner(connection, request)
        return await self._authorised(target.path, headers, _address(connection))

    async def _authorised(self, path: str, headers: Headers, address: str) -> Response:
        """Answer a request of an authorised browser."""
        if path == "/stop":
            return await self._stopped(headers, address)
        if path == "/alive":
            return _text(http.HTTPStatus.OK, "alive" if self._alive() else "hangs")
        # The viewer has a page of its own at another path, without the stop button.
        if path != "/":
            return _text(http.HTTPStatus.NOT_FOUND, "Not found; the page is at /.")
        return _html(http.HTTPStatus.OK, self._page, {"Content-Encoding": "gzip"})

    def _has_cookie(self, headers: Headers, host: str) -> bool:
        shown = _cookies(headers).get(_cookie(host), "")
        return hmac.compare_digest(_bytes(shown), _bytes(self._cookie_value))

    def _check_token(self, host: str, token: str) -> Response:
        """Answer a browser without the cookie: with the cookie for the right token, otherwise with a form for it."""
        if not token:
            return _html(http.HTTPStatus.UNAUTHORIZED, _form("").encode())
        if not hmac.compare_digest(_bytes(token), _bytes(self._token)):
            return _html(http.HTTPStatus.UNAUTHORIZED, _form("This is not the token.").encode())
        # After a redirect that a file or another site began, a browser would not send the cookie.
        answer = _html(http.HTTPStatus.OK, link_page("/").encode())
        answer.headers["Set-Cookie"] = f"{_cookie(host)}={self._cookie_value}; HttpOnly; SameSite=Strict; Path=/"
        return answer

    async def _stopped(self, headers: Headers, address: str) -> Response:
        # A page of another site cannot send this header without a preflight request, which is refused.
        if headers.get("X-Tenodesis") != "stop":
            return _text(http.HTTPStatus.FORBIDDEN, "Only the page's stop button stops.")
        problem = await asyncio.to_thread(self._stop, f"stop button at {address}")
        if problem is None:
            return _text(http.HTTPStatus.OK, "Stopped.")
        return _text(http.HTTPStatus.SERVICE_UNAVAILABLE, problem)


def link_page(url: str) -> str:
    """Return the HTML of a page that opens another at once."""
    # Without an icon of its own, a browser that is slow to go on asks for /favicon.ico, which there is not.
    head = '<!doctype html><meta charset="utf-8"><link rel="icon" href="data:,">'
    return f'{head}<meta http-equiv="refresh" content="0; url={escape(url)}">'


def page_html() -> str:
    """Return the HTML of the page: the viewer's, with the stop button on top of everything; it loads nothing else.

    The stop button is no part of the viewer's panel, which can be folded away, and does not need its connection.
    """
    import viser  # noqa: PLC0415 - takes half a second

    viewer = (Path(viser.__file__).parent / "client" / "build" / "index.html").read_text("utf-8")
    overlay = (resources.files("tenodesis.console") / "overlay.html").read_text("utf-8")
    before, ends, after = viewer.rpartition("</body>")
    return before + overlay.replace("LARGEST_UPLOAD", str(LARGEST_UPLOAD)) + ends + after


def is_loopback(host: str) -> bool:
    """Return whether a host name or address can be reached from this machine only."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _address(connection: ServerConnection) -> str:
    remote: Any = connection.remote_address
    return str(remote[0]) if remote else "unknown"


def _bytes(text: str) -> bytes:
    # A header may hold any bytes, which come as text.
    return text.encode("utf-8", "surrogateescape")


def _name(host: str) -> str:
    """Return the host's name without its port."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def _cookie(host: str) -> str:
    """Return the cookie's name, with the port: browsers do not keep the cookies of two ports apart."""
    try:
        port = urlsplit(f"//{host}").port
    except ValueError:
        port = None
    return f"tenodesis-{port or 80}"


def _cookies(headers: Headers) -> Mapping[str, str]:
    pairs = (pair.partition("=") for line in headers.get_all("Cookie") for pair in line.split(";"))
    return {name.strip(): value.strip() for name, _, value in pairs}


def _response(status: http.HTTPStatus, body: bytes, headers: Mapping[str, str]) -> Response:
    return Response(
        status.value, status.phrase, Headers({**_HEADERS, **headers, "Content-Length": str(len(body))}), body
    )


def _text(status: http.HTTPStatus, text: str) -> Response:
    return _response(status, text.encode(), {"Content-Type": "text/plain; charset=utf-8"})


def _html(status: http.HTTPStatus, body: bytes, headers: Mapping[str, str] | None = None) -> Response:
    return _response(status, body, {"Content-Type": "text/html; charset=utf-8", **(headers or {})})


def _form(problem: str) -> str:
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        "<title>Tenodesis</title><style>body{font:16px system-ui,sans-serif;color:#1b2733;max-width:26em;"
        "margin:15vh auto;padding:0 1em}input,button{font:inherit;padding:.5em;width:100%;box-sizing:border-box;"
        "margin-top:.6em}p.problem{color:#b4232f}</style><h1>Tenodesis console</h1>"
        "<p>Who opens this page can move motors, so it needs the token that <code>tenodesis console</code> printed at "
        "its start; <code>tenodesis link</code> prints it again.</p>"
        f'<p class="problem" role="alert">{escape(problem)}</p>'
        '<form><label>Token<input name="token" type="password" autocomplete="off" autofocus></label>'
        "<button>Open the console</button></form></html>"
    )
