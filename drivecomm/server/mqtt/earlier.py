"""What an earlier run of the gateway has told, as the broker kept it: what has gone since has to be forgotten there."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from typing import TYPE_CHECKING

from drivecomm.client import parsed
from drivecomm.errors import LinkDownError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.server.broker import Connection, Received

KEPT_WITHIN_S = 1.0
"""A broker that has kept something sends it at once; one that has kept nothing does not say so."""


class Earlier:
    """Asks the broker once what it has kept. topic: where the gateway tells what there is."""

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self._said: bytes | None = None
        self._heard = asyncio.Event()

    def received(self, received: Received) -> None:
        """Hear what was kept; the first counts."""
        if self._said is None:
            self._said = received.payload
            self._heard.set()

    async def quantities(self, connection: Connection) -> Mapping[str, frozenset[str]]:
        """Return the quantities of each drive that there was; nothing where the broker does not let us see it."""
        with suppress(LinkDownError, TimeoutError):
            # A connection that is lost is noticed with what is published next.
            await connection.subscribe_with_kept(self.topic)
            async with asyncio.timeout(KEPT_WITHIN_S):
                await self._heard.wait()
        with suppress(LinkDownError):
            await connection.unsubscribe(self.topic)
        return drives_told(self._said or b"")


def drives_told(payload: bytes) -> Mapping[str, frozenset[str]]:
    """Return the quantities of each drive that a message tells; nothing of one that is not ours."""
    try:
        return {
            str(each["name"]): frozenset(str(name) for name in each["quantities"]) for each in parsed(payload)["drives"]
        }
    except (ValueError, ArithmeticError, RecursionError, LookupError, TypeError):
        return {}
