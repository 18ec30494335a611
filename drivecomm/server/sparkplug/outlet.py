"""The only output of a session: numbers each message as it leaves, so that none overtakes another."""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING

from drivecomm.server.broker import BrokerMessage
from drivecomm.server.sparkplug.edge_node import BD_SEQ
from drivecomm.server.sparkplug.metrics import milliseconds
from drivecomm.server.sparkplug.payload import DataType, Metric, Payload, encode_payload

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from drivecomm.server.broker import BrokerConnection
    from drivecomm.server.sparkplug.edge_node import Unsent
    from drivecomm.server.sparkplug.topics import SparkplugTopics

_NUMBERS = 256
_TOGETHER = 20


def death(topics: SparkplugTopics, bd_seq: int) -> BrokerMessage:
    """Return the death message of the edge node, for use as will or as last message; without a sequence number.

    bd_seq: bdSeq number of the connection, the same as in its births.
    """
    number = Metric(name=BD_SEQ, type=DataType.INT64, value=bd_seq)
    payload = Payload(metrics=(number,), time_ms=milliseconds(time.time()))
    return BrokerMessage(topic=topics.of("NDEATH"), payload=encode_payload(payload, say_types=True), qos=1)


class Outlet:
    """Output of one connection. Methods raise LinkDownError when the connection has ended."""

    def __init__(self, connection: BrokerConnection, topics: SparkplugTopics) -> None:
        self._connection, self._topics = connection, topics
        self._seq = 0
        self._turn = asyncio.Lock()

    async def send(self, make: Callable[[], Iterable[Unsent]]) -> None:
        """Send messages without interruption by others. make: called when it is our turn."""
        async with self._turn:
            await self._leave_all(make())

    async def send_births(self, make: Callable[[], Iterable[Unsent]], not_before: float) -> None:
        """Send births; nothing else is sent until they are out.

        make: called when it is our turn. not_before: earliest time, by the clock of the event loop.
        """
        async with self._turn:
            await asyncio.sleep(not_before - asyncio.get_running_loop().time())
            await self._leave_all(make())

    async def _leave_all(self, messages: Iterable[Unsent]) -> None:
        for number, unsent in enumerate(messages, 1):
            await self._leave(unsent)
            if not number % _TOGETHER:
                # Lets the event loop process commands in between.
                await asyncio.sleep(0)

    async def _leave(self, unsent: Unsent) -> None:
        if unsent.kind == "NBIRTH":
            self._seq = 0
        payload = Payload(metrics=unsent.metrics, time_ms=milliseconds(time.time()), seq=self._seq)
        message = BrokerMessage(
            topic=self._topics.of(unsent.kind, unsent.device),
            payload=encode_payload(payload, say_types=unsent.kind.endswith("BIRTH")),
            qos=0,
        )
        # Counted only after the connection has taken the message, so that a failure leaves no gap in the sequence.
        await self._connection.publish(message)
        self._seq = (self._seq + 1) % _NUMBERS
