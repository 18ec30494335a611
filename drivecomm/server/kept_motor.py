"""Kept motors: the server feeds their watchdogs while the commander's lease holds, then applies their policies."""

from __future__ import annotations

import asyncio
from collections import deque
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from drivecomm.bus import KeepReports, carry_out_async, keep_async, reading_speed, starting, starting_by
from drivecomm.client import error_content
from drivecomm.errors import CommandCancelledError, DriveCommError, in_one_line
from drivecomm.line import result_of

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Awaitable, Callable, Mapping

    from drivecomm.bus import AsyncDrive, Procedure
    from drivecomm.protocol import Stop
    from drivecomm.server.keep_settings import KeepSettings

MOST_TOLD = 200
"""Events of one motor that are retained for later readers; the history has all of them."""


class MotorStory:
    """The events of a kept motor since its start, which each reader gets from the first retained event on."""

    def __init__(self) -> None:
        self._told: deque[Mapping[str, Any]] = deque(maxlen=MOST_TOLD)
        self._number = 0
        self._over = False
        self._more = asyncio.Event()

    def tell(self, item: Mapping[str, Any]) -> None:
        """Append an event to the story."""
        self._told.append(item)
        self._number += 1
        self._woken()

    def end(self) -> None:
        """Mark the story as complete."""
        self._over = True
        self._woken()

    async def __aiter__(self) -> AsyncIterator[Mapping[str, Any]]:
        """Yield the retained events, then each new one until the story ends."""
        place = 0
        while True:
            more = self._more
            while place < self._number:
                first = self._number - len(self._told)
                place = max(place, first) + 1
                yield self._told[place - 1 - first]
            if self._over and place == self._number:
                return
            await more.wait()

    def _woken(self) -> None:
        woken, self._more = self._more, asyncio.Event()
        woken.set()


