"""Live values and events for many concurrent clients (Server-Sent Events).

The changes of the plant are read once per door and encoded once per group of clients with the same selection. They are
written directly to the clients that keep up, in slices, so that many clients do not block the event loop. A client that
does not read is skipped until it reads again: it then gets the latest of each value and the number of events it missed.
"""

from __future__ import annotations

import asyncio
import logging
import socket
import time
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import takewhile
from typing import TYPE_CHECKING, Any

from drivecomm.client import json_text, plain
from drivecomm.server.http.content import SLICE_S, aged, joined, value_head

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from starlette.types import Receive, Send

    from drivecomm.server import ChangeStream, CurrentValue, Event, ServedPlant

_log = logging.getLogger("drivecomm.server")

PING_S = 15.0
NOT_READING_S = 30.0
_SHARE = 3
"""Pause after a batch as a multiple of the time the batch took: many clients use at most a quarter of a core."""
_PIECE = 100
"""Values per batch for a client that has to catch up."""
_BEHIND = 64 * 1024
"""Buffered bytes per client above which nothing more is written until the client reads."""
_SOCKET_BUFFER = 128 * 1024
_HEADERS = [(b"content-type", b"text/event-stream; charset=utf-8"), (b"x-accel-buffering", b"no")]


@dataclass(slots=True, eq=False)
class _Seen:
    """Latest state of one value. number: increases with every change of any value."""

    number: int
    value: CurrentValue
    head: str = ""

    @property
    def key(self) -> tuple[str, str]:
        return self.value.drive, self.value.name

    def text(self, now: float) -> str:
        self.head = self.head or value_head(self.value)
        return aged(self.head, self.value, now)


@dataclass(slots=True, eq=False)
class _Client:
    """One connected client.

    values, events: number of the last one sent to it. missed: events skipped while it did not read. keeps_up: data is
    written to it directly.
    """

    transport: asyncio.Transport
    send: Send
    values: int = 0
    events: int = 0
    missed: int = 0
    keeps_up: bool = False
    catching_up: asyncio.Task[None] | None = None


@dataclass(slots=True, eq=False)
class _Group:
    """Clients with the same drives (None: all) and the same shortest interval between values."""

    drives: frozenset[str] | None
    every_s: float
    clients: set[_Client] = field(default_factory=set)
    values: int = 0
    ticking: asyncio.Task[None] | None = None

    def wants(self, drive: str) -> bool:
        return self.drives is None or drive in self.drives

    def is_about(self, event: Event) -> bool:
        return not event.drive or self.wants(event.drive)


