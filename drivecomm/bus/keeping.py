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
from typing import TYPE_CHECKING, Self, get_args

from drivecomm.bus.steps import AskStatus, Steps, StopMotor, carry_out, carry_out_async
from drivecomm.bus.watchdog import Setting, policies, putting_back_steps, reading_steps, setting_steps
from drivecomm.errors import DriveCommError, NotSupported, ReplyError, StateError, UsageError
from drivecomm.protocol import DriveStatus, LinkLoss, Stop, exact

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import TracebackType

    from drivecomm.bus.async_drive import AsyncDrive
    from drivecomm.bus.drive import Drive
    from drivecomm.protocol import Value

REFRESHES_IN_TIME = 3
"""How often a drive is spoken to within its watchdog's time, so that one lost telegram does no harm."""

_STOP_TRIES = 3

# Nobody can command a trip, so the motor is stopped as gently as it can be.
_STOPS: dict[LinkLoss, Stop | None] = {"hold": None, "ramp": Stop.RAMP, "coast": Stop.COAST, "trip": Stop.RAMP}


def keep(
    drive: Drive,
    policy: LinkLoss,
    *,
    watchdog_s: Value | float = 5,
    on_leaving: LinkLoss | None = None,
    on_failure: Callable[[DriveCommError], None] | None = None,
    on_status: Callable[[DriveStatus], None] | None = None,
) -> Kept:
    """Return a block in which the motor turns only as long as this program lives; nothing is sent before it is entered.

    policy: what the motor does when this program falls silent: "ramp", "coast" and "trip" are set in the drive's own
    watchdog, with watchdog_s seconds, and fed; "hold" is not watched at all, and entering then makes sure that the
    drive's watchdog, where its model knows one, is off. on_leaving: what is done when the block is left, the policy's
    own if absent: "ramp" (for "trip" too) and "coast" stop the motor so, "hold" does nothing.

    A drive that stands is told to stop when the block is entered, so that it counts from there. A Danfoss drive that
    turns already, by another program's command, is fed only when this one has commanded it, too.

    A refresh that fails is told to on_failure at once, from the thread, and the block goes on; without on_failure the
    first one is raised when the block ends, or by `Kept.sleep`. on_status: told what each refresh has read.

    Entering raises UsageError for a drive without a model, NotSupported for a policy or a stop that the drive has not,
    StateError for a watchdog that is on against "hold", and what `set_watchdog` raises. Leaving raises what
    `Drive.stop` raises; the watchdog then stays as it is, and acts.
    """
    hand = _Hand(
        drive, policy, watchdog_s=watchdog_s, on_leaving=on_leaving, on_failure=on_failure, on_status=on_status
    )
    return Kept(drive, hand)


def keep_async(
    drive: AsyncDrive,
    policy: LinkLoss,
    *,
    watchdog_s: Value | float = 5,
    on_leaving: LinkLoss | None = None,
    on_failure: Callable[[DriveCommError], None] | None = None,
    on_status: Callable[[DriveStatus], None] | None = None,
) -> AsyncKept:
    """Return a block for `async with`, as `keep` does for `with`; a task of the event loop feeds the watchdog."""
    hand = _Hand(
        drive, policy, watchdog_s=watchdog_s, on_leaving=on_leaving, on_failure=on_failure, on_status=on_status
    )
    return AsyncKept(drive, hand)


