"""What an earlier run of the gateway has told, as the broker kept it: what has gone since has to be forgotten there."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from typing import TYPE_CHECKING, NamedTuple

from drivecomm.client import parsed
from drivecomm.errors import LinkDownError

if TYPE_CHECKING:
    from drivecomm.server.broker import Connection, Received

KEPT_WITHIN_S = 1.0
"""A broker that has kept something sends it at once; one that has kept nothing does not say so."""


class ToldDrive(NamedTuple):
    """A drive that the broker has been told of. topic: below which. quantities: their names."""

    topic: str
    quantities: set[str]


class Earlier:
    """Asks the broker once what it has kept. topic: where the gateway tells what there is. above: of all its topics."""

    def __init__(self, topic: str, above: str) -> None:
        self.topic, self._above = topic, above
        self._said: bytes | None = None
        self._heard = asyncio.Event()

    def received(self, received: Received) -> None:
        """Hear what was kept; the first counts."""
        if self._said is None:
            self._said = received.payload
            self._heard.set()

    async def drives(self, connection: Connection) -> dict[str, ToldDrive]:
        """Return the drives that there were, by name; none where the broker does not let us see them."""
        with suppress(LinkDownError, TimeoutError):
            # A connection that is lost is noticed with what is published next.
            await connection.subscribe_with_kept(self.topic)
            async with asyncio.timeout(KEPT_WITHIN_S):
                await self._heard.wait()
        with suppress(LinkDownError):
            await connection.unsubscribe(self.topic)
        return drives_told(self._said or b"", self._above)


def drives_told(payload: bytes, above: str) -> dict[str, ToldDrive]:
    """Return the drives that a message tells, by name; none of a message that is not ours.

    above: a topic; a drive that is told elsewhere is left alone, whoever says so.
    """
    try:
        found = {
            str(each["name"]): ToldDrive(str(each["topic"]), {str(name) for name in each["quantities"]})
            for each in parsed(payload)["drives"]
        }
    except (ValueError, ArithmeticError, RecursionError, LookupError, TypeError):
        return {}
    return {
        name: each
        for name, each in found.items()
        if each.topic.startswith(f"{above}/") and not set(each.topic) & set("+#")
    }
