"""Judge of a script over a server: what must hold afterwards, given the behaviour of the simulated motors.

A motor may run from the time of its start order until an event ends that: a stop, the commander's absence, or the
server's end. The table bounds how long, in seconds, the motor may keep running after the event:

| event                                                     | bound                          |
|-----------------------------------------------------------|--------------------------------|
| a stop, if the drive can be reached                       | AFTER_STOP_S                   |
| a stop, or an absence, while the drive cannot be reached  | AFTER_SILENCE_S from its return|
| the commander does not renew, and the policy is not hold  | AFTER_ABSENCE_S from the last  |
| nothing reaches a kept drive                              | watchdog + AFTER_WATCHDOG_S    |
| the server is gone, and the policy is not hold            | watchdog + AFTER_WATCHDOG_S    |
| the server was told to end, and the policy is not hold    | AFTER_END_S                    |
| the drive left the plant file, and the policy is not hold | AFTER_END_S                    |

Further rules: no known caller is refused a ramp stop of a drive of the plant. No motor starts without an order that was
not refused and that no stop has followed. No value is published as good that the drive did not have at about that time.
"""

from orders import FOREVER
from server_bench import DRIVES, WATCHDOG_S

AFTER_STOP_S = 3.0
AFTER_SILENCE_S = 15.0
"""Bound in seconds after the return of a drive: a silent drive is probed every nine seconds, a lost port every two."""
AFTER_ABSENCE_S = 3.0
AFTER_WATCHDOG_S = 2.0
AFTER_END_S = 8.0
IN_FLIGHT_S = 1.0
"""A start and a stop within this many seconds may overtake each other."""
LONGEST_ORDER_S = 12.0
"""Seconds in which an unanswered order may still be carried out: ten at most, plus its telegrams."""
LEVEL_S = 1.0
"""Seconds until a demand in the image of a PLC takes effect."""
QUIET = 3
"""Number of seconds without any pending stop before a script is over."""
NEAR_HZ, NEAR_S = 1.5, 1.5


