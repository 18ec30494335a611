"""Whether a drive answers, and when one that does not is asked again. No I/O, no clock.

A drive that answered before is given up after three calls without an answer and two seconds; one that was never heard
after one call and one second. It is then asked again with a growing pause, and never for long: all drives of a line
that do not answer share a small part of its time, so that they cannot spoil it for the others. Where that part is too
small for all of them, the pause grows beyond its usual limit.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.errors import counted

if TYPE_CHECKING:
    from collections.abc import Iterable

FAILED_CALLS = 3
SILENT_S = 2.0
NEVER_HEARD_FAILED_CALLS = 1
NEVER_HEARD_SILENT_S = 1.0
FIRST_PAUSE_S = 0.5
LONGEST_PAUSE_S = 9.0
"""A drive that comes back is in use again within ten seconds, its probe included."""
PROBING_SHARE = 0.0475
"""The part of a line's time that may go into asking drives that do not answer."""
PROBE_S = 0.02
"""What a probe takes, until one has been made."""
DEFAULT_EAR_S = 0.012
LONGEST_EAR_S = 0.030
"""What is listened for a reply at least, and at most where the probes' share of the time is no longer."""


class Health:
    """Whether one drive answers.

    given_up: it does not, and is only probed. away: it was given up, or the port was lost, and what it had been
    commanded or told before may no longer hold.
    """

    def __init__(self) -> None:
        self.given_up = False
        self.away = False
        self.failed_calls = 0
        self.patient = False
        """The next probe waits for the whole reply time, because something was heard after the last one."""
        self._heard = False
        self._silent_since = 0.0
        self._pause = Backoff(FIRST_PAUSE_S, LONGEST_PAUSE_S)

    def __repr__(self) -> str:
        if self.given_up:
            return f"<{type(self).__name__}: does not answer, probed now and then>"
        if self.failed_calls:
            return f"<{type(self).__name__}: no answer to the last {counted(self.failed_calls, 'call')}>"
        return f"<{type(self).__name__}: answers>"

    @property
    def silent_since(self) -> float:
        """Since when it has been asked in vain."""
        return self._silent_since

    @property
    def probe_at(self) -> float:
        """When it may be asked again."""
        return self._pause.over_at

    def answered(self) -> None:
        """Take note of a good reply."""
        self._heard = True
        self.failed_calls = 0
        if self.given_up:
            self.given_up = False
            self.patient = False
            self._pause.succeeded()

    def fell_silent(self, began: float, now: float, least_pause_s: float = 0.0) -> bool:
        """Take note of a call, begun at some time, that ended now without an answer.

        least_pause_s: how long it may not be asked again at least. Returns whether this is when the drive is given up.
        """
        self.failed_calls += 1
        if self.failed_calls == 1:
            self._silent_since = began
        calls, seconds = (FAILED_CALLS, SILENT_S) if self._heard else (NEVER_HEARD_FAILED_CALLS, NEVER_HEARD_SILENT_S)
        enough = self.failed_calls >= calls and now - self._silent_since >= seconds
        if not (self.given_up or enough):
            return False
        first = not self.given_up
        self.given_up = self.away = True
        self._pause.failed(now, least_pause_s)
        return first

    def heard_late(self) -> None:
        """Take note that something came after a probe had been ended: ask again at once, and wait longer."""
        self.patient = True
        self._pause.over_at = float("-inf")


class ProbingTime:
    """How the drives that do not answer share the line's time. number: how many there are."""

    def __init__(self, drives: Iterable[Health]) -> None:
        self.number = max(1, sum(health.given_up for health in drives))

    @property
    def each_s(self) -> float:
        """How long one probe may take, its request included."""
        return LONGEST_PAUSE_S * PROBING_SHARE / self.number

    def least_pause_s(self, took_s: float) -> float:
        """Return the pause that a drive must make after a probe that took so long."""
        return self.number * took_s / PROBING_SHARE


class UsualDelays:
    """How long the drives of each protocol that answer on this line take to begin their replies."""

    def __init__(self) -> None:
        self._delays: dict[str, float] = {}

    def answered(self, protocol: str, delay_s: float) -> None:
        """Take note of a reply; slow ones are remembered longer than quick ones."""
        usual = self._delays.get(protocol, delay_s)
        self._delays[protocol] = delay_s if delay_s > usual else 0.95 * usual + 0.05 * delay_s

    def least_ear_s(self, protocol: str) -> float:
        """Return how long a probe must listen at least, to hear a drive that is as quick as its like."""
        usual = self._delays.get(protocol)
        if usual is None:
            return DEFAULT_EAR_S
        return min(1.05 * usual + 0.0003, LONGEST_EAR_S)


TUNING_ERRORS = 3
TUNING_REQUESTS = 100


class TuningWatch:
    """Whether the tuned turnarounds of a line hold: when errors rise with any of its drives, all are given up for good.

    They rise with three failed requests among a hundred to one drive. One counts only if the drive has answered since
    the one before: a drive that is silent altogether needs no longer pause. Who does not hear a request that follows
    too soon need not be the drive whose reply came before it, so the line as a whole is judged.
    """

    def __init__(self) -> None:
        self.given_up = False
        self._used = False
        self._errors: dict[str, deque[tuple[int, int]]] = {}

    def holds(self) -> bool:
        """Return whether a tuned turnaround may be used, and take note that there is one."""
        self._used = True
        return not self.given_up

    def failed(self, drive: str, requests: int, replies: int) -> bool:
        """Take note that a drive did not answer soundly, after so many requests and replies.

        Returns whether this is when the tuned turnarounds are given up.
        """
        errors = self._errors.setdefault(drive, deque(maxlen=TUNING_ERRORS))
        if self.given_up or not self._used or not replies or (errors and errors[-1][1] == replies):
            return False
        errors.append((requests, replies))
        self.given_up = len(errors) == TUNING_ERRORS and requests - errors[0][0] < TUNING_REQUESTS
        return self.given_up


REOPEN_FIRST_S = 0.5
REOPEN_LONGEST_S = 2.0
"""The pauses between attempts to open a port that was lost: the first, and the longest."""


@dataclass(slots=True)
class Backoff:
    """Doubles with each failure, from the first up to the longest; a success sets it back."""

    first_s: float
    longest_s: float
    over_at: float = float("-inf")
    """When the next attempt may be made."""
    _pause_s: float = 0.0

    def failed(self, now: float, least_s: float = 0.0) -> None:
        """Begin the next pause; it lasts at least so long, also where that is longer than the longest."""
        self._pause_s = min(2 * self._pause_s or self.first_s, self.longest_s)
        self.over_at = now + max(self._pause_s, least_s)

    def succeeded(self) -> None:
        """Have no pause any more."""
        self._pause_s = 0.0
        self.over_at = float("-inf")
