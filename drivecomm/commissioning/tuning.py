"""Tuning of the pause after a drive's reply and of the reply timeout, by measurements with the drive itself.

Tuning writes nothing to the drive. It sends only the probe of the protocol, which cannot move a motor. It tries half of
the turnaround, then half of that, and so on, until the drive makes errors or the maker's minimum is reached. An error
ends a trial. The drive must then answer at its usual turnaround before the next trial, so that it never misses two
requests in a row because of a trial. The turnaround found gets a margin and must hold for the requested number of
exchanges. A drive that makes errors at its usual turnaround gets more time for its replies, and then longer and longer
pauses.

Other callers may use the line between exchanges, for example to feed a watchdog.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from math import ceil
from typing import TYPE_CHECKING, Any

from drivecomm.bus import carry_out, carry_out_async, sleep_until
from drivecomm.errors import DriveError, NotSupported, ReplyError, UsageError, in_one_line
from drivecomm.line import Job
from drivecomm.link import CAREFUL_S, ReplyTimes
from drivecomm.protocol import Pause, with_each_command

if TYPE_CHECKING:
    from collections import Counter
    from collections.abc import Callable, Mapping

    from drivecomm.bus import AsyncDrive, Drive, Procedure
    from drivecomm.link import Peer, Statistics
    from drivecomm.protocol import Ask, Codec, Exchange, LineFacts, Message, Tell

EXCHANGES = 300
"""Default number of exchanges for which the result must hold."""

_FEWEST_EXCHANGES = 20
_SHARE_OF_A_TRIAL = 10
_RESOLUTION_S = 0.00005
_RESOLUTION_SHARE = 0.04
_MARGIN_SHARE = 1 / 3
# Four characters at 115200 baud, and far more than the drift between the clocks of drive and master.
_LEAST_MARGIN_S = 0.0004
_REPLY_TIMES = 3
_LEAST_REPLY_MARGIN_S = 0.02
# Longer than the reply time, and than the rest between requests, of any drive in the manuals.
_PATIENCE_S = 3.0
_FIRST_LONGER_PAUSE_S, _LONGEST_PAUSE_S = 0.02, 1.3
_RECOVERY_ATTEMPTS = 3
_USUAL_FAILURES = 6
_TROUBLES = ("timeouts", "damaged", "strays", "noise bytes", "unasked bytes", "drained bytes")


@dataclass(frozen=True, slots=True, kw_only=True)
class TuningTrial:
    """Exchanges with one turnaround. pause_s: the shortest pauses measured, including the master's own delay.

    error: the error that ended the trial early; empty if all exchanges succeeded.
    """

    turnaround_s: float
    pause_s: float
    exchanges: int
    seconds: float
    error: str = ""

    @property
    def per_second(self) -> float:
        """Exchanges per second."""
        return self.exchanges / self.seconds if self.seconds else 0.0

    def rest_s(self, exchanges: int, facts: LineFacts) -> float:
        """Estimate the remaining seconds of a tuning with N exchanges after this first trial."""
        failure_s = facts.timing.reply_timeout_s + facts.timing.late_s
        asked = exchanges + _SHARE_OF_A_TRIAL * _of_a_trial(exchanges)
        return asked * self.seconds / max(1, self.exchanges) + _USUAL_FAILURES * failure_s


@dataclass(frozen=True, slots=True, kw_only=True)
class TuningResult:
    """Tuning result of one drive. before, after: trial at the usual turnaround, and all exchanges at the tuned one.

    `before` may have failed if the drive needs a longer pause or more time for replies.

    held_s: the shortest turnaround that held. least_s: the maker's minimum. tuned_before_s: the tuned turnaround in use
    before, 0 for none. reply_delays: times from the end of a request to the beginning of its reply.
    reply_timeout_before_s, reply_timeout_s: the timeout in use, and one that suffices for these delays.
    """

    drive: str
    before: TuningTrial
    after: TuningTrial
    held_s: float
    least_s: float
    tuned_before_s: float
    reply_delays: ReplyTimes
    reply_timeout_before_s: float
    reply_timeout_s: float

    @property
    def error(self) -> str:
        """Error that occurred at every turnaround, so that there is no result; empty if the result holds."""
        return self.after.error

    @property
    def turnaround_s(self) -> float:
        """Turnaround of the final trial in seconds: the shortest with a margin, or a longer one if needed."""
        return self.after.turnaround_s

    @property
    def gain(self) -> float:
        """Exchange rate after tuning as a multiple of the rate before."""
        return self.after.per_second / self.before.per_second if self.before.per_second else 1.0

    @property
    def options(self) -> Mapping[str, float]:
        """Drive options that change; empty if the result does not hold."""
        if self.error:
            return {}
        longer = {"turnaround_s": self.turnaround_s} if self.turnaround_s > self.before.turnaround_s else {}
        tuned_s = self.turnaround_s if self.turnaround_s < self.before.turnaround_s else 0.0
        tuned = {} if tuned_s == self.tuned_before_s else {"tuned_turnaround_s": tuned_s}
        timeout_s = self.reply_timeout_s
        timeout = {} if timeout_s == self.reply_timeout_before_s else {"reply_timeout_s": timeout_s}
        return {**longer, **tuned, **timeout}


def _ignore(*_: object) -> None:
    """Ignore the arguments; default callback."""


def tune(
    drive: Drive,
    exchanges: int = EXCHANGES,
    *,
    tried: Callable[[TuningTrial], None] = _ignore,
    progress: Callable[[str, int, int], None] = _ignore,
) -> TuningResult:
    """Find the shortest turnaround and the reply timeout with which a drive answers N requests without an error.

    tried: called with each finished trial; the first one is at the usual turnaround. progress: called with the current
    attempt, the number of exchanges done, and their total. Raises ReplyError if the drive stops answering, LinkError if
    the port fails.
    """
    return carry_out(drive, _Tuning(drive, exchanges, tried, progress).run())


async def tune_async(
    drive: AsyncDrive,
    exchanges: int = EXCHANGES,
    *,
    tried: Callable[[TuningTrial], None] = _ignore,
    progress: Callable[[str, int, int], None] = _ignore,
) -> TuningResult:
    """Find turnaround and reply timeout for an asyncio drive; see `tune`."""
    return await carry_out_async(drive, _Tuning(drive, exchanges, tried, progress).run())


class _Tuning:
    """Tuning of one drive."""

    def __init__(
        self,
        drive: Drive | AsyncDrive,
        exchanges: int,
        tried: Callable[[TuningTrial], None],
        progress: Callable[[str, int, int], None],
    ) -> None:
        if type(exchanges) is not int or exchanges < _FEWEST_EXCHANGES:
            raise UsageError(f"{exchanges} exchanges are too few; use {_FEWEST_EXCHANGES} or more")
        if drive.peer.probe is None:
            raise NotSupported(f"{drive.peer.name} cannot be probed; tune one drive")
        self._probe = drive.peer.probe
        self._name = drive.name
        self._tuned_before_s = drive.facts.timing.tuned_turnaround_s
        self._facts = drive.facts.untuned
        self._peer = replace(drive.peer, facts=self._facts)
        self._exchanges = exchanges
        self._tried = tried
        self._progress = progress
        self._delays = ReplyTimes()

    def run(self) -> Procedure[TuningResult]:
        usual_s, timing = self._facts.turnaround_s, self._facts.timing
        yield from self._settle()
        least_s = min(usual_s, self._with(timing.least_turnaround_s).turnaround_s)
        before = yield from self._trial(usual_s, _of_a_trial(self._exchanges))
        after = before
        if before.error:
            after = yield from self._with_more(before)
        held_s = longest_s = after.turnaround_s
        if not after.error:
            held_s = yield from self._shortest(longest_s, least_s if longest_s <= usual_s else usual_s)
            after = yield from self._confirmed(min(longest_s, _with_margin(held_s)), longest_s)
        delay_s, enough_s = self._delays.longest_s, timing.reply_timeout_s
        if self._delays.count:
            enough_s = max(_REPLY_TIMES * delay_s, delay_s + _LEAST_REPLY_MARGIN_S, timing.least_reply_timeout_s)
        return TuningResult(
            drive=self._name,
            before=before,
            after=after,
            held_s=held_s,
            least_s=least_s,
            tuned_before_s=self._tuned_before_s,
            reply_delays=self._delays,
            reply_timeout_before_s=timing.reply_timeout_s,
            reply_timeout_s=ceil(round(enough_s * 1e3, 6)) / 1e3,
        )

    def _with_more(self, before: TuningTrial) -> Procedure[TuningTrial]:
        """Try more time for replies, then longer and longer pauses; return the first trial that held, or `before`."""
        usual = self._facts
        self._use(usual.override({"reply_timeout_s": _patience_s(usual)}))
        trial = yield from self._trial(before.turnaround_s, _of_a_trial(self._exchanges))
        if not trial.error:
            return trial
        self._use(usual)
        pause_s = max(2 * before.turnaround_s, _FIRST_LONGER_PAUSE_S)
        while pause_s <= _LONGEST_PAUSE_S:
            trial = yield from self._trial(pause_s, _of_a_trial(self._exchanges))
            if not trial.error:
                return trial
            pause_s *= 2
        return before

    def _use(self, facts: LineFacts) -> None:
        self._facts, self._peer = facts, replace(self._peer, facts=facts)

    def _settle(self) -> Procedure[None]:
        """Probe once, then wait until the bus stops listening for a second reply, which lengthens the pauses."""
        yield from self._recover(self._facts.turnaround_s)
        # Only network ports need this wait, but the tuning does not know the kind of its port.
        now: float = yield _now
        yield sleep_until(now + CAREFUL_S)

    def _confirmed(self, turnaround_s: float, usual_s: float) -> Procedure[TuningTrial]:
        """Run all exchanges with a turnaround; double it after each failure, up to the usual turnaround."""
        while True:
            trial = yield from self._trial(turnaround_s, self._exchanges)
            if not trial.error or turnaround_s >= usual_s:
                return trial
            turnaround_s = min(usual_s, 2 * turnaround_s)

    def _shortest(self, usual_s: float, least_s: float) -> Procedure[float]:
        """Find the shortest turnaround that holds for a trial, between the usual one and the maker's minimum."""
        held_s, short_s, enough_s = usual_s, least_s, usual_s
        while held_s - short_s > max(_RESOLUTION_S, _RESOLUTION_SHARE * held_s):
            middle_s = (held_s + short_s) / 2
            trial = yield from self._trial(middle_s, _of_a_trial(self._exchanges))
            if trial.error:
                short_s = middle_s
            else:
                held_s, enough_s = middle_s, trial.pause_s
        return enough_s

    def _trial(self, turnaround_s: float, exchanges: int) -> Procedure[TuningTrial]:
        peer = replace(self._peer, facts=self._with(turnaround_s))
        yield from self._recover(turnaround_s)
        statistics: Statistics = yield _statistics(self._name)
        before, error = statistics.counters.copy(), ""
        ended_s: list[float] = []
        pauses_s: list[float] = []
        # The first request still follows the usual turnaround, so it does not count.
        for done in range(exchanges + 1):
            self._progress(f"with a pause of {turnaround_s * 1000:.2f} ms", done, exchanges)
            error, spoken_s = yield from self._exchange(peer, statistics)
            error = error or _trouble(before, statistics.counters)
            if error:
                break
            now: float = yield _now
            pauses_s += [now - ended_s[-1] - spoken_s] if ended_s else []
            ended_s.append(now)
        trial = TuningTrial(
            turnaround_s=turnaround_s,
            # The very shortest pauses may come from a clock that was read late.
            pause_s=max(turnaround_s, sorted(pauses_s)[len(pauses_s) // 10]) if pauses_s else turnaround_s,
            exchanges=len(pauses_s),
            seconds=ended_s[-1] - ended_s[0] if ended_s else 0.0,
            error=error,
        )
        self._tried(trial)
        return trial

    def _exchange(self, peer: Peer, statistics: Statistics) -> Procedure[tuple[str, float]]:
        """Probe once; return the error, empty on success, and the seconds from request to reply."""
        times, settings = statistics.reply_times, self._facts.settings
        count, total_s = times.count, times.total_s
        lengths = _Lengths()
        try:
            yield partial(_ask, peer, self._probe, lengths)
        except ReplyError as failure:
            return in_one_line(failure), 0.0
        except DriveError:
            # A refusal is an answer, too.
            pass
        took_s = times.total_s - total_s
        if lengths.replies and lengths.replies == times.count - count:
            self._delays.add(max(0.0, took_s - settings.wire_s(lengths.received)) / lengths.replies)
        return "", took_s + settings.wire_s(lengths.sent)

    def _recover(self, turnaround_s: float) -> Procedure[None]:
        """Wait until the drive answers again; the last attempt waits as long as any drive needs. Raises ReplyError.

        turnaround_s: minimum pause after the drive's answer; the usual turnaround is used if it is longer.
        """
        usual = replace(self._peer, facts=self._with(max(turnaround_s, self._facts.turnaround_s)))
        patient = self._facts.override(
            {"turnaround_s": _LONGEST_PAUSE_S, "reply_timeout_s": _patience_s(self._facts), "attempts": 1}
        )
        for attempt in range(1, _RECOVERY_ATTEMPTS + 1):
            is_last = attempt == _RECOVERY_ATTEMPTS
            peer = replace(self._peer, facts=patient) if is_last else usual
            try:
                yield partial(_ask, peer, self._probe, _Lengths())
            except ReplyError:
                if is_last:
                    raise
            except DriveError:
                return
            else:
                return

    def _with(self, turnaround_s: float) -> LineFacts:
        return self._facts.override({"turnaround_s": turnaround_s, "attempts": 1})


def _patience_s(facts: LineFacts) -> float:
    return max(_PATIENCE_S, facts.timing.reply_timeout_s)


def _of_a_trial(exchanges: int) -> int:
    return max(_FEWEST_EXCHANGES, exchanges // _SHARE_OF_A_TRIAL)


def _with_margin(seconds: float) -> float:
    return ceil(round((seconds + max(_MARGIN_SHARE * seconds, _LEAST_MARGIN_S)) * 1e5, 6)) / 1e5


def _trouble(before: Counter[str], after: Counter[str]) -> str:
    """Return the line faults counted between two readings of the counters, as text; empty if there were none."""
    more = {name: after[name] - before[name] for name in _TROUBLES if after[name] > before[name]}
    return ", ".join(f"{name}: {number}" for name, number in more.items())


def _now(drive: Any) -> Any:
    return drive.bus.now()


def _statistics(name: str) -> Callable[[Any], Statistics]:
    return lambda drive: drive.bus.statistics[name]


@dataclass(slots=True)
class _Lengths:
    """Characters sent and received in an exchange, and its number of replies."""

    sent: int = 0
    received: int = 0
    replies: int = 0


def _ask(peer: Peer, probe: Callable[[], Exchange[None]], lengths: _Lengths, drive: Any) -> Any:
    """Probe a drive even if it is given up."""
    return drive.bus.run(Job(peer, _measured(probe(), peer.codec, lengths), insists=True))


def _measured(exchange: Exchange[None], codec: Codec, lengths: _Lengths) -> Exchange[None]:
    """Run an exchange and record the lengths of its telegrams."""

    def sent(command: Ask | Tell | Pause) -> Ask | Tell | Pause:
        lengths.sent += 0 if isinstance(command, Pause) else len(codec.encode(command.message))
        return command

    def heard(reply: Message) -> None:
        lengths.received += len(codec.encode(reply))
        lengths.replies += 1

    return with_each_command(exchange, sent, heard)
