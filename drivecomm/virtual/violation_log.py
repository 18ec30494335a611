"""Violations by the master of one virtual line, recorded from now on."""

from __future__ import annotations

from collections import Counter, deque
from threading import Lock
from typing import TYPE_CHECKING

from drivecomm.virtual.timing_watch import TimingWatch

if TYPE_CHECKING:
    from collections.abc import Iterable

    from drivecomm.virtual.line import VirtualLine
    from drivecomm.virtual.line_rules import LineRules, Violation
    from drivecomm.virtual.medium import Transmission

MOST_KEPT = 1000


class ViolationLog:
    """The last 1000 violations on one line, and counts of all of them. May be read from another thread.

    tolerance_s: largest delay of the line's times, such as `SERVED_TOLERANCE_S` for a line that is served.
    """

    def __init__(self, line: VirtualLine, drives: Iterable[LineRules], *, tolerance_s: float = 0.0) -> None:
        self._watch = TimingWatch(drives, tolerance_s=tolerance_s)
        self._found: deque[Violation] = deque(maxlen=MOST_KEPT)
        self._guard = Lock()
        self._failures: Counter[str] = Counter()
        self._notes: Counter[str] = Counter()
        line.on_transmit.append(self._take)
        line.recorders.append(self._hear)

    @property
    def found(self) -> tuple[Violation, ...]:
        """The last 1000 violations, in order."""
        with self._guard:
            return tuple(self._found)

    @property
    def failures(self) -> dict[str, int]:
        """Number of violations of each rule whose value a source demands, by name of the rule."""
        with self._guard:
            return dict(self._failures)

    @property
    def notes(self) -> dict[str, int]:
        """Number of violations of each rule whose value is a default of drivecomm, by name of the rule."""
        with self._guard:
            return dict(self._notes)

    def forget(self, drive: str) -> None:
        """Remove the violations of a drive found so far; the counts stay."""
        with self._guard:
            kept = [each for each in self._found if each.drive != drive]
            self._found.clear()
            self._found.extend(kept)

    def _hear(self, sent: Transmission) -> None:
        # Requests are judged when the master hands them over, not when they arrive.
        if sent.source != "master":
            self._take(sent)

    def _take(self, sent: Transmission) -> None:
        for each in self._watch.take(sent):
            with self._guard:
                self._found.append(each)
                (self._failures if each.demanded else self._notes)[each.rule] += 1
