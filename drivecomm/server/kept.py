"""Motors that a server keeps in hand: fed while their commander's lease holds, treated by their policy after it."""

from __future__ import annotations

import asyncio
from collections import deque
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from drivecomm.bus import KeepNews, carry_out_async, keep_async, starting, starting_by, telling_speed
from drivecomm.client import error_content
from drivecomm.errors import CommandCancelledError, DriveCommError, in_one_line

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Awaitable, Callable, Mapping

    from drivecomm.bus import AsyncDrive, Procedure
    from drivecomm.protocol import Stop
    from drivecomm.server.keep_orders import KeepOrder

MOST_TOLD = 200
"""So much of what has happened to one motor is told to whoever asks for it later; the history has it all."""


class Story:
    """What has happened to a kept motor since it was started, for all who want to know, whenever they begin to ask."""

    def __init__(self) -> None:
        self._told: deque[Mapping[str, Any]] = deque(maxlen=MOST_TOLD)
        self._number = 0
        self._over = False
        self._more = asyncio.Event()

    def tell(self, item: Mapping[str, Any]) -> None:
        """Add something."""
        self._told.append(item)
        self._number += 1
        self._woken()

    def end(self) -> None:
        """Say that nothing more will come."""
        self._over = True
        self._woken()

    async def __aiter__(self) -> AsyncIterator[Mapping[str, Any]]:
        """Yield what there is, and what comes until the end."""
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
    """A motor that is kept in hand for its commander until it is released.

    told: hears what happens to it, each thing once: a word for programs, a sentence, and more. check: raises when it
    must not be started any more; asked right before it is. stopped: has a stop retried that was not confirmed, and
    returns when nothing is left to be retried.
    """

    def __init__(
        self,
        drive: AsyncDrive,
        order: KeepOrder,
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
        self._news = KeepNews(self._tell, self._tell_silent, self._end.set if order.start else lambda: None)
        self._keeper = keep_async(
            drive,
            order.policy,
            watchdog_s=order.watchdog_s,
            # It is tried again later, when others have had the line.
            stop_tries=1,
            on_failure=self._news.failed,
            on_status=self._news.answered,
        )
        self._task: asyncio.Task[None] | None = None

    async def begin(self) -> None:
        """Set its watchdog, start it, and keep it from now on. Raises what either raises; release it then."""
        begun: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._task = asyncio.create_task(self._keep(begun), name=f"keeping {self._drive.name}")
        self._task.add_done_callback(lambda _: self._set_off(begun, self._released_first()))
        try:
            await asyncio.shield(begun)
        except asyncio.CancelledError:
            self._end.set()
            raise

    @property
    def watchdog(self) -> str:
        """How its own watchdog is set, in words; empty where its model knows none."""
        return "" if self._keeper.watchdog is None else str(self._keeper.watchdog)

    @property
    def over(self) -> bool:
        """Whether it is to be kept no longer."""
        return self._end.is_set() or self._task is None or self._task.done()

    def stop_by(self, how: Stop | None) -> None:
        """Let it be stopped so when it is released, whatever its policy says; None: not at all, as it is stopped."""
        self._keeper.stop_by(how)

    async def release(self) -> None:
        """Treat it by its policy and set its watchdog as it was; returns when its stop is confirmed, however long."""
        self._end.set()
        if self._task is not None:
            await asyncio.wait([self._task])
        # Its watchdog may have been on before: what commands it from now on feeds it, or nobody.
        self._drive.watched(None)

    def leave_alone(self) -> None:
        """Try no more to stop it: its own watchdog acts as soon as nobody speaks to it."""
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
                        await carry_out_async(self._drive.checked(self._check_wanted), self._starting())
                except Exception as error:  # noqa: BLE001 - whoever began it is told, when it is stopped
                    failed = error
                else:
                    begun.set_result(None)
                    await self._kept()
        except Exception as error:  # noqa: BLE001 - whoever began it is told, or who follows it
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
            # Whoever ends it does not wait for a drive that is slow to tell its speed.
            await asyncio.wait({speed, ended}, return_when=asyncio.FIRST_COMPLETED)
            self._tell_started(speed.result() if speed.done() else "")
            await ended
        finally:
            speed.cancel()
            ended.cancel()

    async def _speed(self) -> str:
        """Return where the motor runs to, in words; empty if that is not known."""
        drive = self._drive
        with suppress(Exception):
            return await carry_out_async(
                drive, telling_speed(drive.model, drive.bus.now, waits=self.order.by is not None)
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
        """Raise when it is to be released before it is started; nothing is awaited between this and the telegram."""
        self._check()
        if self._end.is_set():
            raise self._released_first()

    def _set_off(self, begun: asyncio.Future[None], error: Exception) -> None:
        """Tell whoever began it that it is not kept."""
        if not begun.done():
            begun.set_exception(error)

    def _released_first(self) -> CommandCancelledError:
        return CommandCancelledError(f"{self._drive.name} was released before it was started")

    async def _stop_later(self, error: Exception) -> None:
        """Have its stop retried until the drive confirms; polls feed its watchdog as soon as it answers again."""
        if not self._keeper.stopped and (how := self._keeper.leaving_stop) is not None:
            self._not_as_wished("may be running, because its stop is not confirmed, and is tried again", error)
            await self._stopped(how, error)
            self._keeper.stop_by(None)
            try:
                await self._keeper.__aexit__(None, None, None)
            except Exception as again:  # noqa: BLE001 - it is told
                error = again
            else:
                self._news.stopped()
                return
        self._not_as_wished("is stopped, but its watchdog may not be set as it was", error)

    def _not_as_wished(self, what: str, error: Exception) -> None:
        told = {"error": error_content(error)} if isinstance(error, DriveCommError) else {}
        self._tell("failed", f"{self._drive.name} {what}: {in_one_line(error)}", **told)

    def _tell(self, done: str, text: str, **further: Any) -> None:
        # Whoever hears it does not keep the motor from being stopped.
        with suppress(Exception):
            self._told(done, text, further)

    def _tell_silent(self, error: DriveCommError) -> None:
        self._tell("not answering", in_one_line(error), error=error_content(error))
