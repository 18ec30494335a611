"""Whose turn it is in a poll plan. No I/O, no clock.

A `Schedule` is a queue by due time for the items of one line. Whoever carries it out tells it the time:

    while (item := schedule.due(now)) is not None:
        ...read it...
        result = schedule.finished(item, now, reading, time_s=wall_time)

What is due may be a block of items that one telegram reads; it goes back by `block_finished`.
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

# A NamedTuple's own constructor is a function of Python's.
_new = tuple.__new__

PRIORITY_STEP_S = 1.0
"""What one step of priority is worth: an overdue item goes before those that have waited this much longer."""

FIRST_ROUND_S = 1.0
"""The first round is spread over one period, at most over this time."""

REST_S = 0.1
"""An item without a period that failed is not asked again before this time has passed."""


@dataclass(slots=True, eq=False)
class _Entry(Generic[D]):
    """An item, or a block, in the queue. Its periods begin at anchor_s and are numbered from there; turn is its own.

    drive: as results call it. members: of a block, which remember what each of its items gave.
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
        """Among the overdue the least goes first: what was due first, moved ahead by its priority."""
        patience = 0.0 if self.item.period_s else UNHURRIED_S
        return self.due_s - self.item.priority * PRIORITY_STEP_S + patience


class Schedule(Generic[D]):
    """Whose turn it is on one line.

    What is due first goes first; among the overdue, priority moves an item ahead by a second a step. An item whose
    period is over before it was asked is not asked twice to catch up: that period is missed, and counted. Items with
    the same period are spread over it. start_s: now. cycles: how many results each item has before it is done.
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
        # By the items' identities: their hash goes through all that they hold.
        self._entries: dict[int, _Entry[D]] = {}
        place = 0
        for item in plan:
            share = before[item.period_s] / together[item.period_s]
            before[item.period_s] += 1
            # A long period does not keep its reader waiting for a first value.
            first = start_s + share * min(item.period_s, FIRST_ROUND_S)
            anchor = start_s + share * item.period_s
            entry = self._entries[id(item)] = _entry(item, place, anchor, first)
            place += len(entry.members) or 1
        self._waiting = [(entry.due_s, entry.place, entry) for entry in self._entries.values()]
        heapq.heapify(self._waiting)
        self._overdue: list[tuple[float, int, _Entry[D]]] = []

    def next_due(self) -> float:
        """Return when the item that goes next is due, in the past if it is overdue, infinity when all are done."""
        if self._overdue:
            return self._overdue[0][-1].due_s
        return self._waiting[0][0] if self._waiting else math.inf

    def due(self, now: float) -> PollItem[D] | PollBlock[D] | None:
        """Return what to ask now, None when nothing is due. It is out of the queue until it is `finished`."""
        waiting, overdue = self._waiting, self._overdue
        if waiting and waiting[0][0] <= now:
            _, place, entry = heapq.heappop(waiting)
            if not overdue and not (waiting and waiting[0][0] <= now):
                # Nothing else is due, as mostly.
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
        """Take what came of an item, put it back into the queue, and return the result.

        item: the very object that `due` gave. time_s: for people, when it failed; a reading has its own time.
        """
        if isinstance(outcome, DriveCommError):
            entry = self._entries[id(item)]
            result = _failure(entry, now, outcome, time_s)
            self._put_back(entry, now, REST_S)
            return result
        return self.succeeded(item, now, outcome)

    def succeeded(self, item: PollItem[D], now: float, reading: Reading) -> PollResult:
        """Take the value of an item, as `finished` does."""
        entry = self._entries[id(item)]
        result = _value(entry, now, reading)
        entry.good, entry.good_s = reading, now
        self._put_back(entry, now, 0.0)
        return result

    def block_finished(
        self, block: PollBlock[D], now: float, outcome: Sequence[Reading] | DriveCommError, *, time_s: float
    ) -> list[PollResult]:
        """Take what came of a block, put it back into the queue, and return the results of its items.

        A drive that refuses a block does not say which item it means: there are no results then, but the block is two
        from now on, which are due at once. What the drive refuses ends up alone, and spoils no other.
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
        """Queue what could not be asked yet once more, so that the items of other drives go first until then."""
        entry = self._entries[id(item)]
        heapq.heappush(self._waiting, (until, entry.place, entry))

    def _put_back(self, entry: _Entry[D], now: float, rest_s: float) -> None:
        """Queue an item by its next period that has not begun yet; those in between are missed."""
        entry.results += 1
        if self._cycles is not None and entry.results >= self._cycles:
            return
        period_s = entry.item.period_s
        if period_s:
            # What ends in the very moment in which its next period begins has missed nothing.
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
        """Queue some items of a block for themselves, in the same turn."""
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
