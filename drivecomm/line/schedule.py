"""Order of the items in a poll plan. No I/O, no clock.

A `Schedule` is a queue by due time for the items of one line. The caller provides the time:

    while (item := schedule.due(now)) is not None:
        ...read it...
        result = schedule.finished(item, now, reading, time_s=wall_time)

A due item may be a block of items that one telegram reads; it is returned by `block_finished`.
"""

from __future__ import annotations

import heapq
import math
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic

from drivecomm.errors import DriveCommError, RefusedError, in_one_line
from drivecomm.line.poll_items import UNHURRIED_S, D, PollBlock, PollItem, PollResult, checked

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from drivecomm.protocol import Reading

# The constructor of a NamedTuple is a Python function, and slower.
_new = tuple.__new__

PRIORITY_STEP_S = 1.0
"""Value of one step of priority in seconds: an overdue item precedes those that have waited this much longer."""

FIRST_ROUND_S = 1.0
"""Maximum time in seconds over which the first round is spread; one period if that is shorter."""

REST_S = 0.1
"""Pause in seconds before an item without a period is read again after a failure."""


@dataclass(slots=True, eq=False)
class _Entry(Generic[D]):
    """An item, or a block, in the queue.

    anchor_s: time from which its periods are numbered. turn: number of its present period. drive: its name in results.
    members: entries of a block's items, each with its last good value.
    """

    item: PollItem[D] | PollBlock[D]
    drive: str
    place: int
    anchor_s: float
    due_s: float
    turn: int = 0
    missed: int = 0
    asked_s: float = 0.0
    results: int = 0
    good: Reading | None = None
    good_s: float = 0.0
    members: tuple[_Entry[D], ...] = ()

    @property
    def urgency(self) -> float:
        """Sort key of overdue items, smallest first: the due time, moved ahead by the priority."""
        patience = 0.0 if self.item.period_s else UNHURRIED_S
        return self.due_s - self.item.priority * PRIORITY_STEP_S + patience


