"""What holds for every request: where it may come from, how large it may be, and what each answer says to browsers."""

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
"""A name or an address, and a port; nothing before it, such as the name of a user, and no path."""

_MOST_FAILURES = 5
_WITHIN_S = 60.0
_MOST_REMEMBERED = 10_000


def guarded(
    app: Starlette, check_place: Callable[[Scope], None], refused: Callable[[HTTPException], Response]
) -> ASGIApp:
    """Return an application with its checks in front of it, and the security headers on each of its answers.

    check_place: raises HTTPException for requests from where none may come. refused: makes the answer to those.
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
        # Routes are found in what was sent: a slash in a name divides nothing.
        await app({**scope, "path": scope["raw_path"].decode("ascii", "replace")}, receive, with_headers)

    return checked


def _check_said_once(scope: Scope) -> None:
    """Raise HTTPException for a request that says something twice, of which proxies and servers believe another one."""
    names = Counter(name for name, _ in scope["headers"])
    twice = sorted(name.decode("latin-1") for name in _SAID_ONCE if names[name] > 1)
    if twice:
        raise HTTPException(400, f"the request has several headers {', '.join(twice)}; send one")
    if names[b"content-length"] and names[b"transfer-encoding"]:
        raise HTTPException(400, "the request has content-length and transfer-encoding; send one of both")


def check_place(scope: Scope, names: Collection[str]) -> None:
    """Raise HTTPException for a request of a page that is not ours, or for another machine's name.

    A page from elsewhere can have its own name lead to this machine (DNS rebinding), so only names that are known to
    be ours are served, and addresses, which nobody can make lead elsewhere.
    """
    headers = dict(scope["headers"])
    host = headers.get(b"host", b"").decode("latin-1")
    if not _is_ours(host, names):
        raise HTTPException(
            403, f"this server is not called {host!r}; use its address, or write names = [...] in its [[door]]"
        )
    if b"origin" in headers and urlsplit(headers[b"origin"].decode("latin-1")).netloc.lower() != host.lower():
        raise HTTPException(403, "the request comes from a page of another server")


def check_no_browser(scope: Scope) -> None:
    """Raise HTTPException for a request of a page: none has reached a unix socket without somebody's help."""
    if any(name == b"origin" for name, _ in scope["headers"]):
        raise HTTPException(403, "the request comes from a page of another server")


def own_names() -> frozenset[str]:
    """Return what this machine is called, without asking the network."""
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
    """Return the body. Raises HTTPException for one that is too large, or takes too long to come."""
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
        raise HTTPException(408, "the body did not come in time", {"Connection": "close"}) from None
    return body


class LoginRate:
    """How often somebody at one address may be wrong; how often about one name, the users see to."""

    def __init__(self) -> None:
        self.turn = asyncio.Lock()
        self._failures: dict[str, deque[float]] = {}

    def check(self, address: str) -> None:
        """Raise HTTPException for one who has been wrong too often within a minute."""
        now = time.monotonic()
        failures = self._failures.get(address, ())
        recent = [each for each in failures if now - each < _WITHIN_S]
        if len(recent) >= _MOST_FAILURES:
            wait_s = int(_WITHIN_S - (now - recent[0])) + 1
            raise HTTPException(429, f"too many wrong logins; wait {wait_s} s", {"Retry-After": str(wait_s)})

    def failed(self, address: str) -> None:
        """Count one who was wrong."""
        if len(self._failures) >= _MOST_REMEMBERED:
            self._failures.pop(next(iter(self._failures)))
        self._failures.setdefault(address, deque(maxlen=_MOST_FAILURES)).append(time.monotonic())
