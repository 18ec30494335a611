"""The kept motors of a plant, each kept while its lease holds; after that, stopped until the drive confirms."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

from drivecomm.errors import LeaseError
from drivecomm.server.kept_motor import KeptMotor, MotorStory

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable, Collection, Mapping

    from drivecomm.protocol import DriveConfig, Stop
    from drivecomm.server.keep_settings import KeepSettings
    from drivecomm.server.leases import Lease, Leases
    from drivecomm.server.standing_stops import StandingStops
    from drivecomm.server.table import ValueTable

RELEASED_WITHIN_S = 6.0
"""Time limit for stops when their line is closed or the server ends; after that, the drive's own watchdog acts."""


class KeptMotors:
    """The kept motors of a plant; used from the core's event loop, and queried from any thread.

    A motor is kept from `begin` until its release, and is forgotten when its stop is confirmed after that.
    """

    def __init__(self, table: ValueTable, stops: StandingStops, leases: Leases) -> None:
        self._table, self._stops, self._leases = table, stops, leases
        self._kept: dict[str, tuple[KeptMotor, Lease]] = {}
        self._let_go: dict[str, tuple[KeptMotor, asyncio.Task[None]]] = {}
        self._stories: dict[str, MotorStory] = {}

    def __contains__(self, drive: object) -> bool:
        return drive in self._kept or drive in self._let_go

    def policy(self, drive: str) -> str:
        """Return the link-loss policy under which a motor is kept, empty if it is not kept."""
        kept = self._kept.get(drive)
        return "" if kept is None else kept[0].order.policy

    async def begin(
        self, whom: Any, config: DriveConfig, order: KeepSettings, lease: Lease, check: Callable[[], None]
    ) -> Mapping[str, Any]:
        """Start a motor and keep it while its lease holds; return its policy and watchdog settings.

        check: raises if the motor must no longer be started. With the policy hold the motor is started, but not kept.
        """
        name = config.name
        if name in self:
            raise LeaseError(f"{name} is kept running already; stop it first")
        story = MotorStory()

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
        """Yield past and new events of the motor that was kept last under this drive name, until it is forgotten."""
        if drive in self._stories:
            async for item in self._stories[drive]:
                yield item

    def release(self, drive: str, how: Stop | None = None) -> None:
        """Release a motor by its policy, or stop it in the given way; do nothing if it is not kept."""
        kept, lease = self._kept.pop(drive, (None, None))
        if kept is not None and lease is not None:
            if not kept.order.start:
                # Otherwise the commander could start the motor again without its being kept.
                self._leases.release(lease)
            if how is not None:
                kept.stop_by(how)
            task = asyncio.create_task(self._released(drive, kept), name=f"releasing {drive}")
            self._let_go[drive] = kept, task

    def outlasts_stop(self, drive: str, lease: str) -> bool:
        """Return whether a motor is still kept after a stop under the lease with this key.

        That is so if the commander starts and stops the motor itself, and stops it under the lease under which it is
        kept.
        """
        kept = self._kept.get(drive)
        return kept is not None and not kept[0].order.start and kept[1].key == lease

    def stop_by(self, drive: str, how: Stop | None) -> None:
        """Set the kind of stop for a released motor that is still stopping; None if the motor has stopped already."""
        if drive in self._let_go:
            self._let_go[drive][0].stop_by(how)

    def look(self) -> None:
        """Release the motors that must not be kept any longer."""
        for name in [name for name, (kept, _) in self._kept.items() if kept.over]:
            self.release(name)

    def lease_expired(self, lease: Lease) -> None:
        """Record that a lease has expired, and apply the policy of the motor that was kept under it."""
        if self._is_under(lease):
            text = f"{lease.holder} did not renew the lease; the motor is released by its policy, "
            self._table.record_event(
                "link loss", text + self.policy(lease.drive), drive=lease.drive, who=str(lease.holder)
            )
            self.release(lease.drive)

    def given_back(self, lease: Lease) -> None:
        """Apply the policy of the motor that was kept under a lease, because its commander has released the lease."""
        if self._is_under(lease):
            self._table.record_event("command", "released", drive=lease.drive, who=str(lease.holder))
            self.release(lease.drive)

    async def settled(self, drive: str, within_s: float) -> None:
        """Wait until the stop of a motor that was kept before is confirmed.

        Raises LeaseError if that takes more than `within_s` seconds.
        """
        if drive in self._let_go:
            await asyncio.wait([self._let_go[drive][1]], timeout=within_s)
        if drive in self._let_go:
            raise LeaseError(f"{drive} was kept running, and its stop is not confirmed yet; retrying")

    async def release_all(self, drives: Collection[str] | None = None) -> None:
        """Release all motors, or these; after some seconds, unconfirmed stops are left to the drives' watchdogs."""
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

    def _teller(self, config: DriveConfig, story: MotorStory) -> Callable[[str, str, Mapping[str, Any]], None]:
        """Return a callback that records the events of a kept motor in the plant and in the motor's story."""

        def tell(done: str, text: str, further: Mapping[str, Any]) -> None:
            if done in ("not answering", "answers again", "failed"):
                self._table.record_event("link loss", text, drive=config.name, line=config.line)
            story.tell({"done": done, "text": text, **further})

        return tell