class Schedule(Generic[D]):
    """Schedule of one line.

    The item that is due first goes first; among overdue items, priority moves an item ahead by one second a step. An
    item that was not read before its period ended is not read twice to catch up: the period is missed, and counted.
    Items with the same period are spread over it. start_s: the present time. cycles: number of results after which an
    item is done.
    """

    def __init__(
        self, items: Iterable[PollItem[D] | PollBlock[D]], *, start_s: float, cycles: int | None = None
    ) -> None:
        plan = list(items)
        checked(
            [one for each in plan for one in (each.items if isinstance(each, PollBlock) else (each,))], cycles=cycles
        )
        self._cycles = cycles
        together = Counter(item.period_s for item in plan)
        before: Counter[float] = Counter()
        # By identity, because hashing an item goes through all its contents.
        self._entries: dict[int, _Entry[D]] = {}
        place = 0
        for item in plan:
            share = before[item.period_s] / together[item.period_s]
            before[item.period_s] += 1
            # The first value of an item with a long period must not take a whole period.
            first = start_s + share * min(item.period_s, FIRST_ROUND_S)
            anchor = start_s + share * item.period_s
            entry = self._entries[id(item)] = _entry(item, place, anchor, first)
            place += len(entry.members) or 1
        self._waiting = [(entry.due_s, entry.place, entry) for entry in self._entries.values()]
        heapq.heapify(self._waiting)
        self._overdue: list[tuple[float, int, _Entry[D]]] = []

    def next_due(self) -> float:
        """Return the due time of the next item: in the past if it is overdue, infinity when all are done."""
        if self._overdue:
            return self._overdue[0][-1].due_s
        return self._waiting[0][0] if self._waiting else math.inf

    def due(self, now: float) -> PollItem[D] | PollBlock[D] | None:
        """Return the item to read now; None if none is due. It is out of the queue until it is `finished`."""
        waiting, overdue = self._waiting, self._overdue
        if waiting and waiting[0][0] <= now:
            _, place, entry = heapq.heappop(waiting)
            if not overdue and not (waiting and waiting[0][0] <= now):
                # The usual case: no other item is due.
                entry.asked_s = now
                return entry.item
            heapq.heappush(overdue, (entry.urgency, place, entry))
            while waiting and waiting[0][0] <= now:
                _, place, entry = heapq.heappop(waiting)
                heapq.heappush(overdue, (entry.urgency, place, entry))
        if not overdue:
            return None
        _, _, entry = heapq.heappop(overdue)
        entry.asked_s = now
        return entry.item

    def finished(
        self, item: PollItem[D], now: float, outcome: Reading | DriveCommError, *, time_s: float
    ) -> PollResult:
        """Record the outcome of an item, put it back into the queue, and return the result.

        item: the very object that `due` returned. time_s: time for people, used for a failure; a reading has its own
        time.
        """
        if isinstance(outcome, DriveCommError):
            entry = self._entries[id(item)]
            result = _failure(entry, now, outcome, time_s)
            self._put_back(entry, now, REST_S)
            return result
        return self.succeeded(item, now, outcome)

    def succeeded(self, item: PollItem[D], now: float, reading: Reading) -> PollResult:
        """Record the value of an item, as `finished` does."""
        entry = self._entries[id(item)]
        result = _value(entry, now, reading)
        entry.good, entry.good_s = reading, now
        self._put_back(entry, now, 0.0)
        return result

    def block_finished(
        self, block: PollBlock[D], now: float, outcome: Sequence[Reading] | DriveCommError, *, time_s: float
    ) -> list[PollResult]:
        """Record the outcome of a block, put it back into the queue, and return the results of its items.

        A drive that refuses a block does not show which item it refuses. No results are returned then; the block is
        split into two, which are due immediately. So a refused item ends up alone, and does not affect the others.
        """
        entry = self._entries[id(block)]
        if isinstance(outcome, RefusedError):
            half = len(entry.members) // 2
            self._split_off(entry, entry.members[:half])
            self._split_off(entry, entry.members[half:])
            return []
        results = []
        for number, member in enumerate(entry.members):
            member.due_s, member.asked_s, member.missed = entry.due_s, entry.asked_s, entry.missed
            if isinstance(outcome, DriveCommError):
                results.append(_failure(member, now, outcome, time_s))
            else:
                results.append(_value(member, now, outcome[number]))
                member.good, member.good_s = outcome[number], now
        self._put_back(entry, now, REST_S if isinstance(outcome, DriveCommError) else 0.0)
        return results

    def put_off(self, item: PollItem[D] | PollBlock[D], until: float) -> None:
        """Queue an item again that could not be read yet; items of other drives go first until then."""
        entry = self._entries[id(item)]
        heapq.heappush(self._waiting, (until, entry.place, entry))

    def _put_back(self, entry: _Entry[D], now: float, rest_s: float) -> None:
        """Queue an item for its next period that has not begun yet; the periods in between are missed."""
        entry.results += 1
        if self._cycles is not None and entry.results >= self._cycles:
            return
        period_s = entry.item.period_s
        if period_s:
            # A read that ends exactly when its next period begins has missed nothing.
            not_begun = math.ceil((now - entry.anchor_s) / period_s - 1e-9)
            following = max(entry.turn + 1, not_begun)
            entry.missed = following - entry.turn - 1
            entry.turn = following
            due_s = entry.anchor_s + following * period_s
        else:
            due_s = now + rest_s
        entry.due_s = due_s
        heapq.heappush(self._waiting, (due_s, entry.place, entry))

    def _split_off(self, whole: _Entry[D], members: tuple[_Entry[D], ...]) -> None:
        """Queue some items of a block as an entry of their own, in the same turn."""
        first = members[0]
        part = first
        if len(members) > 1:
            items = tuple(each.item for each in members if isinstance(each.item, PollItem))
            part = _Entry(PollBlock(items), first.drive, first.place, whole.anchor_s, whole.due_s, members=members)
        part.anchor_s, part.due_s, part.turn = whole.anchor_s, whole.due_s, whole.turn
        part.missed, part.results = whole.missed, whole.results
        self._entries[id(part.item)] = part
        heapq.heappush(self._waiting, (part.due_s, part.place, part))


def _entry(item: PollItem[D] | PollBlock[D], place: int, anchor_s: float, due_s: float) -> _Entry[D]:
    members = item.items if isinstance(item, PollBlock) else ()
    own = tuple(_Entry(each, _called(each), place + number, anchor_s, due_s) for number, each in enumerate(members))
    return _Entry(item, _called(item), place, anchor_s, due_s, members=own)


def _called(item: PollItem[D] | PollBlock[D]) -> str:
    first = item.items[0] if isinstance(item, PollBlock) else item
    return first.name or first.drive.name


def _value(entry: _Entry[D], now: float, reading: Reading) -> PollResult:
    item: Any = entry.item
    due_s, asked_s = entry.due_s, entry.asked_s
    late_s, took_s, time_s = asked_s - due_s, now - asked_s, reading.time_s
    said = item, entry.drive, item.parameter, reading, "", None, time_s, due_s, late_s, took_s, entry.missed
    return _new(PollResult, said)


def _failure(entry: _Entry[D], now: float, error: DriveCommError, time_s: float) -> PollResult:
    item: Any = entry.item
    good = entry.good if entry.good is not None and now - entry.good_s <= item.keeps_s else None
    return PollResult(
        item=item,
        drive=entry.drive,
        parameter=item.parameter,
        reading=good,
        cause=in_one_line(error),
        error=error,
        time_s=time_s,
        due_s=entry.due_s,
        late_s=entry.asked_s - entry.due_s,
        took_s=now - entry.asked_s,
        missed=entry.missed,
    )