class Streams:
    """All streams of one door; used only within its event loop."""

    def __init__(self, plant: ServedPlant) -> None:
        self._plant = plant
        self._groups: dict[tuple[frozenset[str] | None, float], _Group] = {}
        # Ordered by change: the most recent is last.
        self._latest: dict[tuple[str, str], _Seen] = {}
        self._number = 0
        self._turn = asyncio.Lock()
        self._reading: asyncio.Task[None] | None = None
        self._pinging: asyncio.Task[None] | None = None

    @property
    def clients(self) -> int:
        """Number of connected clients."""
        return sum(len(group.clients) for group in self._groups.values())

    async def serve(
        self,
        connection: tuple[asyncio.Transport, Receive, Send],
        hello: str,
        drives: frozenset[str] | None,
        every_s: float,
        after: int | None,
    ) -> None:
        """Serve one client until it disconnects. after: number of the last event the client already has."""
        transport, receive, send = connection
        with suppress(OSError, AttributeError):
            # A small system buffer: unread data waits here, where newer values replace it.
            transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SOCKET_BUFFER)
        await send({"type": "http.response.start", "status": 200, "headers": list(_HEADERS)})
        await send(_body(_message("hello", hello)))
        group = self._group(drives, every_s)
        latest = max((each.number for each in self._plant.events()), default=0)
        client = _Client(transport, send, events=latest if after is None else min(after, latest))
        group.clients.add(client)
        self._catch_up(group, client)
        try:
            while (await receive())["type"] != "http.disconnect":
                pass
        finally:
            group.clients.discard(client)
            if client.catching_up is not None:
                client.catching_up.cancel()
            self._clear_up(group)

    async def close(self) -> None:
        """End all streams: properly for clients that keep up, by aborting the connection for the others."""
        for group in self._groups.values():
            for client in group.clients:
                if client.keeps_up:
                    client.transport.write(b"0\r\n\r\n")
                    client.transport.close()
                else:
                    client.transport.abort()
        tasks = [self._reading, self._pinging, *(group.ticking for group in self._groups.values())]
        for task in tasks:
            if task is not None:
                task.cancel()

    def _group(self, drives: frozenset[str] | None, every_s: float) -> _Group:
        if self._reading is None:
            changes = self._plant.changes()
            self._note(self._plant.values())
            self._reading = asyncio.create_task(self._read(changes))
            self._pinging = asyncio.create_task(self._ping())
        key = (drives, every_s)
        group = self._groups.get(key)
        if group is None:
            group = self._groups[key] = _Group(drives, every_s, values=self._number)
            if every_s:
                group.ticking = asyncio.create_task(self._tick(group))
        return group

    def _clear_up(self, group: _Group) -> None:
        if not group.clients:
            self._groups.pop((group.drives, group.every_s), None)
            if group.ticking is not None:
                group.ticking.cancel()
        if not self._groups:
            for task in (self._reading, self._pinging):
                if task is not None:
                    task.cancel()
            self._reading = self._pinging = None
            self._latest.clear()

    async def _read(self, changes: ChangeStream) -> None:
        try:
            async for values, events in changes:
                began = time.thread_time()
                try:
                    await self._give(values, events)
                except Exception:  # noqa: BLE001 - the next batch is another one
                    _cut_off(*self._groups.values())
                if (took_s := time.thread_time() - began) > SLICE_S:
                    await asyncio.sleep(took_s * _SHARE)
        finally:
            changes.close()

    async def _give(self, values: Sequence[CurrentValue], events: Sequence[Event]) -> None:
        self._note(values)
        for group in list(self._groups.values()):
            if not group.every_s:
                await self._give_values(group)
            if events:
                await self._give_events(group, events)

    def _note(self, values: Iterable[CurrentValue]) -> None:
        for value in values:
            self._number += 1
            seen = _Seen(self._number, value)
            self._latest.pop(seen.key, None)
            self._latest[seen.key] = seen

    def _forget(self) -> None:
        """Drop the values of drives that the plant no longer has."""
        there = {drive.name for drive in self._plant.plant.drives}
        for key in [key for key in self._latest if key[0] not in there]:
            del self._latest[key]

    async def _tick(self, group: _Group) -> None:
        while True:
            await asyncio.sleep(group.every_s)
            try:
                await self._give_values(group)
            except Exception:  # noqa: BLE001 - as above
                _cut_off(group)

    async def _ping(self) -> None:
        while True:
            await asyncio.sleep(PING_S)
            self._forget()
            for group in list(self._groups.values()):
                await self._write(group, list(group.clients), b": ping\n\n")

    async def _give_values(self, group: _Group) -> None:
        news = self._after(group, group.values)
        if not news:
            return
        before, group.values = group.values, news[-1].number
        if any(each.keeps_up for each in group.clients):
            now = time.time()
            data = _message("values", await joined(seen.text(now) for seen in news))
            up_to_date = [each for each in group.clients if each.keeps_up and before <= each.values < group.values]
            await self._write(group, up_to_date, data, values=group.values)

    async def _give_events(self, group: _Group, events: Sequence[Event]) -> None:
        if wanted := [each for each in events if group.is_about(each)]:
            data, last = _told(wanted), wanted[-1].number
            await self._write(group, [each for each in group.clients if each.events < last], data, events=wanted)

    async def _write(
        self, group: _Group, clients: Sequence[_Client], data: bytes, *, values: int = 0, events: Sequence[Event] = ()
    ) -> None:
        framed = _framed(data)
        until = time.monotonic() + SLICE_S
        for client in clients:
            if client.transport.is_closing():
                continue
            if client.keeps_up and client.transport.get_write_buffer_size() > _BEHIND:
                client.keeps_up = False
                self._catch_up(group, client)
            if client.keeps_up:
                client.transport.write(framed)
                client.values = max(client.values, values)
                client.events = max(client.events, events[-1].number if events else 0)
            else:
                client.missed += len(events)
            if time.monotonic() > until:
                await asyncio.sleep(0)
                until = time.monotonic() + SLICE_S

    def _catch_up(self, group: _Group, client: _Client) -> None:
        client.catching_up = asyncio.create_task(self._give_missed(group, client))

    async def _give_missed(self, group: _Group, client: _Client) -> None:
        """Send a client the data it lacks, as fast as it reads, until it keeps up."""
        try:
            while not (client.keeps_up or client.transport.is_closing()):
                news = self._after(group, client.values)
                for start in range(0, len(news) + 1, _PIECE):
                    if client.transport.get_write_buffer_size():
                        async with asyncio.timeout(NOT_READING_S):
                            # Sent only when the buffer has room, so that the data after it is the latest.
                            await client.send(_body(b":\n\n"))
                    # One client at a time, even if many have to catch up.
                    async with self._turn:
                        await self._give_piece(group, client, news[start : start + _PIECE])
        except TimeoutError:
            client.transport.abort()

    async def _give_piece(self, group: _Group, client: _Client, piece: Sequence[_Seen]) -> None:
        # A value that has changed since is in a later batch.
        now = time.time()
        values = await joined(seen.text(now) for seen in piece if self._latest.get(seen.key) is seen) if piece else ""
        events = [each for each in self._plant.events() if each.number > client.events and group.is_about(each)]
        lost, client.missed = max(0, client.missed - len(events)), 0
        data = b""
        if lost:
            data += _message("lost", json_text({"events": lost}))
        if events:
            client.events = events[-1].number
            data += _told(events)
        if piece:
            client.values = piece[-1].number
            data += _message("values", values)
        # With many clients there is always something new by the next turn, so a short rest is sent along.
        if len(rest := self._after(group, client.values)) <= _PIECE:
            now = time.time()
            if rest:
                data += _message("values", f"[{','.join(seen.text(now) for seen in rest)}]")
            client.values, client.keeps_up = self._number, True
        if data and not client.transport.is_closing():
            client.transport.write(_framed(data))

    def _after(self, group: _Group, number: int) -> list[_Seen]:
        newer = takewhile(lambda seen: seen.number > number, reversed(self._latest.values()))
        return [seen for seen in newer if group.wants(seen.value.drive)][::-1]


def _cut_off(*groups: _Group) -> None:
    """Disconnect clients that missed changes by an internal error: they reconnect and get the latest values."""
    _log.exception("sending changes to the stream")
    for group in groups:
        for client in group.clients:
            client.transport.abort()


def _framed(data: bytes) -> bytes:
    return b"%x\r\n%b\r\n" % (len(data), data)


def _told(events: Sequence[Event]) -> bytes:
    return f"id: {events[-1].number}\n".encode() + _message("events", json_text(plain(list(events))))


def _message(name: str, data: str) -> bytes:
    return f"event: {name}\ndata: {data}\n\n".encode()


def _body(data: bytes) -> dict[str, Any]:
    return {"type": "http.response.body", "body": data, "more_body": True}
