"""The control socket of a running plant: one line of JSON in, one out, for up to 64 clients."""

from __future__ import annotations

import contextlib
import json
import os
import socket
import stat
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from drivecomm.client import check_peer, may_command
from drivecomm.errors import LinkDownError, PortError, UsageError, reason_of
from drivecomm.virtual.accepting import Accepting
from drivecomm.virtual.control_orders import answer_order

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from drivecomm.virtual.virtual_plant import VirtualPlant

LONGEST_ORDER = 65536
"""Largest size of an order, in bytes."""

_MOST_CLIENTS = 64
# Small reads, so that a client with many orders does not delay the lines.
_CHUNK = 512
_ANSWERS_S = 0.5
_FORMS = "HOST:PORT or unix:PATH"


class SocketAddress(NamedTuple):
    """Address of a control socket: a host and a port, or the path of a Unix socket."""

    host: str
    port: int
    path: str

    def __str__(self) -> str:
        if self.path:
            return f"unix:{self.path}"
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"


def parse_socket_address(text: str) -> SocketAddress:
    """Parse `HOST:PORT`, `:PORT` for this machine only, or `unix:PATH`. Raises UsageError."""
    if text.startswith("unix:"):
        if not hasattr(socket, "AF_UNIX"):
            raise UsageError(f"this system has no Unix sockets; write HOST:PORT instead of {text!r}")
        if len(text) == len("unix:"):
            raise UsageError(f"{text!r} names no path; write unix:PATH")
        return SocketAddress("", 0, text.removeprefix("unix:"))
    host, colon, port = text.rpartition(":")
    if not colon or not port.isascii() or not port.isdigit() or int(port) > 65535:
        raise UsageError(f"{text!r} is not an address for the control socket; write {_FORMS}")
    return SocketAddress(host.removeprefix("[").removesuffix("]") or "127.0.0.1", int(port), "")


class ControlServer:
    """Server through which other programs control a plant that is being served.

    be_now: called before each order to bring the lines up to the present time, so that the order takes effect now.
    """

    def __init__(self, place: SocketAddress, plant: VirtualPlant, be_now: Callable[[], None]) -> None:
        self._place = place
        self._plant = plant
        self._be_now = be_now
        self._server: socket.socket | None = None
        self._accepting = Accepting()
        self._clients: dict[int, socket.socket] = {}
        self._pending: dict[int, bytes] = {}

    @property
    def address(self) -> str:
        """The address to connect to; final once the server is open."""
        return str(self._place)

    def open(self) -> None:
        """Listen for clients. Raises PortError."""
        place = self._place
        try:
            if place.path:
                self._server = _unix_server(place.path)
            else:
                family = socket.AF_INET6 if ":" in place.host else socket.AF_INET
                self._server = socket.create_server((place.host, place.port), family=family)
                self._place = place._replace(port=self._server.getsockname()[1])
        except (OSError, OverflowError) as error:
            raise PortError(
                f"cannot open the control socket at {place} ({reason_of(error)}); "
                "choose another address, or port 0 for any free one"
            ) from error
        self._server.setblocking(False)
        self._accepting.open()

    def close(self) -> None:
        """Close all connections; may be called again."""
        self._accepting.close()
        for descriptor in list(self._clients):
            self._disconnect(descriptor)
        if self._server is not None:
            self._server.close()
            self._server = None
            if self._place.path:
                Path(self._place.path).unlink(missing_ok=True)

    @property
    def descriptors(self) -> Sequence[int]:
        """Descriptors of the listening socket and of its clients."""
        return [] if self._server is None else [self._server.fileno(), *self._clients]

    def attend(self, descriptor: int) -> None:
        """Accept a client, or process the bytes of one."""
        if self._server is not None and descriptor == self._server.fileno():
            self._accept(self._server)
        elif descriptor in self._clients:
            self._receive(descriptor)

    def _accept(self, server: socket.socket) -> None:
        client = self._accepting.next(server)
        if client is None:
            return
        if len(self._clients) >= _MOST_CLIENTS or (self._place.path and not may_command(client)):
            client.close()
            return
        client.setblocking(False)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)
        self._clients[client.fileno()] = client
        self._pending[client.fileno()] = b""

    def _receive(self, descriptor: int) -> None:
        try:
            data = self._clients[descriptor].recv(_CHUNK)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._disconnect(descriptor)
            return
        *orders, rest = (self._pending[descriptor] + data).split(b"\n")
        if len(rest) > LONGEST_ORDER:
            self._disconnect(descriptor)
            return
        self._pending[descriptor] = rest
        for order in orders:
            if order.strip() and descriptor in self._clients:
                self._be_now()
                self._answer(descriptor, answer_order(self._plant, order))

    def _answer(self, descriptor: int, answer: bytes) -> None:
        """Send an answer; disconnect a client that does not read its answers."""
        try:
            sent = self._clients[descriptor].send(answer)
        except OSError:
            sent = -1
        if sent != len(answer):
            self._disconnect(descriptor)

    def _disconnect(self, descriptor: int) -> None:
        self._clients.pop(descriptor).close()
        del self._pending[descriptor]


