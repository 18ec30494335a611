"""Virtual drives in real time, for programs outside: over a pseudo-terminal, TCP or RFC 2217.

with Server([virtual_drive("vabus", 1)], parse_listen("tcp:127.0.0.1:0")) as server:
    print(server.address)
    server.run(stop)
"""

from __future__ import annotations

import heapq
import time
from typing import TYPE_CHECKING, Self

from drivecomm.virtual.listeners import parse_listen
from drivecomm.virtual.station import Station
from drivecomm.virtual.uart import heard

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from threading import Event
    from types import TracebackType

    from drivecomm.line import LineSettings
    from drivecomm.protocol import VirtualDrive
    from drivecomm.virtual.listeners import Listener

# How late a stop may be noticed.
_TICK_S = 0.1
_MILLISECOND = 0.001
# A master that asks on and on without listening would fill the memory with replies; a real line has room for one.
_MOST_REPLIES = 256


class Server:
    """Virtual drives on one line whose master is some other program.

    Every drive hears everything on the line and ignores what is not for it. echo: the master hears itself, as on some
    two-wire adapters. paced: characters take the time that they take at the drive's baud rate; a telegram then arrives
    when its last character would have. Entering opens the listener and raises PortError when it cannot.
    """

    def __init__(
        self, drives: Iterable[VirtualDrive], listener: Listener, *, echo: bool = False, paced: bool = False
    ) -> None:
        self.drives = list(drives)
        self._listener = listener
        self._echo = echo
        self._paced = paced
        self._stations = [Station(drive) for drive in self.drives]
        self._replies: list[tuple[float, int, Station, bytes]] = []
        self._order = 0
        self._busy_until = 0.0
        self._began = time.monotonic()

    @property
    def address(self) -> str:
        """What a master opens: a path, or a URL with the port number that was really given."""
        return self._listener.address

    def run(self, stop: Event) -> None:
        """Serve until the event is set, and a tenth of a second at most after it; may be called again."""
        while not stop.is_set():
            self._serve_once()

    def now(self) -> float:
        """Return the time that the drives live in: seconds since the server was made."""
        return time.monotonic() - self._began

    def __enter__(self) -> Self:
        self._listener.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._listener.close()

    def _serve_once(self) -> None:
        due = self._replies[0][0] - self.now() if self._replies else _TICK_S
        if 0 < due < _MILLISECOND:
            # What waits for sockets and terminals knows whole milliseconds only.
            time.sleep(due)
            due = 0.0
        whole = max(0.0, min(_TICK_S, due)) // _MILLISECOND * _MILLISECOND
        data = self._listener.receive(whole)
        if data:
            self._hear_master(data)
        while self._replies and self._replies[0][0] <= self.now():
            _, _, station, reply = heapq.heappop(self._replies)
            self._speak(station, reply)

    def _hear_master(self, data: bytes) -> None:
        if self._echo:
            self._listener.send(data)
        now = self.now()
        for station in self._stations:
            self._tell(station, data, self._listener.settings, now)

    def _speak(self, station: Station, reply: bytes) -> None:
        settings, now = station.drive.settings, self.now()
        self._listener.send(_at(self._listener.settings, reply, settings))
        for other in self._stations:
            if other is not station:
                self._tell(other, reply, settings, now)

    def _tell(self, station: Station, data: bytes, sender: LineSettings | None, now: float) -> None:
        """Let a drive hear something, and note down what it answers."""
        drive = station.drive
        arriving = data if sender is None else heard(data, sender, drive.settings)
        for answer in station.hear(arriving, now, now):
            begins = now + answer.delay_s
            if self._paced:
                # A line carries one telegram at a time: the request, the drive's delay, the reply.
                begins = max(begins + drive.settings.wire_s(len(data)), self._busy_until)
                begins += drive.settings.wire_s(len(answer.data))
                self._busy_until = begins
            if len(self._replies) < _MOST_REPLIES:
                self._order += 1
                heapq.heappush(self._replies, (begins, self._order, station, answer.data))


def _at(receiver: LineSettings | None, data: bytes, sender: LineSettings) -> bytes:
    return data if receiver is None else heard(data, sender, receiver)


def serve(
    drives: Iterable[VirtualDrive],
    listen: str,
    *,
    stop: Event,
    echo: bool = False,
    paced: bool = False,
    ready: Callable[[str], None] | None = None,
) -> None:
    """Serve virtual drives at `pty:PATH`, `tcp:HOST:PORT` or `rfc2217:HOST:PORT` until the event is set.

    ready: told the address when a master may connect. Raises UsageError for a listen text that is none of these, and
    PortError when the place is taken.
    """
    with Server(drives, parse_listen(listen), echo=echo, paced=paced) as server:
        if ready is not None:
            ready(server.address)
        server.run(stop)
