"""Local door of a program that has a port and is not a server: other programs of its user stop drives through it.

The door accepts the part of a server's interface that stops need: `POST
/api/v1/lines/line/drives/PROTOCOL:ADDRESS/stop`, with `PROTOCOL:*` for all drives, and `GET /healthz`. It can neither
start nor read a drive.
"""

from __future__ import annotations

import itertools
import os
import socket
import time
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from threading import Event, Thread
from typing import TYPE_CHECKING, Any, TypeAlias
from urllib.parse import unquote

from drivecomm.client.peers import may_command
from drivecomm.client.registration import Registration, holders_socket, register_holder
from drivecomm.errors import DriveCommError, UsageError
from drivecomm.protocol import Stop

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

STOP_LINE = "line"
"""Name of the door's only line."""

_BACKLOG = 128
_REQUEST_S = 5.0
_ACCEPT_S = 0.2
_LONGEST_BODY = 1 << 16
# Time for a stop with all its attempts.
_END_S = 12.0
_HAS_UNIX_SOCKETS = hasattr(socket, "AF_UNIX") and os.name == "posix"
_NUMBERS = itertools.count()


@dataclass(frozen=True, slots=True, kw_only=True)
class StopOrder:
    """Received stop. address: None for all drives of the protocol. options: options of the drive."""

    protocol: str
    address: int | None
    how: Stop
    options: Mapping[str, Any]


CarryOut: TypeAlias = "Callable[[StopOrder], None]"


@contextmanager
def stop_door(port: str, program: str, carry_out: CarryOut, on_failure: Callable[[Exception], None]) -> Iterator[None]:
    """Accept stops of this user's other programs during the block.

    carry_out: stops a drive; called in threads. Its DriveCommError is sent to the other program. on_failure: called if
    the door cannot be opened; the block then runs without it.
    """
    with ExitStack() as stack:
        try:
            door = _Door(carry_out)
            stack.callback(door.close)
            registration = Registration(
                plant="",
                socket=door.socket,
                port=door.port,
                token=door.token,
                lines={STOP_LINE: port},
                started_s=time.time(),
                program=program,
            )
            stack.enter_context(register_holder(registration, door.name))
        except Exception as error:  # noqa: BLE001 - the program also works without a door
            stack.close()
            on_failure(error)
        yield


class _Door:
    """Listening socket that serves each connection in a separate thread."""

    def __init__(self, carry_out: CarryOut) -> None:
        self._carry_out = carry_out
        self._closed = Event()
        self._clients: list[Thread] = []
        self.name = holders_socket(next(_NUMBERS))
        self.socket, self.port, self.token = "", 0, ""
        if _HAS_UNIX_SOCKETS:
            self._listening = _unix_socket(str(self.name))
            self.socket = str(self.name)
        else:
            import secrets

            self._listening = socket.create_server(("127.0.0.1", 0))
            self.port, self.token = self._listening.getsockname()[1], secrets.token_hex(32)
        self._listening.settimeout(_ACCEPT_S)
        self._thread = Thread(target=self._accept, name="door for stops", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Refuse new connections, and wait until the present ones end."""
        self._closed.set()
        # A connection wakes the accepting thread; a shutdown of the listening socket does not.
        address = str(self.name) if self.socket else ("127.0.0.1", self.port)
        with suppress(OSError), socket.socket(self._listening.family) as guest:
            guest.settimeout(_ACCEPT_S)
            guest.connect(address)
        self._thread.join()
        self._listening.close()
        if self.socket:
            with suppress(OSError):
                self.name.unlink()
        until = time.monotonic() + _END_S
        for client in self._clients:
            client.join(max(0.0, until - time.monotonic()))

    def _accept(self) -> None:
        while not self._closed.is_set():
            try:
                connected = self._listening.accept()[0]
            except TimeoutError:
                continue
            except OSError:
                # A resource such as file descriptors may be exhausted; the next attempt may succeed.
                self._closed.wait(_ACCEPT_S)
                continue
            self._clients = [client for client in self._clients if client.is_alive()]
            self._clients.append(Thread(target=self._serve, args=(connected,), daemon=True))
            self._clients[-1].start()

    def _serve(self, connected: socket.socket) -> None:
        # The stop of a client that disconnects is carried out all the same; a malformed request is dropped.
        # Imported late, because most doors close without any client.
        from drivecomm.client.local_http import HttpStream
        from drivecomm.client.wire import error_content

        with connected, suppress(OSError, ValueError):
            connected.settimeout(_REQUEST_S)
            stream = HttpStream(connected)
            request, headers = stream.head()
            bearer = headers.get("authorization", "").removeprefix("bearer ")
            if self.token:
                import hmac

                known = hmac.compare_digest(bearer.encode(), self.token.encode())
            else:
                known = may_command(connected)
            if not known:
                _answer(connected, 403, {"error": error_content(UsageError("this door serves only its own user"))})
                return
            length = int(headers.get("content-length", "0"))
            if not 0 <= length <= _LONGEST_BODY:
                raise ValueError("a body that is too long")
            _answer(connected, *self._result(request, stream.exactly(length)))

    def _result(self, request: str, body: bytes) -> tuple[int, object]:
        """Return status and content of the response to a request."""
        from drivecomm.client.wire import error_content

        method, path, *_ = [*request.split(" "), "", ""]
        if (method, path) == ("GET", "/healthz"):
            return 200, {}
        try:
            order = _order(method, path, body)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            wrong = UsageError(f"the program that has this port accepts only stops ({error!r})")
            return 404, {"error": error_content(wrong)}
        try:
            self._carry_out(order)
        except DriveCommError as error:
            return 200, {"outcome": "open", "error": error_content(error)}
        except Exception as error:  # noqa: BLE001 - any error must be reported to the other program
            return 200, {"outcome": "open", "error": error_content(DriveCommError(repr(error)))}
        return 200, {"outcome": "done", "error": None}


def _order(method: str, path: str, body: bytes) -> StopOrder:
    from drivecomm.client.wire import parsed

    words = [unquote(word) for word in path.split("/")]
    if (method, words[:-2], words[-1]) != ("POST", ["", "api", "v1", "lines", STOP_LINE, "drives"], "stop"):
        raise ValueError(f"{method} {path}")
    protocol, _, address = words[-2].partition(":")
    content = parsed(body)
    return StopOrder(
        protocol=protocol,
        address=None if address == "*" else int(address),
        how=Stop(content["arguments"]["how"]),
        options=dict(content.get("options", {})),
    )


def _answer(connected: socket.socket, status: int, content: object) -> None:
    from drivecomm.client.wire import json_text

    body = json_text(content).encode()
    head = f"HTTP/1.1 {status} \r\nContent-Type: application/json\r\nContent-Length: {len(body)}\r\n"
    connected.sendall(f"{head}Connection: close\r\n\r\n".encode() + body)


def _unix_socket(path: str) -> socket.socket:
    with suppress(FileNotFoundError):
        # The socket is left over from an earlier process with this number.
        os.unlink(path)  # noqa: PTH108
    listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        # The permissions are set before the socket listens, so no other user can connect.
        listening.bind(path)
        os.chmod(path, 0o600)  # noqa: PTH101
        listening.listen(_BACKLOG)
    except OSError:
        listening.close()
        raise
    return listening
