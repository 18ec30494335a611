"""The connections of a door, served one telegram each in turn, so that a flood delays only its sender.

A telegram is taken from a connection only in its turn, and little is read before: further data waits in the peer's
system. All connections together use a limited share of a core. A peer that sends anything but Modbus TCP, is silent for
too long, or does not read its responses is disconnected.
"""

from __future__ import annotations

import asyncio
import socket
import time
from collections import deque
from typing import TYPE_CHECKING, cast

from drivecomm.server import Acceptor, run_concurrently

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.server import Bounds
    from drivecomm.server.modbus_tcp.sessions import ModbusSession

SILENT_S = 10.0
"""Seconds without a request after which a connection is closed for a new one when the door is full."""
FIRST_REQUEST_S = 10.0
IDLE_S = 300.0
NOT_READING_S = 10.0
_HEADER = 6
_LONGEST = 260
_BUFFER = 1024
_SOCKET_BUFFER = 16 * 1024
_SLICE_S = 0.001
_SHARE = 3
"""Pause as a multiple of the time worked: a flood uses at most a quarter of a core."""
_LOOK_S = 1.0


class Connections:
    """All connections of a door; used only within its event loop.

    answering: makes the session for the address of a peer. may_command: whether an address may command; None if none
    may. bounds: see `Acceptor`.
    """

    def __init__(
        self,
        answering: Callable[[str], ModbusSession],
        may_command: Callable[[str], bool] | None = None,
        *,
        bounds: Bounds,
    ) -> None:
        self._answering = answering
        self._may_command = may_command
        self._acceptor = Acceptor(bounds, self._made, known=may_command)
        self._open: set[_Connection] = set()
        self._waiting: deque[_Connection] = deque()
        self._woken = asyncio.Event()
        self._pace = _Pace()
        self._resting = False

    def __len__(self) -> int:
        return len(self._open)

    async def serve(self, listening: socket.socket, opened: Callable[[], None]) -> None:
        """Serve until cancelled. opened: called once connections are accepted."""
        opened()
        try:
            await run_concurrently(self._acceptor.run(listening), self._take_turns(), self._look())
        finally:
            for connection in list(self._open):
                connection.cut_off()

    def asks(self, connection: _Connection) -> None:
        """Serve a connection: immediately if no other one waits, otherwise after those in the queue."""
        if self._waiting or self._resting:
            connection.wait()
            return
        connection.take_turn()
        if self._pace.rest_s() > 0:
            self._resting = True
            self._woken.set()

    def wants_a_turn(self, connection: _Connection) -> None:
        """Append a connection to the queue."""
        self._waiting.append(connection)
        self._woken.set()

    def forget(self, connection: _Connection) -> None:
        """Remove a closed connection."""
        self._open.discard(connection)

    def _made(self, peer: str) -> _Connection:
        known = self._may_command is not None and self._may_command(peer)
        return _Connection(self, self._answering(peer), known=known)

    def begins(self, connection: _Connection) -> None:
        """Add an open connection."""
        self._open.add(connection)

    async def _take_turns(self) -> None:
        while True:
            if not self._waiting and not self._resting:
                self._woken.clear()
                await self._woken.wait()
            until = time.thread_time() + _SLICE_S
            while self._waiting and time.thread_time() < until:
                self._waiting.popleft().take_turn()
            self._resting = True
            await asyncio.sleep(self._pace.rest_s())
            self._resting = False
            self._pace.rested()

    async def _look(self) -> None:
        while True:
            await asyncio.sleep(_LOOK_S)
            now = asyncio.get_running_loop().time()
            for connection in list(self._open):
                connection.look(now)


class _Pace:
    """Pauses of the serving thread, which leave time for the lines and the other doors."""

    def __init__(self) -> None:
        self.rested()

    def rested(self) -> None:
        """Start a new measurement."""
        self._since_s, self._worked_s = time.monotonic(), time.thread_time()

    def rest_s(self) -> float:
        """Return the pause due now, in seconds. Reading counts as work; rare requests need no pause."""
        # Limited, because the thread's other work must not lengthen the pause.
        work_s = min(time.thread_time() - self._worked_s, _SHARE * _SLICE_S)
        if work_s < _SLICE_S:
            return 0.0
        rest_s = work_s * (1 + _SHARE) - (time.monotonic() - self._since_s)
        if rest_s <= 0:
            self.rested()
        return max(0.0, rest_s)