class Kept:
    """A drive kept in hand by a thread. On a virtual line, whose time does not pass by itself, `sleep` does it."""

    def __init__(self, drive: Drive, hand: _Hand) -> None:
        self._drive = drive
        self._hand = hand
        self._left = Event()
        self._failed = Event()
        self._thread: Thread | None = None
        self._next_at = 0.0

    @property
    def watchdog(self) -> Setting | None:
        """How the drive's watchdog is set inside the block; None where its model knows none."""
        return self._hand.setting

    def stop_by(self, how: Stop) -> None:
        """Stop so when the block is left, whatever its policy says."""
        self._hand.stop_by(how)

    def sleep(self, seconds: float) -> None:
        """Let time pass on the line's clock. Raises the error of a refresh that has failed, unless on_failure is told.

        A program may as well do without and use `time.sleep`; not so on a virtual line.
        """
        if self._drive.bus.real_time:
            self._failed.wait(seconds)
            self._failed.clear()
        else:
            self._pass(seconds)
        self._hand.raise_first()

    def until(self, event: Event) -> None:
        """Let time pass until this event is set, by a signal handler say. Raises as `sleep` does."""
        while not event.is_set():
            if self._drive.bus.real_time:
                # Not for ever at once: on some systems nothing else interrupts that.
                event.wait(_AT_ONCE_S)
                self._hand.raise_first()
            else:
                self.sleep(self._hand.every_s)

    def __enter__(self) -> Self:
        carry_out(self._drive, self._hand.taking())
        self._hand.begin()
        if self._hand.feeds and self._drive.bus.real_time:
            # A program that ends without leaving the block is not kept alive by this: that is for the watchdog.
            self._thread = Thread(target=self._feed, name=f"keeping {self._drive.name}", daemon=True)
            self._thread.start()
        self._next_at = self._drive.bus.now() + self._hand.every_s
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._left.set()
        try:
            carry_out(self._drive, self._hand.stopping())
        finally:
            if self._thread is not None:
                self._thread.join()
        carry_out(self._drive, self._hand.putting_back())
        if error is None:
            self._hand.raise_first()

    def _feed(self) -> None:
        pause_s = self._hand.every_s
        while not self._left.wait(pause_s):
            began = time.monotonic()
            self._refresh()
            pause_s = self._hand.pause_after_s(time.monotonic() - began)

    def _refresh(self) -> None:
        try:
            carry_out(self._drive, self._hand.refreshing())
        except Exception as error:  # noqa: BLE001 - a thread has nobody who would see it; the block's end raises it
            self._hand.break_down(error)
        if self._hand.has_failed:
            self._failed.set()

    def _pass(self, seconds: float) -> None:
        bus = self._drive.bus
        until = bus.now() + seconds
        while (now := bus.now()) < until:
            if self._hand.feeds and now >= self._next_at:
                self._refresh()
                self._next_at = bus.now() + self._hand.pause_after_s(bus.now() - now)
            bus.sleep_until(min(until, self._next_at) if self._hand.feeds else until)


class AsyncKept:
    """A drive kept in hand by a task of the event loop; on a virtual line `sleep` does it."""

    def __init__(self, drive: AsyncDrive, hand: _Hand) -> None:
        self._drive = drive
        self._hand = hand
        self._left = asyncio.Event()
        self._failed = asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self._next_at = 0.0

    @property
    def watchdog(self) -> Setting | None:
        """How the drive's watchdog is set inside the block; None where its model knows none."""
        return self._hand.setting

    async def sleep(self, seconds: float) -> None:
        """Let time pass on the line's clock; as `Kept.sleep`."""
        if self._drive.bus.real_time:
            await _set_within(self._failed, seconds)
            self._failed.clear()
        else:
            await self._pass(seconds)
        self._hand.raise_first()

    async def __aenter__(self) -> Self:
        await carry_out_async(self._drive, self._hand.taking())
        self._hand.begin()
        if self._hand.feeds and self._drive.bus.real_time:
            self._task = asyncio.create_task(self._feed(), name=f"keeping {self._drive.name}")
        self._next_at = self._drive.bus.now() + self._hand.every_s
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
            self._hand.raise_first()

    async def _leave(self) -> None:
        self._left.set()
        try:
            await carry_out_async(self._drive, self._hand.stopping())
        finally:
            if self._task is not None:
                await self._task
        await carry_out_async(self._drive, self._hand.putting_back())

    async def _feed(self) -> None:
        pause_s = self._hand.every_s
        while not await _set_within(self._left, pause_s):
            began = time.monotonic()
            await self._refresh()
            pause_s = self._hand.pause_after_s(time.monotonic() - began)

    async def _refresh(self) -> None:
        try:
            await carry_out_async(self._drive, self._hand.refreshing())
        except Exception as error:  # noqa: BLE001 - as in a thread
            self._hand.break_down(error)
        if self._hand.has_failed:
            self._failed.set()

    async def _pass(self, seconds: float) -> None:
        bus = self._drive.bus
        until = bus.now() + seconds
        while (now := bus.now()) < until:
            if self._hand.feeds and now >= self._next_at:
                await self._refresh()
                self._next_at = bus.now() + self._hand.pause_after_s(bus.now() - now)
            await bus.sleep_until(min(until, self._next_at) if self._hand.feeds else until)


