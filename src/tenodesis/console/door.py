"""Who comes in: what every request to the page must show before anything of the page answers."""

import asyncio
import gzip
import hmac
import http
import ipaddress
import secrets
from collections.abc import Callable, Mapping
from html import escape
from math import ceil
from typing import Any
from urllib.parse import parse_qs, urlsplit

from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from tenodesis.console.lockout import Lockout

# The browser itself is told to ask nobody else for anything.
_POLICY = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; connect-src 'self' data: blob:; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'self'"
)
_ALWAYS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Content-Security-Policy": _POLICY,
}

Inner = Callable[[ServerConnection, Request], Response | None]


class Door:
    """Answers requests in place of the page, or lets them through.

    Parameters
    ----------
    page
        The HTML page.
    loopback
        Whether only this machine can reach it; it must then be asked for by a name of this machine, so that no page of
        another site can be pointed at it.
    token
        What must be shown once by whoever wants in; None for nothing.
    stop
        Stops the motors in the name of an origin; returns what went wrong, or None.
    alive
        Returns whether the page goes on.
    lockout
        Slows guesses down.
    """

    def __init__(
        self,
        page: str,
        *,
        loopback: bool,
        token: str | None,
        stop: Callable[[str], str | None],
        alive: Callable[[], bool] = lambda: True,
        lockout: Lockout | None = None,
    ) -> None:
        self._page = gzip.compress(page.encode())
        self._loopback, self._token, self._stop, self._alive = loopback, token, stop, alive
        self._lockout = Lockout() if lockout is None else lockout
        self._pass = secrets.token_urlsafe(32)

    async def answer(self, connection: ServerConnection, request: Request, inner: Inner) -> Response | None:
        """Return the answer to a request; None lets a WebSocket begin."""
        headers = request.headers
        try:
            host, origin = headers.get("Host", ""), headers.get("Origin")
            target, site = urlsplit(request.path), None if origin is None else urlsplit(origin).netloc
        except (LookupError, ValueError):
            return _text(http.HTTPStatus.BAD_REQUEST, "This request cannot be understood.")
        if self._loopback and not is_loopback(_name(host)):
            return _text(http.HTTPStatus.FORBIDDEN, "This page answers to localhost and 127.0.0.1 only.")
        if site not in (None, host):
            return _text(http.HTTPStatus.FORBIDDEN, "This page answers to itself only, not to another site.")
        if self._token is not None and not self._knows_pass(headers, host):
            return self._let_in(_address(connection), host, parse_qs(target.query).get("token", [""])[0])
        if "websocket" in headers.get_all("Upgrade"):
            return inner(connection, request)
        return await self._page_of(target.path, headers, _address(connection))

    async def _page_of(self, path: str, headers: Headers, address: str) -> Response:
        """Answer somebody who may come in."""
        if path == "/stop":
            return await self._stopped(headers, address)
        if path == "/alive":
            return _text(http.HTTPStatus.OK, "alive" if self._alive() else "hangs")
        # Of the library's own pages one is the viewer, without the stop button.
        if path != "/":
            return _text(http.HTTPStatus.NOT_FOUND, "There is nothing here; the page is at /.")
        return _html(http.HTTPStatus.OK, self._page, {"Content-Encoding": "gzip"})

    def _knows_pass(self, headers: Headers, host: str) -> bool:
        shown = _cookies(headers).get(_cookie(host), "")
        return hmac.compare_digest(_bytes(shown), _bytes(self._pass))

    def _let_in(self, address: str, host: str, guess: str) -> Response:
        """Answer somebody who is not known yet: with a pass for the right token, or with the question for it."""
        seconds = self._lockout.remaining(address)
        if seconds > 0:
            answer = _text(http.HTTPStatus.TOO_MANY_REQUESTS, f"Too many wrong tokens. Wait {ceil(seconds)} s.")
            answer.headers["Retry-After"] = f"{ceil(seconds)}"
            return answer
        if not guess:
            return _html(http.HTTPStatus.UNAUTHORIZED, _question("").encode())
        if not hmac.compare_digest(_bytes(guess), _bytes(str(self._token))):
            self._lockout.wrong(address)
            return _html(http.HTTPStatus.UNAUTHORIZED, _question("That is not the token.").encode())
        self._lockout.right(address)
        answer = _text(http.HTTPStatus.SEE_OTHER, "Come in.")
        answer.headers["Location"] = "/"
        answer.headers["Set-Cookie"] = f"{_cookie(host)}={self._pass}; HttpOnly; SameSite=Strict; Path=/"
        return answer

    async def _stopped(self, headers: Headers, address: str) -> Response:
        # No other site can send a header of its own without being asked first, which it is refused.
        if headers.get("X-Tenodesis") != "stop":
            return _text(http.HTTPStatus.FORBIDDEN, "Only the page's stop button stops.")
        problem = await asyncio.to_thread(self._stop, f"stop button at {address}")
        if problem is None:
            return _text(http.HTTPStatus.OK, "Stopped.")
        return _text(http.HTTPStatus.SERVICE_UNAVAILABLE, problem)


def is_loopback(host: str) -> bool:
    """Return whether a host name or address is this machine's own to itself."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _address(connection: ServerConnection) -> str:
    remote: Any = connection.remote_address
    return str(remote[0]) if remote else "unknown"


def _bytes(text: str) -> bytes:
    # Whatever bytes a header holds come as text.
    return text.encode("utf-8", "surrogateescape")


def _name(host: str) -> str:
    """Return the host's name without its port."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def _cookie(host: str) -> str:
    """Return the name of the pass; browsers do not tell cookies of two ports apart."""
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
        status.value, status.phrase, Headers({**_ALWAYS, **headers, "Content-Length": str(len(body))}), body
    )


def _text(status: http.HTTPStatus, text: str) -> Response:
    return _response(status, text.encode(), {"Content-Type": "text/plain; charset=utf-8"})


def _html(status: http.HTTPStatus, body: bytes, headers: Mapping[str, str] | None = None) -> Response:
    return _response(status, body, {"Content-Type": "text/html; charset=utf-8", **(headers or {})})


def _question(problem: str) -> str:
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        "<title>Tenodesis</title><style>body{font:16px system-ui,sans-serif;color:#1b2733;max-width:26em;"
        "margin:15vh auto;padding:0 1em}input,button{font:inherit;padding:.5em;width:100%;box-sizing:border-box;"
        "margin-top:.6em}p.problem{color:#b4232f}</style><h1>Tenodesis console</h1>"
        "<p>This instrument can be reached from other machines, so the page asks for the token that "
        "<code>tenodesis console</code> printed when it began.</p>"
        f'<p class="problem" role="alert">{escape(problem)}</p>'
        '<form><label>Token<input name="token" type="password" autocomplete="off" autofocus></label>'
        "<button>Come in</button></form></html>"
    )
