"""A broker that is reconnected after each lost connection, for as long as a door runs."""

from __future__ import annotations

import asyncio
import random
from contextlib import suppress
from typing import TYPE_CHECKING, Protocol

from drivecomm.errors import LinkDownError, LinkError, UsageError, in_one_line
from drivecomm.link import Backoff
from drivecomm.server import cancel_and_wait
from drivecomm.server.broker.connection import IdentityTakenOver, connect_to_broker
from drivecomm.server.broker.identity import Identity, client_id_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.server.broker.connection import BrokerConnection, BrokerMessage, ReceivedMessage
    from drivecomm.server.broker.settings import BrokerSettings

FIRST_S, LONGEST_S = 0.5, 3.0
"""First and longest pause between attempts: many gateways return within seconds of their broker, but spread out."""
_TAKEN_FIRST_S, _TAKEN_LONGEST_S = 5.0, 30.0
"""First and longest pause while another client has the identity, or takes it repeatedly."""
_LASTED_S = 10.0
_LOST_SOON = 3
"""Number of connections in a row, each lost soon, that suggests a second client with the same client id."""
_PEACE_S = 600.0
"""Time in seconds after which a connection counts as stable, so that the pauses after a takeover start short again."""
_FAREWELL_S = 1.0


class Messages(Protocol):
    """The part of a door that uses the broker; called in the door's event loop."""

    def will(self) -> BrokerMessage | None:
        """Return the message that the broker publishes if this gateway vanishes; called before each connection."""

    async def serve(self, connection: BrokerConnection) -> None:
        """Serve a new connection until cancelled; the task is cancelled when the connection is lost."""

    def received(self, received: ReceivedMessage) -> None:
        """Process a message; must be quick and never wait."""

    async def farewell(self, connection: BrokerConnection) -> None:
        """Publish that this gateway leaves; the broker publishes the will only after an unexpected end."""


class Broker:
    """A broker, and the connection of a door to it.

    topic: gateways announce themselves below it; gateways with the same topic have the same identity. client_id: base
    of the client id, unless the settings name one. tell: called once when the broker is lost and once when it is back.
    """

    def __init__(
        self, settings: BrokerSettings, messages: Messages, *, topic: str, client_id: str, tell: Callable[[str], None]
    ) -> None:
        self.settings = settings
        self.connected = False
        self._identity = Identity(topic, settings.client_id or client_id_of(client_id))
        self._messages = messages
        self._tell = tell
        self._told = ""
        self._pauses = Backoff(FIRST_S, LONGEST_S)
        self._taken = Backoff(_TAKEN_FIRST_S, _TAKEN_LONGEST_S)
        self._connection: BrokerConnection | None = None
        self._answering: set[asyncio.Task[None]] = set()

    @property
    def instance(self) -> str:
        """A random word that identifies this gateway."""
        return self._identity.instance

    async def run(self, tried: Callable[[], None]) -> None:
        """Connect and reconnect until cancelled. tried: called after each attempt, successful or not."""
        now = asyncio.get_running_loop().time
        lost_soon = 0
        while True:
            began, pauses, problem = now(), self._pauses, ""
            was_connected = False
            try:
                await self._identity.ask(self.settings)
                await self._serve(tried)
            except (IdentityTakenOver, UsageError) as error:
                # Another gateway has the identity, or the password is missing; neither changes within seconds.
                pauses, problem = self._taken, in_one_line(error)
            except (LinkError, TimeoutError) as error:
                problem, was_connected = in_one_line(error) or "the broker does not answer", self.connected
            lost_soon = lost_soon + 1 if was_connected and now() - began < _LASTED_S else 0
            if lost_soon >= _LOST_SOON:
                # Not every broker reports that another client took over the client id.
                pauses = self._taken
                problem = (
                    f"broker {self.settings.place}: the connection is repeatedly lost soon after it was made; if "
                    "another client uses the same client id, write a different client_id = for one of them"
                )
            self.connected = False
            if now() - began >= (_PEACE_S if pauses is self._taken else _LASTED_S):
                pauses.succeeded()
            # Report a problem once, and again when it changes.
            if problem != self._told:
                self._told = problem
                self._tell(f"{problem}; it is tried again")
            tried()
            pauses.failed(now())
            await asyncio.sleep((pauses.over_at - now()) * random.uniform(0.5, 1.0))  # noqa: S311 - only spreads attempts over time

    async def _serve(self, tried: Callable[[], None]) -> None:
        async with connect_to_broker(
            self.settings, self._identity.client_id, self._received, self._messages.will()
        ) as connection:
            self._connection = connection
            lost = asyncio.create_task(connection.lost(), name="broker lost")
            serving = asyncio.create_task(self._all(connection, tried), name="broker served")
            try:
                await asyncio.wait({lost, serving}, return_when=asyncio.FIRST_COMPLETED)
                for task in (lost, serving):
                    if task.done():
                        task.result()
                raise LinkDownError(f"broker {self.settings.place}: no work is left")
            except asyncio.CancelledError:
                await cancel_and_wait(serving)
                with suppress(LinkError, TimeoutError):
                    async with asyncio.timeout(_FAREWELL_S):
                        await self._messages.farewell(connection)
                        await self._identity.leave(connection)
                raise
            finally:
                self._connection = None
                await cancel_and_wait(lost, serving)

    async def _all(self, connection: BrokerConnection, tried: Callable[[], None]) -> None:
        await self._identity.hold(connection)
        self.connected = True
        if self._told:
            self._told = ""
            self._tell(f"broker {self.settings.place} is connected again")
        tried()
        await self._messages.serve(connection)

    def _received(self, received: ReceivedMessage) -> None:
        message = self._identity.answer_to(received)
        if message is None:
            self._messages.received(received)
        elif self._connection is not None and not self._answering:
            answering = asyncio.create_task(self._answer(self._connection, message), name="who has this identity")
            self._answering.add(answering)
            answering.add_done_callback(self._answering.discard)

    async def _answer(self, connection: BrokerConnection, message: BrokerMessage) -> None:
        with suppress(LinkError):
            await connection.publish(message)
