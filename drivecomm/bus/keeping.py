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
from typing import TYPE_CHECKING, Any, Generic, Self, TypeVar, get_args

from drivecomm.bus.async_bus import AsyncDrive
from drivecomm.bus.bus import Drive
from drivecomm.bus.procedures import ask_status, carry_out, carry_out_async, sleep_until, stop_motor
from drivecomm.bus.watchdog import Setting, policies, reading_watchdog, restoring_watchdog, setting_watchdog
from drivecomm.errors import DriveCommError, NotSupported, ReplyError, StateError, UsageError
from drivecomm.protocol import DriveStatus, LinkLoss, Stop, exact

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import TracebackType

    from drivecomm.bus.procedures import Procedure
    from drivecomm.bus.verbs import DriveVerbs
    from drivecomm.protocol import Value

D = TypeVar("D", bound="DriveVerbs[Any]")

REFRESHES_IN_TIME = 3
"""How often a drive is spoken to within its watchdog's time, so that one lost telegram does no harm."""

_STOP_TRIES = 3
_AT_ONCE_S = 0.5

# Nobody can command a trip, so the motor is stopped as gently as it can be.
_STOPS: dict[LinkLoss, Stop | None] = {"hold": None, "ramp": Stop.RAMP, "coast": Stop.COAST, "trip": Stop.RAMP}


