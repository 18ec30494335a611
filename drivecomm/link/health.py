"""Health of drives: which of them answer, and when to try a silent one again. No I/O, no clock.

A drive that answered before is given up after three calls and two seconds without a reply; a drive that never answered,
after one call and one second. It is then probed with growing pauses, and only briefly: all silent drives of a line
share a small part of its time, so that they do not delay the others. If that part is too small for all of them, the
pauses grow beyond their usual limit.
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
"""Longest usual pause between probes in seconds: a returning drive is in use within ten seconds, probe included."""
PROBING_SHARE = 0.0475
"""Share of a line's time that probes of silent drives may take."""
PROBE_S = 0.02
"""Assumed duration of a probe in seconds, until one was measured."""
DEFAULT_EAR_S = 0.012
LONGEST_EAR_S = 0.030
"""Minimum time in seconds that a probe listens: the default, and the upper limit of the value learnt from replies."""


class Health:
    """Health of one drive.

    given_up: whether the drive is silent and only probed. away: whether the drive was given up or the port was lost, so
    that its earlier commands and settings may no longer hold.
    """

    def __init__(self) -> None:
        self.given_up = False
        self.away = False
        self.failed_calls = 0
        self.patient = False
        """Whether the next probe waits for the whole reply time, because bytes came after the last probe."""
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
        """Start of the first failed call since the last reply, in seconds on the line's clock."""
        return self._silent_since

    @property
    def probe_at(self) -> float:
        """Earliest time of the next probe, in seconds on the line's clock."""
        return self._pause.over_at

    def answered(self) -> None:
        """Record a good reply."""
        self._heard = True
        self.failed_calls = 0
        if self.given_up:
            self.given_up = False
            self.patient = False
            self._pause.succeeded()

    def fell_silent(self, began: float, now: float, least_pause_s: float = 0.0) -> bool:
        """Record a call that began at `began` and ended now without a reply.

        least_pause_s: minimum pause before the next probe. Returns True if the drive is given up because of this call.
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
        """Record that bytes came after a probe had ended: the next probe is due immediately, and listens longer."""
        self.patient = True
        self._pause.over_at = float("-inf")


class ProbingTime:
    """Probing time that the silent drives of a line share. number: number of these drives, at least 1."""

    def __init__(self, drives: Iterable[Health]) -> None:
        self.number = max(1, sum(health.given_up for health in drives))

    @property
    def each_s(self) -> float:
        """Maximum duration of one probe in seconds, its request included."""
        return LONGEST_PAUSE_S * PROBING_SHARE / self.number

    def least_pause_s(self, took_s: float) -> float:
        """Return the minimum pause of a drive in seconds, after a probe that took `took_s`."""
        return self.number * took_s / PROBING_SHARE


class UsualDelays:
    """Usual delays between a request and the beginning of its reply on one line, by protocol."""

    def __init__(self) -> None:
        self._delays: dict[str, float] = {}

    def answered(self, protocol: str, delay_s: float) -> None:
        """Record the delay of a reply.

        A longer delay becomes the usual one immediately; shorter ones lower it gradually.
        """
        usual = self._delays.get(protocol, delay_s)
        self._delays[protocol] = delay_s if delay_s > usual else 0.95 * usual + 0.05 * delay_s

    def minimum_listen_s(self, protocol: str) -> float:
        """Return the minimum listening time of a probe in seconds, enough for the usual delay of the protocol."""
        usual = self._delays.get(protocol)
        if usual is None:
            return DEFAULT_EAR_S
        return min(1.05 * usual + 0.0003, LONGEST_EAR_S)


TUNING_ERRORS = 3
TUNING_REQUESTS = 100


class TuningWatch:
    """Monitor of the tuned turnarounds of a line; if errors rise on any of its drives, all are given up for good.

    Errors have risen after three failed requests among a hundred to one drive. A failure counts only if the drive has
    answered since the failure before, because a drive that is silent altogether does not need a longer pause. The drive
    that misses a request which follows too soon need not be the drive that replied before it, so the line is judged as
    a whole.
    """

    def __init__(self) -> None:
        self.given_up = False
        self._used = False
        self._errors: dict[str, deque[tuple[int, int]]] = {}

    def holds(self) -> bool:
        """Return whether tuned turnarounds may be used, and record that the line has one."""
        self._used = True
        return not self.given_up

    def failed(self, drive: str, requests: int, replies: int) -> bool:
        """Record that a drive did not answer soundly. Returns True if this ends the tuned turnarounds.

        requests, replies: counts of this drive so far.
        """
        errors = self._errors.setdefault(drive, deque(maxlen=TUNING_ERRORS))
        if self.given_up or not self._used or not replies or (errors and errors[-1][1] == replies):
            return False
        errors.append((requests, replies))
        self.given_up = len(errors) == TUNING_ERRORS and requests - errors[0][0] < TUNING_REQUESTS
        return self.given_up


REOPEN_FIRST_S = 0.5
REOPEN_LONGEST_S = 2.0
"""First and longest pause between attempts to reopen a lost port, in seconds."""


@dataclass(slots=True)
class Backoff:
    """Pause that doubles with each failure, from `first_s` up to `longest_s`; a success resets it."""

    first_s: float
    longest_s: float
    over_at: float = float("-inf")
    """Earliest time of the next attempt."""
    _pause_s: float = 0.0

    def failed(self, now: float, least_s: float = 0.0) -> None:
        """Begin the next pause, which lasts at least `least_s`, even if that exceeds `longest_s`."""
        self._pause_s = min(2 * self._pause_s or self.first_s, self.longest_s)
        self.over_at = now + max(self._pause_s, least_s)

    def succeeded(self) -> None:
        """Reset the pause."""
        self._pause_s = 0.0
        self.over_at = float("-inf")
