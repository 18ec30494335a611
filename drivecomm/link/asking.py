"""Carrying out one exchange: telegrams are told, questions are asked and repeated, late replies waited out."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, TypeVar

from drivecomm.errors import (
    CommandCancelledError,
    DamagedReplyError,
    DoubtfulReplyError,
    OvertakenError,
    ReplyError,
)
from drivecomm.link.belief import Answers
from drivecomm.link.held_back import HeldBack
from drivecomm.link.other_masters import STRAGGLING_S, Question
from drivecomm.link.reception import await_reply
from drivecomm.protocol import Ask, Pause, resumed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.link.call import Call
    from drivecomm.link.line_state import LineState
    from drivecomm.link.peer import Peer, PeerState
    from drivecomm.link.port import Arrival, Steps
    from drivecomm.protocol import Exchange, Message, Tell

T = TypeVar("T")

_OPEN = "; whether the drive acted on it is not known"


class Begun(NamedTuple):
    """What has come of a command so far.

    unasked: what came before its telegram could be sent. came: what has come since it was sent, piece by piece, nothing
    if it was not.
    """

    unasked: bytes = b""
    came: Sequence[Arrival] = ()


def carry_out(call: Call, exchange: Exchange[T]) -> Steps[T]:
    """Carry out an exchange and return its result; raises what it raises.

    One that is cut off leaves the line unclean, and whoever is next begins with draining it.
    """
    line = call.line
    if not line.is_set_for(call.peer):
        yield from line.settle(call.peer)
    if line.unclean:
        line.heard_at = line.now
        yield from line.drain(call.peer, call.partner)
    line.unclean = True
    return (yield from go_on(call, exchange))


def go_on(
    call: Call, exchange: Exchange[T], command: Ask | Tell | Pause | None = None, begun: Begun | None = None
) -> Steps[T]:
    """Carry out an exchange, or what is left of it from a command on that it has yielded already.

    begun: what has come of this command so far. Raises HeldBack where others may have the line before it is sent.
    """
    line = call.line
    reply: Message | None = None
    error: ReplyError | None = None
    while True:
        if command is None:
            try:
                command = exchange.send(reply) if error is None else exchange.throw(error)
            except StopIteration as finished:
                line.unclean = False
                result: T = finished.value
                return result
            except Exception:
                # The exchange ended by its own decision; what had to be drained was drained where it went wrong.
                line.unclean = False
                raise
        reply = error = None
        if call.may_be_held_back and isinstance(command, Ask) and (until := _held_back_until(call, command)) > line.now:
            line.unclean = False
            raise HeldBack(until, resumed(command, exchange))
        call.may_be_held_back = False
        try:
            if isinstance(command, Ask):
                reply = yield from _ask(call, command, begun)
            elif isinstance(command, Pause):
                yield from call.stay(line.now + command.seconds)
            else:
                yield from _tell(call, command, begun)
        except ReplyError as failed:
            error = failed
        except BaseException as failed:
            exchange.close()
            # What was cancelled was not sent, so nothing is under way.
            line.unclean = not isinstance(failed, CommandCancelledError)
            raise
        command = begun = None


def _tell(call: Call, tell: Tell, begun: Begun | None) -> Steps[None]:
    line, peer = call.line, call.peer
    if begun is None:
        call.check_command(acts=True)
    unasked, _ = begun or Begun()
    data = peer.telegram(tell.message)
    yield from line.send(peer, call.partner, data, tell.message, unasked)
    told(line, peer, tell, data)
    call.told = True


def told(line: LineState, peer: Peer, tell: Tell, data: bytes) -> None:
    """Take note that a telegram that nobody answers is out."""
    line.told = data
    line.free_at = line.sent_at + (peer.facts.broadcast_pause_s if tell.pause_s is None else tell.pause_s)


def _ask(call: Call, ask: Ask, begun: Begun | None) -> Steps[Message]:
    line, peer, partner = call.line, call.peer, call.partner
    timing = peer.facts.timing
    data = peer.telegram(ask.message)
    attempts = 1 if ask.prepared else ask.attempts or timing.attempts
    call.check_others()
    if must_outwait(partner, ask, data):
        yield from _outwait_late_reply(call, ask, data)
    attempt = failed_in_a_row = 0
    answers = Answers(call, ask, data)
    while True:
        attempt += 1
        if begun is None:
            next_at = partner.asked_at + timing.request_interval_s
            if line.now < next_at:
                yield from call.stay(next_at)
            call.check_deadline()
            call.check_overtaken()
            call.check_command(acts=ask.acts)
            if ask.command:
                call.check_age(ask)
            partner.asked_at = line.now
            partner.count["requests" if attempt == 1 and not answers.doubts else "retries"] += 1
        unasked, came = begun or Begun()
        begun = None
        try:
            if not came:
                yield from line.send(peer, partner, data, ask.message, unasked, mirrored=ask.mirrored)
            found = yield from await_reply(call, ask, data, came)
            if not answers.agree_on(found):
                attempt -= 1
                # A drive that answers is asked on.
                failed_in_a_row = 0
                continue
        except ReplyError as error:
            doubtful, overtaken = isinstance(error, DoubtfulReplyError), isinstance(error, OvertakenError)
            damaged = isinstance(error, DamagedReplyError)
            partner.count[
                "damaged" if damaged else "doubtful" if doubtful else "overtaken" if overtaken else "timeouts"
            ] += 1
            if not (doubtful or overtaken):
                line.request_failed(peer, partner)
            if line.heard_at > partner.asked_at:
                # Where nothing came at all there is nothing to let finish.
                if call.listen_until is not None:
                    line.probed = partner
                yield from line.drain(peer, partner)
            if doubtful:
                expect_reply(line, peer, partner, ask, data)
                if answers.may_ask_again():
                    attempt -= 1
                    continue
            else:
                expect_late_reply(line, peer, partner, ask, data)
            failed_in_a_row += 1
            others_wait = call.others_first()
            ended = failed_in_a_row >= attempts or line.now >= call.deadline or overtaken
            if ended or doubtful or others_wait:
                call.failed = type(error)(f"{error}{_times(attempt)}{_OPEN if ask.acts else ''}")
                call.failed.others_wait = others_wait
                raise call.failed from None
        except BaseException:
            expect_late_reply(line, peer, partner, ask, data)
            raise
        else:
            partner.count["replies"] += 1
            partner.health.answered()
            # The replies to the attempts before may still come, and would answer the same question as if it were asked
            # anew.
            partner.surplus = attempt > 1 or (partner.surplus and ask.distinct)
            if attempt > 1:
                for each in line.takers(peer, partner, ask):
                    each.late_until, each.unanswered = line.sent_at + timing.late_s, data
                    each.nameless = ask.nameless
            if ask.command:
                partner.commanded_at = line.sent_at
            return found.message


def _held_back_until(call: Call, ask: Ask) -> float:
    """Return when a question can be asked, its call's deadline at the latest; in the past where it is sent now."""
    partner = call.partner
    if ask.urgent or not partner.unanswered or not must_outwait(partner, ask, call.peer.telegram(ask.message)):
        return float("-inf")
    return min(partner.late_until, call.deadline)


