"""Stops that come faster than they can be handed on: the latest of each drive waits for its turn, and none is lost."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

from drivecomm.server.mqtt.floods import A_SECOND

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable

    from drivecomm.server.broker import Received

MOST = 2000
"""So many different ones wait at most; there is one of each drive."""


class Stops:
    """Those that wait. hand_on: begins what a stop asks for. Used within one event loop."""

    def __init__(self, hand_on: Callable[[Received], None]) -> None:
        self._hand_on = hand_on
        self._waiting: dict[Hashable, Received] = {}
        self._turns: asyncio.Task[None] | None = None

    @property
    def wait(self) -> bool:
        """Whether any waits: what comes now goes behind it, so that an old one never overrides a later one."""
        return bool(self._waiting)

    def put(self, of: Hashable, received: Received) -> bool:
        """Have a stop wait, in the place of an earlier one of the same; whether there is room for it."""
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
