"""The one way out of a session: every message gets its number when it leaves, and none can overtake another."""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING

from drivecomm.server.broker import Message
from drivecomm.server.sparkplug.edge_node import BD_SEQ
from drivecomm.server.sparkplug.metrics import milliseconds
from drivecomm.server.sparkplug.payload import DataType, Metric, Payload, encoded

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from drivecomm.server.broker import Connection
    from drivecomm.server.sparkplug.edge_node import Unsent
    from drivecomm.server.sparkplug.topics import Topics

_NUMBERS = 256
_TOGETHER = 20


def death(topics: Topics, bd_seq: int) -> Message:
    """Return the message that the edge node is gone, as a will or as what it says last; it has no number.

    bd_seq: of the connection, which the births of the same one have, too.
    """
    number = Metric(name=BD_SEQ, type=DataType.INT64, value=bd_seq)
    payload = Payload(metrics=(number,), time_ms=milliseconds(time.time()))
    return Message(topic=topics.of("NDEATH"), payload=encoded(payload, say_types=True), qos=1)


class Outlet:
    """Where the messages of one connection leave. Methods raise LinkDownError when it is over."""

    def __init__(self, connection: Connection, topics: Topics) -> None:
        self._connection, self._topics = connection, topics
        self._seq = 0
        self._turn = asyncio.Lock()

    async def send(self, make: Callable[[], Iterable[Unsent]]) -> None:
        """Send what there is to send when it is our turn; nothing else leaves in between."""
        async with self._turn:
            await self._leave_all(make())

    async def send_births(self, make: Callable[[], Iterable[Unsent]], not_before: float) -> None:
        """Send births; from now until they are out nothing else leaves. not_before: by the clock of the event loop."""
        async with self._turn:
            await asyncio.sleep(not_before - asyncio.get_running_loop().time())
            await self._leave_all(make())

    async def _leave_all(self, messages: Iterable[Unsent]) -> None:
        for number, unsent in enumerate(messages, 1):
            await self._leave(unsent)
            if not number % _TOGETHER:
                # Commands come in between.
                await asyncio.sleep(0)

    async def _leave(self, unsent: Unsent) -> None:
        if unsent.kind == "NBIRTH":
            self._seq = 0
        payload = Payload(metrics=unsent.metrics, time_ms=milliseconds(time.time()), seq=self._seq)
        message = Message(
            topic=self._topics.of(unsent.kind, unsent.device),
            payload=encoded(payload, say_types=unsent.kind.endswith("BIRTH")),
            qos=0,
        )
        # It counts once the broker's connection has taken it: what was not sent leaves no hole.
        await self._connection.publish(message)
        self._seq = (self._seq + 1) % _NUMBERS
