"""Keeping a motor: it turns only as long as this program lives and communicates with the drive.

    with keep(pump, "trip", watchdog_s=5) as kept:
        pump.start()
        ...

The drive's own watchdog (`drivecomm.bus.watchdog`) is set to the policy and fed by a thread, or a task, that reads the
status word three times within the watchdog time. Leaving the block, even by an exception, stops the motor and restores
the watchdog. If the program dies, the watchdog acts. This is not a safety function.

The thread shows only that the program lives, not that it works: a loop that hangs is not noticed. To monitor a loop,
set the watchdog with `set_watchdog` and read the status in that loop.
"""

from __future__ import annotations

import asyncio
import time
from threading import Event, Thread
from typing import Self

from drivecomm.bus.drives import AsyncDrive, Drive
from drivecomm.bus.keeper import Keeper
from drivecomm.bus.procedures import carry_out, carry_out_async

_LOOKED_S = 0.02
"""Interval in seconds between checks of an event: too short to be noticed, and without measurable cost."""


class WatchdogKeeper(Keeper[Drive]):
    """Context manager in which the motor turns only as long as this program lives.

    Nothing is sent before it is entered.

    policy: what the motor does when this program falls silent: "ramp", "coast" and "trip" are set in the drive's own
    watchdog, with watchdog_s seconds, and fed; "hold" is not monitored at all, and entering then checks that the
    drive's watchdog, if its model knows one, is off. on_leaving: action when the block is left, the policy's own if
    absent: "ramp" (for "trip" too) and "coast" stop the motor in this way, "hold" does nothing. stop_tries: number of
    immediate attempts to stop the motor before the error is raised.

    A drive at standstill is sent a stop when the block is entered, so that its watchdog counts from there. A Danfoss
    drive that turns already, by another program's command, is fed only after this program has commanded it, too.

    A failed refresh is reported to on_failure immediately, from the thread, and the block continues; without on_failure
    the first failure is raised when the block ends, or by `sleep`. on_status: called with the status that each refresh
    has read.

    Entering raises UsageError for a drive without a model, NotSupported for a policy or a stop that the drive does not
    have, StateError if the watchdog is on in spite of "hold", and the errors of `set_watchdog`. Leaving raises the
    errors of `Drive.stop`; the watchdog then stays as it is, and acts. A thread feeds the watchdog; on a virtual line,
    whose time does not pass by itself, `sleep` feeds it.
    """

    _thread: Thread | None = None

    def sleep(self, seconds: float) -> None:
        """Wait on the line's clock. Raises the error of a failed refresh, unless on_failure is given.

        A program may use `time.sleep` instead, but not on a virtual line.
        """
        if self._drive.bus.real_time:
            self._failed.wait(seconds)
            self._failed.clear()
        else:
            carry_out(self._drive, self._passing(seconds))
        self._raise_first()

    def until(self, event: Event) -> None:
        """Wait until this event is set, for example by a signal handler. Raises the errors of `sleep`."""
        while not event.is_set():
            if self._drive.bus.real_time:
                # Polled, because a signal handler that sets an event deadlocks if it interrupts a wait for it.
                self._failed.wait(_LOOKED_S)
                self._raise_first()
            else:
                self.sleep(self._every_s)

    def __enter__(self) -> Self:
        self._left, self._failed = Event(), Event()
        carry_out(self._drive, self._taking())
        if self._feeds and self._drive.bus.real_time:
            # A daemon thread: a program that ends without leaving the block must not be kept alive; the watchdog acts.
            self._thread = Thread(target=self._feed, name=f"keeping {self._drive.name}", daemon=True)
            self._thread.start()
        return self

    def __exit__(self, kind: object, error: BaseException | None, traceback: object) -> None:
        self._left.set()
        try:
            carry_out(self._drive, self._stopping())
        finally:
            if self._thread is not None:
                self._thread.join()
        carry_out(self._drive, self._restoring())
        if error is None:
            self._raise_first()

    def _feed(self) -> None:
        pause_s = self._every_s
        while not self._left.wait(pause_s):
            began = time.monotonic()
            carry_out(self._drive, self._refreshing())
            if self._first is not None:
                self._failed.set()
            pause_s = self._pause_after_s(time.monotonic() - began)


class AsyncWatchdogKeeper(Keeper[AsyncDrive]):
    """Counterpart of `WatchdogKeeper` for `async with`; a task of the event loop feeds the watchdog."""

    _task: asyncio.Task[None] | None = None

    async def sleep(self, seconds: float) -> None:
        """Wait on the line's clock, as `WatchdogKeeper.sleep` does."""
        if self._drive.bus.real_time:
            await _set_within(self._failed, seconds)
            self._failed.clear()
        else:
            await carry_out_async(self._drive, self._passing(seconds))
        self._raise_first()

    async def __aenter__(self) -> Self:
        self._left, self._failed = asyncio.Event(), asyncio.Event()
        await carry_out_async(self._drive, self._taking())
        if self._feeds and self._drive.bus.real_time:
            self._task = asyncio.create_task(self._feed(), name=f"keeping {self._drive.name}")
        return self

    async def __aexit__(self, kind: object, error: BaseException | None, traceback: object) -> None:
        # A second cancellation must not prevent the stop of the motor, nor close the bus during it.
        leaving = asyncio.ensure_future(self._leave())
        cancelled: asyncio.CancelledError | None = None
        while not leaving.done():
            try:
                await asyncio.wait([leaving])
            except asyncio.CancelledError as again:
                cancelled = again
        if cancelled is not None:
            raise cancelled from leaving.exception()
        leaving.result()
        if error is None:
            self._raise_first()

    async def _leave(self) -> None:
        self._left.set()
        try:
            await carry_out_async(self._drive, self._stopping())
        finally:
            if self._task is not None:
                await self._task
        await carry_out_async(self._drive, self._restoring())

    async def _feed(self) -> None:
        pause_s = self._every_s
        while not await _set_within(self._left, pause_s):
            began = time.monotonic()
            await carry_out_async(self._drive, self._refreshing())
            if self._first is not None:
                self._failed.set()
            pause_s = self._pause_after_s(time.monotonic() - began)


keep = WatchdogKeeper
"""Context manager that keeps a drive's watchdog fed during a `with` block; see `WatchdogKeeper`."""

keep_async = AsyncWatchdogKeeper
"""Context manager that keeps a drive's watchdog fed during an `async with` block; see `AsyncWatchdogKeeper`."""


async def _set_within(event: asyncio.Event, seconds: float) -> bool:
    try:
        async with asyncio.timeout(seconds):
            await event.wait()
    except TimeoutError:
        return False
    return True