class Judge:
    """Judge of one script. truth: as recorded by `ClockedPlant`. ended: the clock at the end.

    late_s: added to each bound if processes share their machine with others.
    """

    def __init__(self, book, truth, ended, *, late_s=0.0):
        self._book, self._truth, self._ended, self._late_s = book, truth, ended, late_s

    def failures(self):
        for drive in DRIVES:
            yield from self._of(drive)
        yield from self._of_refused_stops()
        yield from self._of_values()

    def owes(self):
        """Return whether a motor runs that has to stop."""
        return any(seen and seen[-1].running and not self._may_stay(drive) for drive, seen in self._truth.items())

    def _may_stay(self, drive):
        starts = (each for each in self._book.starts if each.drive == drive and self._counts(each))
        return any(self._may_until(each)[0] == FOREVER for each in starts)

    def _of(self, drive):
        starts = [each for each in self._book.starts if each.drive == drive and self._counts(each)]
        may = [(each, self._may_until(each)) for each in starts]
        for began, ended in self._runs(drive):
            if not any(self._explains(start, began) for start in starts):
                yield f"{drive} began to run at {began:.2f}, which nobody had ordered, or a stop had forbidden"
            at = began
            while at < ended:
                until = max((end for start, (end, _) in may if start.at - 0.1 <= at < end), default=at)
                if until <= at:
                    near = [(start, end, why) for start, (end, why) in may if start.at <= at]
                    start, end, why = max(near, key=lambda each: each[1], default=(None, began, "no start"))
                    said = "" if start is None else f", started over {start.door} at {start.at:.2f}"
                    yield f"{drive} runs until {ended:.2f}{said}; it had to stand by {end:.2f}: {why}"
                    break
                at = until

    def _counts(self, start):
        return start.outcome != "refused"

    def _runs(self, drive):
        began = None
        for seen in self._truth[drive]:
            if seen.running and began is None:
                began = seen.at
            elif not seen.running and began is not None:
                yield began, seen.at
                began = None
        if began is not None:
            yield began, self._ended

    def _explains(self, start, at):
        if not start.at - 0.1 <= at <= min(start.answered, start.at + LONGEST_ORDER_S) + IN_FLIGHT_S:
            return False
        for stop in self._stops(start.drive):
            if start.at < stop.at < at - IN_FLIGHT_S and stop.answered <= at:
                return False
            if stop.at + LEVEL_S < start.at < stop.stands_until - LEVEL_S:
                return False
        return True

    def _stops(self, drive):
        return [
            each
            for each in self._book.stops
            if each.drive in ("", drive) and each.outcome not in ("refused", "failed") and each.answered < FOREVER
        ]

    def _may_until(self, start):
        """Return the time until which a motor may run because of this order, and the reason for this end."""
        drive, policy = start.drive, DRIVES[start.drive][3]
        kept = policy != "hold" and not start.local
        ends = [(FOREVER, "")]
        for stop in self._stops(drive):
            if stop.at >= start.at or stop.stands_until > start.at + LEVEL_S:
                at = max(stop.at, start.at)
                if not self._forgotten(at, drive):
                    ends.append((self._reached(drive, at, AFTER_STOP_S), f"stopped over {stop.door} at {stop.at:.2f}"))
        if kept:
            ends += self._ends_of_keeping(start, drive)
        at, why = min(ends)
        return at + self._late_s, why

    def _ends_of_keeping(self, start, drive):
        if start.present_until < FOREVER:
            at = max(start.present_until, start.at)
            yield self._reached(drive, at, AFTER_ABSENCE_S), f"its commander was gone at {at:.2f}"
        for trouble in self._troubles(drive):
            if trouble.dead and trouble.until > start.at:
                at = max(trouble.at, start.at)
                if trouble.until - at > WATCHDOG_S + AFTER_WATCHDOG_S:
                    yield at + WATCHDOG_S + AFTER_WATCHDOG_S, f"nothing reached it from {trouble.at:.2f}"
        for died, how, _ in self._book.deaths:
            if died > start.at:
                bound = (
                    WATCHDOG_S + AFTER_WATCHDOG_S if how == "killed" else self._reached(drive, died, AFTER_END_S) - died
                )
                yield died + bound, f"the server was {how} at {died:.2f}"
        for each in self._book.removals:
            if each.drive == drive and each.at > start.at:
                yield self._reached(drive, each.at, AFTER_END_S), f"left the plant file at {each.at:.2f}"

    def _forgotten(self, at, drive):
        """Whether the server that had to send a stop died before it could, or did not know the drive."""
        until = self._reached(drive, at, AFTER_STOP_S)
        return any(died <= until and at - 0.1 <= back for died, _, back in self._book.deaths) or any(
            each.drive == drive and each.at <= until and at - 0.1 <= each.back + LEVEL_S for each in self._book.removals
        )

    def _troubles(self, drive):
        line = DRIVES[drive][0]
        found = (each for each in self._book.troubles if each.line == line or each.drive == drive)
        return sorted(found, key=lambda each: each.at)

    def _reached(self, drive, at, bound):
        """Return the latest time of an event that requires the drive to be reachable."""
        changed = True
        while changed:
            changed = False
            for trouble in self._troubles(drive):
                if trouble.at < at + bound and trouble.until > at:
                    at, bound, changed = trouble.until, max(bound, AFTER_SILENCE_S), True
        return at + bound

    def _of_refused_stops(self):
        for stop in self._book.stops:
            moved = any(
                each.drive == stop.drive and each.at - 1 <= stop.at <= each.back + LEVEL_S
                for each in self._book.removals
            )
            if stop.outcome == "refused" and stop.how == "ramp" and not moved:
                yield f"a stop of {stop.drive} over {stop.door} at {stop.at:.2f} was refused"

    def _of_values(self):
        for at, drive, value, age_s in self._book.said:
            taken = at - age_s
            known = [each for each in self._truth[drive] if each.at <= taken + NEAR_S]
            before = [each for each in known if each.at < taken - NEAR_S][-1:]
            near = [each.output_hz for each in before + known if each.at >= taken - NEAR_S or each in before]
            if not min(near) - NEAR_HZ <= value <= max(near) + NEAR_HZ:
                was = f"{min(near):g} to {max(near):g}"
                yield f"{drive} was said to be at {value:g} Hz at {taken:.2f}, and was at {was}"
