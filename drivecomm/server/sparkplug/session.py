"""One connection of the edge node to a broker, from its subscriptions to its death."""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING

from drivecomm.errors import LinkError
from drivecomm.server import run_concurrently
from drivecomm.server.sparkplug.host_state import HostState, host_message
from drivecomm.server.sparkplug.outlet import Outlet, death

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Sequence

    from drivecomm.server import ChangeStream, CommandAnswer, CommandRequest, ServedPlant
    from drivecomm.server.broker import BrokerConnection, BrokerMessage, ReceivedMessage
    from drivecomm.server.sparkplug.backlog import Backlog
    from drivecomm.server.sparkplug.edge_node import EdgeNode
    from drivecomm.server.sparkplug.hosts import Hosts
    from drivecomm.server.sparkplug.topics import SparkplugTopics

TOGETHER_S = 0.05
"""Seconds within which further changes join the same message."""
LOOKED_OVER_S = 1.0
HOST_S = 10.0
"""Seconds to wait for a silent primary host if there is another broker to try."""
BETWEEN_BIRTHS_S = 1.0
FAREWELL_S = 1.0
_TOLD_EVERY_S = 0.05
"""Seconds over which changes are collected into one message per device."""
_MOST_ANSWERS = 100


class HostGoneError(LinkError):
    """The primary host is not online on this broker; the next broker must be tried."""


class SparkplugSession:
    """Session on one broker. bd_seq: number of its connection. is_only: whether there is no other broker to try."""

    def __init__(
        self,
        plant: ServedPlant,
        node: EdgeNode,
        hosts: Hosts,
        backlog: Backlog | None,
        topics: SparkplugTopics,
        *,
        bd_seq: int,
        is_only: bool,
    ) -> None:
        self.born = False
        self._plant, self._node, self._hosts, self._backlog, self._topics = plant, node, hosts, backlog, topics
        self._bd_seq, self._is_only = bd_seq, is_only
        self._host, self._host_told = HostState(), asyncio.Event()
        self._answers: asyncio.Queue[tuple[CommandRequest, CommandAnswer, str, float]] = asyncio.Queue(_MOST_ANSWERS)
        self._born_at = 0.0

    def will(self) -> BrokerMessage:
        """Return the message that the broker publishes if this connection is lost."""
        return death(self._topics, self._bd_seq)

    def heard(self, received: ReceivedMessage) -> None:
        """Process a message; never blocks."""
        if received.topic == self._topics.host_state:
            self._host_heard(received.payload)
        else:
            self._hosts.heard(received, self._node)

    def _host_heard(self, payload: bytes) -> None:
        message = host_message(payload) if self._topics.host else None
        if message is None:
            return
        if not message.online:
            # Even if the timestamp is too old to end the session: a wrong clock must not keep a motor running.
            self._hosts.host_left()
        if self._host.heard(message, time_ms=int(time.time() * 1000), now_s=time.monotonic()):
            self._host_told.set()

    def answered(self, command: CommandRequest, answer: CommandAnswer, text: str) -> None:
        """Queue the outcome of a command; in a flood, excess outcomes are dropped."""
        with suppress(asyncio.QueueFull):
            self._answers.put_nowait((command, answer, text, time.time()))

    async def run(self, connection: BrokerConnection, opened: Callable[[], None]) -> None:
        """Serve until cancelled. Raises LinkDownError for a lost connection, HostGoneError without a primary host.

        opened: called after the births, or when waiting for the host begins.
        """
        await run_concurrently(connection.lost(), self._live(connection, opened))

    async def _live(self, connection: BrokerConnection, opened: Callable[[], None]) -> None:
        await connection.subscribe(self._topics.node_commands, self._topics.device_commands)
        if self._topics.host:
            await connection.subscribe_with_kept(self._topics.host_state)
            if self._is_only:
                opened()
            await self._host_there()
        outlet = Outlet(connection, self._topics)
        # Subscribed before the births, so that no change is lost after them.
        changes = self._plant.changes(_TOLD_EVERY_S)
        try:
            await self._births(outlet)
            self.born = True
            self._hosts.admit()
            opened()
            await run_concurrently(*self._work(outlet, changes))
        finally:
            changes.close()

    async def farewell(self, connection: BrokerConnection) -> None:
        """Publish the death of the edge node, because a broker drops the will of a client that leaves in order."""
        with suppress(LinkError, TimeoutError):
            async with asyncio.timeout(FAREWELL_S):
                if self.born:
                    await connection.publish(self.will())
                    if self._backlog is not None:
                        await self._backlog.all_passed_on()
                await connection.leave_with_will()

    def _work(self, outlet: Outlet, changes: ChangeStream) -> Sequence[Coroutine[None, None, None]]:
        work = [
            self._tell_changes(outlet, changes),
            self._look_over(outlet),
            self._tell_answers(outlet),
            self._give_births_again(outlet),
            self._hosts.lead(),
        ]
        if self._topics.host:
            work.append(self._watch_host())
        if self._backlog is not None:
            work.append(self._backlog.serve(self._node, outlet, time.time()))
        return work

    async def _births(self, outlet: Outlet, not_before: float = 0.0) -> None:
        # The first call reads models for the limits of values, which is slow.
        await outlet.send_births(lambda: self._node.births(self._bd_seq, time.time()), not_before)
        self._born_at = asyncio.get_running_loop().time()

    async def _tell_changes(self, outlet: Outlet, changes: ChangeStream) -> None:
        async for values, events in changes:
            drives = {each.drive for each in events if each.drive}
            await outlet.send(lambda v=values, d=drives: self._node.changed(v, d, time.time()))  # type: ignore[misc]
            await asyncio.sleep(TOGETHER_S)

    async def _look_over(self, outlet: Outlet) -> None:
        while True:
            await asyncio.sleep(LOOKED_OVER_S)
            await outlet.send(lambda: self._node.periodic_messages(time.time()))

    async def _tell_answers(self, outlet: Outlet) -> None:
        while True:
            await outlet.send(partial(self._node.answered, *await self._answers.get()))

    async def _give_births_again(self, outlet: Outlet) -> None:
        while True:
            await self._hosts.rebirth.wait()
            # Births are expensive, so they are limited however often hosts request them.
            await self._births(outlet, self._born_at + BETWEEN_BIRTHS_S)
            self._hosts.rebirth.clear()

    async def _host_there(self) -> None:
        """Wait for the primary host. Raises HostGoneError if it is not here but may be on another broker."""
        with suppress(TimeoutError):
            async with asyncio.timeout(None if self._is_only else HOST_S):
                while not self._host.online:
                    if self._host.online is False and not self._is_only:
                        break
                    await self._host_told.wait()
                    self._host_told.clear()
        if not self._host.online:
            raise HostGoneError(f"the primary host {self._topics.host} is not there")

    async def _watch_host(self) -> None:
        while self._host.online:
            await self._host_told.wait()
            self._host_told.clear()
        raise HostGoneError(f"the primary host {self._topics.host} has gone")
