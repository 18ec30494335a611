"""Queue for stops that arrive faster than they can be processed: keeps the latest of each drive and loses none."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

from drivecomm.server.mqtt.rate_limit import A_SECOND

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable

    from drivecomm.server.broker import ReceivedMessage

MOST = 2000
"""Maximum number of waiting stops, at most one of each drive."""


class Stops:
    """Waiting stops; used only within one event loop. hand_on: starts the processing of a stop."""

    def __init__(self, hand_on: Callable[[ReceivedMessage], None]) -> None:
        self._hand_on = hand_on
        self._waiting: dict[Hashable, ReceivedMessage] = {}
        self._turns: asyncio.Task[None] | None = None

    @property
    def wait(self) -> bool:
        """Whether any stop is waiting. A new stop must then queue, so that an old one never overrides it."""
        return bool(self._waiting)

    def put(self, of: Hashable, received: ReceivedMessage) -> bool:
        """Queue a stop, replacing an earlier one for the same target. Return whether there was room."""
        if of not in self._waiting and len(self._waiting) >= MOST:
            return False
        self._waiting[of] = received
        if self._turns is None or self._turns.done():
            self._turns = asyncio.create_task(self._take_turns(), name="stops that wait")
        return True

    async def _take_turns(self) -> None:
        while self._waiting:
            await asyncio.sleep(1.0 / A_SECOND)
            self._hand_on(self._waiting.pop(next(iter(self._waiting))))