def must_outwait(partner: PeerState, ask: Ask, data: bytes) -> bool:
    """Whether a late reply may still come that would be taken for that to this request."""
    if not partner.unanswered or (ask.distinct and partner.nameless):
        return False
    return partner.unanswered != data or partner.surplus


def expect_late_reply(line: LineState, peer: Peer, partner: PeerState, ask: Ask, data: bytes) -> None:
    """Keep in mind that the reply to a request may still come, and let it pass if it does not name its request."""
    expect_reply(line, peer, partner, ask, data)
    if ask.nameless:
        for each in line.takers(peer, partner, ask):
            each.late_until, each.unanswered = line.now + peer.facts.timing.late_s, data
            each.surplus, each.nameless = False, True


def expect_reply(line: LineState, peer: Peer, partner: PeerState, ask: Ask, data: bytes) -> None:
    """Keep in mind that the reply to a request may still come."""
    until = line.now + peer.facts.timing.late_s + STRAGGLING_S
    for each in line.takers(peer, partner, ask):
        each.owes(Question(data, ask.message, peer.mismatch, until))


def _outwait_late_reply(call: Call, ask: Ask, data: bytes) -> Steps[None]:
    """Do not ask for something else while a reply that does not name its request may still come."""
    line, partner = call.line, call.partner
    if ask.urgent and line.now < partner.late_until:
        yield from line.send(call.peer, partner, data, ask.message)
    yield from call.stay(partner.late_until)
    yield from line.drain(call.peer, partner)
    for each in line.takers(call.peer, partner, ask):
        if each.late_until <= line.now:
            each.unanswered, each.surplus = b"", False


def _times(attempts: int) -> str:
    return "" if attempts == 1 else f" (asked {attempts} times)"