class _Hand:
    """What is done with a drive that is kept, as plans, and what has gone wrong meanwhile.

    setting: how its watchdog is set inside the block. every_s: the time from one refresh to the next.
    """

    def __init__(
        self,
        drive: Drive | AsyncDrive,
        policy: LinkLoss,
        *,
        watchdog_s: Value | float,
        on_leaving: LinkLoss | None,
        on_failure: Callable[[DriveCommError], None] | None,
        on_status: Callable[[DriveStatus], None] | None,
    ) -> None:
        for given in (policy, on_leaving or policy):
            if given not in get_args(LinkLoss):
                raise UsageError(f"{given!r} is no policy; write one of {', '.join(get_args(LinkLoss))}")
        self._name, self._model = drive.name, drive.model
        self._policy = policy
        self._watchdog_s = exact(watchdog_s, "watchdog time")
        self._stop = _STOPS[on_leaving or policy]
        if self._stop is not None and self._stop not in drive.capabilities.stops:
            able = ", ".join(sorted(stop.value for stop in drive.capabilities.stops))
            raise NotSupported(f"{drive.name} cannot stop by {self._stop.value} when it is left; it can by {able}")
        self._on_failure, self._on_status = on_failure, on_status
        self._earlier: Setting | None = None
        self._first: Exception | None = None
        self._asked = self._unanswered = 0
        self._answered_at: float | None = None
        self._now = drive.bus.now
        self.setting: Setting | None = None
        self.every_s = float(self._watchdog_s) / REFRESHES_IN_TIME

    @property
    def feeds(self) -> bool:
        """Whether there is a watchdog to be fed."""
        return self._policy != "hold"

    @property
    def has_failed(self) -> bool:
        """Whether there is something to raise."""
        return self._first is not None

    def taking(self) -> Steps[None]:
        """Set the watchdog to the policy, and remember how it was."""
        if self.feeds:
            # Made first, because it refuses what cannot be before anything is sent.
            setting = setting_steps(self._name, self._model, self._policy, self._watchdog_s)
            self._earlier = yield from reading_steps(self._name, self._model)
            status: DriveStatus = yield AskStatus()
            if not status.running and not status.fault:
                # Changes nothing, but a drive that counts from its last command would act at once if that is long ago.
                yield StopMotor(Stop.RAMP)
            self.setting = yield from setting
        elif policies(self._model):
            self.setting = yield from reading_steps(self._name, self._model)
            if self.setting.policy != "hold":
                raise StateError(
                    f"the watchdog of {self._name} is on ({self.setting}), which is not hold; choose its policy, or "
                    "switch it off first"
                )

    def stop_by(self, how: Stop) -> None:
        """Stop so on leaving."""
        self._stop = how

    def pause_after_s(self, took_s: float) -> float:
        """Return how long to wait after a refresh that took so long; the line is left to others for some time."""
        return max(self.every_s / 2, self.every_s - took_s)

    def begin(self) -> None:
        """Count the watchdog's time from now."""
        self._answered_at = self._now()

    def refreshing(self) -> Steps[None]:
        """Speak to the drive; what goes wrong is kept in mind and told."""
        self._asked += 1
        try:
            status = yield AskStatus()
        except DriveCommError as error:
            self._unanswered += 1
            self._look_at_silence(self._now(), None)
            self._fail(error)
        else:
            now = self._now()
            self._look_at_silence(now, now)
            if self._on_status is not None:
                self._on_status(status)

    def _look_at_silence(self, now: float, answered_at: float | None) -> None:
        """Tell, once, that the drive was not spoken to for so long that its watchdog has acted."""
        if self._answered_at is not None:
            silent_s = now - self._answered_at
            if silent_s > self._watchdog_s:
                self._answered_at = None
                self._fail(
                    StateError(
                        f"{self._name} was not spoken to for {silent_s:.1f} s, longer than its watchdog waits; what it "
                        "was commanded is not repeated, so start it again if it shall run"
                    )
                )
        if answered_at is not None:
            self._answered_at = answered_at

    def _fail(self, error: DriveCommError) -> None:
        if self._on_failure is None:
            self._first = self._first or error
        else:
            self._on_failure(error)

    def break_down(self, error: Exception) -> None:
        """Keep in mind what a refresh, or what is told of it, must not raise."""
        self._first = self._first or error

    def stopping(self) -> Steps[None]:
        """Do what is to be done on leaving."""
        for left in reversed(range(_STOP_TRIES if self._stop is not None else 0)):
            try:
                yield StopMotor(self._stop)  # type: ignore[arg-type]
            except ReplyError:
                if not left:
                    raise
            else:
                return

    def putting_back(self) -> Steps[None]:
        """Set the watchdog as it was, so that a program that speaks less often does not set it off."""
        if self._earlier is not None:
            yield from putting_back_steps(self._name, self._model, self._earlier)

    def raise_first(self) -> None:
        """Raise the first error, once."""
        first, self._first = self._first, None
        if first is None:
            return
        if isinstance(first, DriveCommError) and self._unanswered:
            count = f"{self._unanswered} of {self._asked} refreshes of {self._name} failed so far"
            first.args = (f"{count}, and its watchdog may have acted; the first: {first}", *first.args[1:])
        raise first


_AT_ONCE_S = 0.5


async def _set_within(event: asyncio.Event, seconds: float) -> bool:
    try:
        async with asyncio.timeout(seconds):
            await event.wait()
    except TimeoutError:
        return False
    return True
