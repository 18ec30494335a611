"""The poll loop of one line: what comes next, and what came of it; and the loop that blocks."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

from drivecomm.errors import DriveCommError, LinkError
from drivecomm.link import REOPEN_FIRST_S, Backoff
from drivecomm.polling.schedule import PollItem, PollResult, Schedule

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Sequence

    from drivecomm.protocol import Reading

NAP_S = 0.1
"""The longest sleep in one piece: a plan that is given up ends within this time."""


class PolledBus(Protocol):
    """What a poll loop needs of a bus, be it a `Bus` or an `AsyncBus`."""

    def now(self) -> float:
        """Return the time of the bus's clock, in seconds; also while its line is down. UsageError when closed."""

    def wall_time(self) -> float:
        """Return the time in seconds since 1970; on a virtual line since its start."""

    def sleep_until(self, until: float) -> Any:
        """Wait outside the line's turn, also while it is down."""


class PolledDrive(Protocol):
    """What a poll loop needs of a drive, be it a `Drive` or an `AsyncDrive`."""

    @property
    def name(self) -> str:
        """The drive as the command line names it."""

    @property
    def bus(self) -> PolledBus:
        """The bus that it is on."""

    def check_read(self, parameter: str, **options: Any) -> None:
        """Raise UsageError for a parameter that can never be read."""

    def polled(self, parameter: str, **options: Any) -> Any:
        """Read a parameter, letting everything else on the bus go first."""


D = TypeVar("D", bound=PolledDrive)


class Polling(Generic[D]):
    """The poll loop of one line without its waiting and reading: what comes next, and what came of it."""

    def __init__(self, items: Sequence[PollItem[D]], duration_s: float, cycles: int | None) -> None:
        self.bus = items[0].drive.bus
        self._start_s = self.bus.now()
        self._duration_s = duration_s
        self._schedule = Schedule(items, start_s=self._start_s, cycles=cycles)
        self._backoff = Backoff(REOPEN_FIRST_S, REOPEN_FIRST_S)
        self._down: LinkError | None = None

    def next(self, now: float) -> PollItem[D] | PollResult | float | None:
        """Return the item to read, or the time until which none is due; None when the plan is over.

        now: on the bus's clock. While the line is down, an item is not worth trying and its result is returned instead.
        """
        if now - self._start_s >= self._duration_s:
            return None
        item = self._schedule.due(now)
        if item is None:
            due_s = self._schedule.next_due()
            return None if due_s == math.inf or due_s - self._start_s >= self._duration_s else due_s
        if self._down is not None and now < self._backoff.over_at:
            return self._schedule.finished(item, now, self._down, time_s=self.bus.wall_time())
        return item

    def finished(self, item: PollItem[D], outcome: Reading | DriveCommError, now: float) -> PollResult:
        """Return the result of an item that was read."""
        if not isinstance(outcome, DriveCommError):
            return self._schedule.finished(item, now, outcome, time_s=outcome.time_s)
        if isinstance(outcome, LinkError):
            self._down = outcome
            self._backoff.failed(now)
        return self._schedule.finished(item, now, outcome, time_s=self.bus.wall_time())


def _never() -> bool:
    return False


def poll_bus(
    items: Sequence[PollItem[D]], duration_s: float, cycles: int | None = None, stopped: Callable[[], bool] = _never
) -> Generator[PollResult, None, None]:
    """Yield the results of items that are all on one bus; what can never be read is a failure each time."""
    polling = Polling(items, duration_s, cycles)
    bus = polling.bus
    while not stopped() and (due := polling.next(bus.now())) is not None:
        if isinstance(due, PollItem):
            outcome: Reading | DriveCommError
            try:
                outcome = due.drive.polled(due.parameter, **due.options)
            except DriveCommError as error:
                outcome = error
            yield polling.finished(due, outcome, bus.now())
        elif isinstance(due, PollResult):
            yield due
        else:
            bus.sleep_until(min(due, bus.now() + NAP_S))
