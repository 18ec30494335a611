"""Poll plan of one line: the next item to read, and its result. The caller does the waiting."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar, runtime_checkable

from drivecomm.errors import DriveCommError, HeldBackError, LinkError
from drivecomm.line.poll_items import STATUS, PollBlock, PollItem, PollResult
from drivecomm.line.schedule import Schedule
from drivecomm.link import REOPEN_FIRST_S, Backoff

if TYPE_CHECKING:
    from collections.abc import Sequence


class PolledBus(Protocol):
    """Interface of a bus that a poll loop needs: a `Bus` or an `AsyncBus`."""

    def now(self) -> float:
        """Return the time of the bus's clock in seconds, even while its line is down. Raises UsageError when closed."""

    def wall_time(self) -> float:
        """Return the time in seconds since 1970; on a virtual line since its start."""

    def sleep_until(self, until: float) -> Any:
        """Wait without a turn on the line, even while it is down."""


class PolledDrive(Protocol):
    """Interface of a drive that a poll loop needs: a `Drive` or an `AsyncDrive`."""

    @property
    def name(self) -> str:
        """The drive as the command line names it."""

    @property
    def bus(self) -> PolledBus:
        """The bus of this drive."""

    def check_read(self, parameter: str, **options: Any) -> None:
        """Raise UsageError for a parameter that can never be read."""

    def polled(self, parameter: str, **options: Any) -> Any:
        """Read a parameter with the rank of a poll: stops, commands and reads on the bus go first."""


@runtime_checkable
class BlockDrive(Protocol):
    """Interface of a drive several of whose parameters can be read by one telegram."""

    def blocks(self, parameters: Sequence[str]) -> Sequence[Sequence[int]]:
        """Return groups of parameters that one telegram can read, as indexes of the list."""

    def polled_many(self, parameters: Sequence[str]) -> Any:
        """Read the parameters of one of the `blocks` with the rank of a poll."""


D = TypeVar("D", bound=PolledDrive)


def in_blocks(items: Sequence[PollItem[D]]) -> list[PollItem[D] | PollBlock[D]]:
    """Combine items that one telegram can read: of one drive, with the same period and priority, without options.

    The status is read alone, because it is not a parameter.
    """
    alike: dict[object, list[int]] = {}
    for place, item in enumerate(items):
        is_alone = item.options or item.parameter == STATUS
        what = place if is_alone else (id(item.drive), item.period_s, item.priority)
        alike.setdefault(what, []).append(place)
    turns: dict[int, PollItem[D] | PollBlock[D]] = {}
    for places in alike.values():
        drive = items[places[0]].drive
        blocks: Sequence[Sequence[int]] = [[number] for number in range(len(places))]
        if len(places) > 1 and isinstance(drive, BlockDrive):
            blocks = drive.blocks([items[place].parameter for place in places])
        for block in blocks:
            own = tuple(items[places[number]] for number in sorted(block))
            turns[places[min(block)]] = PollBlock(own) if len(own) > 1 else own[0]
    return [turns[place] for place in sorted(turns)]


class Polling(Generic[D]):
    """Poll plan of one line: the next item to read, and its result."""

    def __init__(self, items: Sequence[PollItem[D]], duration_s: float, cycles: int | None) -> None:
        self.bus = items[0].drive.bus
        self._start_s = self.bus.now()
        self._duration_s = duration_s
        self._schedule = Schedule(in_blocks(items), start_s=self._start_s, cycles=cycles)
        self.succeeded = self._schedule.succeeded
        """Records the value of an item and returns the result."""
        self._backoff = Backoff(REOPEN_FIRST_S, REOPEN_FIRST_S)
        self._down: LinkError | None = None

    def next(self, now: float) -> PollItem[D] | PollBlock[D] | list[PollResult] | float | None:
        """Return the next item to read, or the time until which none is due; None when the plan is over.

        now: on the bus's clock. While the line is down, nothing is read, and a list of failed results is returned
        instead.
        """
        if now - self._start_s >= self._duration_s:
            return None
        item = self._schedule.due(now)
        if item is None:
            due_s = self._schedule.next_due()
            return None if due_s == math.inf or due_s - self._start_s >= self._duration_s else due_s
        if self._down is not None and now < self._backoff.over_at:
            time_s = self.bus.wall_time()
            if isinstance(item, PollBlock):
                return self._schedule.block_finished(item, now, self._down, time_s=time_s)
            return [self._schedule.finished(item, now, self._down, time_s=time_s)]
        return item

    def ask(self, due: PollItem[D] | PollBlock[D]) -> Any:
        """Read an item and return its outcome, an awaitable for an asynchronous drive."""
        if isinstance(due, PollBlock):
            return due.drive.polled_many(due.parameters)
        return due.drive.polled(due.parameter, **due.options)

    def finished(self, due: PollItem[D] | PollBlock[D], outcome: Any, now: float) -> list[PollResult]:
        """Return the results of a read; an empty list if it is repeated later, or in parts.

        outcome: the `Reading` of an item, the sequence of readings of a block, or the DriveCommError of either.
        """
        if isinstance(outcome, HeldBackError):
            self._schedule.put_off(due, outcome.until)
            return []
        if isinstance(outcome, LinkError):
            self._down = outcome
            self._backoff.failed(now)
        if isinstance(due, PollBlock):
            return self._schedule.block_finished(due, now, outcome, time_s=self.bus.wall_time())
        if isinstance(outcome, DriveCommError):
            return [self._schedule.finished(due, now, outcome, time_s=self.bus.wall_time())]
        return [self.succeeded(due, now, outcome)]
