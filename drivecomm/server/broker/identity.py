"""Check for another gateway with the same topics before connecting, so that two gateways never compete.

A retained message names the holder of an identity; a holder that runs answers requests. One that was killed does not.
"""

from __future__ import annotations

import asyncio
import os
import secrets
import socket
import time
from hashlib import sha256
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from drivecomm.client import json_text, parsed
from drivecomm.errors import UsageError
from drivecomm.server.broker.connection import BrokerConnection, BrokerMessage, IdentityRefused, connect_to_broker

if TYPE_CHECKING:
    from drivecomm.server.broker.connection import ReceivedMessage
    from drivecomm.server.broker.settings import BrokerSettings

_LONGEST_ID = 64
"""Length limit of a client id: some brokers permit only 100 characters, and the check appends a word of 13."""
_ANSWER_S = 1.0
"""Timeout for the answer of the holder."""


def client_id_of(name: str) -> str:
    """Return a client id for a name that every broker accepts: short, and of ASCII without spaces and wildcards."""
    text = quote(name, safe="%")
    if len(text) <= _LONGEST_ID:
        return text
    known_by = sha256(name.encode()).hexdigest()[:12]
    return f"{text[: _LONGEST_ID - len(known_by) - 1]}-{known_by}"


class Identity:
    """The identity of one gateway on a broker.

    topic: holders announce themselves below it, so only gateways with the same topic compete.
    """

    def __init__(self, topic: str, client_id: str) -> None:
        self.instance = secrets.token_urlsafe(9)
        self.client_id = client_id
        self._holder_topic, self._asked_topic = f"{topic}/holder", f"{topic}/asked"
        self._held_since_s = 0.0

    async def ask(self, settings: BrokerSettings) -> None:
        """Check that no other gateway has this identity.

        Raises UsageError if one has, PortError without a connection.
        """
        asking = _Asking(self._holder_topic, self._asked_topic, self.instance)
        try:
            async with connect_to_broker(
                settings, f"{self.client_id}-{self.instance}", asking.on_message
            ) as connection:
                await connection.subscribe_with_kept(self._holder_topic, self._asked_topic)
                await connection.publish(BrokerMessage(topic=self._asked_topic, payload=json_text(asking.word)))
                holder = await asking.holder()
        except IdentityRefused:
            # This broker admits only configured client ids, each of them once, so no other gateway has this identity.
            return
        if holder is not None:
            raise UsageError(
                f"broker {settings.place}: a gateway on {holder.get('host', 'another machine')} (pid "
                f"{holder.get('pid', '?')}) has this identity already; stop it, or give this one another prefix ="
            )

    async def hold(self, connection: BrokerConnection) -> None:
        """Announce that this gateway has the identity, and subscribe to requests, which `answer_to` answers."""
        self._held_since_s = time.time()
        await connection.subscribe(self._asked_topic)
        await connection.publish(self._holder())

    async def leave(self, connection: BrokerConnection) -> None:
        """Announce that the identity is free."""
        await connection.publish(BrokerMessage(topic=self._holder_topic, payload=b"", retain=True))

    def answer_to(self, received: ReceivedMessage) -> BrokerMessage | None:
        """Return the answer to a request for the holder, or None for any other message."""
        if received.topic != self._asked_topic:
            return None
        return self._holder(_word(received))

    def _holder(self, asked: str = "") -> BrokerMessage:
        content = {
            "instance": self.instance,
            "host": socket.gethostname(),
            "pid": os.getpid(),
            "since_s": round(self._held_since_s, 3),
            "answers": asked,
        }
        return BrokerMessage(topic=self._holder_topic, payload=json_text(content), retain=True)


def _word(received: ReceivedMessage) -> str:
    return received.payload.decode(errors="replace")[:100].strip('"')


class _Asking:
    """One check: the retained message of the holder, and its answer if it still runs."""

    def __init__(self, holder_topic: str, asked_topic: str, instance: str) -> None:
        self.word = secrets.token_urlsafe(9)
        self._holder_topic, self._asked_topic, self._instance = holder_topic, asked_topic, instance
        self._kept: dict[str, Any] | None = None
        self._answer: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()
        self._asked = asyncio.Event()

    def on_message(self, received: ReceivedMessage) -> None:
        if received.topic == self._asked_topic and _word(received) == self.word:
            # Our own request has come back, so the broker has sent the retained message already.
            self._asked.set()
        elif received.topic == self._holder_topic and received.payload:
            try:
                content = parsed(received.payload)
            except (ValueError, ArithmeticError, RecursionError):
                return
            if not isinstance(content, dict) or content.get("instance") == self._instance:
                return
            self._kept = content
            if content.get("answers") == self.word and not self._answer.done():
                self._answer.set_result(content)

    async def holder(self) -> dict[str, Any] | None:
        """Return the holder of the identity, or None if there is no answer."""
        async with asyncio.timeout(_ANSWER_S * 5):
            await self._asked.wait()
        if self._kept is None:
            return None
        try:
            return await asyncio.wait_for(self._answer, _ANSWER_S)
        except TimeoutError:
            return None
