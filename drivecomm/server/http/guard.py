"""Checks of every request: origin, size and duplicate headers; and the security headers of every response."""

from __future__ import annotations

import asyncio
import ipaddress
import re
import socket
import time
from collections import Counter, deque
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from starlette.exceptions import HTTPException

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import Response
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

LARGEST_BODY = 64 * 1024
BODY_TIMEOUT_S = 10.0

HEADERS = {
    "Content-Security-Policy": "default-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'self'",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
}
_RAW_HEADERS = [(name.lower().encode(), value.encode()) for name, value in HEADERS.items()]
_NOT_STORED = (b"cache-control", b"no-store")

_SAID_ONCE = (b"host", b"origin", b"authorization", b"content-length", b"content-type", b"transfer-encoding")
_HOST = re.compile(r"(?:\[(?P<address>[0-9A-Fa-f:.]+)\]|(?P<name>[0-9A-Za-z._-]+))(?::[0-9]{0,5})?")
"""Host header: a name or an address with an optional port; no user name before it and no path."""

_MOST_FAILURES = 5
_WITHIN_S = 60.0
_MOST_REMEMBERED = 10_000


def guarded(
    app: Starlette, check_place: Callable[[Scope], None], refused: Callable[[HTTPException], Response]
) -> ASGIApp:
    """Return the application wrapped in the checks, with security headers on every response.

    check_place: raises HTTPException for a request from a forbidden origin. refused: makes the response to it.
    """
    app.router.redirect_slashes = False

    async def checked(scope: Scope, receive: Receive, send: Send) -> None:
        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = message["headers"] = [*message.get("headers", ()), *_RAW_HEADERS]
                if not any(name == b"cache-control" for name, _ in headers):
                    headers.append(_NOT_STORED)
            await send(message)

        try:
            _check_said_once(scope)
            check_place(scope)
        except HTTPException as error:
            await refused(error)(scope, receive, with_headers)
            return
        # Routes match the path before it is unquoted: a quoted slash in a name must not split it.
        await app({**scope, "path": scope["raw_path"].decode("ascii", "replace")}, receive, with_headers)

    return checked


def _check_said_once(scope: Scope) -> None:
    """Raise HTTPException for duplicate headers, which proxies and servers may interpret differently."""
    names = Counter(name for name, _ in scope["headers"])
    twice = sorted(name.decode("latin-1") for name in _SAID_ONCE if names[name] > 1)
    if twice:
        raise HTTPException(400, f"the request has several headers {', '.join(twice)}; send one")
    if names[b"content-length"] and names[b"transfer-encoding"]:
        raise HTTPException(400, "the request has content-length and transfer-encoding; send one of both")


def check_place(scope: Scope, names: Collection[str]) -> None:
    """Raise HTTPException for a request from a page of another server, or for a foreign host name.

    An attacker can make a name of his own resolve to this machine (DNS rebinding). So only known names of this machine
    are accepted, and addresses, which cannot be redirected.
    """
    headers = dict(scope["headers"])
    host = headers.get(b"host", b"").decode("latin-1")
    if not _is_ours(host, names):
        raise HTTPException(
            403, f"this server is not named {host!r}; use its address, or write names = [...] in its [[door]]"
        )
    if b"origin" in headers and urlsplit(headers[b"origin"].decode("latin-1")).netloc.lower() != host.lower():
        raise HTTPException(403, "the request comes from a page of another server")


def check_no_browser(scope: Scope) -> None:
    """Raise HTTPException for a request from a web page: a page reaches a unix socket only through a relay."""
    if any(name == b"origin" for name, _ in scope["headers"]):
        raise HTTPException(403, "the request comes from a page of another server")


def own_names() -> frozenset[str]:
    """Return the names of this machine, without a network lookup."""
    name = socket.gethostname().lower()
    return frozenset({"localhost", name, f"{name}.local", name.partition(".")[0]})


def _is_ours(host: str, names: Collection[str]) -> bool:
    found = _HOST.fullmatch(host)
    if found is None:
        return False
    name = (found["address"] or found["name"]).lower()
    try:
        return name in names or bool(ipaddress.ip_address(name))
    except ValueError:
        return False


async def whole_body(request: Request) -> bytes:
    """Return the body of a request. Raises HTTPException if it is too large or arrives too slowly."""
    too_large = HTTPException(413, f"the body is larger than {LARGEST_BODY // 1024} KiB", {"Connection": "close"})
    stated = request.headers.get("content-length", "0")
    if len(stated) > len(str(LARGEST_BODY)) or int(stated) > LARGEST_BODY:
        raise too_large
    body = b""
    try:
        async with asyncio.timeout(BODY_TIMEOUT_S):
            async for piece in request.stream():
                body += piece
                if len(body) > LARGEST_BODY:
                    raise too_large
    except TimeoutError:
        raise HTTPException(408, "the body did not arrive in time", {"Connection": "close"}) from None
    return body


class LoginRate:
    """Limit of failed logins per client address. `users` limits them per user name."""

    def __init__(self) -> None:
        self.turn = asyncio.Lock()
        self._failures: dict[str, deque[float]] = {}

    def check(self, address: str) -> None:
        """Raise HTTPException if this address has had too many failures within a minute."""
        now = time.monotonic()
        failures = self._failures.get(address, ())
        recent = [each for each in failures if now - each < _WITHIN_S]
        if len(recent) >= _MOST_FAILURES:
            wait_s = int(_WITHIN_S - (now - recent[0])) + 1
            raise HTTPException(429, f"too many wrong logins; wait {wait_s} s", {"Retry-After": str(wait_s)})

    def failed(self, address: str) -> None:
        """Count a failed login of this address."""
        if len(self._failures) >= _MOST_REMEMBERED:
            self._failures.pop(next(iter(self._failures)))
        self._failures.setdefault(address, deque(maxlen=_MOST_FAILURES)).append(time.monotonic())
