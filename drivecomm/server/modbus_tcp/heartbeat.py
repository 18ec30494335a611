"""The lease of a drive, held for a PLC while its heartbeat counts up; it expires when the heartbeat stops."""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError, LeaseError

if TYPE_CHECKING:
    from drivecomm.server import Caller, ServedPlant
    from drivecomm.server.modbus_tcp.register_image import RegisterImage

_WRAP = 2**16
RENEWED_EVERY_S = 0.1
"""Shortest interval between renewals, however fast the heartbeat counts."""
_AGAIN_S = 0.5
"""Seconds before a refused lease is requested again."""


def counts_up(before: int, now: int) -> bool:
    """Whether a word has moved forward, by less than half its range. Backward means another program or an old image."""
    return 0 < (now - before) % _WRAP < _WRAP // 2


class HeldLease:
    """Lease of one drive as seen by a door; used only within its event loop.

    seconds: how long a heartbeat holds the lease.
    """

    def __init__(self, plant: ServedPlant, drive: str, seconds: float) -> None:
        self._plant, self._drive, self._seconds = plant, drive, seconds
        self.key = ""
        self.owner: RegisterImage | None = None
        self._until_s = 0.0
        self._again_s = 0.0
        self._counted: tuple[RegisterImage, Caller] | None = None
        """The image whose heartbeat has counted since the last request for the lease, and its caller."""
        self._counted_s = 0.0
        self._asking: asyncio.Task[None] | None = None
        self._ending: asyncio.Task[None] | None = None

    def is_held_by(self, image: RegisterImage) -> bool:
        """Whether this image holds the lease now."""
        return self.owner is image and self.left_s > 0

    @property
    def left_s(self) -> float:
        """Seconds until the lease expires; 0 without a lease."""
        return max(0.0, self._until_s - time.monotonic()) if self.key else 0.0

    def counted(self, image: RegisterImage, caller: Caller) -> None:
        """Acquire or renew the lease, because the heartbeat of an image has counted up."""
        if not self._may_have(image):
            return
        self._counted, self._counted_s = (image, caller), time.monotonic()
        if self._asking is None and (self.key or time.monotonic() >= self._again_s):
            self._asking = asyncio.create_task(self._ask(), name=f"lease of {self._drive}")

    def give_back(self, image: RegisterImage, caller: Caller) -> None:
        """Release the lease if this image holds it; the policy of the motor is then applied immediately."""
        if self._counted is not None and self._counted[0] is image:
            self._counted = None
        if self.owner is image and self.key:
            key, self.key, self.owner = self.key, "", None
            self._ending = asyncio.create_task(self._end(caller, key), name=f"end of the lease of {self._drive}")

    def _may_have(self, image: RegisterImage) -> bool:
        """Whether this image may request the lease: it holds it, no other image does, or its peer has reconnected.

        After a cut cable the old connection is still open: only its heartbeat is silent.
        """
        owner = self.owner
        if owner is None or owner is image or self.left_s <= 0:
            return True
        is_quiet = time.monotonic() - self._counted_s > self._seconds / 2
        return owner.address == image.address and (is_quiet or not owner.is_connected)

    async def _ask(self) -> None:
        try:
            while self._counted is not None:
                (image, caller), self._counted = self._counted, None
                # The time before the request, so that the lease never lasts longer here than in the server.
                now = time.monotonic()
                try:
                    await self._renewed(caller)
                except DriveCommError:
                    # Another caller holds the lease, or this address may not have it.
                    self.key, self.owner, self._again_s = "", None, now + _AGAIN_S
                    return
                self.owner, self._until_s = image, now + self._seconds
                await asyncio.sleep(RENEWED_EVERY_S)
        finally:
            self._asking = None

    async def _renewed(self, caller: Caller) -> None:
        if self.key:
            try:
                await self._plant.renew_lease(caller, self._drive, self.key, self._seconds)
            except LeaseError:
                # The lease has expired, but perhaps no other caller has acquired it.
                self.key = ""
            else:
                return
        self.key = (await self._plant.take_lease(caller, self._drive, self._seconds)).key

    async def _end(self, caller: Caller, key: str) -> None:
        try:
            await self._plant.end_lease(caller, self._drive, key)
        except DriveCommError:
            # The lease had already expired.
            return
