"""The motors of a plant that are kept, each for as long as a lease holds; stopped until that is confirmed."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

from drivecomm.errors import LeaseError
from drivecomm.server.kept import KeptMotor, Story

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable, Collection, Mapping

    from drivecomm.protocol import DriveConfig, Stop
    from drivecomm.server.keep_orders import KeepOrder
    from drivecomm.server.leases import Lease, Leases
    from drivecomm.server.standing_stops import StandingStops
    from drivecomm.server.table import Table

RELEASED_WITHIN_S = 6.0
"""How long a stop is tried when its line is closed or the server ends; then the drive's own watchdog acts."""


class KeptMotors:
    """Keeps motors and releases them; used from the core's event loop, and asked from any thread.

    From its begin until it is released a motor is kept; it is let go when its stop is confirmed.
    """

    def __init__(self, table: Table, stops: StandingStops, leases: Leases) -> None:
        self._table, self._stops, self._leases = table, stops, leases
        self._kept: dict[str, tuple[KeptMotor, Lease]] = {}
        self._let_go: dict[str, tuple[KeptMotor, asyncio.Task[None]]] = {}
        self._stories: dict[str, Story] = {}

    def __contains__(self, drive: object) -> bool:
        return drive in self._kept or drive in self._let_go

    def policy(self, drive: str) -> str:
        """Return the link-loss policy under which a motor is kept, empty where it is not."""
        kept = self._kept.get(drive)
        return "" if kept is None else kept[0].order.policy

    async def begin(
        self, whom: Any, config: DriveConfig, order: KeepOrder, lease: Lease, check: Callable[[], None]
    ) -> Mapping[str, Any]:
        """Start a motor and keep it as long as this lease holds; returns what its commander wants to know of that.

        check: raises when it must not be started any more. With the policy hold it is started, and not kept.
        """
        name = config.name
        if name in self:
            raise LeaseError(f"{name} is kept running already; stop it first")
        story = Story()

        async def stopped(how: Stop, error: Exception) -> None:
            self._stops.stand(name, how, str(lease.holder), self._stops.sent([name], how), error)
            await self._stops.until_over(name)

        kept = KeptMotor(whom, order, self._teller(config, story), check, stopped)
        self._kept[name], self._stories[name] = (kept, lease), story
        begun = False
        try:
            await kept.begin()
            begun = order.policy != "hold"
        finally:
            if not begun and self._kept.get(name) == (kept, lease):
                self.release(name)
        return {"policy": order.policy, "watchdog": kept.watchdog}

    async def following(self, drive: str) -> AsyncIterator[Mapping[str, Any]]:
        """Tell what has happened, and happens, to the motor that was kept last, until it is let go."""
        if drive in self._stories:
            async for item in self._stories[drive]:
                yield item

    def release(self, drive: str, how: Stop | None = None) -> None:
        """Treat a motor by its policy from now on, or stop it so; one that is not kept is left alone."""
        kept, lease = self._kept.pop(drive, (None, None))
        if kept is not None and lease is not None:
            if not kept.order.start:
                # Its commander must not start it again without anybody keeping it.
                self._leases.release(lease)
            if how is not None:
                kept.stop_by(how)
            task = asyncio.create_task(self._released(drive, kept), name=f"releasing {drive}")
            self._let_go[drive] = kept, task

    def outlasts_stop(self, drive: str, lease: str) -> bool:
        """Whether a motor goes on being kept after a stop under the lease with this key.

        So it does if its commander, who may start it again, stops it under the lease under which it is kept.
        """
        kept = self._kept.get(drive)
        return kept is not None and not kept[0].order.start and kept[1].key == lease

    def stop_by(self, drive: str, how: Stop | None) -> None:
        """Have a motor whose stop is still being tried stopped so from now on; None: no more, because it is stopped."""
        if drive in self._let_go:
            self._let_go[drive][0].stop_by(how)

    def look(self) -> None:
        """Release those that are to be kept no longer."""
        for name in [name for name, (kept, _) in self._kept.items() if kept.over]:
            self.release(name)

    def lapsed(self, lease: Lease) -> None:
        """Take note that a lease was not renewed, and treat the motor that was kept under it by its policy."""
        if self._is_under(lease):
            text = f"{lease.holder} does not renew their lease; the motor is treated by its policy, "
            self._table.happened("link loss", text + self.policy(lease.drive), drive=lease.drive, who=str(lease.holder))
            self.release(lease.drive)

    def given_back(self, lease: Lease) -> None:
        """Treat the motor that was kept under a lease by its policy, because its commander wants no more of it."""
        if self._is_under(lease):
            self._table.happened("command", "released", drive=lease.drive, who=str(lease.holder))
            self.release(lease.drive)

    async def settled(self, drive: str, within_s: float) -> None:
        """Wait until nothing is left to be done of what was kept before. Raises LeaseError when that takes longer."""
        if drive in self._let_go:
            await asyncio.wait([self._let_go[drive][1]], timeout=within_s)
        if drive in self._let_go:
            raise LeaseError(f"{drive} was kept running, and its stop is not confirmed yet; it is tried again")

    async def release_all(self, drives: Collection[str] | None = None) -> None:
        """Release all motors, or these; what is not confirmed after some seconds is left to the drive's watchdog."""
        for name in list(self._kept):
            if drives is None or name in drives:
                self.release(name)
        left = {name: each for name, each in self._let_go.items() if drives is None or name in drives}
        if not left:
            return
        await asyncio.wait([task for _, task in left.values()], timeout=RELEASED_WITHIN_S)
        for kept, task in left.values():
            if not task.done():
                kept.leave_alone()
        await asyncio.wait([task for _, task in left.values()])

    def _is_under(self, lease: Lease) -> bool:
        kept = self._kept.get(lease.drive)
        return kept is not None and kept[1].key == lease.key

    async def _released(self, drive: str, kept: KeptMotor) -> None:
        story = self._stories[drive]
        try:
            await kept.release()
        finally:
            del self._let_go[drive]
            story.end()

    def _teller(self, config: DriveConfig, story: Story) -> Callable[[str, str, Mapping[str, Any]], None]:
        """Return what tells of a motor that is kept from now on: as an event, and to those who follow it."""

        def tell(done: str, text: str, further: Mapping[str, Any]) -> None:
            if done in ("not answering", "answers again", "failed"):
                self._table.happened("link loss", text, drive=config.name, line=config.line)
            story.tell({"done": done, "text": text, **further})

        return tell