class _Connection(asyncio.BufferedProtocol):
    """One connection: it collects a whole telegram, waits for its turn, and sends the response."""

    def __init__(self, connections: Connections, answering: ModbusSession, *, known: bool) -> None:
        self._connections = connections
        self._answering = answering
        self._known = known
        self._transport: asyncio.Transport | None = None
        self._buffer = memoryview(bytearray(_BUFFER))
        self._received = bytearray()
        self._now = asyncio.get_running_loop().time
        self._asked_s = self._now()
        self._has_asked = False
        self._stuck_s: float | None = None
        self._ended = False
        self._waits = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Register the connection and limit its buffers."""
        self._transport = cast("asyncio.Transport", transport)
        # A small system buffer: unread responses wait here, where the door notices them.
        transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SOCKET_BUFFER)
        self._connections.begins(self)
        # At most one response waits here: the connection gets no further turn until it is read.
        self._transport.set_write_buffer_limits(high=0)

    def get_buffer(self, _: int) -> memoryview:
        """Return the receive buffer."""
        return self._buffer

    def buffer_updated(self, count: int) -> None:
        """Store received bytes, and pause reading if earlier ones still wait for their turn."""
        self._received += self._buffer[:count]
        if not self._waits:
            self._connections.asks(self)
        elif self._transport is not None:
            # Further bytes arrived before the turn of the connection.
            self._transport.pause_reading()

    def eof_received(self) -> bool:
        """Answer the requests received before the peer closed its side, then close."""
        self._ended = True
        if not self._waits:
            self._connections.asks(self)
        return True

    def pause_writing(self) -> None:
        """Pause reading, because the peer does not read its responses."""
        self._stuck_s = self._now()
        if self._transport is not None:
            self._transport.pause_reading()

    def resume_writing(self) -> None:
        """Resume, because the peer reads again."""
        self._stuck_s = None
        self.wait()

    def connection_lost(self, _: Exception | None) -> None:
        """Unregister the connection and release its stops."""
        self._transport = None
        self._received.clear()
        self._connections.forget(self)
        self._answering.closed()

    def wait(self) -> None:
        """Join the queue for a turn."""
        if self._transport is not None and not self._waits:
            self._waits = True
            self._connections.wants_a_turn(self)

    def take_turn(self) -> None:
        """Answer one telegram if it is complete."""
        self._waits = False
        transport = self._transport
        if transport is None or self._stuck_s is not None:
            return
        try:
            found = self._next()
        except ValueError:
            self.cut_off()
            return
        if found is not None:
            head, unit, telegram = found
            self._asked_s, self._has_asked = self._now(), True
            answer = self._answering.answer(unit, telegram)
            transport.write(head + (len(answer) + 1).to_bytes(2) + bytes([unit]) + answer)
            if self._received or self._ended or self._stuck_s is not None:
                self.wait()
                return
        elif self._ended:
            transport.close()
            return
        transport.resume_reading()

    def _next(self) -> tuple[bytes, int, bytes] | None:
        """Return the start of the next telegram's header, its unit and its content.

        None if the telegram is incomplete. Raises ValueError for data that is not Modbus TCP.
        """
        received = self._received
        if len(received) < _HEADER:
            if received[2:4].strip(b"\0"):
                raise ValueError
            return None
        length = int.from_bytes(received[4:6])
        if received[2:4] != b"\0\0" or not 2 <= length <= _LONGEST - _HEADER:
            raise ValueError
        end = _HEADER + length
        if len(received) < end:
            return None
        head, unit, telegram = bytes(received[:4]), received[6], bytes(received[7:end])
        del received[:end]
        return head, unit, telegram

    def look(self, now: float) -> None:
        """Disconnect a peer that does not read or has been silent for too long."""
        reads_nothing = self._stuck_s is not None and now - self._stuck_s > NOT_READING_S
        if reads_nothing or now - self._asked_s > (IDLE_S if self._has_asked else FIRST_REQUEST_S):
            self.cut_off()

    def yields(self, *, to_known: bool) -> tuple[int, float] | None:
        """Rank this connection for closing when the door is full; None if it must stay open.

        The order is: peers that never sent a request, then silent ones. Active strangers and silent commanders only
        give way to a commander; an active commander stays.
        """
        silent = self._now() - self._asked_s > SILENT_S
        if self._known:
            return (3, self._asked_s) if to_known and silent else None
        if self._has_asked and not silent:
            return (2, self._asked_s) if to_known else None
        return int(self._has_asked), self._asked_s

    def cut_off(self) -> None:
        """Abort the connection."""
        if self._transport is not None:
            self._transport.abort()
