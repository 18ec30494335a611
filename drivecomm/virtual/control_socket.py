"""The control socket of a running plant: a line of JSON in, a line of JSON out, for any number of programs."""

from __future__ import annotations

import contextlib
import json
import os
import socket
import stat
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from drivecomm.errors import LinkDownError, PortError, UsageError
from drivecomm.virtual.control_orders import answer_order

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from types import TracebackType

    from drivecomm.virtual.virtual_plant import VirtualPlant

LONGEST_ORDER = 65536
"""The most bytes that an order may have."""

_MOST_GUESTS = 64
# A little at a time, so that somebody with many orders cannot keep the server from its lines.
_CHUNK = 512
_ANSWERS_S = 0.5
_FORMS = "HOST:PORT or unix:PATH"


class Place(NamedTuple):
    """Where a control socket is: a host and a port, or the path of a Unix socket."""

    host: str
    port: int
    path: str

    def __str__(self) -> str:
        if self.path:
            return f"unix:{self.path}"
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"


def parse_place(text: str) -> Place:
    """Read `HOST:PORT`, `:PORT` for this machine only, or `unix:PATH`. Raises UsageError."""
    if text.startswith("unix:"):
        if not hasattr(socket, "AF_UNIX"):
            raise UsageError(f"this system has no Unix sockets; write HOST:PORT in the place of {text!r}")
        if len(text) == len("unix:"):
            raise UsageError(f"{text!r} names no path; write unix:PATH")
        return Place("", 0, text.removeprefix("unix:"))
    host, colon, port = text.rpartition(":")
    if not colon or not port.isascii() or not port.isdigit() or int(port) > 65535:
        raise UsageError(f"{text!r} is no place for control; write {_FORMS}")
    return Place(host.removeprefix("[").removesuffix("]") or "127.0.0.1", int(port), "")


class ControlDoor:
    """Lets other programs steer a plant while it is served.

    be_now: brings the lines to the present, called before each order so that it happens now and not earlier.
    """

    def __init__(self, place: Place, plant: VirtualPlant, be_now: Callable[[], None]) -> None:
        self._place = place
        self._plant = plant
        self._be_now = be_now
        self._door: socket.socket | None = None
        self._guests: dict[int, socket.socket] = {}
        self._pending: dict[int, bytes] = {}

    @property
    def address(self) -> str:
        """Where to connect; certain once it is open."""
        return str(self._place)

    def open(self) -> None:
        """Listen. Raises PortError."""
        place = self._place
        try:
            if place.path:
                self._door = _unix_door(place.path)
            else:
                family = socket.AF_INET6 if ":" in place.host else socket.AF_INET
                self._door = socket.create_server((place.host, place.port), family=family)
                self._place = place._replace(port=self._door.getsockname()[1])
        except (OSError, OverflowError) as error:
            raise PortError(
                f"cannot listen for control at {place} ({getattr(error, 'strerror', None) or error}); "
                "choose another place, or port 0 for any free one"
            ) from error
        self._door.setblocking(False)

    def close(self) -> None:
        """End all connections; may be called again."""
        for descriptor in list(self._guests):
            self._let_go(descriptor)
        if self._door is not None:
            self._door.close()
            self._door = None
            if self._place.path:
                Path(self._place.path).unlink(missing_ok=True)

    @property
    def descriptors(self) -> Sequence[int]:
        """The door and those who came in."""
        return [] if self._door is None else [self._door.fileno(), *self._guests]

    def attend(self, descriptor: int) -> None:
        """Let somebody in, or take what somebody sent."""
        if self._door is not None and descriptor == self._door.fileno():
            self._let_in()
        elif descriptor in self._guests:
            self._hear(descriptor)

    def _let_in(self) -> None:
        if self._door is None:
            return
        try:
            guest, _ = self._door.accept()
        except OSError:
            # It has given up already.
            return
        if len(self._guests) >= _MOST_GUESTS:
            guest.close()
            return
        guest.setblocking(False)
        guest.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)
        self._guests[guest.fileno()] = guest
        self._pending[guest.fileno()] = b""

    def _hear(self, descriptor: int) -> None:
        try:
            data = self._guests[descriptor].recv(_CHUNK)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._let_go(descriptor)
            return
        *orders, rest = (self._pending[descriptor] + data).split(b"\n")
        if len(rest) > LONGEST_ORDER:
            self._let_go(descriptor)
            return
        self._pending[descriptor] = rest
        for order in orders:
            if order.strip() and descriptor in self._guests:
                self._be_now()
                self._answer(descriptor, answer_order(self._plant, order))

    def _answer(self, descriptor: int, answer: bytes) -> None:
        """Send; somebody who asks and does not read is let go."""
        guest = self._guests.get(descriptor)
        if guest is None:
            return
        try:
            sent = guest.send(answer)
        except OSError:
            sent = -1
        if sent != len(answer):
            self._let_go(descriptor)

    def _let_go(self, descriptor: int) -> None:
        guest = self._guests.pop(descriptor, None)
        self._pending.pop(descriptor, None)
        if guest is not None:
            guest.close()


def _unix_door(path: str) -> socket.socket:
    with contextlib.suppress(FileNotFoundError):
        if not stat.S_ISSOCK(os.stat(path).st_mode):  # noqa: PTH116 - mode of whatever is there
            raise PortError(f"{path} exists and is no socket; choose another path, or remove it")
        if _is_served(path):
            raise PortError(f"another plant is steered at {path}; end it, or choose another path")
        # Left behind by a plant that was killed.
        os.unlink(path)  # noqa: PTH108
    door = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        door.bind(path)
        door.listen()
    except OSError:
        door.close()
        raise
    return door


def _is_served(path: str) -> bool:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as guest:
        guest.settimeout(_ANSWERS_S)
        try:
            guest.connect(path)
        except OSError as error:
            # Somebody who is too busy to let us in is there, too.
            return isinstance(error, TimeoutError | BlockingIOError)
    return True


_PATIENCE_S = 10.0


class PlantControl:
    """A connection to the control socket at HOST:PORT or unix:PATH.

    Raises UsageError for a text that is neither, PortError where no plant is.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        place = parse_place(address)
        try:
            if place.path:
                self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
                self._socket.settimeout(_PATIENCE_S)
                self._socket.connect(place.path)
            else:
                self._socket = socket.create_connection((place.host, place.port), timeout=_PATIENCE_S)
        except OSError as error:
            raise PortError(
                f"no plant at {address} ({error.strerror or error}); start one with drivecomm simulate, "
                "which prints the place of its control socket"
            ) from error
        self._file = self._socket.makefile("rb")

    def order(self, order: str, **fields: Any) -> dict[str, Any]:
        """Give an order and return the answer, without its `ok`.

        The orders are trip, power, set, inject, fault and show, with the fields that `control_orders` tells. Raises
        UsageError when the plant refuses, LinkDownError when it has gone.
        """
        try:
            self._socket.sendall(json.dumps({"order": order, **fields}).encode() + b"\n")
            line = self._file.readline()
            answer = json.loads(line) if line else None
        except (OSError, ValueError) as error:
            raise LinkDownError(f"the plant at {self.address} does not answer ({error}); is it running?") from error
        if not isinstance(answer, dict):
            raise LinkDownError(f"the plant at {self.address} has gone; start it again")
        if not answer.pop("ok", False):
            raise UsageError(str(answer.get("error", "the plant refused without saying why")))
        return answer

    def close(self) -> None:
        """End the connection; the plant goes on."""
        self._file.close()
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()
