"""What is done with a drive that is kept in hand, as procedures: take it, feed its watchdog, stop it, let it go."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Generic, TypeVar, get_args

from drivecomm.bus.faces import Sent
from drivecomm.bus.procedures import ask_status, ask_status_first, sleep_until, stop_motor
from drivecomm.bus.watchdog import Setting, policies, reading_watchdog, restoring_watchdog, setting_watchdog
from drivecomm.errors import DriveCommError, NotSupported, ReplyError, StateError, UsageError
from drivecomm.protocol import DriveStatus, LinkLoss, Stop, exact

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.bus.procedures import Procedure
    from drivecomm.bus.verbs import DriveVerbs
    from drivecomm.protocol import Value

D = TypeVar("D", bound="DriveVerbs[Any]")

REFRESHES_IN_TIME = 3
"""How often a drive is spoken to within its watchdog's time, so that one lost telegram does no harm."""

_STOP_TRIES = 3

# Nobody can command a trip, so the motor is stopped as gently as it can be.
_STOPS: dict[LinkLoss, Stop | None] = {"hold": None, "ramp": Stop.RAMP, "coast": Stop.COAST, "trip": Stop.RAMP}


class Keeper(Generic[D]):
    """What is done with a drive that is kept, as procedures, and what has gone wrong meanwhile."""

    def __init__(
        self,
        drive: D,
        policy: LinkLoss,
        *,
        watchdog_s: Value | float = 5,
        on_leaving: LinkLoss | None = None,
        stop_tries: int = _STOP_TRIES,
        on_failure: Callable[[DriveCommError], None] | None = None,
        on_status: Callable[[DriveStatus], None] | None = None,
    ) -> None:
        for given in (policy, on_leaving or policy):
            if given not in get_args(LinkLoss):
                *some, last = get_args(LinkLoss)
                raise UsageError(f"unknown policy {given!r}; use {', '.join(some)} or {last}")
        self._drive, self._policy = drive, policy
        self._feeds = policy != "hold"
        if self._feeds and isinstance(drive, Sent):
            raise UsageError(
                f"{drive.name} is on a line of a server, whose own questions would feed its watchdog although this "
                "program had died; keep it with drivecomm.client.KeptMotor, or open the plant with own_ports=True",
                says="own_ports=True",
            )
        self._watchdog_s = exact(watchdog_s, "watchdog time")
        self._every_s = float(self._watchdog_s) / REFRESHES_IN_TIME
        self._stop = _STOPS[on_leaving or policy]
        if self._stop is not None and self._stop not in drive.capabilities.stops:
            able = ", ".join(sorted(stop.value for stop in drive.capabilities.stops))
            raise NotSupported(f"{drive.name} cannot stop by {self._stop.value} when it is left; it can by {able}")
        self._stop_tries = stop_tries
        self._on_failure, self._on_status = on_failure, on_status
        self._setting: Setting | None = None
        self._earlier: Setting | None = None
        self._first: Exception | None = None
        self._stopped = False
        self._asked = self._unanswered = 0
        self._answered_at: float | None = None
        self._next_at = 0.0

    @property
    def watchdog(self) -> Setting | None:
        """How the drive's watchdog is set inside the block; None where its model knows none."""
        return self._setting

    @property
    def stopped(self) -> bool:
        """Whether what is done on leaving was done; setting the watchdog as it was may have failed all the same."""
        return self._stopped

    @property
    def leaving_stop(self) -> Stop | None:
        """The kind of stop sent on leaving; None for none."""
        return self._stop

    def stop_by(self, how: Stop | None) -> None:
        """Stop so when the block is left, whatever its policy says; None: do nothing then, because it is stopped."""
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
                # However much is read by others, the drive is spoken to in time.
                status = yield ask_status_first()
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
        for left in reversed(range(self._stop_tries)):
            if self._stop is None:
                break
            try:
                yield stop_motor(self._stop)
            except ReplyError:
                if not left:
                    raise
            else:
                break
        self._stopped = True

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
