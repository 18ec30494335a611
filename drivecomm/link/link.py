"""The sans-I/O link: sends, frames, correlates, repeats, drains. It yields effects and is resumed with what came.

One link serves one line. It never sleeps and never reads a clock: the runner tells the time with every resumption.

    Configure   set the port to these line settings
    Send        write these bytes
    Receive     wait for bytes until a time; `at_least` says how few are of no use yet
    Wait        let time pass until then

What does not stop a motor gives way to a stop that waits for the line: it sends nothing more, and what its drive has
not begun to answer within the time of one telegram is not waited for. It ends with OvertakenError.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias, TypeVar

from drivecomm.errors import (
    CommandCancelledError,
    CommandTooOldError,
    DamagedReplyError,
    DeadlineError,
    NoReplyError,
    NotAnsweringError,
    OvertakenError,
    ReplyError,
)
from drivecomm.link.echo import Echo, EchoFilter, in_place_of_echo
from drivecomm.link.health import LONGEST_PAUSE_S, PROBE_S, Health, ProbingTime, UsualDelays
from drivecomm.link.statistics import Statistics
from drivecomm.protocol import Ask, Damaged, Framed, Framer, Noise, Pause

if TYPE_CHECKING:
    from collections import Counter
    from collections.abc import Mapping

    from drivecomm.link.command_order import CommandCall
    from drivecomm.protocol import Codec, Exchange, LineFacts, LineSettings, Message, Tell

T = TypeVar("T")


class Configure(NamedTuple):
    """Set the port to these line settings."""

    settings: LineSettings


class Send(NamedTuple):
    """Write these bytes."""

    data: bytes


class Receive(NamedTuple):
    """Wait for bytes until this time; return early only with at least this many.

    gives_way: return early, too, when a stop waits for the line.
    """

    until: float
    at_least: int = 1
    gives_way: bool = False


class Wait(NamedTuple):
    """Let time pass until then. gives_way: return early when a stop waits for the line."""

    until: float
    gives_way: bool = False


Effect: TypeAlias = Configure | Send | Receive | Wait


class Arrival(NamedTuple):
    """The time, and the bytes that came (for Receive)."""

    time: float
    data: bytes = b""
    note: str = ""


Steps: TypeAlias = Generator[Effect, Arrival, T]

What: TypeAlias = Literal["sent", "received", "echo", "stray", "damaged", "noise", "note"]


@dataclass(frozen=True, slots=True, kw_only=True)
class TraceEvent:
    """Something that happened on the line.

    what: sent and received telegrams of an exchange; echo: our own bytes; stray: a sound telegram that does not answer
    the request; damaged and noise: bytes that are no telegram; note: something about the line itself.
    drive: the drive that the exchange is with. detail: why, for strays and damage; the text of a note.
    """

    time: float
    what: What
    drive: str
    data: bytes = b""
    message: Message | None = None
    detail: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Party:
    """A drive as the link sees it: who it is, how its telegrams look, what holds on the line for it.

    mismatch: names the first field in which a sound reply does not belong to the request. probe: asks whether it is
    there, moving nothing; None for all drives at once. set_up: what must be done after it was away, before anything
    else is.
    """

    name: str
    codec: Codec
    facts: LineFacts
    mismatch: Callable[[Message, Message], str]
    probe: Callable[[], Exchange[None]] | None = None
    set_up: Callable[[], Exchange[None]] | None = None
    protocol: str = field(init=False)
    gap_s: float = field(init=False)
    turnaround_s: float = field(init=False)

    def __post_init__(self) -> None:
        # Asked for in every exchange.
        object.__setattr__(self, "protocol", self.name.partition(":")[0])
        object.__setattr__(self, "gap_s", self.facts.gap_s)
        object.__setattr__(self, "turnaround_s", self.facts.turnaround_s)


class _Partner:
    """What the link remembers of one drive."""

    __slots__ = (
        "asked_at",
        "commanded_at",
        "count",
        "health",
        "late_until",
        "settings",
        "statistics",
        "surplus",
        "unanswered",
        "watchdog_s",
    )

    def __init__(self, settings: LineSettings | None = None) -> None:
        self.settings = settings
        self.statistics = Statistics()
        self.count = self.statistics.counters
        self.health = Health()
        self.asked_at = float("-inf")
        self.commanded_at = float("-inf")
        self.watchdog_s = float("inf")
        self.late_until = 0.0
        self.unanswered = b""
        self.surplus = False


class Link:
    """One line. `run` turns an exchange with a drive into effects for a runner.

    echo: whether the adapter hands back what it sends. guard_s: quiet time after the line settings change, for
    receivers to settle. paced: whether characters take their time on this port, as on a real line; then nothing that
    comes before a request is out can answer it. stop_waits: tells whether a stop waits for the line. away: told the
    name of a drive that is given up, or that may have been without its line: what it was commanded holds no longer.
    """

    def __init__(
        self,
        *,
        trace: Callable[[TraceEvent], None] | None = None,
        echo: Echo = "off",
        guard_s: float = 0.005,
        away: Callable[[str], None] | None = None,
    ) -> None:
        self._trace = trace
        self._away = away
        self._echo = EchoFilter(echo)
        self._guard_s = guard_s
        self.paced = False
        self.stop_waits: Callable[[], bool] = _never
        self._gives_way = True
        self._command: CommandCall | None = None
        self._settings: LineSettings | None = None
        self._now = 0.0
        self._free_at = 0.0
        self._sent_at = 0.0
        self._heard_at = float("-inf")
        self._deadline = float("inf")
        self._listen_until: float | None = None
        self._delays = UsualDelays()
        self._probed: _Partner | None = None
        self._probe_took_s = PROBE_S
        self._patient_at = float("-inf")
        self._unclean = False
        # Threads that make drives add to it at any time: whoever goes through it takes a copy, which is one step.
        self._partners: dict[str, _Partner] = {}

    @property
    def counters(self) -> Mapping[str, Counter[str]]:
        """What has happened, by the name of the drive."""
        return {name: partner.count for name, partner in self._partners.copy().items()}

    @property
    def statistics(self) -> Mapping[str, Statistics]:
        """What has happened and how fast the drives answer, by the name of the drive."""
        return {name: partner.statistics for name, partner in self._partners.copy().items()}

    @property
    def health(self) -> Mapping[str, Health]:
        """Whether the drives answer, by name."""
        return {name: partner.health for name, partner in self._partners.copy().items()}

    def reopened(self) -> None:
        """Forget what held for the port before it was opened anew; all drives are set up again."""
        self._settings = None
        self._unclean = False
        for name, partner in self._partners.copy().items():
            partner.health.away = True
            self._tell_away(name)

    def must_set_up(self, party: Party) -> None:
        """Let this drive be set up before its next exchange."""
        self._partner(party).health.away = True

    def repeat_within(self, party: Party, watchdog_s: float) -> None:
        """Repeat no command to this drive that it was last sent, or last sent again, longer ago than this."""
        self._partner(party).watchdog_s = watchdog_s

    def run(
        self,
        party: Party,
        exchange: Exchange[T],
        *,
        deadline: float = float("inf"),
        command: CommandCall | None = None,
    ) -> Steps[T]:
        """Carry out an exchange with a drive and return its result. Raises what the exchange raises.

        A drive that has been given up is probed when it is time for that, and refused with NotAnsweringError until
        then; one that was away is set up first. deadline: when the call's time is over. command: raises
        CommandCancelledError in place of sending what a stop has cancelled.

        An exchange that is cut off in the middle (by closing this generator) leaves the link unclean: the next one
        begins with draining the line.
        """
        self._now = began = (yield _NOW).time
        self._deadline, self._command = deadline, command
        self._gives_way = True
        partner = self._partner(party)
        health = partner.health
        if party.probe is not None and health.given_up:
            yield from self._probe(party, partner, party.probe)
        try:
            if health.away and party.set_up is not None:
                yield from self._carry_out(party, partner, party.set_up())
                health.away = False
            return (yield from self._carry_out(party, partner, exchange))
        except NoReplyError:
            self._fell_silent(party, partner, began)
            raise

    def insist(self, party: Party, exchange: Exchange[T], *, deadline: float = float("inf")) -> Steps[T]:
        """Carry out an exchange whatever is known of the drive: for asking whether it is there."""
        return self._insist(party, exchange, deadline, gives_way=True)

    def stop(self, party: Party, exchange: Exchange[T], *, deadline: float = float("inf")) -> Steps[T]:
        """Carry out an exchange that stops a motor, whatever is known of the drive; it gives way to nothing."""
        return self._insist(party, exchange, deadline, gives_way=False)

    def _insist(self, party: Party, exchange: Exchange[T], deadline: float, *, gives_way: bool) -> Steps[T]:
        self._now = began = (yield _NOW).time
        self._deadline, self._command, self._gives_way = deadline, None, gives_way
        partner = self._partner(party)
        try:
            return (yield from self._carry_out(party, partner, exchange))
        except NoReplyError:
            self._fell_silent(party, partner, began)
            raise

    def _fell_silent(self, party: Party, partner: _Partner, began: float) -> None:
        time = ProbingTime(each.health for each in self._partners.copy().values())
        if partner.health.fell_silent(began, self._now, time.least_pause_s(self._probe_took_s)):
            self._note(party, "note", detail="does not answer; it is asked again now and then")
            self._tell_away(party.name)

    def _tell_away(self, name: str) -> None:
        if self._away is not None:
            self._away(name)

    def _probe(self, party: Party, partner: _Partner, probe: Callable[[], Exchange[None]]) -> Steps[None]:
        """Ask a drive that has been given up, or refuse until it is time for that."""
        health, began = partner.health, self._now
        silent = f"{party.name} has not answered for {began - health.silent_since:.1f} s"
        if began < health.probe_at:
            raise NotAnsweringError(f"{silent}; it is asked again in {health.probe_at - began:.1f} s")
        time = ProbingTime(each.health for each in self._partners.copy().values())
        if not health.patient:
            self._listen_until = began + time.each_s
        health.patient = False
        partner.count["probes"] += 1
        try:
            yield from self._carry_out(party, partner, probe())
        except ReplyError as error:
            something_came = health.patient
            self._probe_took_s = self._now - began
            health.fell_silent(began, self._now, time.least_pause_s(self._probe_took_s))
            if something_came:
                health.heard_late()
            elif self._listen_until is not None:
                self._probed = partner
            if not isinstance(error, NoReplyError):
                raise
            raise NotAnsweringError(f"{silent}; it was asked again just now") from error
        finally:
            self._listen_until = None

    def _carry_out(self, party: Party, partner: _Partner, exchange: Exchange[T]) -> Steps[T]:
        if self._settings != party.facts.settings:
            yield from self._settle(party)
        if self._unclean:
            self._heard_at = self._now
            yield from self._drain(party, partner)
        self._unclean = True
        outcome: Message | None = None
        error: ReplyError | None = None
        while True:
            try:
                command = exchange.send(outcome) if error is None else exchange.throw(error)
            except StopIteration as finished:
                self._unclean = False
                result: T = finished.value
                return result
            except Exception:
                # The exchange ended by its own decision; what had to be drained was drained where it went wrong.
                self._unclean = False
                raise
            outcome = error = None
            try:
                if isinstance(command, Ask):
                    outcome = yield from self._ask(party, partner, command)
                elif isinstance(command, Pause):
                    yield from self._pause(party, command.seconds)
                else:
                    yield from self._tell(party, partner, command)
            except ReplyError as failed:
                error = failed
            except BaseException as failed:
                exchange.close()
                # What was cancelled was not sent, so nothing is under way.
                self._unclean = not isinstance(failed, CommandCancelledError)
                raise

    def _tell(self, party: Party, partner: _Partner, tell: Tell) -> Steps[None]:
        self._check_cancelled(party)
        yield from self._send(party, partner, party.codec.encode(tell.message), tell.message)
        pause = party.facts.broadcast_pause_s if tell.pause_s is None else tell.pause_s
        self._free_at = self._sent_at + pause

    def _pause(self, party: Party, seconds: float) -> Steps[None]:
        yield from self._stay(party, min(self._now + seconds, self._deadline))
        self._check_deadline(party)

    def _ask(self, party: Party, partner: _Partner, ask: Ask) -> Steps[Message]:
        data = party.codec.encode(ask.message)
        attempts = ask.attempts or party.facts.timing.attempts
        if partner.unanswered and (partner.unanswered != data or partner.surplus):
            yield from self._outwait_late_reply(party, partner, ask, data)
        attempt = 0
        while True:
            attempt += 1
            next_at = partner.asked_at + party.facts.timing.request_interval_s
            if self._now < next_at:
                yield from self._stay(party, min(next_at, self._deadline))
            self._check_deadline(party)
            self._check_overtaken(party)
            self._check_cancelled(party)
            if ask.command:
                self._check_age(party, partner, ask)
            partner.asked_at = self._now
            partner.count["requests" if attempt == 1 else "retries"] += 1
            try:
                yield from self._send(party, partner, data, ask.message)
                message = yield from self._await_reply(party, partner, ask, data)
            except ReplyError as error:
                partner.count["damaged" if isinstance(error, DamagedReplyError) else "timeouts"] += 1
                if self._heard_at > partner.asked_at:
                    # Where nothing came at all there is nothing to let finish.
                    if self._listen_until is not None:
                        self._probed = partner
                    yield from self._drain(party, partner)
                self._expect_late_reply(party, partner, ask, data)
                if attempt == attempts or self._now >= self._deadline or isinstance(error, OvertakenError):
                    raise type(error)(f"{error}{_times(attempt)}{_OPEN if ask.acts else ''}") from None
            except BaseException:
                self._expect_late_reply(party, partner, ask, data)
                raise
            else:
                partner.count["replies"] += 1
                partner.health.answered()
                # The replies to the attempts before may still come, and would answer the same question as if it were
                # asked anew.
                partner.surplus = attempt > 1
                if partner.surplus:
                    partner.late_until, partner.unanswered = self._sent_at + party.facts.timing.late_s, data
                if ask.command:
                    partner.commanded_at = self._sent_at
                return message

    def _await_reply(self, party: Party, partner: _Partner, ask: Ask, data: bytes) -> Steps[Message]:
        settings, timing, gap_s, echo = party.facts.settings, party.facts.timing, party.gap_s, self._echo
        timeout = timing.reply_timeout_s if ask.reply_timeout_s is None else ask.reply_timeout_s
        sent_at = self._sent_at
        if self._listen_until is not None:
            timeout = min(timeout, max(self._delays.least_ear_s(party.protocol), self._listen_until - sent_at))
        limit = deadline = sent_at + settings.character_s + timeout
        if limit > self._deadline:
            limit = deadline = max(self._deadline, sent_at)
            timeout = 0.0
        latest = limit + settings.wire_s(_LONGEST_TELEGRAM) + gap_s
        # A reply's first character cannot be over before this.
        earliest = sent_at + settings.character_s / 2 if self.paced else 0.0
        framer = Framer(party.codec, "reply")
        damage, stray, early, first = "", "", b"", b""
        taken = 0
        in_haste, gives_way = False, self._gives_way
        while True:
            self._now, came, _ = yield Receive(deadline, framer.missing + echo.missing, gives_way)
            if gives_way and self.stop_waits():
                # Whoever has begun to answer is heard to the end; others have no longer than their like need to begin.
                in_haste, gives_way = True, False
                limit = min(limit, max(self._now, sent_at + self._delays.least_ear_s(party.protocol)))
                if not framer.begun:
                    deadline = min(deadline, limit)
            if not came and self._now < deadline:
                continue
            if came:
                self._heard_at = self._now
                if self._now < earliest:
                    # While the request is still on its way nothing can answer it: an echo, or a late reply.
                    early += came
                    stray = self._early(party, partner, came, is_echo=data.startswith(early))
                    continue
            quiet = not came
            if echo.looking:
                came = self._without_echo(party, partner, came)
                quiet = quiet and not came
            elif len(first) < len(data):
                first += came
            place = taken - framer.held
            taken += len(came)
            for find in framer.flush() if quiet else framer.feed(came):
                if isinstance(find, Framed):
                    in_place = in_place_of_echo(find.data, place, echo.excused)
                    is_echo = in_place or find.data == data
                    reason = "echo" if is_echo else party.mismatch(ask.message, find.message)
                    if not reason:
                        self._answered(party, partner, find, alone=not place)
                        return find.message
                    place += len(find.data)
                    self._stray(party, partner, find, reason)
                    if reason != "echo":
                        stray = f"the reply that came differs in {reason}"
                    else:
                        stray = _IN_PLACE_OF_ECHO if in_place else _ECHO
                else:
                    wrong = self._garbage(party, partner, find)
                    if taken > echo.excused:
                        damage = wrong or damage
                    place += len(find.data) if isinstance(find, Noise) else 0
            # Once a reply has begun only the gap limit counts; before that, the reply time keeps running.
            begun = framer.begun or damage
            deadline = self._now + settings.wire_s(framer.missing) + gap_s if begun else limit
            if (quiet and damage) or self._now >= min(deadline, latest):
                break
        if first.startswith(data):
            damage, stray = "", _ECHO
        if damage and not in_haste:
            raise DamagedReplyError(f"{party.name} answered with a damaged telegram ({damage})")
        why = f": {stray}" if stray else ""
        if in_haste:
            raise OvertakenError(f"{party.name} was not waited for any longer, because a stop went first{why}")
        if not timeout:
            raise DeadlineError(
                f"{party.name} did not answer before the call's time ({timing.deadline_s:g} s) was over{why}"
            )
        raise NoReplyError(f"{party.name} did not answer within {timeout * 1000:.0f} ms{why}")

    def _answered(self, party: Party, partner: _Partner, find: Framed, *, alone: bool) -> None:
        self._free_at = self._now + party.turnaround_s
        taken = self._now - self._sent_at
        partner.statistics.reply_times.add(taken)
        self._delays.answered(party.protocol, taken - party.facts.settings.wire_s(len(find.data)))
        if self._echo.looking and self._echo.answered(alone=alone):
            partner.count["echoes missing"] += 1
        if self._trace is not None:
            self._note(party, "received", find.data, find.message)

    def _without_echo(self, party: Party, partner: _Partner, came: bytes) -> bytes:
        """Return what came beside the echo. Nothing came: what was held back was the beginning of one."""
        echo, rest = self._echo.take(came) if came else (self._echo.give_up(), b"")
        if echo:
            partner.count["echo bytes"] += len(echo)
            self._note(party, "echo", echo)
        return rest

    def _send(self, party: Party, partner: _Partner, data: bytes, message: Message) -> Steps[None]:
        facts = party.facts
        if self._settings != facts.settings:
            yield from self._settle(party)
        if self._now < self._free_at:
            self._now = (yield Wait(self._free_at)).time
        self._now, came, _ = yield Receive(self._now)
        if came and self._echo.looking:
            # Of what was told, and not answered.
            came = self._without_echo(party, partner, came)
        if came:
            # Something speaks out of turn (a repeated or late reply): let it finish before we add to it.
            self._heard_at = self._now
            partner.count["unasked bytes"] += len(came)
            self._note(party, "noise", came, detail="unasked")
            self._heard_out_of_turn()
            yield from self._drain(party, partner)
        # Whatever comes of it, nobody may speak, or change the line settings, before it is on the wire.
        self._free_at = self._sent_at = self._now + facts.settings.wire_s(len(data))
        self._now = (yield Send(data)).time
        if self._echo.looking:
            self._echo.sent(data)
        if self._trace is not None:
            self._note(party, "sent", data, message)

    def _early(self, party: Party, partner: _Partner, came: bytes, *, is_echo: bool) -> str:
        """Drop what came while the request was on its way. Returns a hint when it is the request itself."""
        if self._echo.looking:
            rest = self._without_echo(party, partner, came)
            self._echo.excused = max(0, self._echo.excused - len(came))
            if not rest:
                return ""
            came = rest
        if is_echo:
            partner.count["echo bytes"] += len(came)
            self._note(party, "echo", came)
            return _ECHO
        partner.count["unasked bytes"] += len(came)
        self._note(party, "noise", came, detail="came before the request was out")
        self._heard_out_of_turn()
        return ""

    def _settle(self, party: Party) -> Steps[None]:
        """Bring the port to the drive's line settings."""
        yield from self._wait(self._free_at)
        # Whoever is interrupted in the middle of this no longer knows how the port stands.
        before, self._settings = self._settings, None
        arrival = yield Configure(party.facts.settings)
        self._now = arrival.time
        if arrival.note:
            self._note(party, "note", detail=arrival.note)
        if before is not None:
            self._free_at = max(self._free_at, self._now + self._guard_s)
        self._settings = party.facts.settings

    def _drain(self, party: Party, partner: _Partner) -> Steps[None]:
        """Read until the line has been quiet for the drive's gap, at most for one reply time."""
        gap = party.gap_s
        limit = self._now + max(party.facts.timing.reply_timeout_s, gap)
        while (quiet_at := min(limit, self._heard_at + gap)) > self._now:
            self._now, came, _ = yield Receive(quiet_at)
            if came:
                self._heard_at = self._now
                partner.count["drained bytes"] += len(came)
                self._note(party, "noise", came, detail="drained")
                self._heard_out_of_turn()

    def _expect_late_reply(self, party: Party, partner: _Partner, ask: Ask, data: bytes) -> None:
        """Keep in mind that a reply which does not name its request may still come."""
        if ask.nameless:
            partner.late_until, partner.unanswered = self._now + party.facts.timing.late_s, data
            partner.surplus = False

    def _outwait_late_reply(self, party: Party, partner: _Partner, ask: Ask, data: bytes) -> Steps[None]:
        """Do not ask for something else while a reply that does not name its request may still come."""
        if ask.urgent and self._now < partner.late_until:
            yield from self._send(party, partner, data, ask.message)
        yield from self._stay(party, min(partner.late_until, self._deadline))
        self._check_deadline(party)
        yield from self._drain(party, partner)
        partner.unanswered, partner.surplus = b"", False

    def _wait(self, until: float) -> Steps[None]:
        if self._now < until:
            self._now = (yield Wait(until)).time

    def _stay(self, party: Party, until: float) -> Steps[None]:
        """Let time pass, unless a stop waits for the line."""
        while self._now < until:
            self._check_overtaken(party)
            self._now = (yield Wait(until, self._gives_way)).time

    def _overtaken(self) -> bool:
        return self._gives_way and self.stop_waits()

    def _check_overtaken(self, party: Party) -> None:
        if self._overtaken():
            raise OvertakenError(f"{party.name} was not asked, because a stop went first")

    def _check_cancelled(self, party: Party) -> None:
        if self._command is not None and self._command.cancelled:
            raise CommandCancelledError(
                f"{party.name} was not sent the command, because a stop was called after it; start it again if it "
                "shall run"
            )

    def _check_age(self, party: Party, partner: _Partner, ask: Ask) -> None:
        """Make sure that what is repeated still holds: the drive's own watchdog may have acted meanwhile."""
        silent_s = self._now - partner.commanded_at
        if ask.command == "repeated" and silent_s > partner.watchdog_s:
            self._tell_away(party.name)
            raise CommandTooOldError(
                f"{party.name} was last commanded {silent_s:.1f} s ago, longer than its watchdog waits; what it was "
                "commanded is not repeated, so start it again if it shall run"
            )

    def _check_deadline(self, party: Party) -> None:
        if self._now >= self._deadline:
            raise DeadlineError(f"{party.name}: the call's time ({party.facts.timing.deadline_s:g} s) is over")

    def _heard_out_of_turn(self) -> None:
        """See whether it was the drive that was probed last, and that answers more slowly than was waited for."""
        if self._probed is not None and self._now >= self._patient_at:
            self._probed.health.heard_late()
            # Noise must not make every probe a long one.
            self._patient_at = self._now + LONGEST_PAUSE_S
        self._probed = None

    def _stray(self, party: Party, partner: _Partner, find: Framed, reason: str) -> None:
        what: What = "echo" if reason == "echo" else "stray"
        partner.count["echoes" if reason == "echo" else "strays"] += 1
        self._note(party, what, find.data, find.message, detail=reason)
        self._heard_out_of_turn()

    def _garbage(self, party: Party, partner: _Partner, find: Damaged | Noise) -> str:
        """Count and trace; return what is wrong with a damaged telegram, nothing for noise that was never one."""
        if isinstance(find, Noise):
            partner.count["noise bytes"] += len(find.data)
            self._note(party, "noise", find.data)
            return ""
        partner.count[f"{find.error.category} errors"] += 1
        self._note(party, "damaged", find.data, detail=str(find.error))
        return str(find.error)

    def _partner(self, party: Party) -> _Partner:
        partner = self._partners.get(party.name)
        if partner is None:
            partner = self._partners.setdefault(party.name, _Partner(party.facts.settings))
        elif partner.settings is not party.facts.settings and partner.settings != party.facts.settings:
            # Silence at other line settings says nothing about these.
            away, partner.settings, partner.health = partner.health.away, party.facts.settings, Health()
            partner.health.away = away
        return partner

    def _note(
        self, party: Party, what: What, data: bytes = b"", message: Message | None = None, detail: str = ""
    ) -> None:
        if self._trace is not None:
            self._trace(
                TraceEvent(time=self._now, what=what, drive=party.name, data=data, message=message, detail=detail)
            )


def _never() -> bool:
    return False


_NOW = Wait(0.0)

# The longest one that exists has 257 bytes (Danfoss FC with LGE 255); a line that never falls silent is not waited for.
_LONGEST_TELEGRAM = 257
_OPEN = "; whether the drive acted on it is not known"
_ECHO = "the adapter hands back what it sends, and no other reply came; open the port with echo on"
_IN_PLACE_OF_ECHO = "what came may be a disturbed echo; if this adapter has none, open the port with echo off"


def _times(attempts: int) -> str:
    return "" if attempts == 1 else f" (asked {attempts} times)"
