"""A drive that is read only when its line is idle, and within a share of the line's time."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.bus import AsyncDrive
    from drivecomm.protocol import Reading


class PacedDrive:
    """A drive for procedures that only read, which leaves most of the line's time to other users.

    share: of the line's time, above 0 and up to 1. check: called before each read; its errors end the procedure.
    """

    def __init__(self, drive: AsyncDrive, share: float, check: Callable[[], None]) -> None:
        self._drive = drive
        self._pauses = 1 / share - 1
        self._check = check

    async def read(self, parameter: str, **options: Any) -> Reading:
        """Read as `polled` does, then wait until other users have had their share of the time."""
        self._check()
        loop = asyncio.get_running_loop()
        began_s = loop.time()
        try:
            return await self._drive.polled(parameter, **options)
        finally:
            await asyncio.sleep((loop.time() - began_s) * self._pauses)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._drive, name)
