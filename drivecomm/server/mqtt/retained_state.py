"""Retained topics of an earlier run, read back from the broker so that obsolete ones can be cleared."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from typing import TYPE_CHECKING, NamedTuple

from drivecomm.client import parsed
from drivecomm.errors import LinkDownError

if TYPE_CHECKING:
    from drivecomm.server.broker import BrokerConnection, ReceivedMessage

KEPT_WITHIN_S = 1.0
"""Seconds to wait for retained messages: a broker sends them immediately, but does not say if it has none."""


class AnnouncedDrive(NamedTuple):
    """Drive that is announced on the broker. topic: prefix of its topics. quantities: names of its quantities."""

    topic: str
    quantities: set[str]


class RetainedInventory:
    """Reader of the retained inventory. topic: topic of the inventory. above: prefix of all topics of the gateway."""

    def __init__(self, topic: str, above: str) -> None:
        self.topic, self._above = topic, above
        self._said: bytes | None = None
        self._heard = asyncio.Event()

    def received(self, received: ReceivedMessage) -> None:
        """Take the retained inventory; only the first message counts."""
        if self._said is None:
            self._said = received.payload
            self._heard.set()

    async def drives(self, connection: BrokerConnection) -> dict[str, AnnouncedDrive]:
        """Return the drives of the retained inventory by name; empty if the broker does not send it."""
        with suppress(LinkDownError, TimeoutError):
            # A lost connection is noticed at the next publication.
            await connection.subscribe_with_kept(self.topic)
            async with asyncio.timeout(KEPT_WITHIN_S):
                await self._heard.wait()
        with suppress(LinkDownError):
            await connection.unsubscribe(self.topic)
        return drives_in_inventory(self._said or b"", self._above)


def drives_in_inventory(payload: bytes, above: str) -> dict[str, AnnouncedDrive]:
    """Return the drives in an inventory message by name; empty if the message is invalid.

    above: prefix of our topics; drives outside it are ignored, so that no foreign topic is cleared.
    """
    try:
        found = {
            str(each["name"]): AnnouncedDrive(str(each["topic"]), {str(name) for name in each["quantities"]})
            for each in parsed(payload)["drives"]
        }
    except (ValueError, ArithmeticError, RecursionError, LookupError, TypeError):
        return {}
    return {
        name: each
        for name, each in found.items()
        if each.topic.startswith(f"{above}/") and not set(each.topic) & set("+#")
    }
