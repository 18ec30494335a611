"""Non-blocking part of keeping a motor: its refreshes, its errors, and its release."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Generic, TypeVar

from drivecomm.bus.call_styles import RemoteCalls
from drivecomm.bus.feeding import Feeding, WatchdogFeeding
from drivecomm.bus.keep_policy import REFRESHES_IN_TIME, STOP_TRIES, USUAL_WATCHDOG_S, stop_on_leaving
from drivecomm.bus.procedures import sleep_until
from drivecomm.errors import DriveCommError, ReplyError, StateError
from drivecomm.protocol import DriveStatus, LinkLoss, Stop, exact

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.bus.procedures import Procedure
    from drivecomm.bus.verbs import DriveVerbs
    from drivecomm.bus.watchdog import Setting
    from drivecomm.protocol import Value

D = TypeVar("D", bound="DriveVerbs[Any]")


class Keeper(Generic[D]):
    """Procedures that keep a motor, and the errors that occurred meanwhile."""

    def __init__(
        self,
        drive: D,
        policy: LinkLoss,
        *,
        watchdog_s: Value | float = USUAL_WATCHDOG_S,
        on_leaving: LinkLoss | None = None,
        stop_tries: int = STOP_TRIES,
        on_failure: Callable[[DriveCommError], None] | None = None,
        on_status: Callable[[DriveStatus], None] | None = None,
    ) -> None:
        self._drive = drive
        self._stop = stop_on_leaving(drive, policy, on_leaving)
        self._feeds = policy != "hold"
        self._watchdog_s = exact(watchdog_s, "watchdog time")
        self._feeding: Feeding = (
            # The server's own polls feed the drive's watchdog, so it cannot show that this program has died.
            drive.feeding(policy, self._watchdog_s, self._stop)
            if self._feeds and isinstance(drive, RemoteCalls)
            else WatchdogFeeding(drive, policy, self._watchdog_s)
        )
        self._every_s = self._feeding.silence_s / REFRESHES_IN_TIME
        self._stop_tries = stop_tries
        self._on_failure, self._on_status = on_failure, on_status
        self._first: Exception | None = None
        self._stopped = False
        self._asked = self._unanswered = 0
        self._answered_at: float | None = None
        self._next_at = 0.0

    @property
    def watchdog(self) -> Setting | None:
        """Setting of the drive's watchdog inside the block; None if its model knows no watchdog."""
        return self._feeding.setting

    @property
    def stopped(self) -> bool:
        """Whether the stop on leaving is done; restoring the watchdog may have failed nevertheless."""
        return self._stopped

    @property
    def leaving_stop(self) -> Stop | None:
        """The kind of stop sent on leaving; None for none."""
        return self._stop

    def stop_by(self, how: Stop | None) -> None:
        """Set the stop that is sent on leaving, whatever the policy says; None if the motor is stopped already."""
        self._stop = how

    def _taking(self) -> Procedure[None]:
        """Begin to keep the motor, and count its time from now."""
        yield from self._feeding.taking()
        self._answered_at = self._drive.bus.now()
        self._next_at = self._answered_at + self._every_s

    def _refreshing(self) -> Procedure[None]:
        """Refresh the watchdog or the lease; errors are recorded and reported."""
        self._asked += 1
        try:
            try:
                status = yield from self._feeding.refreshing()
            except DriveCommError as error:
                self._unanswered += 1
                self._check_silence(self._drive.bus.now(), None)
                self._fail(error)
            else:
                now = self._drive.bus.now()
                self._check_silence(now, now)
                if self._on_status is not None:
                    self._on_status(status)
        except Exception as error:  # noqa: BLE001 - lost in a thread otherwise; the end of the block raises it
            self._first = self._first or error

    def _pause_after_s(self, took_s: float) -> float:
        """Return the pause in seconds after a refresh that took `took_s`; it leaves some line time to others."""
        return max(self._every_s / 2, self._every_s - took_s)

    def _passing(self, seconds: float) -> Procedure[None]:
        """Let time pass on a virtual line, and refresh whenever a refresh is due."""
        bus = self._drive.bus
        until = bus.now() + seconds
        while (now := bus.now()) < until:
            if self._feeds and now >= self._next_at:
                yield from self._refreshing()
                self._next_at = bus.now() + self._pause_after_s(bus.now() - now)
            yield sleep_until(min(until, self._next_at) if self._feeds else until)

    def _stopping(self) -> Procedure[None]:
        """Send the stop on leaving, with repetitions."""
        for left in reversed(range(self._stop_tries)):
            try:
                yield from self._feeding.stopping(self._stop)
            except ReplyError:
                if not left:
                    raise
            else:
                break
        self._stopped = True

    def _restoring(self) -> Procedure[None]:
        """End the keeping and restore the watchdog."""
        yield from self._feeding.restoring()

    def _check_silence(self, now: float, answered_at: float | None) -> None:
        """Report, once, that the drive got no telegram for so long that its watchdog has acted."""
        if self._answered_at is not None:
            silent_s = now - self._answered_at
            if silent_s > self._feeding.silence_s:
                self._answered_at = None
                self._fail(
                    StateError(
                        f"{self._drive.name} received no request for {silent_s:.1f} s, longer than its watchdog waits; "
                        "what it was commanded is not repeated, so start it again if it should run"
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
        """Raise the first recorded error, once."""
        first, self._first = self._first, None
        if first is None:
            return
        if isinstance(first, DriveCommError) and self._unanswered:
            count = f"{self._unanswered} of {self._asked} refreshes of {self._drive.name} have failed"
            first.args = (f"{count}, and its watchdog may have acted; the first: {first}", *first.args[1:])
        raise first
