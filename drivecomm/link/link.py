"""Sans-I/O link: runs exchanges with the drives of one line as effects for a runner.

Nearly all exchanges are plain and take the short path: each request and its reply are one effect in one generator
frame, or a few effects if the reply comes in pieces. The short path judges nothing. Any irregularity continues on the
long path (`drivecomm.link.exchange_loop`), from the state that the long path would have at that moment.

A call that does not stop a motor gives way to a stop that waits for the line: it sends nothing more, and does not wait
for a reply that has not begun within the time of one telegram. It ends with OvertakenError.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

from drivecomm.errors import NoReplyError, TelegramError
from drivecomm.link.call_context import CallContext
from drivecomm.link.exchange_loop import (
    PartialReply,
    carry_out,
    expect_late_reply,
    must_wait_for_late_reply,
    note_sent,
    resume_exchange,
)
from drivecomm.link.health import Health
from drivecomm.link.held_back import HeldBack
from drivecomm.link.line_state import LineState
from drivecomm.link.other_masters import SHARED, OtherMasters
from drivecomm.link.peer import DriveRecord, Peer, TraceEvent
from drivecomm.link.probing import Probing
from drivecomm.link.reply_pieces import rest_of_reply
from drivecomm.link.reply_trust import note_reply
from drivecomm.protocol import Ask, Tell

if TYPE_CHECKING:
    from collections import Counter
    from collections.abc import Callable, Mapping, Sequence

    from drivecomm.link.command_order import CommandCall
    from drivecomm.link.echo import Echo
    from drivecomm.link.port import Arrival, LinkSteps
    from drivecomm.link.statistics import Statistics
    from drivecomm.protocol import Exchange, Message

T = TypeVar("T")

_NEVER = float("inf")


class Link:
    """Link of one line. `run` turns an exchange with a drive into effects for a runner.

    echo: whether the adapter returns what it sends. guard_s: quiet time in seconds after a change of the line settings,
    for receivers to settle. paced: whether characters take their real time on this port; if so, bytes that come before
    a request is out cannot be its reply. stop_waits: returns whether a stop waits for the line. away: called with the
    name of a drive that is given up, or that may have been without its line, so that its last command no longer holds.
    on_shared: called with the reason each time the line begins to count as shared with another master.
    """

    def __init__(
        self,
        *,
        trace: Callable[[TraceEvent], None] | None = None,
        echo: Echo = "off",
        guard_s: float = 0.005,
        away: Callable[[str], None] | None = None,
        on_shared: Callable[[str], None] | None = None,
    ) -> None:
        self.paced = False
        self.stop_waits: Callable[[], bool] = _never
        # Other threads add drives at any time, so loops run over a copy; making a copy is one atomic step.
        self._records: dict[str, DriveRecord] = {}
        self._line = LineState(trace, away, echo, guard_s, OtherMasters(self._records, on_shared), self._records)
        self._probing = Probing(self._line, self._records)

    @property
    def counters(self) -> Mapping[str, Counter[str]]:
        """Counters of each drive, by its name."""
        return {name: record.count for name, record in self._records.copy().items()}

    @property
    def statistics(self) -> Mapping[str, Statistics]:
        """Counters and reply times of each drive, by its name."""
        return {name: record.statistics for name, record in self._records.copy().items()}

    @property
    def health(self) -> Mapping[str, Health]:
        """Health of each drive, by its name."""
        return {name: record.health for name, record in self._records.copy().items()}

    @property
    def trace(self) -> Callable[[TraceEvent], None] | None:
        """Function that receives every event on the line; None allows exchanges to take the short path."""
        return self._line.trace

    @trace.setter
    def trace(self, trace: Callable[[TraceEvent], None] | None) -> None:
        self._line.trace = trace

    @property
    def doubt(self) -> str:
        """Why the result of the last exchange is uncertain; empty if it is certain."""
        return self._line.doubt

    def other_master(self, now: float) -> str:
        """Return the warning that another master shares the line; empty if none was heard lately."""
        return SHARED if self._line.others.shared(now) else ""

    def opened(self, now: float) -> None:
        """Record that the port was just opened or reopened."""
        if not self.paced:
            self._line.others.may_be_shared(now)

    def reopened(self) -> None:
        """Forget the state of the port before it was reopened; all drives are set up again."""
        self._line.reopened()
        for name, record in self._records.copy().items():
            record.health.away = True
            self._line.away(name)

    def must_set_up(self, peer: Peer) -> None:
        """Set up this drive before its next exchange."""
        self._record_of(peer).health.away = True

    def repeat_within(self, peer: Peer, watchdog_s: float) -> None:
        """Set the maximum age of repeated commands: the seconds since the last command was sent to the drive."""
        self._record_of(peer).watchdog_s = watchdog_s

    def run(
        self,
        peer: Peer,
        exchange: Exchange[T],
        now: float,
        deadline: float = _NEVER,
        command: CommandCall | None = None,
    ) -> LinkSteps[T]:
        """Run an exchange with a drive and return its result. Raises what the exchange raises.

        A drive that was given up is probed when its probe is due, and refused with NotAnsweringError until then; a
        drive that was away is set up first. now: time at which the exchange begins. deadline: end of the call's time.
        command: raises CommandCancelledError instead of sending what a stop has cancelled, or raises what its own check
        raises.

        An exchange that is cut off (by closing this generator) leaves the line unclean: the next exchange drains it
        first.
        """
        if peer.cautious is not None and not self._line.tuning.holds():
            peer = peer.cautious
        record = self._records.get(peer.name)
        if record is None or record.settings is not peer.settings:
            record = self._record_of(peer)
        # A drive that was given up is away, too.
        if not record.health.away and self._line.is_plain_for(peer):
            return self._by_short_way(peer, record, exchange, now, deadline, True, command, _never)
        return self._run(self._call(peer, record, deadline, True, command, _never), exchange, now)

    def _run(self, call: CallContext, exchange: Exchange[T], now: float) -> LinkSteps[T]:
        self._line.now, self._line.doubt = now, ""
        try:
            yield from self._prepare(call, now)
        except HeldBack as held:
            held.exchange.close()
            raise HeldBack(held.until, exchange) from None
        try:
            return (yield from carry_out(call, exchange))
        except NoReplyError:
            self._probing.fell_silent(call.peer, call.record, now)
            raise

    def _prepare(self, call: CallContext, now: float) -> LinkSteps[None]:
        """Probe a drive that was given up, and set up a drive that was away."""
        peer, health = call.peer, call.record.health
        if peer.probe is not None and health.given_up:
            yield from self._probing.probe(call, peer.probe)
        if not health.away or peer.set_up is None:
            return
        try:
            yield from carry_out(call, peer.set_up())
        except NoReplyError:
            self._probing.fell_silent(call.peer, call.record, now)
            raise
        health.away = False

    def insist(
        self,
        peer: Peer,
        exchange: Exchange[T],
        now: float,
        *,
        deadline: float = _NEVER,
        gives_way: bool = True,
        others_first: Callable[[], bool] | None = None,
    ) -> LinkSteps[T]:
        """Run an exchange even with a drive that was given up or away, without a probe or set-up before it."""
        if peer.cautious is not None and not self._line.tuning.holds():
            peer = peer.cautious
        record, others_first = self._record_of(peer), others_first or _never
        if self._line.is_plain_for(peer):
            return self._by_short_way(peer, record, exchange, now, deadline, gives_way, None, others_first)
        return self._insist(self._call(peer, record, deadline, gives_way, None, others_first), exchange, now)

    def _insist(self, call: CallContext, exchange: Exchange[T], now: float) -> LinkSteps[T]:
        self._line.now, self._line.doubt = now, ""
        try:
            return (yield from carry_out(call, exchange))
        except NoReplyError:
            self._probing.fell_silent(call.peer, call.record, now)
            raise

    def stop(
        self,
        peer: Peer,
        exchange: Exchange[T],
        now: float,
        *,
        deadline: float = _NEVER,
        others_first: Callable[[], bool] | None = None,
    ) -> LinkSteps[T]:
        """Run an exchange that stops a motor, even with a drive that was given up; it gives way to nothing.

        others_first: called after a failed attempt; returns whether to make no further attempt because others wait for
        the line.
        """
        return self.insist(peer, exchange, now, deadline=deadline, gives_way=False, others_first=others_first)

    def _call(  # noqa: PLR0917 - as below
        self,
        peer: Peer,
        record: DriveRecord,
        deadline: float,
        gives_way: bool,
        command: CommandCall | None,
        others_first: Callable[[], bool],
    ) -> CallContext:
        call = CallContext(
            self._line, peer, record, self.paced, self.stop_waits, deadline, gives_way, command, others_first
        )
        call.may_be_held_back = gives_way
        return call

    def _by_short_way(  # noqa: PLR0917 - a call with names takes twice as long, and each exchange makes this one
        self,
        peer: Peer,
        record: DriveRecord,
        exchange: Exchange[T],
        began: float,
        deadline: float,
        gives_way: bool,
        command: CommandCall | None,
        others_first: Callable[[], bool],
    ) -> LinkSteps[T]:
        line, codec, telegram, timing = self._line, peer.codec, peer.telegram, peer.facts.timing
        character_s = peer.character_s
        per_character_s = character_s if self.paced else 0.0
        talk, count = line.talk, record.count
        talk.deadline, talk.gives_way = deadline, gives_way
        line.now = now = began
        line.unclean, line.doubt = True, ""
        may_be_held_back = gives_way
        reply: Message | None = None
        known = peer.known
        # Bytes for the long path: received before the telegram, and after it.
        unasked = b""
        heard: Sequence[Arrival] = ()
        try:
            while True:
                try:
                    asked = exchange.send(reply)
                except StopIteration as finished:
                    line.unclean = False
                    result: T = finished.value
                    return result
                except Exception:
                    line.unclean = False
                    raise
                if type(asked) is Ask:
                    data = telegram(asked.message)
                    if (
                        asked.command
                        or record.owed
                        or (record.unanswered and must_wait_for_late_reply(record, asked, data))
                        or now < record.asked_at + timing.request_interval_s
                        or now >= deadline
                        or (gives_way and self.stop_waits())
                        or (command is not None and command.in_doubt)
                    ):
                        break
                    record.asked_at = now
                    count["requests"] += 1
                    timeout = asked.reply_timeout_s
                    timeout = timing.reply_timeout_s if timeout is None else timeout
                    talk.at_least = shortest = peer.shortest
                    # Copied from `Peer.arrives_within_s`, because a call would make a read 2 % slower.
                    talk.reply_s = timeout + character_s * (1 if self.paced else max(len(data), shortest))
                elif type(asked) is Tell and not (command is not None and command.in_doubt):
                    data = telegram(asked.message)
                    talk.at_least = 0
                else:
                    break
                talk.wire_s = wire_s = len(data) * character_s
                talk.free_at, talk.data = line.free_at, data
                talk.begun = None
                try:
                    arrival = yield talk
                    now, came, _ = arrival
                    line.now = now
                    if talk.begun is None:
                        unasked = came
                        break
                    line.free_at = line.sent_at = sent_at = talk.begun + wire_s
                    if type(asked) is Tell:
                        note_sent(line, peer, asked, data)
                        reply, may_be_held_back = None, False
                        continue
                    if not came or (self.paced and now < sent_at + character_s / 2):
                        heard = (arrival,)
                        break
                    reply = known.get((data, came))
                    if reply is None:
                        heard = (arrival,)
                        needed = codec.measure(came, "reply")
                        if needed > len(came):
                            rest = rest_of_reply(line, peer, talk, arrival, needed, stop_waits=self.stop_waits)
                            heard, came, needed = yield from rest
                            now = line.now
                        if needed != len(came) or came == data:
                            break
                        reply = known.get((data, came))
                    if asked.nameless and (
                        len(came) == 1
                        or now < line.others.careful_until
                        or (not asked.acts and now - sent_at - len(came) * per_character_s < record.soonest_s)
                    ):
                        # The reply may belong to another master or be noise: the long path waits for more bytes.
                        heard = heard or (arrival,)
                        break
                    if reply is None:
                        try:
                            reply = codec.decode(came, "reply")
                        except TelegramError:
                            break
                        if peer.mismatch(asked.message, reply):
                            break
                        peer.know(data, came, reply)
                    heard = ()
                    line.heard_at = now
                    record.last = data, came
                    note_reply(line, peer, record, len(came), now)
                except BaseException:
                    if talk.begun is not None:
                        line.now = max(line.now, talk.begun)
                        line.sent_at = talk.begun + wire_s
                        line.free_at = max(line.free_at, line.sent_at)
                    if type(asked) is Ask:
                        expect_late_reply(line, peer, record, asked, data)
                    raise
                count["replies"] += 1
                record.health.answered()
                may_be_held_back = False
            call = self._call(peer, record, deadline, gives_way, command, others_first)
            call.may_be_held_back = may_be_held_back
            begun = PartialReply(unasked, heard) if unasked or heard else None
            return (yield from resume_exchange(call, exchange, asked, begun))
        except NoReplyError:
            self._probing.fell_silent(peer, record, began)
            raise
        except HeldBack:
            raise
        except BaseException:
            exchange.close()
            raise

    def _record_of(self, peer: Peer) -> DriveRecord:
        self._line.others.speaks(peer)
        record = self._records.get(peer.name)
        if record is None:
            made = DriveRecord(peer.settings)
            if (like := self._line.newcomers.get(peer.protocol)) is not None:
                made.copy_owed(like)
            record = self._records.setdefault(peer.name, made)
        elif record.settings is not peer.settings and record.settings != peer.settings:
            # Silence at other line settings does not count at the new ones.
            away, record.settings, record.health = record.health.away, peer.settings, Health()
            record.health.away = away
        return record


def _never() -> bool:
    return False