def _unix_server(path: str) -> socket.socket:
    with contextlib.suppress(FileNotFoundError):
        # Do not follow a symbolic link: its owner could redirect it later.
        if not stat.S_ISSOCK(os.lstat(path).st_mode):
            raise PortError(f"{path} exists and is not a socket; choose another path, or remove it")
        if _is_served(path):
            raise PortError(f"another plant has its control socket at {path}; stop it, or choose another path")
        # Left behind by a plant that was killed.
        os.unlink(path)  # noqa: PTH108
    server = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        server.bind(path)
        server.listen()
    except OSError:
        server.close()
        raise
    return server


def _is_served(path: str) -> bool:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
        client.settimeout(_ANSWERS_S)
        try:
            client.connect(path)
        except OSError as error:
            # A server that is too busy to accept the connection is still running.
            return isinstance(error, TimeoutError | BlockingIOError)
    return True


_PATIENCE_S = 10.0


class ControlClient:
    """A connection to the control socket at HOST:PORT or unix:PATH.

    Raises UsageError for any other text, PortError if no plant listens there.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        place = parse_socket_address(address)
        try:
            if place.path:
                self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
                self._socket.settimeout(_PATIENCE_S)
                self._socket.connect(place.path)
                check_peer(self._socket, place.path)
            else:
                self._socket = socket.create_connection((place.host, place.port), timeout=_PATIENCE_S)
        except OSError as error:
            if place.path:
                self._socket.close()
            raise PortError(
                f"no plant at {address} ({error.strerror or error}); start one with drivecomm simulate, "
                "which prints the address of its control socket"
            ) from error
        self._file = self._socket.makefile("rb")

    def order(self, order: str, **fields: Any) -> dict[str, Any]:
        """Send an order and return the answer without its `ok`.

        The orders are trip, power, set, inject, fault, show, telegrams, violations, counters and state, with the fields
        that `control_orders` lists. Raises UsageError if the plant refuses, LinkDownError if the connection is lost.
        """
        try:
            self._socket.sendall(json.dumps({"order": order, **fields}).encode() + b"\n")
            line = self._file.readline()
            answer = json.loads(line) if line else None
        except (OSError, ValueError) as error:
            raise LinkDownError(f"the plant at {self.address} does not answer ({error}); is it running?") from error
        if not isinstance(answer, dict):
            raise LinkDownError(f"the plant at {self.address} closed the connection; start it again")
        if not answer.pop("ok", False):
            raise UsageError(str(answer.get("error", "the plant refused without a reason")))
        return answer

    def close(self) -> None:
        """Close the connection; the plant keeps running."""
        self._file.close()
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
