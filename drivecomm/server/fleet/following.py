"""Subscription to the messages of many plants; lost connections to the broker are restored."""

from __future__ import annotations

import asyncio
import secrets
from dataclasses import replace
from typing import TYPE_CHECKING

from drivecomm.errors import LinkDownError, LinkError, in_one_line
from drivecomm.link import Backoff
from drivecomm.server import cancel_and_wait
from drivecomm.server.broker import VersionRefused, connect_to_broker

if TYPE_CHECKING:
    from drivecomm.server.broker import BrokerConnection, BrokerSettings, ReceivedMessage
    from drivecomm.server.fleet.plants import Fleet

_FIRST_S, _LONGEST_S = 0.5, 3.0
_QUIET_S, _LONGEST_WAIT_S = 0.3, 10.0
OLDER = "3.1.1"
_MOST_TOPICS = 1_000_000


class FleetSubscription:
    """A subscription that keeps a fleet up to date. problem: why no messages arrive now, empty without a problem."""

    def __init__(self, settings: BrokerSettings, fleet: Fleet) -> None:
        self.fleet = fleet
        self.problem = ""
        self._settings = settings
        self._topics: set[str] = set()
        self._new_s = 0.0
        self._subscribed, self._more = asyncio.Event(), asyncio.Event()

    async def run(self) -> None:
        """Receive messages until cancelled."""
        loop = asyncio.get_running_loop()
        pauses = Backoff(_FIRST_S, _LONGEST_S)
        while True:
            try:
                await self._hear()
            except (LinkError, TimeoutError) as error:
                was_there = self._subscribed.is_set() and not self.problem
                self.problem = in_one_line(error) or "the broker does not answer"
                self.fleet.silent()
                if was_there:
                    pauses.succeeded()
                pauses.failed(loop.time())
                await asyncio.sleep(max(0.0, pauses.over_at - loop.time()))

    async def known(self) -> None:
        """Wait until all retained messages have arrived. Raises LinkError if the broker cannot be reached.

        The broker sends them in one burst, so they have arrived when no new topic appears for a moment.
        """
        hearing = asyncio.create_task(self._hear())
        try:
            subscribed = asyncio.create_task(self._subscribed.wait())
            await asyncio.wait({hearing, subscribed}, return_when=asyncio.FIRST_COMPLETED)
            subscribed.cancel()
            loop = asyncio.get_running_loop()
            until = loop.time() + _LONGEST_WAIT_S
            while not hearing.done() and (wait_s := min(self._new_s + _QUIET_S, until) - loop.time()) > 0:
                await asyncio.wait({hearing}, timeout=wait_s)
            if hearing.done():
                hearing.result()
            if self.problem:
                raise LinkDownError(self.problem)
        finally:
            await cancel_and_wait(hearing)

    async def _hear(self) -> None:
        try:
            await self._hear_by(self._settings)
        except VersionRefused:
            # Receiving works the same in both versions of MQTT.
            self._settings = replace(self._settings, version=OLDER)
            await self._hear_by(self._settings)

    async def _hear_by(self, settings: BrokerSettings) -> None:
        name = f"drivecomm-fleet-{secrets.token_urlsafe(6)}"
        async with connect_to_broker(settings, settings.client_id or name, self._received) as connection:
            lost = asyncio.create_task(connection.lost())
            wanted: list[str] = []
            try:
                while not lost.done():
                    self._more.clear()
                    await self._subscribe(connection, wanted, lost)
                    self._subscribed.set()
                    more = asyncio.create_task(self._more.wait())
                    await asyncio.wait({lost, more}, return_when=asyncio.FIRST_COMPLETED)
                    more.cancel()
                await lost
            finally:
                await cancel_and_wait(lost)

    async def _subscribe(self, connection: BrokerConnection, wanted: list[str], lost: asyncio.Task[None]) -> None:
        """Subscribe to the fleet's new topics. A later refusal by the broker does not affect earlier subscriptions."""
        news = [each for each in self.fleet.filters if each not in wanted]
        try:
            await connection.subscribe_with_kept(*news)
        except LinkDownError as error:
            if not wanted or lost.done():
                raise
            self.problem = in_one_line(error)
        else:
            self.problem = ""
        wanted += news
        self._new_s = asyncio.get_running_loop().time()

    def _received(self, received: ReceivedMessage) -> None:
        if received.topic not in self._topics and len(self._topics) < _MOST_TOPICS:
            self._topics.add(received.topic)
            self._new_s = asyncio.get_running_loop().time()
        before = self.fleet.depths
        self.fleet.take(received.topic, received.payload)
        if self.fleet.depths != before:
            self._more.set()
