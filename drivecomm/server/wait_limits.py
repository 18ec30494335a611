"""Waiting for a state of a drive, for callers who may only view: limited in time, and at the lowest priority."""

from __future__ import annotations

import asyncio
from collections import Counter
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

from drivecomm.bus import AsyncDrive, GoalWait
from drivecomm.errors import NotSupported, OvertakenError, UsageError, unknown_key

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.bus import AsyncBroadcast, AwaitedLine
    from drivecomm.protocol import DriveStatus

LONGEST_S = 600.0
"""Longest wait of one call in seconds; a caller that needs longer repeats the call."""
MOST = 20
"""Number of calls that may wait for one drive in parallel."""
_ASKED_EVERY_S = 0.1
_USUAL_S = 10.0


class Waits:
    """The calls that wait for drives. Used within one event loop."""

    def __init__(self) -> None:
        self._turns: WeakKeyDictionary[AwaitedLine, asyncio.Lock] = WeakKeyDictionary()
        self._waiting: Counter[str] = Counter()

    async def wait(self, whom: AsyncDrive | AsyncBroadcast, arguments: Mapping[str, Any]) -> DriveStatus:
        """Poll a drive's status until it reaches the goal; return that status. Raises as `AsyncDrive.wait_for`.

        Raises UsageError for a timeout that is too long, and if too many calls wait already.
        """
        goal, timeout_s = _checked(**arguments)
        if not isinstance(whom, AsyncDrive):
            raise NotSupported(f"{whom.peer.name} cannot be waited for; wait for each drive")
        waiting = GoalWait(whom.name, goal, timeout_s, whom.bus.now())
        if timeout_s > LONGEST_S:
            raise UsageError(f"timeout_s is at most {LONGEST_S:g}; call it again when the time has expired")
        place = f"{id(whom.bus)} {whom.name}"
        if self._waiting[place] >= MOST:
            raise UsageError(f"{MOST} calls wait for {whom.name} already; read its status, or try again later")
        self._waiting[place] += 1
        try:
            return await self._met(whom, waiting)
        finally:
            self._waiting -= Counter({place: 1})

    async def _met(self, drive: AsyncDrive, waiting: GoalWait) -> DriveStatus:
        # One status request per line at a time, so waiting callers take at most every other turn from the polls.
        turn = self._turns.setdefault(drive.bus, asyncio.Lock())
        while True:
            asked_at = drive.bus.now()
            try:
                async with turn:
                    status = await drive.polled_status()
                if waiting.over(status, drive.bus.now()):
                    return status
            except OvertakenError as error:
                waiting.overtaken(error, drive.bus.now())
            await drive.bus.sleep_until(asked_at + _ASKED_EVERY_S)


def _checked(*, goal: Any = "", timeout_s: Any = _USUAL_S, **unknown: Any) -> tuple[Any, Any]:
    if unknown:
        raise UsageError(unknown_key(min(unknown), ("goal", "timeout_s")))
    return str(goal), timeout_s