class _Keeper(Generic[D]):
    """What is done with a drive that is kept, as procedures, and what has gone wrong meanwhile."""

    def __init__(
        self,
        drive: D,
        policy: LinkLoss,
        *,
        watchdog_s: Value | float = 5,
        on_leaving: LinkLoss | None = None,
        on_failure: Callable[[DriveCommError], None] | None = None,
        on_status: Callable[[DriveStatus], None] | None = None,
    ) -> None:
        for given in (policy, on_leaving or policy):
            if given not in get_args(LinkLoss):
                *some, last = get_args(LinkLoss)
                raise UsageError(f"unknown policy {given!r}; use {', '.join(some)} or {last}")
        self._drive, self._policy = drive, policy
        self._feeds = policy != "hold"
        self._watchdog_s = exact(watchdog_s, "watchdog time")
        self._every_s = float(self._watchdog_s) / REFRESHES_IN_TIME
        self._stop = _STOPS[on_leaving or policy]
        if self._stop is not None and self._stop not in drive.capabilities.stops:
            able = ", ".join(sorted(stop.value for stop in drive.capabilities.stops))
            raise NotSupported(f"{drive.name} cannot stop by {self._stop.value} when it is left; it can by {able}")
        self._on_failure, self._on_status = on_failure, on_status
        self._setting: Setting | None = None
        self._earlier: Setting | None = None
        self._first: Exception | None = None
        self._asked = self._unanswered = 0
        self._answered_at: float | None = None
        self._next_at = 0.0

    @property
    def watchdog(self) -> Setting | None:
        """How the drive's watchdog is set inside the block; None where its model knows none."""
        return self._setting

    def stop_by(self, how: Stop) -> None:
        """Stop so when the block is left, whatever its policy says."""
        self._stop = how

    def _taking(self) -> Procedure[None]:
        """Set the watchdog to the policy, remember how it was, and count its time from now."""
        name, model = self._drive.name, self._drive.model
        if self._feeds:
            # Made first, because it refuses what cannot be before anything is sent.
            setting = setting_watchdog(name, model, self._policy, self._watchdog_s)
            self._earlier = yield from reading_watchdog(name, model)
            status: DriveStatus = yield ask_status()
            if not status.running and not status.fault:
                # Changes nothing, but a drive that counts from its last command would act at once if that is long ago.
                yield stop_motor(Stop.RAMP)
            self._setting = yield from setting
        elif policies(model):
            self._setting = yield from reading_watchdog(name, model)
            if self._setting.policy != "hold":
                raise StateError(
                    f"the watchdog of {name} is on ({self._setting}), which is not hold; choose its policy, or "
                    "switch it off first"
                )
        self._answered_at = self._drive.bus.now()
        self._next_at = self._answered_at + self._every_s

    def _refreshing(self) -> Procedure[None]:
        """Speak to the drive; what goes wrong is remembered and told."""
        self._asked += 1
        try:
            try:
                status = yield ask_status()
            except DriveCommError as error:
                self._unanswered += 1
                self._check_silence(self._drive.bus.now(), None)
                self._fail(error)
            else:
                now = self._drive.bus.now()
                self._check_silence(now, now)
                if self._on_status is not None:
                    self._on_status(status)
        except Exception as error:  # noqa: BLE001 - nobody would see it in a thread; the end of the block raises it
            self._first = self._first or error

    def _pause_after_s(self, took_s: float) -> float:
        """Return how long to wait after a refresh that took so long; the line is left to others for some time."""
        return max(self._every_s / 2, self._every_s - took_s)

    def _passing(self, seconds: float) -> Procedure[None]:
        """Let time pass on a virtual line, and refresh whenever it is time for that."""
        bus = self._drive.bus
        until = bus.now() + seconds
        while (now := bus.now()) < until:
            if self._feeds and now >= self._next_at:
                yield from self._refreshing()
                self._next_at = bus.now() + self._pause_after_s(bus.now() - now)
            yield sleep_until(min(until, self._next_at) if self._feeds else until)

    def _stopping(self) -> Procedure[None]:
        """Do what is to be done on leaving."""
        for left in reversed(range(_STOP_TRIES if self._stop is not None else 0)):
            try:
                yield stop_motor(self._stop)  # type: ignore[arg-type]
            except ReplyError:
                if not left:
                    raise
            else:
                return

    def _restoring(self) -> Procedure[None]:
        """Set the watchdog as it was, so that a program that speaks less often does not set it off."""
        if self._earlier is not None:
            yield from restoring_watchdog(self._drive.name, self._drive.model, self._earlier)

    def _check_silence(self, now: float, answered_at: float | None) -> None:
        """Tell, once, that the drive was not spoken to for so long that its watchdog has acted."""
        if self._answered_at is not None:
            silent_s = now - self._answered_at
            if silent_s > self._watchdog_s:
                self._answered_at = None
                self._fail(
                    StateError(
                        f"{self._drive.name} was not spoken to for {silent_s:.1f} s, longer than its watchdog waits; "
                        "what it was commanded is not repeated, so start it again if it shall run"
                    )
                )
        if answered_at is not None:
            self._answered_at = answered_at

    def _fail(self, error: DriveCommError) -> None:
        if self._on_failure is None:
            self._first = self._first or error
        else:
            self._on_failure(error)

    def _raise_first(self) -> None:
        """Raise the first error, once."""
        first, self._first = self._first, None
        if first is None:
            return
        if isinstance(first, DriveCommError) and self._unanswered:
            count = f"{self._unanswered} of {self._asked} refreshes of {self._drive.name} failed so far"
            first.args = (f"{count}, and its watchdog may have acted; the first: {first}", *first.args[1:])
        raise first


class WatchdogKeeper(_Keeper[Drive]):
    """A block in which the motor turns only as long as this program lives; nothing is sent before it is entered.

    policy: what the motor does when this program falls silent: "ramp", "coast" and "trip" are set in the drive's own
    watchdog, with watchdog_s seconds, and fed; "hold" is not watched at all, and entering then makes sure that the
    drive's watchdog, where its model knows one, is off. on_leaving: what is done when the block is left, the policy's
    own if absent: "ramp" (for "trip" too) and "coast" stop the motor so, "hold" does nothing.

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
                # Not for ever at once: on some systems nothing else interrupts that.
                event.wait(_AT_ONCE_S)
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

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
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


class AsyncWatchdogKeeper(_Keeper[AsyncDrive]):
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

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
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
