"""Keeping a drive in hand: its motor turns only as long as this program lives and speaks to it.

    with keep(pump, "trip", watchdog_s=5) as kept:
        pump.start()
        ...

The drive's own watchdog (`drivecomm.bus.watchdog`) is set to the policy and fed by a thread, or a task, that reads the
status word three times in its time. Leaving the block, by an exception too, stops the motor and sets the watchdog as it
was. A program that dies leaves the rest to the watchdog. This is not a safety function.

The thread vouches for the program being there, not for what it does: a loop that hangs is not noticed. Whoever wants
that sets the watchdog with `set_watchdog` and asks for the status in that loop.
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
"""How soon it is seen that an event was set; nobody feels it, and it costs nothing."""


class WatchdogKeeper(Keeper[Drive]):
    """A block in which the motor turns only as long as this program lives; nothing is sent before it is entered.

    policy: what the motor does when this program falls silent: "ramp", "coast" and "trip" are set in the drive's own
    watchdog, with watchdog_s seconds, and fed; "hold" is not watched at all, and entering then makes sure that the
    drive's watchdog, where its model knows one, is off. on_leaving: what is done when the block is left, the policy's
    own if absent: "ramp" (for "trip" too) and "coast" stop the motor so, "hold" does nothing. stop_tries: how often it
    is stopped at once before its error is raised.

    A drive that stands is told to stop when the block is entered, so that it counts from there. A Danfoss drive that
    turns already, by another program's command, is fed only when this one has commanded it, too.

    A refresh that fails is told to on_failure at once, from the thread, and the block goes on; without on_failure the
    first one is raised when the block ends, or by `sleep`. on_status: told what each refresh has read.

    Entering raises UsageError for a drive without a model, NotSupported for a policy or a stop that the drive has not,
    StateError for a watchdog that is on against "hold", and what `set_watchdog` raises. Leaving raises what
    `Drive.stop` raises; the watchdog then stays as it is, and acts.

    A thread feeds the watchdog; on a virtual line, whose time does not pass by itself, `sleep` does it.
    """

    _thread: Thread | None = None

    def sleep(self, seconds: float) -> None:
        """Let time pass on the line's clock. Raises the error of a refresh that has failed, unless on_failure is told.

        A program may as well do without and use `time.sleep`; not so on a virtual line.
        """
        if self._drive.bus.real_time:
            self._failed.wait(seconds)
            self._failed.clear()
        else:
            carry_out(self._drive, self._passing(seconds))
        self._raise_first()

    def until(self, event: Event) -> None:
        """Let time pass until this event is set, by a signal handler say. Raises as `sleep` does."""
        while not event.is_set():
            if self._drive.bus.real_time:
                # Only looked at: a signal handler that sets an event waits for ever where it interrupts its wait.
                self._failed.wait(_LOOKED_S)
                self._raise_first()
            else:
                self.sleep(self._every_s)

    def __enter__(self) -> Self:
        self._left, self._failed = Event(), Event()
        carry_out(self._drive, self._taking())
        if self._feeds and self._drive.bus.real_time:
            # A program that ends without leaving the block is not kept alive by this: that is for the watchdog.
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
    """A block for `async with`, as `WatchdogKeeper` is one for `with`; a task of the event loop feeds the watchdog."""

    _task: asyncio.Task[None] | None = None

    async def sleep(self, seconds: float) -> None:
        """Let time pass on the line's clock; as `WatchdogKeeper.sleep`."""
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
        # Whoever cancels a second time does not keep the motor from being stopped, nor closes the bus under it.
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
"""Keeps a drive's watchdog fed while a `with` block runs; see `WatchdogKeeper`."""

keep_async = AsyncWatchdogKeeper
"""Keeps a drive's watchdog fed while an `async with` block runs; see `AsyncWatchdogKeeper`."""


async def _set_within(event: asyncio.Event, seconds: float) -> bool:
    try:
        async with asyncio.timeout(seconds):
            await event.wait()
    except TimeoutError:
        return False
    return True