class KeptMotor:
    """A motor that is kept for its commander until it is released.

    told: called once for each event of the motor with a word for programs, a sentence, and further content. check:
    raises if the motor must no longer be started; called right before the start. stopped: retries a stop that was not
    confirmed, and returns when there is nothing left to retry.
    """

    def __init__(
        self,
        drive: AsyncDrive,
        order: KeepSettings,
        told: Callable[[str, str, Mapping[str, Any]], None],
        check: Callable[[], None],
        stopped: Callable[[Stop, Exception], Awaitable[None]],
    ) -> None:
        self.order = order
        self._drive = drive
        self._told = told
        self._check = check
        self._stopped = stopped
        self._end = asyncio.Event()
        self._news = KeepReports(self._tell, self._tell_silent, self._end.set if order.start else lambda: None)
        self._keeper = keep_async(
            drive,
            order.policy,
            watchdog_s=order.watchdog_s,
            # Standing stops retry it later, after other users of the line.
            stop_tries=1,
            on_failure=self._news.failed,
            on_status=self._news.answered,
        )
        self._task: asyncio.Task[None] | None = None

    async def begin(self) -> None:
        """Set the watchdog, start the motor, and keep it. Raises the errors of both; release the motor then."""
        begun: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._task = asyncio.create_task(self._keep(begun), name=f"keeping {self._drive.name}")
        self._task.add_done_callback(lambda _: self._set_off(begun, self._released_first()))
        try:
            await result_of(begun)
        except asyncio.CancelledError:
            self._end.set()
            raise

    @property
    def watchdog(self) -> str:
        """The settings of the drive's own watchdog, in words; empty if its model has none."""
        return "" if self._keeper.watchdog is None else str(self._keeper.watchdog)

    @property
    def over(self) -> bool:
        """Whether the motor must be released."""
        return self._end.is_set() or self._task is None or self._task.done()

    def stop_by(self, how: Stop | None) -> None:
        """Set the kind of stop at the motor's release, whatever its policy; None if the motor has stopped already."""
        self._keeper.stop_by(how)

    async def release(self) -> None:
        """Release the motor by its policy and restore its watchdog; return when its stop is confirmed.

        The wait has no time limit.
        """
        self._end.set()
        if self._task is not None:
            await asyncio.wait([self._task])
        # The watchdog may have been on before: its next commander feeds it, or it trips.
        self._drive.watched(None)

    def leave_alone(self) -> None:
        """Cancel all attempts to stop the motor: its drive's own watchdog acts when it gets no more requests."""
        if self._task is not None:
            self._task.cancel()

    async def _keep(self, begun: asyncio.Future[None]) -> None:
        entered, failed = False, None
        try:
            async with self._keeper as kept:
                entered = True
                self._news.watchdog_set(kept.watchdog)
                try:
                    if self.order.start:
                        await carry_out_async(self._drive.with_check(self._check_wanted), self._starting())
                except Exception as error:  # noqa: BLE001 - `begin` raises it after the stop
                    failed = error
                else:
                    begun.set_result(None)
                    await self._kept()
        except Exception as error:  # noqa: BLE001 - `begin` raises it, or the story records it
            if not entered:
                self._set_off(begun, error)
                return
            if failed is not None:
                self._set_off(begun, failed)
            await self._stop_later(error)
            return
        if failed is not None:
            self._set_off(begun, failed)
        elif self.order.policy != "hold":
            self._news.stopped()

    async def _kept(self) -> None:
        order = self.order
        if order.policy == "hold":
            self._tell_started("")
            return
        if not order.start:
            await self._end.wait()
            return
        ended = asyncio.create_task(self._end.wait())
        speed = asyncio.create_task(self._speed())
        try:
            # A drive that is slow to report its speed does not delay the release.
            await asyncio.wait({speed, ended}, return_when=asyncio.FIRST_COMPLETED)
            self._tell_started(speed.result() if speed.done() else "")
            await ended
        finally:
            speed.cancel()
            ended.cancel()

    async def _speed(self) -> str:
        """Return the speed that the motor runs up to, in words; empty if it is not known."""
        drive = self._drive
        with suppress(Exception):
            return await carry_out_async(
                drive, reading_speed(drive.model, drive.bus.now, waits=self.order.by is not None)
            )
        return ""

    def _tell_started(self, speed: str) -> None:
        what = "started" if self.order.by is None else "commanded"
        self._news.started(f"{what}, {speed}" if speed else what, self.order.policy, self.order.watchdog_s)

    def _starting(self) -> Procedure[None]:
        order = self.order
        if order.by is not None:
            return starting_by(*order.by, self._check_wanted)
        return starting(reverse=order.reverse, percent=order.percent, hz=order.hz, check=self._check_wanted)

    def _check_wanted(self) -> None:
        """Raise if the motor is released before its start; nothing is awaited between this check and the telegram."""
        self._check()
        if self._end.is_set():
            raise self._released_first()

    def _set_off(self, begun: asyncio.Future[None], error: Exception) -> None:
        """End a waiting `begin` with an error: the motor is not kept."""
        if not begun.done():
            begun.set_exception(error)

    def _released_first(self) -> CommandCancelledError:
        return CommandCancelledError(f"{self._drive.name} was released before it was started")

    async def _stop_later(self, error: Exception) -> None:
        """Retry the stop until the drive confirms it; polls feed the watchdog as soon as the drive answers again."""
        if not self._keeper.stopped and (how := self._keeper.leaving_stop) is not None:
            self._not_as_wished("may be running, because its stop is not confirmed; retrying", error)
            await self._stopped(how, error)
            self._keeper.stop_by(None)
            try:
                await self._keeper.__aexit__(None, None, None)
            except Exception as again:  # noqa: BLE001 - reported below
                error = again
            else:
                self._news.stopped()
                return
        self._not_as_wished("is stopped, but its watchdog may not be restored", error)

    def _not_as_wished(self, what: str, error: Exception) -> None:
        told = {"error": error_content(error)} if isinstance(error, DriveCommError) else {}
        self._tell("failed", f"{self._drive.name} {what}: {in_one_line(error)}", **told)

    def _tell(self, done: str, text: str, **further: Any) -> None:
        # A failing callback must not prevent the motor from being stopped.
        with suppress(Exception):
            self._told(done, text, further)

    def _tell_silent(self, error: DriveCommError) -> None:
        self._tell("not answering", in_one_line(error), error=error_content(error))
